"""The vehicles that nothing has confirmed yet: measured since the last good master check of their wheels."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from typing import Any, overload
from uuid import UUID

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import (
    BigInteger,
    Column,
    ColumnElement,
    Connection,
    FromClause,
    Select,
    Text,
    and_,
    case,
    cast,
    func,
    or_,
    select,
    true,
)

from alignment.arrays import Index
from db.queries.columns import columns_of, objects, plain_time, plain_uuid, times
from db.queries.filters import EVERYTHING, Filter, about_cycles, at_stations, known_stations
from db.queries.reader import ResultReader, question
from db.records import MASTER_OUTCOMES, CheckKind, CheckOutcome, CycleOutcome
from db.rows import PORTION
from db.schema import (
    calibration_checks,
    calibrations,
    cycles,
    events,
    installations,
    rigs,
    stations,
    vehicles,
    wheel_results,
)

# A clock that was set back is looked through as far as this.
_SET_BACK = timedelta(hours=2)
_REACH = np.timedelta64(_SET_BACK)
# Share of the numbers between two cycles from which on all are read in one go.
_DENSE = 0.3
# Wheels are the bits of a number.
_MOST_WHEELS = 62
# Of each station, the wheels whose last good check was at the same time.
_Groups = dict[str, dict[datetime | None, list[str]]]


@dataclass(frozen=True)
class VehicleSince:
    """A vehicle measured since a check."""

    vin: str
    vehicle_type: str
    received_utc: datetime
    outcome: CycleOutcome
    cycle: UUID


@dataclass(frozen=True, eq=False)
class VehiclesSince(Sequence[VehicleSince]):
    """Vehicles in the order of storing, kept as columns, for there may be many; arrays (N,).

    Attributes
    ----------
    time
        When the trigger came, UTC, datetime64[us].
    vin, vehicle_type, outcome, cycle
        Text, dtype object; `cycle` is the text of a UUID.
    """

    time: NDArray[np.datetime64]
    vin: NDArray[np.object_]
    vehicle_type: NDArray[np.object_]
    outcome: NDArray[np.object_]
    cycle: NDArray[np.object_]

    def __len__(self) -> int:
        return len(self.vin)

    @overload
    def __getitem__(self, index: int) -> VehicleSince: ...

    @overload
    def __getitem__(self, index: slice) -> VehiclesSince: ...

    def __getitem__(self, index: int | slice) -> VehicleSince | VehiclesSince:
        if isinstance(index, slice):
            return self.chosen(index)
        received: datetime = self.time[index].item()
        return VehicleSince(
            self.vin[index],
            self.vehicle_type[index],
            received.replace(tzinfo=UTC),
            CycleOutcome(self.outcome[index]),
            UUID(self.cycle[index]),
        )

    def __iter__(self) -> Iterator[VehicleSince]:
        return map(self.__getitem__, range(len(self)))

    def chosen(self, rows: slice | NDArray[np.intp]) -> VehiclesSince:
        """Some of them."""
        return VehiclesSince(
            self.time[rows], self.vin[rows], self.vehicle_type[rows], self.outcome[rows], self.cycle[rows]
        )


@dataclass(frozen=True)
class SinceCheck:
    """What rests on the wheels of a station whose last good master check was at the same time.

    Attributes
    ----------
    last_good_utc
        Of the last check with a master wheel that was within tolerance; None when there was none.
    vehicles
        Measured since by one of these wheels; all of them without a good check.
    """

    station: str
    wheels: tuple[str, ...]
    last_good_utc: datetime | None
    vehicles: VehiclesSince


@question
def since_last_good_check(reader: ResultReader, where: Filter = EVERYTHING) -> tuple[SinceCheck, ...]:
    """For each station and wheel the last master check within tolerance, and the vehicles measured since.

    By station, the oldest check first. The filter chooses stations, plants, wheels and vehicle types; its
    period bounds the vehicles, not the checks. A vehicle that was stored after others of a later time counts
    as measured after them: then the clock was set back.
    """
    with reader.transaction() as connection:
        return checks_and_since(connection, where)


def checks_and_since(connection: Connection, where: Filter) -> tuple[SinceCheck, ...]:
    """As `since_last_good_check`, within a transaction."""
    good = _last_good_checks(connection)
    groups: _Groups = defaultdict(lambda: defaultdict(list))
    for station, wheel in _wheels(connection, where):
        groups[station][good.get((station, wheel))].append(wheel)
    found = []
    for part in _portions(groups):
        found += [*_since_checks(connection, where, part), *_never_checked(connection, where, part)]
    return tuple(sorted(found, key=_oldest_first))


def _oldest_first(found: SinceCheck) -> tuple[str, str]:
    return found.station, "" if found.last_good_utc is None else found.last_good_utc.isoformat()


def _last_good_checks(connection: Connection) -> dict[tuple[str, str], datetime]:
    """The time of the last good master check of each station and rig."""
    last = (
        select(calibration_checks.c.utc)
        .where(
            calibration_checks.c.calibration_id == calibrations.c.id,
            calibration_checks.c.kind == CheckKind.MASTER_WHEEL,
            calibration_checks.c.outcome == CheckOutcome.WITHIN,
        )
        .order_by(calibration_checks.c.utc.desc())
        .limit(1)
        .scalar_subquery()
    )
    of_each = select(calibrations.c.id, calibrations.c.rig, last.label("utc")).subquery("of_each")
    checked = connection.execute(select(of_each).where(of_each.c.utc.is_not(None))).all()
    used = stations_using(connection, [calibration_id for calibration_id, _, _ in checked])
    good: dict[tuple[str, str], datetime] = {}
    for calibration_id, rig, utc in checked:
        for station in used[calibration_id]:
            good[station, rig] = max(utc, good.get((station, rig), utc))
    return good


def stations_using(connection: Connection, calibration_ids: Sequence[str]) -> dict[str, set[str]]:
    """The stations that use or used each of these calibrations."""
    used: dict[str, set[str]] = defaultdict(set)
    query = (
        select(installations.c.calibration_id, stations.c.name)
        .join(rigs, installations.c.rig_id == rigs.c.id)
        .join(stations, rigs.c.station_id == stations.c.id)
        .distinct()
    )
    for start in range(0, len(calibration_ids), PORTION):
        of_these = installations.c.calibration_id.in_(calibration_ids[start : start + PORTION])
        for calibration_id, station in connection.execute(query.where(of_these)):
            used[calibration_id].add(station)
    for calibration_id in calibration_ids:
        if calibration_id not in used:
            # Stored before stations told what they use: whoever measured with it.
            first = (
                select(cycles.c.station)
                .join(wheel_results, wheel_results.c.cycle_id == cycles.c.id)
                .where(wheel_results.c.calibration_id == calibration_id)
                .limit(1)
            )
            used[calibration_id] = set(connection.execute(first).scalars())
    return used


def _wheels(connection: Connection, where: Filter) -> list[tuple[str, str]]:
    """Stations and their wheels: as they registered, or as the newest cycles of each show."""
    registered = select(stations.c.name, rigs.c.name).join(rigs, rigs.c.station_id == stations.c.id)
    found = {
        (row[0], row[1]) for row in connection.execute(registered.where(*at_stations(where, stations.c.name)))
    }
    told = set(
        connection.execute(select(stations.c.name).join(rigs, rigs.c.station_id == stations.c.id)).scalars()
    )
    for station in known_stations(connection):
        if station in told:
            continue
        newest = select(cycles.c.id).where(cycles.c.station == station, *at_stations(where, cycles.c.station))
        newest = newest.order_by(cycles.c.received_utc.desc()).limit(20)
        names = select(wheel_results.c.wheel).where(wheel_results.c.cycle_id.in_(newest)).distinct()
        found |= {(station, name) for name in connection.execute(names).scalars()}
    return sorted(pair for pair in found if not where.wheels or pair[1] in where.wheels)


def _portions(groups: _Groups) -> Iterator[_Groups]:
    """Stations together as long as their wheels have few enough names."""
    part: _Groups = {}
    for station, wheels_of in groups.items():
        if len(_names({**part, station: wheels_of})) > _MOST_WHEELS:
            yield part
            part = {}
        part[station] = wheels_of
    yield part


def _names(groups: _Groups) -> list[str]:
    return sorted({wheel for of in groups.values() for wheels in of.values() for wheel in wheels})


def _since_checks(connection: Connection, where: Filter, groups: _Groups) -> list[SinceCheck]:
    """Those of the wheels that were checked, out of one statement for all stations.

    A clock that was set back is told by the neighbours of a cycle, so those come too that the filter does not
    want, and are marked.
    """
    checked = {
        station: {last: wheels for last, wheels in wheels_of.items() if last is not None}
        for station, wheels_of in groups.items()
    }
    since = [
        and_(cycles.c.station == station, cycles.c.received_utc > min(wheels_of) - _SET_BACK)
        for station, wheels_of in checked.items()
        if wheels_of
    ]
    if not since:
        return []
    unrestricted = replace(where, stations=(), plants=(), wheels=(), verdict=None) == EVERYTHING
    wanted = None if unrestricted else and_(true(), *about_cycles(where))
    rows = _Rows(connection, _names(groups), _source(where), or_(*since), wanted)
    return [
        SinceCheck(station, tuple(wheels), last, rows.vehicles.chosen(rows.since(station, wheels, last)))
        for station, wheels_of in checked.items()
        for last, wheels in wheels_of.items()
    ]


def _never_checked(connection: Connection, where: Filter, groups: _Groups) -> list[SinceCheck]:
    """Those of the wheels that no good check is known of: everything that they measured."""
    never = {station: wheels_of[None] for station, wheels_of in groups.items() if None in wheels_of}
    if not never:
        return []
    chosen = and_(cycles.c.station.in_(never), *about_cycles(where))
    rows = _Rows(connection, _names(groups), _source(where), chosen, None)
    return [
        SinceCheck(station, tuple(wheels), None, rows.vehicles.chosen(rows.since(station, wheels, None)))
        for station, wheels in never.items()
    ]


def _source(where: Filter) -> FromClause:
    about_vehicles = where.vehicle_types or where.vin is not None
    return cycles.join(vehicles, cycles.c.vehicle_id == vehicles.c.id) if about_vehicles else cycles


def _cycles_of_masters(connection: Connection, of_stations: Sequence[str]) -> frozenset[UUID]:
    """The cycles of these stations that measured a master and no vehicle, as far as that was told."""
    told = select(events.c.cycle_uuid).where(events.c.cycle_uuid.is_not(None))
    # One by one each code is found by an index, however many events there are.
    queries = [
        told.where(events.c.station == station, events.c.code == code)
        for station in of_stations
        for code in MASTER_OUTCOMES
    ]
    return frozenset(uuid for query in queries for uuid in connection.execute(query).scalars())


class _Rows:
    """Cycles as columns: the rows of a station side by side, in the order of storing.

    Parameters
    ----------
    names
        Of all wheels that may be asked for.
    source
        `cycles`, joined with what the conditions are about.
    chosen
        Condition: which cycles.
    wanted
        Which of these are asked for, the others are only looked at; None for all but cycles of masters.
    """

    def __init__(
        self,
        connection: Connection,
        names: Sequence[str],
        source: FromClause,
        chosen: ColumnElement[bool],
        wanted: ColumnElement[bool] | None,
    ) -> None:
        self._connection = connection
        chosen &= cycles.c.vehicle_id.is_not(None)
        query = select(
            cycles.c.id,
            cycles.c.vehicle_id,
            plain_time(connection, cycles.c.received_utc),
            cast(cycles.c.outcome, Text),
            plain_uuid(cycles.c.uuid),
            cycles.c.station,
            *([] if wanted is None else [wanted]),
        )
        columns = columns_of(connection, query.select_from(source).where(chosen))
        self._stations = {name: number for number, name in enumerate(sorted(set(columns[5])))}
        station = np.array([self._stations[name] for name in columns[5]], dtype=np.int64)
        ids = np.array(columns[0], dtype=np.int64)
        # Sorting here costs less than in the database.
        order = np.lexsort((ids, station))
        self._begins = np.searchsorted(station[order], np.arange(len(self._stations) + 1))
        self._id = ids[order]
        self._wanted = np.ones(len(ids), bool) if wanted is None else np.array(columns[6], dtype=bool)[order]

        of_vehicles = select(vehicles.c.id, vehicles.c.vin, vehicles.c.vehicle_type)
        vehicle_ids = np.array(columns[1], dtype=np.int64)[order]
        at, (vin, vehicle_type) = self._beside(of_vehicles, vehicle_ids, cycles.c.vehicle_id, source, chosen)
        outcome, cycle = objects(columns[3])[order], objects(columns[4])[order]
        received = times(columns[2])[order]
        masters = _cycles_of_masters(connection, list(self._stations))
        if masters:
            self._wanted &= np.array([UUID(uuid) not in masters for uuid in cycle], dtype=bool)
        self.vehicles = VehiclesSince(received, objects(vin)[at], objects(vehicle_type)[at], outcome, cycle)

        self._bits = {name: 1 << number for number, name in enumerate(names)}
        bit = case(self._bits, value=wheel_results.c.wheel, else_=0)
        of_wheels = select(wheel_results.c.cycle_id, cast(func.sum(bit), BigInteger))
        of_wheels = of_wheels.group_by(wheel_results.c.cycle_id)
        at, (bits,) = self._beside(of_wheels, self._id, cycles.c.id, source, chosen)
        # The last one is of cycles without any wheel.
        self._measured = np.array([*bits, 0], dtype=np.int64)[at]

    def _beside(
        self,
        query: Select[Any],
        keys: Index,
        link: Column[int],
        source: FromClause,
        chosen: ColumnElement[bool],
    ) -> tuple[NDArray[np.intp], list[list[Any]]]:
        """What another table has of these cycles: for each key its row, -1 without one, and the columns.

        Nearly always the cycles lie side by side; then one pass from the first key to the last costs a
        fraction of looking up every one of them.
        """
        if not len(keys):
            return np.empty(0, dtype=np.intp), [[] for _ in query.selected_columns][1:]
        key = query.selected_columns[0]
        first, last = int(keys.min()), int(keys.max())
        query = query.where(key >= first, key <= last)
        if len(keys) < _DENSE * (last - first):
            query = query.where(key.in_(select(link).select_from(source).where(chosen)))
        found, *columns = columns_of(self._connection, query)
        there = np.array(found, dtype=np.int64)
        order = np.argsort(there)
        if not found:
            return np.full(len(keys), -1, dtype=np.intp), columns
        at = order[np.searchsorted(there, keys, sorter=order).clip(max=len(there) - 1)]
        return np.where(there[at] == keys, at, -1), columns

    def since(self, station: str, wheels: Sequence[str], last: datetime | None) -> slice | NDArray[np.intp]:
        """Which rows have a result of one of these wheels, measured after a time, and are wanted."""
        number = self._stations.get(station)
        if number is None:
            return slice(0)
        start = int(self._begins[number])
        rows = slice(start, self._begins[number + 1])
        bits = sum(self._bits[wheel] for wheel in wheels)
        found = self._wanted[rows] & ((self._measured[rows] & bits) != 0)
        if last is not None:
            at = np.datetime64(last.astimezone(UTC).replace(tzinfo=None), "us")
            time, ids = self.vehicles.time[rows], self._id[rows]
            later = time > at
            # Of the first ones after the check; what came behind these came after it, whatever its time says.
            soon = ids[later & (time < at + _REACH)]
            behind = ids > soon[0] if len(soon) else np.zeros(len(ids), dtype=bool)
            found &= later | (behind & (time > at - _REACH))
        chosen: NDArray[np.intp] = start + np.flatnonzero(found)
        side_by_side = len(chosen) > 0 and chosen[-1] - chosen[0] + 1 == len(chosen)
        return slice(chosen[0], chosen[-1] + 1) if side_by_side else chosen
