"""Doubt after a failed master check: noted for every vehicle since the last good one, and ended.

What there is to note or to end follows from what is stored, so it is done again after a loss of power, and
doing it twice does nothing. A good check ends a doubt only where the rig measures as it did when it measured
the vehicle: with the same calibration and the same zero measurement. Then nothing has drifted. After a
calibration a good check says nothing of the vehicles before it; only a person can answer for them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from uuid import UUID

from sqlalchemy import Connection, select

from alignment.errors import InputError
from db.queries import (
    Filter,
    RigSince,
    StoredCheck,
    checks_and_since,
    newest_checks,
    newest_news,
    open_doubts_before,
    rigs_since,
    vehicles_in_doubt,
)
from db.records import (
    MASTER_RELEASED,
    CheckOutcome,
    ClosedBy,
    DoubtClosing,
    DoubtRecord,
    EventRecord,
    Severity,
    StoredDoubt,
    person_named,
    reason_given,
)
from db.rows import DOUBTS, OPEN_DOUBT, read_doubts
from db.schema import cycles, doubts, vehicles, wheel_results
from db.store import ResultStore

MOST_AT_ONCE = 5000
"""Records of one transaction: it is to end within the bound of a commit."""


@dataclass(frozen=True)
class Settled:
    """What one call has noted and ended.

    Attributes
    ----------
    doubted
        VINs of the vehicles that came into doubt, in the order of measuring, each once.
    confirmed
        How many doubts a good check has ended.
    more
        Whether another call finds more.
    """

    doubted: tuple[str, ...] = ()
    confirmed: int = 0
    more: bool = False


class MasterBook:
    """What a station knows of its master checks, and what it must note after one.

    Parameters
    ----------
    store
        Open.
    station
        Whose rigs.
    in_force
        Id of the calibration of each wheel's rig.
    """

    def __init__(self, store: ResultStore, station: str, in_force: Mapping[str, str]) -> None:
        self._store, self._station, self.in_force = store, station, dict(in_force)

    def since(self) -> dict[str, RigSince]:
        """Where each rig stands since its last good check."""
        with self._store.reading() as connection:
            return rigs_since(connection, self._station, self.in_force)

    def news(self) -> tuple[int, int, int]:
        """Numbers that change when somebody else checked or released; last, the vehicles in doubt."""
        with self._store.reading() as connection:
            return *newest_news(connection, self._station), vehicles_in_doubt(connection, self._station)

    def settle(self, utc: datetime) -> Settled:
        """Note and end doubts as far as one transaction each goes; call it again while there is more."""
        vins: dict[str, None] = {}

        def doubting(connection: Connection) -> Sequence[DoubtRecord]:
            found: list[DoubtRecord] = []
            for wheel, used in self.in_force.items():
                found += _new_doubts(connection, self._station, wheel, used, utc, vins, len(found))
            return found

        def ending(connection: Connection) -> Sequence[DoubtClosing]:
            found: list[DoubtClosing] = []
            for wheel, used in self.in_force.items():
                found += _confirmed(connection, self._station, wheel, used, utc)
            return found[:MOST_AT_ONCE]

        doubted, ended = self._store.record_found(doubting), self._store.record_found(ending)
        return Settled(tuple(vins), len(ended), MOST_AT_ONCE in (len(doubted), len(ended)))


def _new_doubts(
    connection: Connection, station: str, wheel: str, in_force: str, utc: datetime,
    vins: dict[str, None], before: int,
) -> list[DoubtRecord]:  # fmt: skip
    _, newest = newest_checks(connection, station, wheel, {in_force})
    if newest is None or newest.record.outcome != CheckOutcome.OUT or before >= MOST_AT_ONCE:
        return []
    known = select(doubts.c.cycle).where(doubts.c.station == station, doubts.c.wheel == wheel)
    doubted = set(connection.execute(known).scalars())
    found: list[DoubtRecord] = []
    for group in checks_and_since(connection, Filter(stations=(station,), wheels=(wheel,))):
        for text, vin in zip(group.vehicles.cycle, group.vehicles.vin, strict=True):
            cycle = UUID(text)
            if cycle in doubted:
                continue
            if before + len(found) == MOST_AT_ONCE:
                return found
            vins[vin] = None
            check = newest.record
            found.append(DoubtRecord.of(station, cycle, wheel, check.uuid, utc, check.reason))
    return found


def _confirmed(
    connection: Connection, station: str, wheel: str, in_force: str, utc: datetime
) -> list[DoubtClosing]:
    """Ends of the doubts that the newest check of a rig, when it was good, has shown to be unfounded."""
    good, newest = newest_checks(connection, station, wheel, {in_force})
    if good is None or newest is None or newest.number != good.number:
        return []
    found = open_doubts_before(connection, station, wheel, good.number)
    if not found:
        return []
    zero = _zero_of(connection, good, wheel)
    measured = {doubt.record.cycle: doubt for doubt in found}
    query = (
        select(cycles.c.uuid, wheel_results.c.calibration_id, wheel_results.c.zero_measurement_id)
        .join(wheel_results, wheel_results.c.cycle_id == cycles.c.id)
        .join(doubts, doubts.c.cycle == cycles.c.uuid)
        .where(doubts.c.station == station, doubts.c.wheel == wheel, wheel_results.c.wheel == wheel)
    )
    ends = []
    for cycle, calibration, zero_id in connection.execute(query):
        unmeasured = calibration is None
        same = unmeasured or (calibration == good.record.calibration_id and zero_id == zero)
        if cycle in measured and same:
            ends.append(
                DoubtClosing(
                    station, measured[cycle].record.uuid, utc, ClosedBy.GOOD_CHECK,
                    good.record.reason, check_uuid=good.record.uuid,
                )
            )  # fmt: skip
    return ends


def _zero_of(connection: Connection, check: StoredCheck, wheel: str) -> str | None:
    """The zero measurement that corrected the wheel of a check; None where there was none."""
    query = (
        select(wheel_results.c.zero_measurement_id)
        .join(cycles, wheel_results.c.cycle_id == cycles.c.id)
        .where(cycles.c.uuid == check.cycle, wheel_results.c.wheel == wheel)
    )
    found: str | None = connection.execute(query).scalar_one_or_none()
    return found


def release_doubts(
    store: ResultStore,
    station: str,
    person: str,
    reason: str,
    utc: datetime,
    vins: Sequence[str] = (),
) -> tuple[str, ...]:
    """End the doubts about vehicles of a station, which a person answers for with a reason; all or none.

    When nothing is in doubt afterwards, the station learns that what a failed check left is answered for; a
    good check is owed all the same.

    Parameters
    ----------
    vins
        Only of these vehicles.

    Returns
    -------
    The VINs, each once, in the order of measuring.

    Raises
    ------
    InputError
        For a name or a reason that is none, a station without vehicles in doubt, or a VIN that is not.
    """
    person, reason = person_named(person), reason_given(reason)
    released: dict[str, None] = {}

    def ending(connection: Connection) -> Sequence[DoubtClosing]:
        query = (
            DOUBTS.add_columns(vehicles.c.vin)
            .join(cycles, cycles.c.uuid == doubts.c.cycle)
            .join(vehicles, vehicles.c.id == cycles.c.vehicle_id)
            .where(doubts.c.station == station, OPEN_DOUBT)
            .order_by(cycles.c.id, doubts.c.wheel)
        )
        names = connection.execute(query.with_only_columns(vehicles.c.vin)).scalars().all()
        open_ones = list(zip(names, read_doubts(connection, query), strict=True))
        if not open_ones:
            raise InputError(
                choice="station", expected="a station with vehicles in doubt", seen=ascii(station)
            )
        if unknown := [vin for vin in vins if vin not in set(names)]:
            raise InputError(
                choice="vin", expected=f"a vehicle of {station} in doubt", seen=", ".join(map(ascii, unknown))
            )
        chosen = [(vin, doubt) for vin, doubt in open_ones if not vins or vin in vins]
        released.update(dict.fromkeys(vin for vin, _ in chosen))
        return [_released(doubt, person, reason, utc) for _, doubt in chosen]

    whole = f"{person} released every vehicle in doubt: {reason}"
    event = EventRecord(utc, station, Severity.WARNING, "db.upkeep", MASTER_RELEASED, whole)
    if vins:
        store.record_found(ending)
        with store.reading() as connection:
            left = vehicles_in_doubt(connection, station)
        if left == 0:
            store.record_event(event)
    else:
        store.record_found(ending, event)
    return tuple(released)


def _released(doubt: StoredDoubt, person: str, reason: str, utc: datetime) -> DoubtClosing:
    return DoubtClosing(doubt.record.station, doubt.record.uuid, utc, ClosedBy.RELEASE, reason, person=person)
