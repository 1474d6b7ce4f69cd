"""Which results a question is about: values that a person may type, checked before any database sees them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from datetime import UTC, datetime, time, timedelta
from typing import Any
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

from sqlalchemy import (
    Boolean,
    Column,
    ColumnElement,
    Connection,
    Select,
    and_,
    false,
    literal,
    or_,
    select,
    true,
)
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.sql.compiler import SQLCompiler
from sqlalchemy.sql.functions import FunctionElement

from alignment.errors import InputError
from db.records import Quantity, Verdict, check_text
from db.schema import cycles, plants, station_versions, stations, sums_state, vehicles

_LONGEST_SHIFT_PERIOD = timedelta(days=400)


@dataclass(frozen=True, order=True)
class Characteristic:
    """One value of one part: ``front_left.toe``, ``rear.total_toe``, ``vehicle.track_front``.

    Attributes
    ----------
    part
        A wheel for camber, toe and run-out, an axle for total toe and camber difference, else ``vehicle``.
    """

    part: str
    quantity: Quantity

    def __post_init__(self) -> None:
        check_text("characteristic", self.part)

    def __str__(self) -> str:
        return f"{self.part}.{self.quantity}"

    @classmethod
    def parse(cls, text: str) -> Characteristic:
        """Read ``part.quantity``.

        Raises
        ------
        InputError
            For an unknown quantity, or a text without a part.
        """
        part, _, quantity = text.rpartition(".")
        if not part or quantity not in set(Quantity):
            raise InputError(
                choice="characteristic",
                expected=f"PART.QUANTITY, the quantity one of {', '.join(Quantity)}",
                seen=ascii(text),
            )
        return cls(part, Quantity(quantity))


@dataclass(frozen=True)
class Shift:
    """A part of every day, by the plant's clock: ``Shift("late", time(14), time(22), "Europe/Berlin")``.

    One that ends before it begins ends on the next day. A day begins with the shift that begins in it.

    Raises
    ------
    InputError
        For times with a zone of their own, a shift without a length, or an unknown time zone.
    """

    name: str
    start: time
    end: time
    timezone: str = "UTC"

    def __post_init__(self) -> None:
        if self.start.tzinfo or self.end.tzinfo or self.start == self.end:
            raise InputError(
                choice="shift", expected="two different times of day", seen=f"{self.start} to {self.end}"
            )
        self._zone()

    def _zone(self) -> ZoneInfo:
        try:
            return ZoneInfo(self.timezone)
        except (ZoneInfoNotFoundError, ValueError, OSError) as error:
            raise InputError(
                choice="timezone", expected="a name such as Europe/Berlin", seen=ascii(self.timezone)
            ) from error

    def within(self, from_utc: datetime, until_utc: datetime) -> Iterator[tuple[datetime, datetime]]:
        """Its hours between two aware times, as pairs of UTC times, in order."""
        zone = self._zone()
        day = from_utc.astimezone(zone).date() - timedelta(days=1)
        while day <= until_utc.astimezone(zone).date():
            last = day if self.end > self.start else day + timedelta(days=1)
            start = datetime.combine(day, self.start, zone).astimezone(UTC)
            end = datetime.combine(last, self.end, zone).astimezone(UTC)
            start, end = max(start, from_utc), min(end, until_utc)
            if start < end:
                yield start, end
            day += timedelta(days=1)


Interval = tuple[datetime | None, datetime | None]


@dataclass(frozen=True)
class Filter:
    """Which results are asked for; what is left out restricts nothing.

    Attributes
    ----------
    from_utc, until_utc
        Period of the trigger (``received_utc``), aware times, the end excluded.
    stations, plants, vehicle_types, wheels
        Any of these names; a plant stands for its stations.
    verdict
        Of the result asked for: the wheel's, the axle's, the vehicle's angles; of cycles their outcome.
    vin
        A VIN, or a pattern in which ``*`` stands for anything.
    shift
        Only within this part of every day; needs both ends of the period, at most 400 days apart.

    Raises
    ------
    InputError
        For times without a zone, a period that ends before it begins, or text that no database stores.
    """

    from_utc: datetime | None = None
    until_utc: datetime | None = None
    stations: tuple[str, ...] = ()
    plants: tuple[str, ...] = ()
    vehicle_types: tuple[str, ...] = ()
    wheels: tuple[str, ...] = ()
    verdict: Verdict | None = None
    vin: str | None = None
    shift: Shift | None = None

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, datetime) and value.utcoffset() is None:
                raise InputError(field=item.name, expected="a time with its time zone", seen=str(value))
            texts = value if isinstance(value, tuple) else (value,) if isinstance(value, str) else ()
            for text in texts:
                check_text(item.name, text)
        if self.from_utc and self.until_utc and self.from_utc >= self.until_utc:
            raise InputError(
                choice="until", expected=f"a time after {self.from_utc}", seen=str(self.until_utc)
            )
        if self.shift is not None:
            if self.from_utc is None or self.until_utc is None:
                raise InputError(choice="shift", expected="a period with beginning and end", seen="none")
            if self.until_utc - self.from_utc > _LONGEST_SHIFT_PERIOD:
                raise InputError(
                    choice="shift",
                    expected="a period of at most 400 days",
                    seen=str(self.until_utc - self.from_utc),
                )

    def intervals(self) -> tuple[Interval, ...]:
        """The periods meant, in order and apart; None where an end is open."""
        if self.shift is None or self.from_utc is None or self.until_utc is None:
            return ((self.from_utc, self.until_utc),)
        return tuple(self.shift.within(self.from_utc, self.until_utc))

    @property
    def needs_raw_results(self) -> bool:
        """Whether the sums that are kept per hour cannot answer."""
        return self.vin is not None or self.verdict is not None


EVERYTHING = Filter()


def about_cycles(where: Filter) -> list[ColumnElement[bool]]:
    """Conditions on `cycles` and `vehicles`: everything of a filter but wheels and verdict.

    Every text reaches the database as a bound value, never as a part of a statement.
    """
    conditions = [within(where.intervals())]
    conditions += at_stations(where, cycles.c.station)
    if where.vehicle_types:
        conditions.append(vehicles.c.vehicle_type.in_(where.vehicle_types))
    if where.vin is not None:
        conditions.append(matches(vehicles.c.vin, where.vin))
    return conditions


def within(
    intervals: Sequence[Interval], time: ColumnElement[datetime] = cycles.c.received_utc
) -> ColumnElement[bool]:
    """Condition: a time, that of the trigger unless told otherwise, lies in one of these periods."""
    periods = [
        and_(
            true(),
            *([time >= start] if start is not None else []),
            *([time < end] if end is not None else []),
        )
        for start, end in intervals
    ]
    return or_(*periods) if periods else false()


def at_stations(where: Filter, name: Column[str]) -> list[ColumnElement[bool]]:
    """Conditions on a column that holds a station's name."""
    conditions: list[ColumnElement[bool]] = []
    if where.stations:
        conditions.append(name.in_(where.stations))
    if where.plants:
        conditions.append(name.in_(stations_of(where.plants)))
    return conditions


def matches(column: Column[str], pattern: str) -> ColumnElement[bool]:
    """Condition: equal to a text, in which ``*`` stands for anything."""
    if "*" not in pattern:
        return column == pattern
    glob = pattern.replace("[", "[[]").replace("?", "[?]")
    like = pattern.replace("\\", r"\\").replace("%", r"\%").replace("_", r"\_").replace("*", "%")
    return looks_like(column, literal(glob), literal(like))


class looks_like(FunctionElement[bool]):  # noqa: N801  (named as SQL functions are)
    """A column against one pattern, said for GLOB and for LIKE, which on SQLite takes small letters too."""

    type = Boolean()
    inherit_cache = True


@compiles(looks_like, "sqlite")
def _sqlite_pattern(element: Any, compiler: SQLCompiler, **options: Any) -> str:
    column, glob, _ = (compiler.process(part, **options) for part in element.clauses)
    return f"({column} GLOB {glob})"


@compiles(looks_like)
def _postgresql_pattern(element: Any, compiler: SQLCompiler, **options: Any) -> str:
    column, _, like = (compiler.process(part, **options) for part in element.clauses)
    return f"({column} LIKE {like} ESCAPE '\\')"


def stations_of(names: tuple[str, ...]) -> Select[tuple[str]]:
    """Names of the stations that stand, or ever stood, in one of these plants."""
    return (
        select(stations.c.name)
        .join(station_versions, station_versions.c.station_id == stations.c.id)
        .join(plants, station_versions.c.plant_id == plants.c.id)
        .where(plants.c.name.in_(names))
        .distinct()
    )


def known_stations(connection: Connection) -> list[str]:
    """Every station that registered, is in the sums, or has results that are not in the sums yet."""
    last = select(sums_state.c.last_cycle_id).scalar_subquery()
    fresh = select(cycles.c.station).where(cycles.c.id > last)
    return sorted(connection.execute(select(stations.c.name).union(fresh)).scalars())
