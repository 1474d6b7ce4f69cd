"""Concessions: a vehicle that is not ok is released, with the name of who answers for it, and why."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from typing import Any
from uuid import UUID

from alignment.errors import InputError
from db.exports import angle_rows
from db.queries import ResultReader, vin_history
from db.records import (
    AngleVerdict,
    ConcessionRecord,
    ConcessionWithdrawal,
    StoredConcession,
    StoredCycle,
    person_named,
    reason_given,
)
from db.store import ResultStore


def grant(
    database: str, vin: str, person: str, reason: str, now: datetime, cycle: UUID | None = None
) -> ConcessionRecord:
    """Release the vehicle of a VIN by its newest cycle, which must be the one that is meant.

    Parameters
    ----------
    database
        URL.
    person
        Who answers for it.
    reason
        Why.
    now
        Aware.
    cycle
        The cycle that was looked at; None for the newest one.

    Raises
    ------
    InputError
        When nothing is stored of the VIN, or nobody answers for it, or the reason is none; and when the
        vehicle cannot be released: see `ResultStore.grant_concession`.
    """
    person, reason = person_named(person), reason_given(reason)
    with ResultReader(database) as reader:
        history = vin_history(reader, vin)
        found = [each for each in history.cycles if cycle is None or each.record.uuid == cycle]
        if not found:
            seen = f"no cycle of {vin!r}" if cycle is None else f"no cycle {cycle} of {vin!r}"
            raise InputError(
                choice="vin" if cycle is None else "cycle", expected=f"a VIN in {reader.where}", seen=seen
            )
    stored = found[-1]
    record = ConcessionRecord(stored.record.uuid, now, person, reason, exceeded(stored))
    with ResultStore(database) as store:
        store.grant_concession(record)
    return record


def withdraw(
    database: str, concession: UUID, person: str, reason: str, now: datetime
) -> ConcessionWithdrawal:
    """Take a concession back; both stay stored. Errors as of `grant`."""
    record = ConcessionWithdrawal(concession, now, person_named(person), reason_given(reason))
    with ResultStore(database) as store:
        store.withdraw_concession(record)
    return record


def exceeded(stored: StoredCycle) -> dict[str, dict[str, Any]]:
    """Return what is out of its limits in a cycle, by characteristic, as `ConcessionRecord` holds it."""
    return {
        row.characteristic: {
            "value": row.value, "u95": row.u95, "low": row.low, "high": row.high, "unit": row.unit,
        }
        for row in angle_rows(stored)
        if row.verdict == AngleVerdict.NOK
    }  # fmt: skip


def exceeded_in_words(documents: Mapping[str, Any]) -> str:
    """Return what is out of its limits on one line: ``front left toe +0.4000° (−0.1000° to +0.1000°)``."""
    return "; ".join(_in_words(name, document) for name, document in documents.items())


def _in_words(name: str, document: Mapping[str, Any]) -> str:
    unit, digits = ("°", 4) if document.get("unit") == "deg" else (" mm", 2)

    def number(key: str) -> str:
        value = document.get(key)
        return "none" if value is None else f"{value:+.{digits}f}{unit}".replace("-", "−")

    plain = name.replace(".", " ").replace("_", " ")
    return f"{plain} {number('value')} ({number('low')} to {number('high')})"


def in_one_line(stored: StoredConcession) -> str:
    """Return a concession for people."""
    record = stored.record
    text = f"{record.uuid}  {record.utc:%Y-%m-%d %H:%M} UTC  {record.person}: {record.reason}"
    ended = stored.withdrawal
    if ended is not None:
        text += f"  [withdrawn {ended.utc:%Y-%m-%d} by {ended.person}: {ended.reason}]"
    return f"{text}  {exceeded_in_words(record.exceeded)}"
