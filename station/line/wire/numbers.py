"""Numbers that a signal carries, or the word that there is none."""

from __future__ import annotations

import math

from alignment.errors import InputError
from station.line.wire.dbc import LineDatabase, Value
from station.line.wire.dbc_needs import INVALID


def fitting(database: LineDatabase, message: str, signal: str, value: float | None) -> Value:
    """A value for a signal; None is the word invalid.

    Raises
    ------
    InputError
        When it is out of the signal's range.
    """
    if value is None:
        return INVALID
    lowest, highest = database.range_of(message, signal)
    # The reserved raw value lies outside the range, so that no value can be taken for it.
    if not lowest <= value <= highest:
        raise InputError(
            file=database.file,
            field=f"{message}.{signal}",
            expected=f"{lowest:g} to {highest:g} {database.unit(message, signal)}",
            seen=str(value),
        )
    return value


def rounded_up(database: LineDatabase, message: str, signal: str, value: float | None) -> Value:
    """An uncertainty never looks smaller on the bus than it is, and never 0 unless it is 0; as `fitting`."""
    checked = fitting(database, message, signal, value)
    if isinstance(checked, str):
        return checked
    step = database.step(message, signal)
    return math.ceil(checked / step - 1e-9) * step


def bounded(database: LineDatabase, message: str, signal: str, value: float | None) -> Value:
    """A value, or the end of the signal's range that it lies beyond; None is the word invalid."""
    if value is None:
        return INVALID
    lowest, highest = database.range_of(message, signal)
    return min(max(value, lowest), highest)


def milliseconds(database: LineDatabase, message: str, signal: str, seconds: float | None) -> Value:
    """A time for a signal in milliseconds, at most the end of its range; None is the word invalid."""
    if seconds is None:
        return INVALID
    return min(round(1000.0 * seconds), int(database.range_of(message, signal)[1]))


def read_number(value: Value) -> float | None:
    """The number that was decoded; None for the word invalid."""
    return None if value == INVALID else float(value)
