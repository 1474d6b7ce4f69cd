"""What explains results: all of one vehicle, events, checks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from uuid import UUID

from sqlalchemy import ColumnElement, Connection, RowMapping, or_, select

from db.queries.filters import (
    EVERYTHING,
    Filter,
    at_stations,
    known_stations,
    stations_of,
    within,
)
from db.queries.reader import ResultReader, question
from db.queries.since_check import stations_using
from db.records import (
    ArchivedShotRecord,
    ArchiveRemoval,
    CalibrationCheckRecord,
    CalibrationRecord,
    EventRecord,
    Severity,
    StationRecord,
    StoredConcession,
    StoredCycle,
    StoredShot,
    StoredZero,
    check_text,
)
from db.rows import (
    CYCLES,
    REMOVALS,
    SHOTS,
    STATIONS,
    ZEROS,
    read_concessions,
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
    station_versions,
    stations,
    vehicles,
    zero_measurements,
)
from db.schema import events as event_rows

# Events this long before a trigger and after the last image may explain a cycle.
_AROUND = timedelta(minutes=15)
# Cycles whose conditions go into one statement; a database takes an expression of so many parts only.
_PORTION = 200


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
        Of these cycles; and of their stations, up to a quarter of an hour before a trigger and after the last
        image.
    shots
        Archived images, and whether they are still kept.
    concessions
        Releases of the vehicle although it was not ok, withdrawn ones too.
    """

    vin: str
    cycles: tuple[StoredCycle, ...]
    calibrations: Mapping[str, CalibrationRecord]
    checks: tuple[CalibrationCheckRecord, ...]
    zeros: Mapping[str, StoredZero]
    stations: tuple[StationRecord, ...]
    events: tuple[EventRecord, ...]
    shots: tuple[StoredShot, ...]
    concessions: tuple[StoredConcession, ...] = ()


@dataclass(frozen=True)
class CheckOfStation:
    """A check of a calibration, with the rig and the station that used it; None where none did yet."""

    station: str | None
    rig: str
    check: CalibrationCheckRecord


@question
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
            read_concessions(connection, uuids),
        )


@question
def station_names(reader: ResultReader) -> tuple[str, ...]:
    """Every station that registered or has results."""
    with reader.transaction() as connection:
        return tuple(known_stations(connection))


@question
def events(
    reader: ResultReader,
    where: Filter = EVERYTHING,
    text: str | None = None,
    codes: Sequence[str] = (),
    severities: Sequence[Severity] = (),
) -> tuple[EventRecord, ...]:
    """Events of a period and of stations, in the order of their times; `text` is looked for in theirs."""
    conditions = [within(where.intervals(), event_rows.c.utc), *at_stations(where, event_rows.c.station)]
    if text is not None:
        check_text("text", text)
        conditions.append(event_rows.c.text.icontains(text, autoescape=True))
    if codes:
        conditions.append(event_rows.c.code.in_(codes))
    if severities:
        conditions.append(event_rows.c.severity.in_(severities))
    query = select(event_rows).where(*conditions).order_by(event_rows.c.utc, event_rows.c.id)
    with reader.transaction() as connection:
        return tuple(record_of(EventRecord, row) for row in connection.execute(query).mappings())


@question
def checks(reader: ResultReader, where: Filter = EVERYTHING) -> tuple[CheckOfStation, ...]:
    """Checks of calibrations, in the order of their times; wheels of the filter are names of rigs."""
    conditions = [within(where.intervals(), calibration_checks.c.utc)]
    if where.wheels:
        conditions.append(calibrations.c.rig.in_(where.wheels))
    with reader.transaction() as connection:
        found = _checks(connection, conditions)
        if where.stations:
            found = [one for one in found if one.station in where.stations]
        if where.plants:
            there = {*map(str, connection.execute(stations_of(where.plants)).scalars())}
            found = [one for one in found if one.station in there]
        return tuple(found)


def _checks(connection: Connection, conditions: Sequence[ColumnElement[bool]]) -> list[CheckOfStation]:
    query = (
        select(calibration_checks, calibrations.c.rig.label("of_rig"))
        .join(calibrations, calibration_checks.c.calibration_id == calibrations.c.id)
        .where(*conditions)
        .order_by(calibration_checks.c.utc, calibration_checks.c.id)
    )
    rows = connection.execute(query).mappings().all()
    used = stations_using(connection, sorted({row["calibration_id"] for row in rows}))
    found = []
    for row in rows:
        check = record_of(CalibrationCheckRecord, row)
        names: list[str | None] = [*sorted(used[row["calibration_id"]])]
        found += [CheckOfStation(name, row["of_rig"], check) for name in names or [None]]
    return found


def _configurations(connection: Connection, found: Sequence[StoredCycle]) -> tuple[StationRecord, ...]:
    names = {(stored.record.station, stored.record.config_hash) for stored in found}
    rows: list[StationRecord] = []
    for name, config_hash in sorted(names):
        same = (stations.c.name == name) & (station_versions.c.config_hash == config_hash)
        rows += read_stations(connection, STATIONS.where(same).order_by(station_versions.c.id).limit(1))
    return tuple(rows)


def _events_around(connection: Connection, found: Sequence[StoredCycle]) -> tuple[EventRecord, ...]:
    rows: dict[int, RowMapping] = {}
    for start in range(0, len(found), _PORTION):
        portion = found[start : start + _PORTION]
        around = [
            (event_rows.c.station == stored.record.station)
            & (event_rows.c.utc >= stored.record.received_utc - _AROUND)
            & (event_rows.c.utc <= _end(stored) + _AROUND)
            for stored in portion
        ]
        of_these = event_rows.c.cycle_uuid.in_([stored.record.uuid for stored in portion])
        query = select(event_rows).where(or_(of_these, *around))
        rows |= {row["id"]: row for row in connection.execute(query).mappings()}
    ordered = sorted(rows.values(), key=lambda row: (row["utc"], row["id"]))
    return tuple(record_of(EventRecord, row) for row in ordered)


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
