"""Which results a person means."""

from __future__ import annotations

from datetime import UTC, datetime, time
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

import numpy as np

from alignment.errors import ConfigurationError, InputError
from db.queries import Filter, ResultReader, Shift, value_series
from db.records import Verdict
from station.quality.periods import read_time
from station.quality.reports import wheel_angles

_LONGEST_DEFAULT = "30d"


def read_filter(
    from_text: str | None,
    until_text: str | None,
    shift: str | None,
    timezone: str,
    stations: list[str] | None,
    plants: list[str] | None,
    vehicle_types: list[str] | None,
    wheels: list[str] | None,
    verdict: str | None,
    vin: str | None,
) -> Filter:
    """The filter of the options; a shift without a period means the last thirty days.

    Raises
    ------
    InputError
        For a time, shift, zone or verdict that is none.
    """
    now = datetime.now(UTC)
    if verdict is not None and verdict not in set(Verdict):
        raise ConfigurationError(
            choice="verdict", expected=f"one of {', '.join(Verdict)}", seen=ascii(verdict[:60])
        )
    start, end = read_time("from", from_text, now), read_time("until", until_text, now)
    if shift is not None:
        start = start or read_time("from", _LONGEST_DEFAULT, end or now)
        end = end or now
    return Filter(
        from_utc=start,
        until_utc=end,
        stations=tuple(stations or ()),
        plants=tuple(plants or ()),
        vehicle_types=tuple(vehicle_types or ()),
        wheels=tuple(wheels or ()),
        verdict=None if verdict is None else Verdict(verdict),
        vin=vin,
        shift=None if shift is None else read_shift(shift, timezone),
    )


def newest_vin(reader: ResultReader) -> str:
    """The vehicle that was measured last, of those with a measured wheel.

    Raises
    ------
    InputError
        When there is none.
    """
    found: list[tuple[np.datetime64, str]] = []
    for characteristic in wheel_angles(reader, Filter()):
        series = value_series(reader, characteristic, newest=1)
        found += [(time, str(vin)) for time, vin in zip(series.time, series.vin, strict=True) if vin]
    if not found:
        raise InputError(choice="vin", expected=f"a measured vehicle in {reader.where}", seen="none")
    return max(found)[1]


def read_shift(text: str, timezone: str) -> Shift:
    """A part of the day, ``06:00-14:00``, by the clock of a zone.

    Raises
    ------
    InputError
        For anything else.
    """
    try:
        start, end = (time.fromisoformat(part.strip()) for part in text.split("-"))
    except ValueError:
        raise ConfigurationError(
            choice="shift", expected="two times of day such as 06:00-14:00", seen=ascii(text[:60])
        ) from None
    return Shift(text, start, end, timezone)


def read_zone(timezone: str) -> ZoneInfo:
    """A time zone by its name.

    Raises
    ------
    ConfigurationError
        When there is none of that name.
    """
    try:
        return ZoneInfo(timezone)
    except (ZoneInfoNotFoundError, ValueError, OSError):
        raise ConfigurationError(
            choice="timezone", expected="a name such as Europe/Berlin", seen=ascii(timezone[:60])
        ) from None
