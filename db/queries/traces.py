"""What explains results: all of one vehicle, events, checks, and the vehicles since the last good check."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from uuid import UUID

from sqlalchemy import ColumnElement, Connection, false, func, or_, select

from db.quality_records import ArchivedShotRecord, ArchiveRemoval, StationRecord, StoredShot
from db.queries.filters import (
    EVERYTHING,
    Filter,
    about_cycles,
    at_stations,
    known_stations,
    stations_of,
    within,
)
from db.queries.reader import ResultReader
from db.records import (
    CalibrationCheckRecord,
    CalibrationRecord,
    CheckKind,
    CheckOutcome,
    CycleOutcome,
    EventRecord,
    StoredCycle,
    StoredZero,
    check_text,
)
from db.rows import (
    CYCLES,
    REMOVALS,
    SHOTS,
    STATIONS,
    ZEROS,
    read_cycles,
    read_stations,
    read_zeros,
    record_of,
)
from db.schema import (
    archived_shots,
    calibration_checks,
    calibrations,
    cycles,
    installations,
    rigs,
    station_versions,
    stations,
    vehicles,
    wheel_results,
    zero_measurements,
)
from db.schema import events as event_rows

# Events this long before a trigger and after the last image may explain a cycle.
_AROUND = timedelta(minutes=15)
# A clock that was set back is looked through as far as this.
_SET_BACK = timedelta(hours=2)


@dataclass(frozen=True)
class VinHistory:
    """Everything that is stored of a vehicle, and what explains it.

    Attributes
    ----------
    cycles
        In the order of storing.
    calibrations, checks, zeros
        Those that the results rest on, by id; checks in the order of their times.
    stations
        The stations as configured when they measured, for each configuration hash.
    events
        Of these stations, up to a quarter of an hour before a trigger and after the last image.
    shots
        Archived images, and whether they are still kept.
    """

    vin: str
    cycles: tuple[StoredCycle, ...]
    calibrations: Mapping[str, CalibrationRecord]
    checks: tuple[CalibrationCheckRecord, ...]
    zeros: Mapping[str, StoredZero]
    stations: tuple[StationRecord, ...]
    events: tuple[EventRecord, ...]
    shots: tuple[StoredShot, ...]


@dataclass(frozen=True)
class CheckOfStation:
    """A check of a calibration, with the rig and the station that used it; None where none did yet."""

    station: str | None
    rig: str
    check: CalibrationCheckRecord


@dataclass(frozen=True)
class VehicleSince:
    """A vehicle measured since a check."""

    vin: str
    vehicle_type: str
    received_utc: datetime
    outcome: CycleOutcome
    cycle: UUID


@dataclass(frozen=True)
class SinceCheck:
    """What rests on the wheels of a station whose last good master check was at the same time.

    Attributes
    ----------
    last_good_utc
        Of the last check with a master wheel that was within tolerance; None when there was none.
    vehicles
        Measured since by one of these wheels, in the order of storing; all of them without a good check.
    """

    station: str
    wheels: tuple[str, ...]
    last_good_utc: datetime | None
    vehicles: tuple[VehicleSince, ...]


def vin_history(reader: ResultReader, vin: str) -> VinHistory:
    """All cycles of a VIN, of every vehicle type, with everything that explains them."""
    check_text("vin", vin)
    of_vin = select(vehicles.c.id).where(vehicles.c.vin == vin)
    with reader.transaction() as connection:
        found = read_cycles(
            connection,
            CYCLES.where(cycles.c.vehicle_id.in_(of_vin)).order_by(cycles.c.id),
        )
        wheels = [wheel for stored in found for wheel in stored.record.wheels]
        used = sorted({wheel.calibration_id for wheel in wheels if wheel.calibration_id})
        zero_ids = sorted({wheel.zero_measurement_id for wheel in wheels if wheel.zero_measurement_id})
        rows = connection.execute(select(calibrations).where(calibrations.c.id.in_(used))).mappings()
        known = {row["id"]: record_of(CalibrationRecord, row) for row in rows}
        of_checks = select(calibration_checks).where(calibration_checks.c.calibration_id.in_(used))
        checks_found = connection.execute(of_checks.order_by(calibration_checks.c.utc)).mappings()
        zeros = read_zeros(connection, ZEROS.where(zero_measurements.c.id.in_(zero_ids)))
        uuids = [stored.record.uuid for stored in found]
        return VinHistory(
            vin,
            found,
            known,
            tuple(record_of(CalibrationCheckRecord, row) for row in checks_found),
            {zero.record.id: zero for zero in zeros},
            _configurations(connection, found),
            _events_around(connection, found),
            _shots(connection, uuids),
        )


def events(
    reader: ResultReader, where: Filter = EVERYTHING, text: str | None = None, codes: Sequence[str] = ()
) -> tuple[EventRecord, ...]:
    """Events of a period and of stations, in the order of their times; `text` is looked for in theirs."""
    conditions = [within(where.intervals(), event_rows.c.utc), *at_stations(where, event_rows.c.station)]
    if text is not None:
        check_text("text", text)
        conditions.append(event_rows.c.text.icontains(text, autoescape=True))
    if codes:
        conditions.append(event_rows.c.code.in_(codes))
    query = select(event_rows).where(*conditions).order_by(event_rows.c.utc, event_rows.c.id)
    with reader.transaction() as connection:
        return tuple(record_of(EventRecord, row) for row in connection.execute(query).mappings())


def checks(reader: ResultReader, where: Filter = EVERYTHING) -> tuple[CheckOfStation, ...]:
    """Checks of calibrations, in the order of their times; wheels of the filter are names of rigs."""
    with reader.transaction() as connection:
        return tuple(
            found
            for found in _checks(connection, [within(where.intervals(), calibration_checks.c.utc)])
            if _wanted(connection, where, found)
        )


def since_last_good_check(reader: ResultReader, where: Filter = EVERYTHING) -> tuple[SinceCheck, ...]:
    """For each station and wheel the last master check within tolerance, and the vehicles measured since.

    The filter chooses stations, plants, wheels and vehicle types; its period bounds the vehicles, not the
    checks. A vehicle that was stored after others of a later time counts as measured after them: then the
    clock was set back.
    """
    with reader.transaction() as connection:
        good: dict[tuple[str, str], datetime] = {}
        passed = [
            calibration_checks.c.kind == CheckKind.MASTER_WHEEL,
            calibration_checks.c.outcome == CheckOutcome.WITHIN,
        ]
        for found in _checks(connection, passed):
            if found.station is not None:
                good[found.station, found.rig] = found.check.utc
        groups: dict[tuple[str, datetime | None], list[str]] = defaultdict(list)
        for station, wheel in _wheels(connection, where):
            groups[station, good.get((station, wheel))].append(wheel)
        return tuple(
            SinceCheck(
                station, tuple(wheels), last, _vehicles_since(connection, where, station, wheels, last)
            )
            for (station, last), wheels in sorted(groups.items(), key=str)
        )


def _checks(connection: Connection, conditions: Sequence[ColumnElement[bool]]) -> list[CheckOfStation]:
    query = (
        select(calibration_checks, calibrations.c.rig.label("of_rig"))
        .join(calibrations, calibration_checks.c.calibration_id == calibrations.c.id)
        .where(*conditions)
        .order_by(calibration_checks.c.utc, calibration_checks.c.id)
    )
    rows = connection.execute(query).mappings().all()
    used: dict[str, set[str]] = defaultdict(set)
    for calibration_id, station in connection.execute(
        select(installations.c.calibration_id, stations.c.name)
        .join(rigs, installations.c.rig_id == rigs.c.id)
        .join(stations, rigs.c.station_id == stations.c.id)
        .distinct()
    ):
        used[calibration_id].add(station)
    found = []
    for row in rows:
        calibration_id = row["calibration_id"]
        if calibration_id not in used:
            # Stored before stations told what they use: whoever measured with it.
            first = (
                select(cycles.c.station)
                .join(wheel_results, wheel_results.c.cycle_id == cycles.c.id)
                .where(wheel_results.c.calibration_id == calibration_id)
                .limit(1)
            )
            used[calibration_id] = set(connection.execute(first).scalars())
        check = record_of(CalibrationCheckRecord, row)
        names: list[str | None] = [*sorted(used[calibration_id])]
        found += [CheckOfStation(name, row["of_rig"], check) for name in names or [None]]
    return found


def _wanted(connection: Connection, where: Filter, found: CheckOfStation) -> bool:
    if where.wheels and found.rig not in where.wheels:
        return False
    if where.stations and found.station not in where.stations:
        return False
    if not where.plants:
        return True
    return found.station in {*map(str, connection.execute(stations_of(where.plants)).scalars())}


def _wheels(connection: Connection, where: Filter) -> list[tuple[str, str]]:
    """Stations and their wheels: as they registered, or as the newest cycles of each show."""
    registered = select(stations.c.name, rigs.c.name).join(rigs, rigs.c.station_id == stations.c.id)
    found = {
        (row[0], row[1]) for row in connection.execute(registered.where(*at_stations(where, stations.c.name)))
    }
    for station in known_stations(connection):
        if station in {name for name, _ in found}:
            continue
        newest = select(cycles.c.id).where(cycles.c.station == station, *at_stations(where, cycles.c.station))
        newest = newest.order_by(cycles.c.received_utc.desc()).limit(20)
        names = select(wheel_results.c.wheel).where(wheel_results.c.cycle_id.in_(newest)).distinct()
        found |= {(station, name) for name in connection.execute(names).scalars()}
    return sorted(pair for pair in found if not where.wheels or pair[1] in where.wheels)


def _vehicles_since(
    connection: Connection, where: Filter, station: str, wheels: Sequence[str], last: datetime | None
) -> tuple[VehicleSince, ...]:
    conditions = [*about_cycles(where), cycles.c.station == station]
    if last is not None:
        first = select(func.min(cycles.c.id)).where(
            cycles.c.station == station,
            cycles.c.received_utc > last,
            cycles.c.received_utc < last + _SET_BACK,
        )
        conditions += [
            cycles.c.received_utc > last - _SET_BACK,
            or_(cycles.c.received_utc > last, cycles.c.id > first.scalar_subquery()),
        ]
    of_wheels = (wheel_results.c.cycle_id == cycles.c.id) & wheel_results.c.wheel.in_(wheels)
    query = (
        select(
            vehicles.c.vin, vehicles.c.vehicle_type, cycles.c.received_utc, cycles.c.outcome, cycles.c.uuid
        )
        .select_from(cycles)
        .join(vehicles, cycles.c.vehicle_id == vehicles.c.id)
        .where(*conditions, select(wheel_results.c.cycle_id).where(of_wheels).exists())
        .order_by(cycles.c.id)
    )
    return tuple(VehicleSince(*row) for row in connection.execute(query))


def _configurations(connection: Connection, found: Sequence[StoredCycle]) -> tuple[StationRecord, ...]:
    names = {(stored.record.station, stored.record.config_hash) for stored in found}
    rows: list[StationRecord] = []
    for name, config_hash in sorted(names):
        same = (stations.c.name == name) & (station_versions.c.config_hash == config_hash)
        rows += read_stations(connection, STATIONS.where(same).order_by(station_versions.c.id).limit(1))
    return tuple(rows)


def _events_around(connection: Connection, found: Sequence[StoredCycle]) -> tuple[EventRecord, ...]:
    around = [
        (event_rows.c.station == stored.record.station)
        & (event_rows.c.utc >= stored.record.received_utc - _AROUND)
        & (event_rows.c.utc <= _end(stored) + _AROUND)
        for stored in found
    ]
    query = select(event_rows).where(or_(false(), *around)).order_by(event_rows.c.utc, event_rows.c.id)
    return tuple(record_of(EventRecord, row) for row in connection.execute(query).mappings())


def _end(stored: StoredCycle) -> datetime:
    # Not the time of storing: in the central database that is the time of arrival.
    record = stored.record
    return max(record.received_utc, record.measured_utc or record.received_utc)


def _shots(connection: Connection, uuids: Sequence[UUID]) -> tuple[StoredShot, ...]:
    of_cycles = cycles.c.uuid.in_(uuids)
    kept = connection.execute(SHOTS.where(of_cycles).order_by(archived_shots.c.id)).mappings().all()
    removed = {
        row["shot"]: record_of(ArchiveRemoval, row)
        for row in connection.execute(
            REMOVALS.where(archived_shots.c.uuid.in_([row["uuid"] for row in kept]))
        ).mappings()
    }
    return tuple(StoredShot(record_of(ArchivedShotRecord, row), removed.get(row["uuid"])) for row in kept)
