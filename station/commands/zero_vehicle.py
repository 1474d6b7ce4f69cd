"""`truewheel zero measure-vehicle`: zero measurements of all rigs against a master vehicle."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from station.commands.database import DatabaseOption
from station.commands.output import GOAL_MISSED, JsonFlag, print_json, reason_of_force
from station.commands.outputs import ready_database
from station.commands.zero import zero_as_json, zero_line

if TYPE_CHECKING:
    from alignment.values import MeasureSettings, RigCalibration
    from db.records import ZeroRecord
    from station.calibration import LengthFound, SeenMaster
    from station.commands.measure_vehicle import MeasuredWheel


def measure_vehicle_zeros_command(
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="DIR",
            help="Folder of the master vehicle, as measure-vehicle takes it: vehicle.json, and for each rig "
            "its calibration and a shot, or turn_01 … of a wheel that was turned.",
            show_default=False,
        ),
    ],
    certificate: Annotated[
        Path, typer.Option(help="TOML file: certified angles and lengths.", show_default=False)
    ],
    database: DatabaseOption,
    config: Annotated[
        Path | None,
        typer.Option(
            help="Station's configuration whose [measure], [stand] and [zero] count.", show_default=False
        ),
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Store them though one is larger than what is believed.")
    ] = False,
    reason: Annotated[str, typer.Option(help="Why it is forced, for the record.", show_default=False)] = "",
    as_json: JsonFlag = False,
) -> None:
    """Measure a master vehicle and store a zero measurement of every rig; none when one wheel is refused.

    Its toes are certified against its own centreline; it may stand askew. Its lengths are compared, and
    correct nothing: what is wrong with them is wrong with the common frame of the rigs.
    """
    from alignment.values import MeasureSettings
    from sensors.formats import VEHICLE_FILE, read_vehicle_facts
    from station.calibration import LARGEST_ZERO, lengths_found, read_master_vehicle, vehicle_zeros
    from station.commands.measure_vehicle import geometry_of_wheels, measured_wheel, recorded_wheels
    from station.configuration import StandOptions, read_configuration

    ready_database(database)
    forced_reason = reason_of_force(force, reason, "zero measurement")
    master = read_master_vehicle(certificate)
    settings, options, largest = MeasureSettings(), StandOptions(), LARGEST_ZERO
    if config is not None:
        station = read_configuration(config).settings
        settings, options = station.measure.settings(), station.stand
        largest = math.radians(station.zero.largest_arcmin / 60.0)
    vehicle = read_vehicle_facts(folder / VEHICLE_FILE)
    if vehicle.road_z_mm is not None:
        options = options.model_copy(update={"road_z_mm": vehicle.road_z_mm})
    wheels = [measured_wheel(one, settings, as_json) for one in recorded_wheels(folder, vehicle)]
    geometry = geometry_of_wheels(folder, vehicle, wheels, options.stand(), settings.coverage_factor)
    seen, reasons = _seen(wheels, settings)
    if geometry is None or geometry.missing:
        said = "; ".join(reasons) or "expected four wheels whose places are known"
        if as_json:
            print_json({"outcome": "refused", "reason": said})
        else:
            typer.echo(f"refused: {said}")
        raise typer.Exit(GOAL_MISSED)
    zeros = vehicle_zeros(seen, geometry, master, settings.maximum_angle, largest, forced_reason)
    _store(database, [folder / one.recorded.calibration.rig / "calibration.json" for one in wheels], zeros)
    lengths = lengths_found(master, geometry)
    if as_json:
        print_json(_told(zeros, lengths, math.degrees(geometry.value("yaw"))))
        return
    for record in zeros:
        typer.echo(f"stored {record.id}: {zero_line(record)}")
    for each in lengths:
        typer.echo(
            f"{each.name.replace('_', ' ')}: measured less certified {each.value - each.certified:+.3f} mm "
            f"± {each.u95:.3f} mm"
        )


def _seen(
    wheels: list[MeasuredWheel], settings: MeasureSettings
) -> tuple[dict[str, tuple[SeenMaster, RigCalibration]], list[str]]:
    """Return the wheels as the rigs measured them, and why others were not."""
    from alignment.prepared import PreparedRig
    from alignment.values import Refusal
    from sensors.formats import read_shot
    from station.calibration import SeenMaster

    seen, reasons = {}, []
    for one in wheels:
        recorded = one.recorded
        if isinstance(one.found, Refusal):
            reasons.append(f"{recorded.wheel}: {one.found.reason}")
            continue
        taken = read_shot(recorded.shots[-1], recorded.calibration).time_utc
        common = PreparedRig.of(recorded.calibration, settings).angle_covariance
        master = SeenMaster(one.found, len(recorded.shots), taken, common)
        seen[recorded.wheel] = (master, recorded.calibration)
    return seen, reasons


def _store(database: str, calibrations: list[Path], zeros: tuple[ZeroRecord, ...]) -> None:
    from db.records import CalibrationRecord
    from db.store import ResultStore
    from sensors.formats import read_calibration_file

    files = [read_calibration_file(path) for path in calibrations]
    with ResultStore(database) as store:
        for file in files:
            document = file.model_dump(mode="json", by_alias=True)
            store.record_calibration(CalibrationRecord(file.id, file.rig, file.created_utc, document))
        store.record_zeros(zeros)


def _told(zeros: tuple[ZeroRecord, ...], lengths: tuple[LengthFound, ...], yaw_deg: float) -> dict[str, Any]:
    return {
        "outcome": "measured", "reason": None, "yaw_deg": yaw_deg,
        "zero_measurements": [zero_as_json(record) for record in zeros],
        "lengths": {
            each.name: {
                "measured_mm": each.value, "certified_mm": each.certified, "difference_u95_mm": each.u95,
            }
            for each in lengths
        },
    }  # fmt: skip
