"""The station's store: its own database, the work beside it, and what the station says of itself there."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from datetime import datetime
from importlib.metadata import version
from uuid import UUID

from db.connection import station_lock
from db.records import InstallationRecord, Severity, StationRecord, VehicleTypeRecord
from db.store import ResultStore
from db.upkeep import BackgroundWork, Policy, Shipper, StoreHealth
from station.configuration import ArchiveSettings, Configuration, LengthTolerance, Tolerance, VehicleType
from station.cycle import WheelPosition
from station.store.archive import ImageArchive
from station.store.keeping import Keeping


@dataclass(frozen=True, eq=False)
class StationStore:
    """An open store, with the work beside it."""

    results: ResultStore
    background: BackgroundWork

    @property
    def health(self) -> StoreHealth:
        """How the store is, as screens and the maintainer want to know it."""
        return self.background.health


@contextmanager
def open_store(configuration: Configuration) -> Iterator[StationStore]:
    """Open the station's database, and ship from it when a central one is configured.

    Raises
    ------
    StoreError
        When the database cannot be used, or another program is this station on it already. A central database
        that is away is no reason: it shows in the health.
    """
    database, station = configuration.settings.database, configuration.settings.station.id
    url = configuration.database_url
    with ExitStack() as stack:
        results = stack.enter_context(ResultStore(url, create=database.create, timeout_s=database.timeout_s))
        stack.enter_context(station_lock(url, station, database.timeout_s))
        shipper = None
        if database.central_url is not None:
            shipper = Shipper(url, database.central_url, station, timeout_s=database.timeout_s)
        background = BackgroundWork(
            results, url, station, shipper, minimum_free_bytes=int(1e6 * database.minimum_free_mb)
        )
        stack.enter_context(background)
        yield StationStore(results, background)


def describe_station(
    store: ResultStore, configuration: Configuration, positions: Sequence[WheelPosition], now: datetime
) -> None:
    """Record what this station is, judges by and measures with, as far as it is new; after calibrations."""
    settings = configuration.settings
    name = settings.station.id
    store.describe_station(
        StationRecord(
            station=name,
            plant=settings.station.plant,
            label=settings.station.name,
            valid_from_utc=now,
            software_version=version("truewheel"),
            config_hash=configuration.hash,
            # As the hash, without what decides no result and may hold a password.
            configuration=configuration.content({"database": True, "archive": True}),
            rigs=tuple(position.name for position in positions),
        ),
        [
            VehicleTypeRecord(name, kind.name, now, kind.guard_band, limits_of(kind))
            for kind in configuration.vehicle_types.values()
        ],
        [
            InstallationRecord(name, position.name, position.in_force.record().id, now)
            for position in positions
        ],
    )


def open_archive(configuration: Configuration, store: StationStore) -> ImageArchive | None:
    """Return the archive of images, to be entered; None when none is configured."""
    settings = configuration.settings.archive
    if settings is None:
        return None

    def note(text: str, cycle: UUID | None) -> None:
        store.background.note(Severity.WARNING, "images_not_archived", text, cycle)

    folder = configuration.path(settings.folder)
    return ImageArchive(
        store.results,
        folder,
        archive_policy(settings),
        Keeping(settings.keep, settings.every),
        note,
        closing_s=settings.closing_s,
        kinds={kind.name: kind for kind in configuration.vehicle_types.values()},
    )


def archive_policy(settings: ArchiveSettings) -> Policy:
    """What the configuration keeps of the images."""
    return Policy(int(1e9 * settings.most_gb), settings.ordinary_days, settings.evidence_days)


def limits_of(kind: VehicleType) -> dict[str, dict[str, list[float]]]:
    """The limits of a vehicle type in radians and millimetres, as `VehicleTypeRecord` holds them."""

    def pair(tolerance: Tolerance | LengthTolerance) -> list[float]:
        limits = tolerance.limits()
        return [limits.low, limits.high]

    found: dict[str, dict[str, list[float]]] = {}
    for axle, tolerances in kind.axles.items():
        given = {
            "camber": tolerances.camber,
            "toe": tolerances.toe,
            "total_toe": tolerances.total_toe,
            "camber_difference": tolerances.camber_difference,
        }
        found[axle] = {angle: pair(tolerance) for angle, tolerance in given.items() if tolerance is not None}
    of_vehicle: dict[str, Tolerance | LengthTolerance | None] = {
        "thrust_angle": kind.thrust_angle,
        "yaw": kind.yaw,
        **kind.lengths.stated,
        "steering_wheel_offset": None if kind.steering is None else kind.steering.offset,
    }
    given_vehicle = {name: pair(tolerance) for name, tolerance in of_vehicle.items() if tolerance is not None}
    if given_vehicle:
        found["vehicle"] = given_vehicle
    if kind.steering_axis.stated:
        found["steering_axis"] = {
            name: pair(tolerance) for name, tolerance in kind.steering_axis.stated.items()
        }
    return found
