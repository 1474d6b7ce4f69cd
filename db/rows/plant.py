"""What a station says of itself at its start, as far as it is new."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from sqlalchemy import ColumnElement, Connection, Select, Table, select

from db.records import InstallationRecord, StationRecord, VehicleTypeRecord
from db.rows.reading import INSTALLATIONS, LIMITS, STATIONS, read_stations, record_of
from db.schema import installations, rigs, station_versions, stations, vehicle_type_limits


def changed(
    connection: Connection,
    station: StationRecord,
    limits: Sequence[VehicleTypeRecord],
    rigs_use: Sequence[InstallationRecord],
) -> Iterator[StationRecord | VehicleTypeRecord | InstallationRecord]:
    """The records that differ from the newest that are stored of the same station, type or rig."""
    station_id = _id(connection, stations, stations.c.name == station.station)
    known = read_stations(
        connection, _newest(STATIONS.where(station_versions.c.station_id == station_id), station_versions)
    )
    if not known or _content(known[0]) != _content(station):
        yield station
    for limit in limits:
        same = (vehicle_type_limits.c.station_id == station_id) & (
            vehicle_type_limits.c.vehicle_type == limit.vehicle_type
        )
        row = connection.execute(_newest(LIMITS.where(same), vehicle_type_limits)).mappings().one_or_none()
        if row is None or _content(record_of(VehicleTypeRecord, row)) != _content(limit):
            yield limit
    for use in rigs_use:
        rig_id = _id(connection, rigs, (rigs.c.station_id == station_id) & (rigs.c.name == use.rig))
        of_rig = installations.c.rig_id == rig_id
        row = connection.execute(_newest(INSTALLATIONS.where(of_rig), installations)).mappings().one_or_none()
        if row is None or row["calibration_id"] != use.calibration_id:
            yield use


def _id(connection: Connection, table: Table, condition: ColumnElement[bool]) -> int | None:
    # Looked up first: behind a join no index would give the newest, and all would be read.
    return connection.execute(select(table.c.id).where(condition)).scalar_one_or_none()


def _newest(query: Select[Any], table: Any) -> Select[Any]:
    return query.order_by(table.c.id.desc()).limit(1)


def _content(record: StationRecord | VehicleTypeRecord) -> tuple[object, ...]:
    # What was true before does not become news by a new start.
    if isinstance(record, StationRecord):
        return record.plant, record.label, record.software_version, record.config_hash, record.configuration
    return record.guard_band, record.limits
