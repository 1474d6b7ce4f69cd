"""Writing records inside a transaction: each is stored once, the same again changes nothing."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime
from functools import cache
from typing import Any
from uuid import UUID

from sqlalchemy import JSON, Connection, Insert, Table, Text, bindparam, cast, column, func, select, tuple_
from sqlalchemy.dialects import postgresql

from alignment.errors import StoreError
from db.records import (
    ArchivedShotRecord,
    ArchiveRemoval,
    CalibrationCheckRecord,
    CalibrationRecord,
    ConcessionRecord,
    ConcessionWithdrawal,
    CycleRecord,
    DoubtClosing,
    DoubtRecord,
    EventRecord,
    GaugeStudyRecord,
    GaugeValueRecord,
    InstallationRecord,
    StationRecord,
    VehicleRecord,
    VehicleTypeRecord,
    ZeroRecord,
    ZeroRevocation,
)
from db.rows.chain import PARTS, new_links, parts_of
from db.rows.reading import CYCLES, KIND_OF, PORTION, flat_values, key_of, load_records, read_cycles
from db.schema import (
    archive_removals,
    archived_shots,
    calibration_checks,
    calibrations,
    chain_links,
    concession_withdrawals,
    concessions,
    cycles,
    doubt_closings,
    doubts,
    events,
    gauge_studies,
    gauge_values,
    installations,
    metadata,
    plants,
    rigs,
    station_versions,
    stations,
    vehicle_type_limits,
    vehicles,
    zero_measurements,
    zero_revocations,
)

_NAMES = {
    "check": "calibration check",
    "zero": "zero measurement",
    "limits": "set of limits",
    "study": "gauge study",
    "study_value": "value of a gauge study",
    "shot": "archived shot",
    "removal": "removal of an archived shot",
    "withdrawal": "withdrawal of a concession",
    "revocation": "revocation",
    "doubt_closing": "end of a doubt",
    "station": "station version",
}


def write_record(connection: Connection, record: Any, stored_utc: datetime) -> bool:
    """Store a record; false when the same is stored already.

    Raises
    ------
    StoreError
        When another record of the same identity is stored, or what the record refers to is not.
    """
    if isinstance(record, CycleRecord):
        return bool(write_cycles(connection, [record], stored_utc))
    table, key, values = _WRITERS[type(record)](connection, record)
    if "stored_utc" in table.c:
        values["stored_utc"] = stored_utc
    if insert_once(connection, table, key, values) is not None:
        links = new_links(connection, [(record, values.get("stored_utc"))])
        insert_rows(connection, {chain_links: links})
        return True
    kind = KIND_OF[type(record)]
    stored = load_records(connection, kind, [key_of(record)]).get(key_of(record))
    _require_same(kind, record, stored == record)
    return False


def write_cycles(
    connection: Connection, records: Sequence[CycleRecord], stored_utc: datetime
) -> frozenset[UUID]:
    """Store cycles with their vehicles and results, in their order; return the UUIDs of those that were new.

    Raises
    ------
    StoreError
        As `write_record`.
    """
    vehicle_ids = _vehicle_ids(connection, [record.vehicle for record in records if record.vehicle])
    rows = []
    for record in records:
        vehicle_id = None if record.vehicle is None else vehicle_ids[record.vehicle]
        rows.append(flat_values(record) | {"stored_utc": stored_utc, "vehicle_id": vehicle_id})
    statement = _insert_new(connection, cycles, ["uuid"])
    returning = statement.returning(cycles.c.uuid, cycles.c.id, sort_by_parameter_order=False)
    added: dict[UUID, int] = {}
    for start in range(0, len(rows), PORTION):
        portion = _missing(connection, cycles, "uuid", rows[start : start + PORTION])
        if portion:
            added |= {row.uuid: row.id for row in connection.execute(returning, portion)}
    parts: dict[Table, list[dict[str, Any]]] = {metadata.tables[name]: [] for name in PARTS}
    once: dict[UUID, CycleRecord] = {}
    for record in records:
        known = once.setdefault(record.uuid, record) if record.uuid in added else None
        if known is None:
            (stored,) = read_cycles(connection, CYCLES.where(cycles.c.uuid == record.uuid))
            known = stored.record
        _require_same("cycle", record, known == record)
    parts[chain_links] = new_links(connection, [(record, stored_utc) for record in once.values()])
    for record in once.values():
        for name, items in zip(PARTS, parts_of(record), strict=True):
            parts[metadata.tables[name]] += [
                flat_values(item) | {"cycle_id": added[record.uuid]} for item in items
            ]
    insert_rows(connection, parts)
    return frozenset(added)


def insert_rows(connection: Connection, rows: Mapping[Table, Sequence[dict[str, Any]]]) -> None:
    """Insert rows of several tables that do not refer to each other, and of which nothing is to come back."""
    tables = tuple(table for table, part in rows.items() if part)
    if connection.dialect.name == "sqlite":
        for table in tables:
            connection.execute(table.insert(), rows[table])
    elif tables:
        # One statement for all: row by row they cost the server three times as much.
        documents = {
            table.name: json.dumps(rows[table], default=_as_text, ensure_ascii=False, allow_nan=False)
            for table in tables
        }
        connection.execute(_from_documents(tables), documents)


def _as_text(value: datetime | UUID) -> str:
    return value.isoformat() if isinstance(value, datetime) else str(value)


@cache
def _from_documents(tables: tuple[Table, ...]) -> Insert:
    """Insert the rows of a JSON list for each table, named as the table is; on PostgreSQL."""
    first, *others = map(_from_document, tables)
    parts = [insert.cte(f"new_{table.name}") for table, insert in zip(tables[1:], others, strict=True)]
    return first.add_cte(*parts)


def _from_document(table: Table) -> Insert:
    document = cast(bindparam(table.name, type_=Text), JSON())
    columns = [column(item.name, item.type) for item in table.c]
    rows = func.json_to_recordset(document).table_valued(*columns, name="given")
    return table.insert().from_select(table.c.keys(), select(rows.render_derived(with_types=True)))


def insert_once(connection: Connection, table: Table, key: str, values: dict[str, Any]) -> Any:
    """Insert a row and return its primary key; None when a row of the same key is there already.

    The database decides, so two writers of one record cannot both believe that they were first.
    """
    if not _missing(connection, table, key, [values]):
        return None
    statement = _insert_new(connection, table, [key]).values(**values)
    return connection.execute(statement.returning(*table.primary_key)).scalar_one_or_none()


def row_id(connection: Connection, table: Table, **values: Any) -> int:
    """The id of the row with these values, which is made when it is missing."""
    query = select(table.c.id)
    for name, value in values.items():
        query = query.where(table.c[name] == value)
    known: int | None = connection.execute(query).scalar_one_or_none()
    if known is not None:
        return known
    connection.execute(_insert_new(connection, table).values(**values))
    added: int = connection.execute(query).scalar_one()
    return added


def _insert_new(connection: Connection, table: Table, keys: Sequence[str] | None = None) -> Any:
    """INSERT that leaves alone what is there already.

    On SQLite a trigger refuses that before the statement could leave it alone: callers ask first, and their
    transaction is the only one that writes.
    """
    if connection.dialect.name == "sqlite":
        return table.insert()
    return postgresql.insert(table).on_conflict_do_nothing(index_elements=keys)


def _missing(
    connection: Connection, table: Table, key: str, rows: Sequence[dict[str, Any]]
) -> Sequence[dict[str, Any]]:
    """The rows of which none of the same key is stored, each key once; all of them on a server."""
    if connection.dialect.name != "sqlite":
        return rows
    column = table.c[key]
    given = {row[key]: row for row in reversed(rows)}
    known = set(connection.execute(select(column).where(column.in_(given))).scalars())
    return [row for name, row in reversed(given.items()) if name not in known]


def _vehicle_ids(connection: Connection, wanted: Sequence[VehicleRecord]) -> dict[VehicleRecord, int]:
    # In one order for all writers, or two of them could wait for each other.
    missing = sorted(set(wanted), key=lambda vehicle: (vehicle.vin, vehicle.vehicle_type))
    columns = (vehicles.c.id, vehicles.c.vin, vehicles.c.vehicle_type)
    insert = _insert_new(connection, vehicles).returning(*columns)
    found: dict[VehicleRecord, int] = {}

    def add() -> None:
        new = [vehicle for vehicle in missing if vehicle not in found]
        for start in range(0, len(new), PORTION):
            rows = [flat_values(vehicle) for vehicle in new[start : start + PORTION]]
            for row in connection.execute(insert, rows):
                found[VehicleRecord(row.vin, row.vehicle_type)] = row.id

    def look_up() -> None:
        known = [vehicle for vehicle in missing if vehicle not in found]
        for start in range(0, len(known), PORTION):
            names = [(vehicle.vin, vehicle.vehicle_type) for vehicle in known[start : start + PORTION]]
            query = select(*columns).where(tuple_(vehicles.c.vin, vehicles.c.vehicle_type).in_(names))
            for row in connection.execute(query):
                found[VehicleRecord(row.vin, row.vehicle_type)] = row.id

    # Nearly every vehicle comes once, so a server is told that it is new first.
    for step in (look_up, add) if connection.dialect.name == "sqlite" else (add, look_up):
        step()
    return found


def _require_same(kind: str, record: Any, same: bool) -> None:
    if not same:
        name = _NAMES.get(kind, kind)
        identity = getattr(record, "uuid", None) or key_of(record)
        raise StoreError(
            f"already holds another {name} {identity}; what is stored stays. Give the new"
            f" {name} an identity of its own"
        )


def _known_id(connection: Connection, table: Table, name: str, uuid: UUID) -> int:
    found: int | None = connection.execute(
        select(table.c.id).where(table.c.uuid == uuid)
    ).scalar_one_or_none()
    if found is None:
        raise StoreError(f"holds no {name} {uuid}. Record the {name} first")
    return found


_Prepared = tuple[Table, str, dict[str, Any]]


def _plain(table: Table, key: str) -> Callable[[Connection, Any], _Prepared]:
    return lambda connection, record: (table, key, flat_values(record))


def _station(connection: Connection, record: StationRecord) -> _Prepared:
    station_id = row_id(connection, stations, name=record.station)
    for rig in record.rigs:
        row_id(connection, rigs, station_id=station_id, name=rig)
    keys = {"station_id": station_id, "plant_id": row_id(connection, plants, name=record.plant)}
    return station_versions, "uuid", flat_values(record) | keys


def _limits(connection: Connection, record: VehicleTypeRecord) -> _Prepared:
    station_id = row_id(connection, stations, name=record.station)
    return vehicle_type_limits, "uuid", flat_values(record) | {"station_id": station_id}


def _installation(connection: Connection, record: InstallationRecord) -> _Prepared:
    station_id = row_id(connection, stations, name=record.station)
    rig_id = row_id(connection, rigs, station_id=station_id, name=record.rig)
    return installations, "uuid", flat_values(record) | {"rig_id": rig_id}


def _study_value(connection: Connection, record: GaugeValueRecord) -> _Prepared:
    study_id = _known_id(connection, gauge_studies, "gauge study", record.study)
    return gauge_values, "uuid", flat_values(record) | {"study_id": study_id}


def _shot(connection: Connection, record: ArchivedShotRecord) -> _Prepared:
    cycle_id = _known_id(connection, cycles, "cycle", record.cycle)
    return archived_shots, "uuid", flat_values(record) | {"cycle_id": cycle_id}


def _removal(connection: Connection, record: ArchiveRemoval) -> _Prepared:
    shot_id = _known_id(connection, archived_shots, "archived shot", record.shot)
    return archive_removals, "shot_id", flat_values(record) | {"shot_id": shot_id}


def _concession(connection: Connection, record: ConcessionRecord) -> _Prepared:
    cycle_id = _known_id(connection, cycles, "cycle", record.cycle)
    return concessions, "uuid", flat_values(record) | {"cycle_id": cycle_id}


def _withdrawal(connection: Connection, record: ConcessionWithdrawal) -> _Prepared:
    concession_id = _known_id(connection, concessions, "concession", record.concession)
    return concession_withdrawals, "concession_id", flat_values(record) | {"concession_id": concession_id}


_WRITERS: dict[type, Callable[[Connection, Any], _Prepared]] = {
    CalibrationRecord: _plain(calibrations, "id"),
    CalibrationCheckRecord: _plain(calibration_checks, "uuid"),
    ZeroRecord: _plain(zero_measurements, "id"),
    ZeroRevocation: _plain(zero_revocations, "zero_id"),
    EventRecord: _plain(events, "uuid"),
    GaugeStudyRecord: _plain(gauge_studies, "uuid"),
    GaugeValueRecord: _study_value,
    StationRecord: _station,
    VehicleTypeRecord: _limits,
    InstallationRecord: _installation,
    ArchivedShotRecord: _shot,
    ArchiveRemoval: _removal,
    ConcessionRecord: _concession,
    ConcessionWithdrawal: _withdrawal,
    DoubtRecord: _plain(doubts, "uuid"),
    DoubtClosing: _plain(doubt_closings, "doubt"),
}
