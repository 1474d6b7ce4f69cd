"""Archived images with the results that they belong to, for who measures them again."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from uuid import UUID

from sqlalchemy import select

from db.queries.reader import ResultReader, question
from db.records import (
    ArchivedShotRecord,
    CalibrationRecord,
    CycleRecord,
    StationRecord,
    ZeroRecord,
    check_text,
)
from db.rows import (
    CYCLES,
    SHOTS,
    STATIONS,
    ZEROS,
    load_records,
    read_cycles,
    read_stations,
    read_zeros,
    record_of,
)
from db.schema import (
    archive_removals,
    archived_shots,
    cycles,
    station_versions,
    stations,
    vehicles,
    zero_measurements,
)

_PORTION = 500
"""Cycles or images that one question takes at most."""


@dataclass(frozen=True)
class ArchivedCycle:
    """A cycle, its images that are still kept, and the zero measurements that corrected its wheels, by id."""

    record: CycleRecord
    shots: tuple[ArchivedShotRecord, ...]
    zeros: dict[str, ZeroRecord]


@question
def archived_cycles(reader: ResultReader, uuids: Sequence[UUID]) -> dict[UUID, ArchivedCycle]:
    """Those of some cycles that are stored; at most `_PORTION` in one question."""
    found: dict[UUID, ArchivedCycle] = {}
    with reader.transaction() as connection:
        for start in range(0, len(uuids), _PORTION):
            portion = uuids[start : start + _PORTION]
            records = [c.record for c in read_cycles(connection, CYCLES.where(cycles.c.uuid.in_(portion)))]
            rows = connection.execute(SHOTS.where(cycles.c.uuid.in_(portion), _KEPT)).mappings()
            shots = [record_of(ArchivedShotRecord, row) for row in rows]
            names = {w.zero_measurement_id for record in records for w in record.wheels} - {None}
            of_wheels = ZEROS.where(zero_measurements.c.id.in_(names))
            zeros = {each.record.id: each.record for each in read_zeros(connection, of_wheels)}
            for record in records:
                mine = tuple(shot for shot in shots if shot.cycle == record.uuid)
                found[record.uuid] = ArchivedCycle(record, mine, zeros)
    return found


def kept_images(reader: ResultReader, at: Sequence[str]) -> Iterator[ArchivedShotRecord]:
    """All images of some stations that the database promises, as they were archived; portion by portion."""
    last = 0
    while portion := _kept_after(reader, at, last):
        last = portion[-1][0]
        yield from (record for _, record in portion)


@question
def _kept_after(reader: ResultReader, at: Sequence[str], last: int) -> list[tuple[int, ArchivedShotRecord]]:
    of_these = _KEPT & cycles.c.station.in_(at)
    query = SHOTS.where(of_these, archived_shots.c.id > last).order_by(archived_shots.c.id).limit(_PORTION)
    with reader.transaction() as connection:
        rows = connection.execute(query).mappings()
        return [(row["id"], record_of(ArchivedShotRecord, row)) for row in rows]


@question
def cycles_of_vin(reader: ResultReader, vin: str) -> tuple[UUID, ...]:
    """The cycles of a vehicle, in the order in which they were stored."""
    check_text("vin", vin)
    with reader.transaction() as connection:
        of_vehicle = cycles.join(vehicles, cycles.c.vehicle_id == vehicles.c.id)
        query = select(cycles.c.uuid).select_from(of_vehicle).where(vehicles.c.vin == vin)
        return tuple(connection.execute(query.order_by(cycles.c.id)).scalars())


@question
def calibrations_by_id(reader: ResultReader, ids: Sequence[str]) -> dict[str, CalibrationRecord]:
    """Those of some calibrations that are stored."""
    with reader.transaction() as connection:
        return dict(load_records(connection, "calibration", list(ids)))


@question
def configuration_in_force(reader: ResultReader, station: str, config_hash: str) -> StationRecord | None:
    """A station as it was when its configuration had this hash; None where nothing says it."""
    same = (stations.c.name == station) & (station_versions.c.config_hash == config_hash)
    with reader.transaction() as connection:
        query = STATIONS.where(same).order_by(station_versions.c.id).limit(1)
        return next(iter(read_stations(connection, query)), None)


_KEPT = ~select(archive_removals.c.shot_id).where(archive_removals.c.shot_id == archived_shots.c.id).exists()
