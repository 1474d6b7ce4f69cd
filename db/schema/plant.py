"""Where things stand: plants, stations, rigs with their calibrations, and the limits they judged by."""

from __future__ import annotations

from sqlalchemy import Boolean, Column, ForeignKey, Index, Table, Text, UniqueConstraint, Uuid

from db.schema.base import JSON_DOCUMENT, UtcDateTime, check, id_column, metadata
from db.schema.results import calibrations

plants = Table(
    "plants",
    metadata,
    id_column(),
    Column("name", Text, nullable=False),
    # Serves "the stations of a plant".
    UniqueConstraint("name"),
    check("name_not_empty", "name <> ''"),
)

stations = Table(
    "stations",
    metadata,
    id_column(),
    # As in `cycles.station`.
    Column("name", Text, nullable=False),
    # Serves the way from a name to the sums of a station.
    UniqueConstraint("name"),
    check("name_not_empty", "name <> ''"),
)

station_versions = Table(
    "station_versions",
    metadata,
    id_column(),
    Column("uuid", Uuid, nullable=False),
    Column("station_id", ForeignKey(stations.c.id), nullable=False),
    Column("plant_id", ForeignKey(plants.c.id), nullable=False),
    Column("valid_from_utc", UtcDateTime, nullable=False),
    Column("label", Text, nullable=False),
    Column("software_version", Text, nullable=False),
    Column("config_hash", Text, nullable=False),
    # The whole configuration, which the hash in every cycle stands for.
    Column("configuration", JSON_DOCUMENT, nullable=False),
    Column("stored_utc", UtcDateTime, nullable=False),
    UniqueConstraint("uuid"),
    check("config_hash_not_empty", "config_hash <> ''"),
    # Serves "the configuration of a cycle", by station and hash, and the newest of a station.
    Index(None, "station_id", "config_hash", "valid_from_utc"),
    # Serves "the stations of a plant".
    Index(None, "plant_id"),
    # Serves what a station said last of itself, asked for at every start.
    Index(None, "station_id", "id"),
)

rigs = Table(
    "rigs",
    metadata,
    id_column(),
    Column("station_id", ForeignKey(stations.c.id), nullable=False),
    # As in `wheel_results.wheel` and `calibrations.rig`.
    Column("name", Text, nullable=False),
    # Serves "the rigs of a station".
    UniqueConstraint("station_id", "name"),
    check("name_not_empty", "name <> ''"),
)

installations = Table(
    "installations",
    metadata,
    id_column(),
    Column("uuid", Uuid, nullable=False),
    Column("rig_id", ForeignKey(rigs.c.id), nullable=False),
    Column("calibration_id", ForeignKey(calibrations.c.id), nullable=False),
    Column("from_utc", UtcDateTime, nullable=False),
    Column("stored_utc", UtcDateTime, nullable=False),
    UniqueConstraint("uuid"),
    # Serves "the calibration that this rig used then".
    Index(None, "rig_id", "from_utc"),
    # Serves the newest of a rig, asked for at every start.
    Index(None, "rig_id", "id"),
    # Serves "which station and rig does this check speak of".
    Index(None, "calibration_id"),
)

vehicle_type_limits = Table(
    "vehicle_type_limits",
    metadata,
    id_column(),
    Column("uuid", Uuid, nullable=False),
    Column("station_id", ForeignKey(stations.c.id), nullable=False),
    # As in `vehicles.vehicle_type`.
    Column("vehicle_type", Text, nullable=False),
    Column("valid_from_utc", UtcDateTime, nullable=False),
    Column("guard_band", Boolean, nullable=False),
    # Angle by angle: {"front": {"toe": [low, high], ...}, "vehicle": {"thrust_angle": [low, high]}}.
    Column("limits", JSON_DOCUMENT, nullable=False),
    Column("stored_utc", UtcDateTime, nullable=False),
    UniqueConstraint("uuid"),
    check("vehicle_type_not_empty", "vehicle_type <> ''"),
    # Serves "the limits of a type at a time".
    Index(None, "station_id", "vehicle_type", "valid_from_utc"),
    # Serves the newest of a type, asked for at every start.
    Index(None, "station_id", "vehicle_type", "id"),
)
