"""The repair loop: vehicles that came back, as they were found first and as they were left."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import Any
from uuid import UUID

from sqlalchemy import Text, case, cast, func, or_, select
from sqlalchemy.sql import Subquery

from db.queries.filters import EVERYTHING, Filter, about_cycles
from db.queries.reader import ResultReader, question
from db.records import ConcessionRecord, CycleOutcome
from db.rows import read_concessions
from db.schema import cycles, vehicles

_JUDGED = (CycleOutcome.OK.value, CycleOutcome.NOK.value)


@dataclass(frozen=True)
class FirstPass:
    """Vehicles of a station and type by their first verdict."""

    station: str
    vehicle_type: str
    vehicles: int
    ok: int


@dataclass(frozen=True)
class Repaired:
    """A vehicle that was not ok at first, or was judged more than once.

    Attributes
    ----------
    station, vehicle_type, found_utc, found, found_cycle
        Of its first judged cycle: as found.
    attempts
        Judged cycles, the first one included.
    left_station, left_utc, left, left_cycle
        Of its last judged cycle: as left.
    good_utc
        Of the first good cycle; None where there was none.
    concession
        In force for the last cycle.
    """

    vin: str
    station: str
    vehicle_type: str
    found_utc: datetime
    found: CycleOutcome
    found_cycle: UUID
    attempts: int
    left_station: str
    left_utc: datetime
    left: CycleOutcome
    left_cycle: UUID
    good_utc: datetime | None
    concession: ConcessionRecord | None

    @property
    def repair_s(self) -> float | None:
        """Seconds from the first verdict, not ok, to the first that was; None where it was not repaired."""
        if self.found is CycleOutcome.OK or self.good_utc is None:
            return None
        return (self.good_utc - self.found_utc).total_seconds()


@dataclass(frozen=True)
class RepairLoop:
    """What happened to vehicles whose first judged cycle was chosen.

    Attributes
    ----------
    first
        All of them, by station and type.
    repaired
        The newest of those that came back or had to.
    """

    first: tuple[FirstPass, ...]
    repaired: tuple[Repaired, ...]


@question
def repair_loop(reader: ResultReader, where: Filter = EVERYTHING, newest: int = 20_000) -> RepairLoop:
    """First verdicts and what became of them.

    The filter chooses vehicles by their first judged cycle; later ones count whenever and wherever they were.
    Faults and aborts are no verdicts. At most `newest` vehicles are listed, the newest first.
    """
    judged = _by_vin()
    last, good = cycles.alias("last"), cycles.alias("good")
    conditions = about_cycles(where)
    outcome = cast(cycles.c.outcome, Text)
    chosen = judged.join(cycles, cycles.c.id == judged.c.first).join(
        vehicles, vehicles.c.id == cycles.c.vehicle_id
    )
    counts = (
        select(
            cycles.c.station,
            vehicles.c.vehicle_type,
            func.count(),
            func.sum(case((outcome == CycleOutcome.OK.value, 1), else_=0)),
        )
        .select_from(chosen)
        .where(*conditions)
        .group_by(cycles.c.station, vehicles.c.vehicle_type)
        .order_by(cycles.c.station, vehicles.c.vehicle_type)
    )
    listed = (
        select(
            judged.c.vin,
            judged.c.attempts,
            cycles.c.station,
            vehicles.c.vehicle_type,
            cycles.c.received_utc,
            cycles.c.outcome,
            cycles.c.uuid,
            last.c.station.label("left_station"),
            last.c.received_utc.label("left_utc"),
            last.c.outcome.label("left"),
            last.c.uuid.label("left_cycle"),
            good.c.received_utc.label("good_utc"),
        )
        .select_from(
            chosen.join(last, last.c.id == judged.c.last).outerjoin(good, good.c.id == judged.c.good)
        )
        .where(*conditions, or_(judged.c.attempts > 1, outcome == CycleOutcome.NOK.value))
        .order_by(judged.c.first.desc())
        .limit(newest)
    )
    with reader.transaction() as connection:
        passes = tuple(
            FirstPass(station, kind, number, int(ok))
            for station, kind, number, ok in connection.execute(counts)
        )
        rows = connection.execute(listed).mappings().all()
        left = [row["left_cycle"] for row in rows if row["left"] == CycleOutcome.NOK]
        granted = {
            stored.record.cycle: stored.record
            for stored in read_concessions(connection, left)
            if stored.in_force
        }
    return RepairLoop(passes, tuple(_repaired(row, granted.get(row["left_cycle"])) for row in rows))


def _by_vin() -> Subquery:
    """Of every VIN its first, last and first good judged cycle, and how many there are."""
    return (
        select(
            vehicles.c.vin,
            func.min(cycles.c.id).label("first"),
            func.max(cycles.c.id).label("last"),
            func.min(case((cast(cycles.c.outcome, Text) == CycleOutcome.OK.value, cycles.c.id))).label(
                "good"
            ),
            func.count().label("attempts"),
        )
        .join(cycles, cycles.c.vehicle_id == vehicles.c.id)
        .where(cast(cycles.c.outcome, Text).in_(_JUDGED))
        .group_by(vehicles.c.vin)
        .subquery("judged")
    )


def _repaired(row: Any, concession: ConcessionRecord | None) -> Repaired:
    return Repaired(
        vin=row["vin"],
        station=row["station"],
        vehicle_type=row["vehicle_type"],
        found_utc=row["received_utc"],
        found=CycleOutcome(row["outcome"]),
        found_cycle=row["uuid"],
        attempts=row["attempts"],
        left_station=row["left_station"],
        left_utc=row["left_utc"],
        left=CycleOutcome(row["left"]),
        left_cycle=row["left_cycle"],
        good_utc=row["good_utc"],
        concession=concession,
    )
