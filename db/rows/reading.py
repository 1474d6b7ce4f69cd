"""Rows as records and back."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, Any, TypeVar
from uuid import UUID

from sqlalchemy import Connection, RowMapping, Select, Table, Uuid, exists, func, select

from alignment.errors import InputError
from db.records import (
    AdjustingRecord,
    ArchivedShotRecord,
    ArchiveRemoval,
    AxleRecord,
    CalibrationCheckRecord,
    CalibrationRecord,
    ConcessionRecord,
    ConcessionWithdrawal,
    CycleOutcome,
    CycleRecord,
    DoubtClosing,
    DoubtRecord,
    EventRecord,
    GaugeStudyRecord,
    GaugeValueRecord,
    GeometryRecord,
    InstallationRecord,
    StationRecord,
    SteeringAxisRecord,
    SteeringRecord,
    StoredConcession,
    StoredCycle,
    StoredDoubt,
    StoredZero,
    VehicleAnglesRecord,
    VehicleRecord,
    VehicleTypeRecord,
    WheelRecord,
    ZeroRecord,
    ZeroRevocation,
)
from db.schema import (
    adjusting_results,
    archive_removals,
    archived_shots,
    axle_results,
    calibration_checks,
    calibrations,
    concession_withdrawals,
    concessions,
    cycles,
    doubt_closings,
    doubts,
    events,
    gauge_studies,
    gauge_values,
    geometry_results,
    installations,
    plants,
    rigs,
    station_versions,
    stations,
    steering_axis_results,
    steering_results,
    vehicle_results,
    vehicle_type_limits,
    vehicles,
    wheel_results,
    zero_measurements,
    zero_revocations,
)

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

_Record = TypeVar("_Record", bound="DataclassInstance")
# Both databases bound the number of parameters of one statement.
PORTION = 1000
# Parts of records that have tables or columns of their own.
_NESTED = frozenset(
    (
        "vehicle",
        "wheels",
        "axles",
        "vehicle_angles",
        "geometry",
        "steering",
        "steering_axes",
        "adjustings",
        "plant",
        "rigs",
        "study",
        "shot",
    )
)
# Read as joined columns; written as keys.
_JOINED: dict[type, frozenset[str]] = {
    InstallationRecord: frozenset(("station", "rig")),
    VehicleTypeRecord: frozenset(("station",)),
    StationRecord: frozenset(("station", "plant", "rigs")),
    ArchivedShotRecord: frozenset(("cycle",)),
    ConcessionRecord: frozenset(("cycle",)),
    ConcessionWithdrawal: frozenset(("concession",)),
}

CYCLES = select(cycles, vehicles.c.vin, vehicles.c.vehicle_type).outerjoin(
    vehicles, cycles.c.vehicle_id == vehicles.c.id
)
ZEROS = select(
    zero_measurements,
    zero_revocations.c.zero_id,
    zero_revocations.c.utc,
    zero_revocations.c.reason,
).outerjoin(zero_revocations, zero_revocations.c.zero_id == zero_measurements.c.id)
_ZERO = zero_measurements.alias("zero")
_NOT_REVOKED = ~exists().where(zero_revocations.c.zero_id == _ZERO.c.id)
_NEWEST_FIRST = (_ZERO.c.measured_utc.desc(), _ZERO.c.stored_utc.desc(), _ZERO.c.id.desc())
SHOTS = select(archived_shots, cycles.c.uuid.label("cycle")).join(
    cycles, archived_shots.c.cycle_id == cycles.c.id
)
STUDY_VALUES = select(gauge_values, gauge_studies.c.uuid.label("study")).join(
    gauge_studies, gauge_values.c.study_id == gauge_studies.c.id
)
REMOVALS = select(archive_removals, archived_shots.c.uuid.label("shot")).join(
    archived_shots, archive_removals.c.shot_id == archived_shots.c.id
)
CONCESSIONS = select(concessions, cycles.c.uuid.label("cycle")).join(
    cycles, concessions.c.cycle_id == cycles.c.id
)
WITHDRAWALS = select(concession_withdrawals, concessions.c.uuid.label("concession")).join(
    concessions, concession_withdrawals.c.concession_id == concessions.c.id
)
STATIONS = (
    select(station_versions, stations.c.name.label("station"), plants.c.name.label("plant"))
    .join(stations, station_versions.c.station_id == stations.c.id)
    .join(plants, station_versions.c.plant_id == plants.c.id)
)
INSTALLATIONS = (
    select(installations, stations.c.name.label("station"), rigs.c.name.label("rig"))
    .join(rigs, installations.c.rig_id == rigs.c.id)
    .join(stations, rigs.c.station_id == stations.c.id)
)
_ENDS = {name: doubt_closings.c[name].label(f"closing_{name}") for name in doubt_closings.columns.keys()}  # noqa: SIM118
DOUBTS = select(doubts, *_ENDS.values()).outerjoin(doubt_closings, doubt_closings.c.doubt == doubts.c.uuid)
OPEN_DOUBT = doubt_closings.c.doubt.is_(None)
"""Condition on `DOUBTS`: those that nothing has ended."""
LIMITS = select(vehicle_type_limits, stations.c.name.label("station")).join(
    stations, vehicle_type_limits.c.station_id == stations.c.id
)


def flat_values(record: Any) -> dict[str, Any]:
    """The values of a record that are columns of its own table; fields are named as the columns are."""
    left_out = _NESTED | _JOINED.get(type(record), frozenset())
    return {item.name: getattr(record, item.name) for item in fields(record) if item.name not in left_out}


def record_of(kind: type[_Record], row: RowMapping, **nested: Any) -> _Record:
    """The record that a row holds; `nested` gives what is in other tables.

    Raises
    ------
    ValueError
        When the row holds what no record can; `db.connection.failures.store_errors` calls it damage.
    """
    names = [item.name for item in fields(kind) if item.name not in nested and item.name in row]
    try:
        return kind(**{name: row[name] for name in names}, **nested)
    except InputError as error:
        raise ValueError(str(error)) from error


def read_zeros(connection: Connection, query: Select[Any]) -> tuple[StoredZero, ...]:
    """Zero measurements with their revocations; `query` extends `ZEROS`."""
    return tuple(
        StoredZero(
            record_of(ZeroRecord, row),
            None if row["zero_id"] is None else record_of(ZeroRevocation, row),
            row["stored_utc"],
        )
        for row in connection.execute(query).mappings()
    )


def read_concessions(connection: Connection, uuids: Sequence[UUID]) -> tuple[StoredConcession, ...]:
    """Concessions of these cycles with their withdrawals, in the order of storing."""
    found: list[StoredConcession] = []
    for start in range(0, len(uuids), PORTION):
        of_these = cycles.c.uuid.in_(uuids[start : start + PORTION])
        rows = connection.execute(CONCESSIONS.where(of_these).order_by(concessions.c.id)).mappings().all()
        granted = [row["uuid"] for row in rows]
        ended = connection.execute(WITHDRAWALS.where(concessions.c.uuid.in_(granted))).mappings()
        withdrawn = {row["concession"]: record_of(ConcessionWithdrawal, row) for row in ended}
        found += [
            StoredConcession(record_of(ConcessionRecord, row), withdrawn.get(row["uuid"]), row["stored_utc"])
            for row in rows
        ]
    return tuple(found)


def newest_zeros() -> Select[Any]:
    """As `ZEROS`: of every rig and calibration the newest zero measurement that was not revoked."""
    place = func.row_number().over(partition_by=(_ZERO.c.rig, _ZERO.c.calibration_id), order_by=_NEWEST_FIRST)
    placed = select(_ZERO.c.id, place.label("place")).where(_NOT_REVOKED).subquery("placed")
    return ZEROS.where(zero_measurements.c.id.in_(select(placed.c.id).where(placed.c.place == 1)))


def newest_zeros_of(installed: Sequence[tuple[str, str]]) -> Select[Any]:
    """The same of some rigs and ids of calibrations: each is found by an index, and at most one row comes."""
    newest = select(_ZERO.c.id).where(_NOT_REVOKED).order_by(*_NEWEST_FIRST).limit(1)
    wanted = [
        newest.where(_ZERO.c.rig == rig, _ZERO.c.calibration_id == calibration).scalar_subquery()
        for rig, calibration in installed
    ]
    return ZEROS.where(zero_measurements.c.id.in_(wanted))


def read_cycles(connection: Connection, query: Select[Any]) -> tuple[StoredCycle, ...]:
    """Cycles with everything that belongs to them; `query` extends `CYCLES`."""
    rows = connection.execute(query).mappings().all()
    ids = [row["id"] for row in rows]
    wheels = _results(connection, wheel_results, WheelRecord, ids)
    axles = _results(connection, axle_results, AxleRecord, ids)
    angles = _results(connection, vehicle_results, VehicleAnglesRecord, ids)
    geometry = _results(connection, geometry_results, GeometryRecord, ids)
    steering = _results(connection, steering_results, SteeringRecord, ids)
    axes = _results(connection, steering_axis_results, SteeringAxisRecord, ids)
    turned = _results(connection, adjusting_results, AdjustingRecord, ids)
    bad = [row["uuid"] for row in rows if row["outcome"] == CycleOutcome.NOK]
    granted = (stored for stored in read_concessions(connection, bad) if stored.in_force)
    conceded = {stored.record.cycle: stored.record for stored in granted}
    doubted = doubts_of_cycles(connection, [row["uuid"] for row in rows])
    found = []
    for row in rows:
        vehicle = None if row["vin"] is None else record_of(VehicleRecord, row)
        record = record_of(
            CycleRecord,
            row,
            vehicle=vehicle,
            wheels=tuple(wheels[row["id"]]),
            axles=tuple(axles[row["id"]]),
            vehicle_angles=next(iter(angles[row["id"]]), None),
            geometry=next(iter(geometry[row["id"]]), None),
            steering=next(iter(steering[row["id"]]), None),
            steering_axes=tuple(axes[row["id"]]),
            adjustings=tuple(turned[row["id"]]),
        )
        doubt = doubted.get(record.uuid, ())
        found.append(StoredCycle(record, row["stored_utc"], conceded.get(record.uuid), doubt))
    return tuple(found)


def read_doubts(connection: Connection, query: Select[Any]) -> tuple[StoredDoubt, ...]:
    """Doubts with their ends; `query` extends `DOUBTS`."""
    found = []
    for row in connection.execute(query).mappings():
        ended = row["closing_doubt"] is not None
        end = {name: row[label.name] for name, label in _ENDS.items() if name != "stored_utc"}
        found.append(StoredDoubt(record_of(DoubtRecord, row), DoubtClosing(**end) if ended else None))
    return tuple(found)


def doubts_of_cycles(connection: Connection, uuids: Iterable[UUID]) -> dict[UUID, tuple[StoredDoubt, ...]]:
    """The doubts about each of these cycles, by wheel; a cycle without any is left out."""
    wanted = list(uuids)
    found: dict[UUID, list[StoredDoubt]] = {}
    for start in range(0, len(wanted), PORTION):
        query = DOUBTS.where(doubts.c.cycle.in_(wanted[start : start + PORTION])).order_by(doubts.c.wheel)
        for doubt in read_doubts(connection, query):
            found.setdefault(doubt.record.cycle, []).append(doubt)
    return {cycle: tuple(of) for cycle, of in found.items()}


def read_stations(connection: Connection, query: Select[Any]) -> tuple[StationRecord, ...]:
    """Stations as they were from a time on; `query` extends `STATIONS`."""
    rows = connection.execute(query).mappings().all()
    known: dict[int, list[str]] = defaultdict(list)
    ids = sorted({row["station_id"] for row in rows})
    for start in range(0, len(ids), PORTION):
        of_these = rigs.c.station_id.in_(ids[start : start + PORTION])
        for station_id, name in connection.execute(select(rigs.c.station_id, rigs.c.name).where(of_these)):
            known[station_id].append(name)
    return tuple(record_of(StationRecord, row, rigs=tuple(known[row["station_id"]])) for row in rows)


def _results(
    connection: Connection, table: Table, kind: type[_Record], cycle_ids: list[int]
) -> dict[int, list[_Record]]:
    found: dict[int, list[_Record]] = defaultdict(list)
    for start in range(0, len(cycle_ids), PORTION):
        query = select(table).where(table.c.cycle_id.in_(cycle_ids[start : start + PORTION]))
        for row in connection.execute(query).mappings():
            found[row["cycle_id"]].append(record_of(kind, row))
    return found


# What is shipped, by the name it has in the outbox.
RECORD_OF_KIND: dict[str, type] = {
    "station": StationRecord,
    "limits": VehicleTypeRecord,
    "calibration": CalibrationRecord,
    "installation": InstallationRecord,
    "check": CalibrationCheckRecord,
    "zero": ZeroRecord,
    "revocation": ZeroRevocation,
    "event": EventRecord,
    "cycle": CycleRecord,
    "study": GaugeStudyRecord,
    "study_value": GaugeValueRecord,
    "shot": ArchivedShotRecord,
    "removal": ArchiveRemoval,
    "concession": ConcessionRecord,
    "withdrawal": ConcessionWithdrawal,
    "doubt": DoubtRecord,
    "doubt_closing": DoubtClosing,
}
KIND_OF = {record: name for name, record in RECORD_OF_KIND.items()}
_KEYS = {
    "calibration": "id",
    "zero": "id",
    "revocation": "zero_id",
    "removal": "shot",
    "withdrawal": "concession",
    "doubt_closing": "doubt",
}
_SIMPLE: dict[str, tuple[Select[Any], Any]] = {
    "cycle": (CYCLES, cycles.c.uuid),
    "station": (STATIONS, station_versions.c.uuid),
    "limits": (LIMITS, vehicle_type_limits.c.uuid),
    "calibration": (select(calibrations), calibrations.c.id),
    "installation": (INSTALLATIONS, installations.c.uuid),
    "check": (select(calibration_checks), calibration_checks.c.uuid),
    "zero": (select(zero_measurements), zero_measurements.c.id),
    "revocation": (select(zero_revocations), zero_revocations.c.zero_id),
    "event": (select(events), events.c.uuid),
    "study": (select(gauge_studies), gauge_studies.c.uuid),
    "study_value": (STUDY_VALUES, gauge_values.c.uuid),
    "shot": (SHOTS, archived_shots.c.uuid),
    "removal": (REMOVALS, archived_shots.c.uuid),
    "concession": (CONCESSIONS, concessions.c.uuid),
    "withdrawal": (WITHDRAWALS, concessions.c.uuid),
    "doubt": (select(doubts), doubts.c.uuid),
    "doubt_closing": (select(doubt_closings), doubt_closings.c.doubt),
}


def query_of(kind: str) -> tuple[Select[Any], Any, bool]:
    """The query of the own rows of a kind, the column that is their key, and whether that is a UUID."""
    query, column = _SIMPLE[kind]
    return query, column, isinstance(column.type, Uuid)


def key_of(record: Any) -> str:
    """What names a record in the outbox: its id, or the 32 digits of its UUID."""
    key = getattr(record, _KEYS.get(KIND_OF[type(record)], "uuid"))
    return key.hex if isinstance(key, UUID) else str(key)


def load_records(connection: Connection, kind: str, keys: Sequence[str]) -> dict[str, Any]:
    """The stored records of one kind, by their keys in the outbox; what is not there is left out."""
    found: list[Any] = []
    for start in range(0, len(keys), PORTION):
        portion = keys[start : start + PORTION]
        if kind == "cycle":
            query = CYCLES.where(cycles.c.uuid.in_(map(UUID, portion)))
            found += [stored.record for stored in read_cycles(connection, query)]
        elif kind == "station":
            query = STATIONS.where(station_versions.c.uuid.in_(map(UUID, portion)))
            found += read_stations(connection, query)
        else:
            query, column, by_uuid = query_of(kind)
            wanted: Iterable[Any] = map(UUID, portion) if by_uuid else portion
            rows = connection.execute(query.where(column.in_(wanted))).mappings()
            found += [record_of(RECORD_OF_KIND[kind], row) for row in rows]
    return {key_of(record): record for record in found}
