"""The station's configuration: one TOML file, every field described, every number bounded."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, create_model, model_validator

from alignment.errors import ConfigurationError, DegenerateInputError, told
from alignment.file_limits import TEXT
from alignment.vehicle import Stand
from alignment.wheel import FEWEST_EXPOSURES, MOST_EXPOSURES
from sensors.camera import CameraSettings
from sensors.formats import FilePath, Name, StrictModel, load_toml, read_bytes, validate
from sensors.frames import FrameTolerance
from station.configuration.archive import ArchiveSettings
from station.configuration.health import HealthOptions
from station.configuration.master_check import MasterCheckOptions
from station.configuration.measure import MeasureOptions
from station.configuration.projectors import projectors_named
from station.configuration.rigs import MOST_RIGS, RigSettings, drivers_named, rig_model
from station.configuration.vehicle_types import (
    LEAST_TURN_DEG,
    MOST_TURN_DEG,
    QUANTITY,
    Label,
    Measured,
    VehicleType,
    check_series,
    read_vehicle_types,
)

Seconds = Annotated[float, Field(gt=0, le=600)]


class StationSettings(StrictModel):
    """Who this station is."""

    id: Name = Field(description="Identity of the station in every record")
    name: Label = Field(description="Name for people")
    plant: Label = Field(description="Plant it stands in")


class DatabaseSettings(StrictModel):
    """Where results go."""

    url: str = Field(
        min_length=1,
        max_length=1000,
        description="'sqlite:///FILE', a relative FILE being relative to this file's folder, or "
        "'postgresql://USER@HOST/DATABASE'",
    )
    create: bool = Field(
        default=False, description="Make the database when it is missing, which a production server forbids"
    )
    timeout_s: Seconds = Field(default=5.0, description="Longest wait for one commit, seconds")
    central_url: str | None = Field(
        default=None,
        min_length=1,
        max_length=1000,
        description="Central database, to which results are shipped in the background from this station's own"
        " SQLite file; none without",
    )
    minimum_free_mb: float = Field(
        default=500.0, ge=0, le=1e7, description="Less room on the disk than this is reported, megabytes"
    )


class LineSettings(StrictModel):
    """The bus to the PLC."""

    interface: str = Field(
        default="virtual",
        pattern=r"^[a-z0-9_]{1,40}$",
        description="Kind of interface, as python-can names it",
    )
    channel: str = Field(min_length=1, max_length=200, description="Channel of the interface, such as can0")
    bitrate: int = Field(default=500_000, ge=10_000, le=1_000_000, description="Bits per second")
    options: dict[Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,40}$")], bool | int | float | str] = Field(
        default={}, description="Further arguments of the interface, as python-can names them"
    )
    dbc: FilePath = Field(description="File that describes the messages")
    log: FilePath | None = Field(
        default=None,
        description="File for all traffic: .log (candump), .asc or .blf; older ones are kept beside it as "
        "NAME.1.log, NAME.2.log, …; no log without",
    )
    log_mb: float = Field(
        default=100.0, ge=0.01, le=10_000, description="Size at which a new file is begun, megabytes"
    )
    log_files: int = Field(
        default=10, ge=1, le=1000, description="Files of the log that are kept, the current one included"
    )
    acknowledge_timeout_s: Seconds = Field(
        default=2.0,
        description="After so long without acknowledgement an event is recorded; results stay held, seconds",
    )
    communication_timeout_s: Seconds | None = Field(
        default=None,
        description="Without a good Command frame for so long the PLC counts as lost, seconds; the DBC's "
        "timeout without",
    )


class CycleSettings(StrictModel):
    """Bounds of one measuring cycle."""

    shoot_timeout_s: Seconds = Field(
        default=2.0, description="Longest wait for the images of one wheel, seconds"
    )
    measure_timeout_s: Seconds = Field(
        default=30.0, description="Longest time from the first exposure to the last angle, seconds"
    )
    image_folder: FilePath | None = Field(
        default=None,
        description="Folder for the images of the line's mode calibrate; without it that mode is refused",
    )
    adjust_timeout_s: float = Field(
        default=600.0,
        gt=0,
        le=7200,
        description="Longest time of adjusting before the cycle is aborted, seconds",
    )
    live_max_age_s: Seconds = Field(
        default=1.0, description="Live angles older than this are shown as stale, seconds"
    )
    calibration_max_age_days: float = Field(
        default=365.0, gt=0, le=36_500, description="A calibration older than this gives no verdict, days"
    )
    measure: Measured = Field(default="tyre_plane", description=QUANTITY)
    exposures: int = Field(
        default=16, ge=FEWEST_EXPOSURES, le=MOST_EXPOSURES, description="Exposures of a wheel that turns"
    )
    least_turn_deg: float = Field(
        default=600.0,
        ge=LEAST_TURN_DEG,
        le=MOST_TURN_DEG,
        description="Least turn of the wheel from the first of them to the last, degrees",
    )
    exposure_interval_s: float = Field(
        default=0.25,
        ge=0,
        le=10,
        description="Time from one exposure of a wheel that turns to the next, seconds; best such that all of"
        " them go twice round",
    )

    @model_validator(mode="after")
    def _series_is_possible(self) -> CycleSettings:
        check_series(self.exposures, self.least_turn_deg)
        if self.measure == "spin_axis":
            self.check_time(self.exposures)
        return self

    def check_time(self, exposures: int) -> None:
        """Refuse so many exposures that they take longer than a measurement may."""
        taken_s = (exposures - 1) * self.exposure_interval_s
        if taken_s >= self.measure_timeout_s:
            raise DegenerateInputError(
                field="exposures",
                expected=f"so many that they take less than measure_timeout_s, {self.measure_timeout_s:g} s",
                seen=f"{exposures}, every {self.exposure_interval_s:g} s: {taken_s:g} s",
                cure="Take fewer, or allow a longer measure_timeout_s",
            )


class CameraOptions(StrictModel):
    """What every camera is told."""

    exposure_ms: float = Field(default=5.0, gt=0, le=1000, description="Exposure time, milliseconds")
    gain_db: float = Field(default=0.0, ge=0, le=60, description="Analogue gain, decibels")

    call_timeout_s: Seconds = Field(
        default=10.0,
        description="A camera whose driver does not come back from connecting, arming or closing for so long"
        " is lost, seconds",
    )
    clock_tolerance_ms: float = Field(
        default=20.0,
        ge=0,
        le=60_000,
        description="Frames of one shot whose cameras' clocks differ by more make the shot fail, "
        "milliseconds; 0 leaves the clocks uncompared",
    )
    clocks_synchronised: bool = Field(
        default=False,
        description="The cameras' clocks show the same time, as with PTP; otherwise what passed since the "
        "shot before is compared",
    )

    def tolerance(self) -> FrameTolerance:
        """Return what the frames of one shot may differ by."""
        return FrameTolerance(self.clock_tolerance_ms / 1e3, self.clocks_synchronised)

    def settings(self) -> CameraSettings:
        """Return the value that the drivers take."""
        return CameraSettings(self.exposure_ms, self.gain_db)


class StandOptions(StrictModel):
    """The stand as a frame of its rigs, and what toe and thrust angle refer to."""

    reference: Literal["vehicle", "stand"] | None = Field(
        default=None,
        description="What toe and thrust angle refer to: the vehicle's own centreline, or the stand's axis"
        " where a stand clamps the vehicle. Without it: the vehicle where a gauge frame placed the rigs of"
        " all four wheels, else the stand",
    )
    road_z_mm: float | None = Field(
        default=None,
        ge=-2000,
        le=2000,
        description="Height of the wheel supports in the gauge frame's vehicle frame, millimetres; with it"
        " and the tyres' widths lengths are between contact centres, else between wheel centres",
    )
    temperature_sigma_k: float = Field(
        default=2.0,
        ge=0,
        le=30,
        description="How far the stand's temperature may be from that at which its rigs were placed, one"
        " standard deviation, kelvin; it is part of the uncertainty of lengths",
    )
    gradient_sigma_k_per_m: float = Field(
        default=0.2,
        ge=0,
        le=10,
        description="How unevenly warm the stand may have become, one standard deviation along each axis,"
        " kelvin per metre; it is part of the uncertainty of toe",
    )
    expansion_ppm_per_k: float = Field(
        default=12.0, ge=0, le=40, description="Expansion of the stand's frame per kelvin, millionths"
    )

    def stand(self) -> Stand:
        """Return the value that the mathematics uses."""
        return Stand(
            self.road_z_mm,
            self.temperature_sigma_k,
            self.gradient_sigma_k_per_m,
            1e-6 * self.expansion_ppm_per_k,
        )


class ZeroOptions(StrictModel):
    """What is believed of a zero measurement."""

    largest_arcmin: float = Field(
        default=10.0,
        gt=0,
        le=120,
        description="Largest measured less certified angle of a master wheel that needs no reason, "
        "arcminutes",
    )


class StationConfig(StrictModel):
    """What ``station.toml`` holds; paths are relative to its folder."""

    station: StationSettings = Field(description="Who this station is")
    database: DatabaseSettings = Field(description="Where results go")
    archive: ArchiveSettings | None = Field(default=None, description="Where images are kept; none without")
    line: LineSettings = Field(description="The bus to the PLC")
    vehicle_types: FilePath = Field(description="Folder with one TOML file per vehicle type")
    cycle: CycleSettings = Field(default=CycleSettings(), description="Bounds of one measuring cycle")
    cameras: CameraOptions = Field(default=CameraOptions(), description="What every camera is told")
    health: HealthOptions = Field(default=HealthOptions(), description="When cameras are warned of")
    measure: MeasureOptions = Field(default=MeasureOptions(), description="Choices of the measurement")
    stand: StandOptions = Field(
        default=StandOptions(), description="The frame of the rigs, and what toe refers to"
    )
    master_check: MasterCheckOptions | None = Field(
        default=None, description="When a check with a master is due; never without"
    )
    zero: ZeroOptions = Field(default=ZeroOptions(), description="What is believed of a zero measurement")
    rigs: tuple[RigSettings, ...] = Field(
        min_length=1, max_length=MOST_RIGS, description="One per wheel position"
    )

    @model_validator(mode="after")
    def _rigs_differ(self) -> StationConfig:
        names = [rig.name for rig in self.rigs]
        if len(set(names)) < len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise DegenerateInputError(
                field="rigs", expected="rigs with different names", seen=f"'{twice}' twice"
            )
        return self


def station_model(drivers: Collection[str], projectors: Collection[str] = ()) -> type[StationConfig]:
    """Return the model of a station's file with the tables of its drivers; these drivers are imported."""
    rigs = StationConfig.model_fields["rigs"]
    return create_model(
        "StationConfig",
        __base__=StationConfig,
        __doc__=StationConfig.__doc__,
        rigs=(tuple[rig_model(drivers, projectors), ...], rigs),  # type: ignore[arg-type, misc]
    )


@dataclass(frozen=True)
class Configuration:
    """A station's configuration with everything it refers to.

    Attributes
    ----------
    file
        Where it was read; relative paths start at its folder.
    settings
        Its content.
    vehicle_types
        By number.
    """

    file: Path
    settings: StationConfig
    vehicle_types: Mapping[int, VehicleType]

    def path(self, relative: str) -> Path:
        """Return a path of the file as one that can be opened."""
        return self.file.parent / relative

    @property
    def database_url(self) -> str:
        """The database URL, an SQLite file relative to the configuration resolved."""
        prefix = "sqlite:///"
        url = self.settings.database.url
        if not url.startswith(prefix):
            return url
        name, mark, options = url.removeprefix(prefix).partition("?")
        return f"{prefix}{self.path(name)}{mark}{options}" if name and name != ":memory:" else url

    def content(self, left_out: dict[str, bool | set[str]]) -> dict[str, Any]:
        """Return the settings as plain values, without what is left out or not said.

        Drivers that other packages brought are named with their versions: they decide results too.
        """
        try:
            content = self.settings.model_dump(
                mode="json", by_alias=True, exclude_none=True, exclude=left_out
            )
        except Exception as error:
            # Ours can be written; the settings of a foreign driver may be anything.
            raise ConfigurationError(
                file=self.file,
                field="rigs",
                expected="settings of camera drivers that can be written as JSON",
                seen=told(error),
                cure="Ask the makers of the driver for a version that fits truewheel",
            ) from error
        foreign = {
            rig.driver: str(rig.cameras.installed)
            for rig in self.settings.rigs
            if rig.cameras.installed.foreign
        }
        lights = {
            light.driver: str(light.projector.installed)
            for light in (rig.projector for rig in self.settings.rigs)
            if light is not None and light.projector.installed.foreign
        }
        named = {"drivers": foreign, "projectors": lights}
        return content | {key: value for key, value in named.items() if value}

    @property
    def hash(self) -> str:
        """SHA-256 of what decides results: settings, drivers, vehicle types, DBC; every record carries it.

        Where results are stored is left out: it changes none, and may hold a password. So is the bus's log.
        """
        content = {
            "station": self.content(
                {"database": True, "archive": True, "line": {"log", "log_mb", "log_files"}}
            ),
            "vehicle_types": [kind.model_dump(mode="json") for _, kind in sorted(self.vehicle_types.items())],
            "dbc": hashlib.sha256(read_bytes(self.path(self.settings.line.dbc), "a DBC", TEXT)).hexdigest(),
        }
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def read_station(path: Path) -> StationConfig:
    """Read a station's file alone, without what it refers to.

    Raises
    ------
    ConfigurationError
        As `read_configuration`.
    """
    data = load_toml(path, "a station's configuration")
    rigs = data.get("rigs")
    model = station_model(drivers_named(rigs), projectors_named(rigs))
    return validate(model, data, file=path, error=ConfigurationError)


def read_configuration(path: Path) -> Configuration:
    """Read a station's configuration and the vehicle types it names.

    Raises
    ------
    ConfigurationError
        When one of the files is missing, a field of one is missing, unknown or out of range, or a camera
        driver that it names cannot be loaded.
    """
    settings = read_station(path)
    for field, name, found in (
        ("line.dbc", settings.line.dbc, (path.parent / settings.line.dbc).exists()),
        ("vehicle_types", settings.vehicle_types, (path.parent / settings.vehicle_types).is_dir()),
    ):
        if not found:
            raise ConfigurationError(
                file=path, field=field, expected="a file or folder that exists", seen=f"'{name}'"
            )
    types = read_vehicle_types(path.parent / settings.vehicle_types)
    for kind in types.values():
        _check_series_of(kind, settings.cycle, path)
    return Configuration(path, settings, types)


def _check_series_of(kind: VehicleType, cycle: CycleSettings, path: Path) -> None:
    """Refuse a vehicle type whose series the station cannot take."""
    exposures = kind.exposures or cycle.exposures
    try:
        check_series(exposures, kind.least_turn_deg or cycle.least_turn_deg)
        if (kind.measure or cycle.measure) == "spin_axis":
            cycle.check_time(exposures)
    except DegenerateInputError as error:
        raise ConfigurationError(
            file=path,
            field=f"cycle.{error.field} with the vehicle type '{kind.name}'",
            expected=error.expected,
            seen=error.seen,
            cure=error.cure,
        ) from error
