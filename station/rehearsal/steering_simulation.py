"""`truewheel simulate steering`: a vehicle whose front wheels are rendered at positions of the steering."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from sensors.formats import (
    STEERING_TRUTH_FILE,
    VEHICLE_FILE,
    SteeringTruth,
    SteeringTruthFile,
    write_shot,
    write_truth,
    write_vehicle,
)
from sensors.simulation import (
    FRONT_WHEELS,
    Optics,
    SimulatedStand,
    SteeredVehicle,
    Vehicle,
    WheelScene,
    truth_of,
)
from station.rehearsal.simulation import SimulationConfig, write_simulated_wheel, write_true_calibration
from station.rehearsal.vehicle_simulation import Photographer, stated_vehicle


def write_steered_vehicle(
    folder: Path,
    config: SimulationConfig,
    steered: SteeredVehicle,
    stand: SimulatedStand,
    steers: tuple[float, ...],
    *,
    tyre_width_sigma_mm: float = 0.0,
    shot_done: Callable[[], None] = lambda: None,
) -> SteeringTruthFile:
    """Render a vehicle at positions of its steering into a new folder.

    Parameters
    ----------
    folder
        New; gets ``vehicle.json``, ``steering_truth.json`` and a folder for each rig: ``pos_01`` … of the
        front wheels, one shot of the rear ones straight ahead.
    config
        Light and cameras.
    steered, stand
        What is rendered, and the rigs.
    steers
        Angles of the rack, radians, positive to the left.
    tyre_width_sigma_mm
        Stated in ``vehicle.json``.
    shot_done
        Called after each shot.

    Raises
    ------
    FormatError
        When the folder holds something already or cannot be written.
    """
    straight = steered.at(0.0)
    photographers = {
        wheel: Photographer(straight, stand, wheel, config.cameras.settings()) for wheel in straight.corners
    }
    for number, steer in enumerate(steers, start=1):
        vehicle = steered.at(steer)
        for wheel in FRONT_WHEELS:
            scene = _scene(vehicle, wheel, stand, config)
            here = folder / wheel / f"pos_{number:02d}"
            write_shot(here, photographers[wheel].shot(scene, number))
            write_truth(here / "truth.json", truth_of(scene))
            shot_done()
    for wheel in FRONT_WHEELS:
        write_true_calibration(folder / wheel, stand.rigs[wheel])
    for wheel in straight.corners:
        if wheel not in FRONT_WHEELS:
            scene = _scene(straight, wheel, stand, config)
            shot = photographers[wheel].shot(scene, 1)
            write_simulated_wheel(folder / wheel, shot, truth_of(scene), stand.rigs[wheel])
            shot_done()
    truth = steering_truth(steered, steers)
    write_vehicle(folder / STEERING_TRUTH_FILE, truth)
    write_vehicle(folder / VEHICLE_FILE, stated_vehicle(straight, tyre_width_sigma_mm))
    return truth


def _scene(vehicle: Vehicle, wheel: str, stand: SimulatedStand, config: SimulationConfig) -> WheelScene:
    drawn = vehicle.scene(wheel, stand)
    return replace(drawn, ambient=config.ambient, optics=Optics(**config.optics.model_dump()))


def steering_truth(steered: SteeredVehicle, steers: tuple[float, ...]) -> SteeringTruthFile:
    """Return how a vehicle was steered; angles against its thrust line."""
    straight = steered.at(0.0)
    toe = {wheel: corner.angles[1] for wheel, corner in straight.corners.items()}
    thrust = 0.5 * (toe["rear_right"] - toe["rear_left"])
    wheels = {}
    for wheel in FRONT_WHEELS:
        geometry = steered.geometry[wheel]
        outboard = 1.0 if wheel.endswith("left") else -1.0
        (x, y, z), _ = steered.axis(wheel)
        ahead, left = _turned(x, y, thrust)
        caster, kpi = math.atan2(-ahead, z), math.atan2(-outboard * left, z)
        # From the contact centre to the axis, along the thrust line and across it.
        trail, inboard = _turned(geometry.trail_mm, -outboard * geometry.scrub_mm, thrust)
        wheels[wheel] = SteeringTruth(
            caster_deg=math.degrees(caster),
            kpi_deg=math.degrees(kpi),
            included_angle_deg=math.degrees(kpi + straight.corners[wheel].angles[0]),
            trail_mm=trail,
            scrub_mm=-outboard * inboard,
            give_deg=math.degrees(geometry.give),
            angles_deg=tuple(math.degrees(steered.wheel_angles(steer)[wheel]) for steer in steers),
        )
    return SteeringTruthFile(seed=steered.straight.seed, wheels=wheels)  # type: ignore[arg-type]


def _turned(x: float, y: float, by: float) -> tuple[float, float]:
    """A vector along and across a direction, radians counter-clockwise from x."""
    return math.cos(by) * x + math.sin(by) * y, math.cos(by) * y - math.sin(by) * x
