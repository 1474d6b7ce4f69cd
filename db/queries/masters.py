"""Where the rigs of a station stand with their master checks, and the doubts that failed ones left."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from uuid import UUID

from sqlalchemy import Connection, func, select

from db.queries.filters import EVERYTHING, Filter, about_cycles
from db.queries.reader import ResultReader, question
from db.queries.since_check import checks_and_since, stations_using
from db.records import (
    MASTER_AFTER_CAMERA,
    MASTER_AFTER_FAULT,
    MASTER_GOOD,
    MASTER_OUT,
    MASTER_RELEASED,
    CalibrationCheckRecord,
    CheckKind,
    CheckOutcome,
    StoredDoubt,
    master_source,
)
from db.rows import DOUBTS, OPEN_DOUBT, doubts_of_cycles, read_doubts, record_of
from db.schema import calibration_checks, calibrations, cycles, doubt_closings, doubts, events, vehicles

_OF_MASTERS = calibration_checks.c.kind == CheckKind.MASTER_WHEEL


@dataclass(frozen=True)
class StoredCheck:
    """A check with a master, with its place in the order of storing."""

    number: int
    record: CalibrationCheckRecord

    @property
    def cycle(self) -> UUID | None:
        """The cycle that it is of; None of one that was made by hand."""
        text = (self.record.as_found or {}).get("cycle")
        try:
            return None if text is None else UUID(str(text))
        except ValueError:
            return None


@dataclass(frozen=True)
class RigSince:
    """A rig since its last good check.

    Attributes
    ----------
    good
        That check; None when there was none.
    out
        The newest check, when it was out.
    vehicles
        Measured since the good one; 0 without one.
    after
        Codes of the events since that ask for a check.
    released
        Whether a person released all vehicles after the check that was out.
    """

    wheel: str
    good: StoredCheck | None
    out: StoredCheck | None
    vehicles: int
    after: tuple[str, ...]
    released: bool


@dataclass(frozen=True)
class DoubtedVehicle:
    """A doubt with the vehicle that it is about."""

    doubt: StoredDoubt
    vin: str
    vehicle_type: str
    received_utc: datetime
    outcome: str


def rigs_since(connection: Connection, station: str, in_force: Mapping[str, str]) -> dict[str, RigSince]:
    """Where each rig of a station stands; `in_force` is the id of the calibration of each wheel."""
    return {wheel: _since(connection, station, wheel, used) for wheel, used in in_force.items()}


def _since(connection: Connection, station: str, wheel: str, in_force: str) -> RigSince:
    good, newest = newest_checks(connection, station, wheel, {in_force})
    out = newest if newest is not None and newest.record.outcome == CheckOutcome.OUT else None
    vehicles = 0
    if good is not None:
        where = Filter(stations=(station,), wheels=(wheel,))
        vehicles = sum(len(group.vehicles) for group in checks_and_since(connection, where))
    mark = _newest_event(connection, station, MASTER_GOOD, master_source(wheel))
    of_all = (events.c.station == station) & (events.c.id > mark)
    asked = select(events.c.code).where(
        of_all,
        (events.c.code == MASTER_AFTER_FAULT)
        | ((events.c.code == MASTER_AFTER_CAMERA) & (events.c.source == master_source(wheel))),
    )
    if good is not None and good.cycle is None:
        # Made by hand, it has no event: only its time tells what came after it.
        asked = asked.where(events.c.utc > good.record.utc)
    released = False
    if out is not None:
        after = _newest_event(connection, station, MASTER_OUT, master_source(wheel))
        query = select(func.count()).where(
            events.c.station == station, events.c.code == MASTER_RELEASED, events.c.id > after,
            *([] if out.cycle is not None else [events.c.utc > out.record.utc]),
        )  # fmt: skip
        released = connection.execute(query).scalar_one() > 0
    codes = tuple(sorted(set(connection.execute(asked).scalars())))
    return RigSince(wheel, good, out, vehicles, codes, released)


def _newest_event(connection: Connection, station: str, code: str, source: str) -> int:
    query = select(func.max(events.c.id)).where(
        events.c.station == station, events.c.code == code, events.c.source == source
    )
    return connection.execute(query).scalar_one() or 0


def newest_checks(
    connection: Connection, station: str, wheel: str, in_force: Collection[str] = ()
) -> tuple[StoredCheck | None, StoredCheck | None]:
    """The last good check with a master of a rig, and the last one of any outcome, in the order of storing.

    `in_force` names calibrations that are the station's although it has not told so yet.
    """
    checked = select(calibrations.c.id).where(
        calibrations.c.rig == wheel,
        select(calibration_checks.c.id)
        .where(calibration_checks.c.calibration_id == calibrations.c.id, _OF_MASTERS)
        .exists(),
    )
    known = list(connection.execute(checked).scalars())
    used = stations_using(connection, known)
    own = [each for each in known if station in used[each] or each in in_force]
    newest = (
        select(calibration_checks)
        .where(calibration_checks.c.calibration_id.in_(own), _OF_MASTERS)
        .order_by(calibration_checks.c.id.desc())
        .limit(1)
    )
    good, last = (
        connection.execute(query).mappings().one_or_none()
        for query in (newest.where(calibration_checks.c.outcome == CheckOutcome.WITHIN), newest)
    )
    return (
        None if good is None else StoredCheck(good["id"], record_of(CalibrationCheckRecord, good)),
        None if last is None else StoredCheck(last["id"], record_of(CalibrationCheckRecord, last)),
    )


def vehicles_in_doubt(connection: Connection, station: str) -> int:
    """How many vehicles of a station are in doubt that nothing has ended, each counted once."""
    query = (
        select(func.count(cycles.c.vehicle_id.distinct()))
        .select_from(doubts)
        .join(cycles, cycles.c.uuid == doubts.c.cycle)
        .outerjoin(doubt_closings, doubt_closings.c.doubt == doubts.c.uuid)
        .where(doubts.c.station == station, OPEN_DOUBT)
    )
    return int(connection.execute(query).scalar_one())


def newest_news(connection: Connection, station: str) -> tuple[int, int]:
    """Numbers of the newest check with a master and of the last release: they tell that there is news."""
    check = select(func.max(calibration_checks.c.id)).where(_OF_MASTERS)
    release = select(func.max(events.c.id)).where(
        events.c.station == station, events.c.code == MASTER_RELEASED
    )
    return connection.execute(check).scalar_one() or 0, connection.execute(release).scalar_one() or 0


@question
def doubted_vehicles(reader: ResultReader, where: Filter = EVERYTHING) -> tuple[DoubtedVehicle, ...]:
    """Every doubt on record with its vehicle, in the order of measuring, closed ones too.

    The filter chooses stations, plants, wheels, vehicle types, VINs and the period of measuring.
    """
    of_wheels = [doubts.c.wheel.in_(where.wheels)] if where.wheels else []
    query = (
        DOUBTS.add_columns(vehicles.c.vin, vehicles.c.vehicle_type, cycles.c.received_utc, cycles.c.outcome)
        .join(cycles, cycles.c.uuid == doubts.c.cycle)
        .join(vehicles, vehicles.c.id == cycles.c.vehicle_id)
        .where(*about_cycles(where), *of_wheels)
        .order_by(cycles.c.received_utc, cycles.c.id, doubts.c.wheel)
    )
    with reader.transaction() as connection:
        rows = connection.execute(query).mappings().all()
        found = read_doubts(connection, query)
    return tuple(
        DoubtedVehicle(doubt, row["vin"], row["vehicle_type"], row["received_utc"], str(row["outcome"]))
        for doubt, row in zip(found, rows, strict=True)
    )


@question
def doubts_about(reader: ResultReader, uuids: Iterable[UUID]) -> dict[UUID, tuple[StoredDoubt, ...]]:
    """The doubts about each of these cycles, by wheel; a cycle without any is left out."""
    with reader.transaction() as connection:
        return doubts_of_cycles(connection, uuids)


def open_doubts_before(
    connection: Connection, station: str, wheel: str, check_number: int
) -> Sequence[StoredDoubt]:
    """The doubts about a rig that nothing has ended, left by checks before one."""
    earlier = select(calibration_checks.c.uuid).where(calibration_checks.c.id < check_number)
    query = DOUBTS.where(
        doubts.c.station == station, doubts.c.wheel == wheel, OPEN_DOUBT, doubts.c.check_uuid.in_(earlier)
    )
    return read_doubts(connection, query)
