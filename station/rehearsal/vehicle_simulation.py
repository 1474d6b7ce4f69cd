"""`truewheel simulate vehicle`: four rendered wheels of one vehicle on a stand, and its truth."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from alignment.vehicle import FOUR_WHEELS
from sensors.camera import CameraSettings
from sensors.formats import (
    VEHICLE_FILE,
    VEHICLE_TRUTH_FILE,
    VehicleFile,
    VehicleTruthFile,
    WheelTruth,
    write_vehicle,
)
from sensors.shot import WheelShot
from sensors.simulation import (
    ROAD_Z_MM,
    Optics,
    Rollers,
    SimulatedStand,
    TurningWheel,
    Vehicle,
    WheelScene,
    simulate_shot,
    truth_of,
    truth_of_vehicle,
)
from station.rehearsal.simulation import SimulationConfig, write_simulated_wheel, write_turning_wheel


def write_simulated_vehicle(
    folder: Path,
    config: SimulationConfig,
    vehicle: Vehicle,
    stand: SimulatedStand,
    *,
    turns: int = 0,
    rollers: Rollers | None = None,
    tyre_width_sigma_mm: float = 0.0,
    wheel_done: Callable[[], None] = lambda: None,
) -> VehicleTruthFile:
    """Render a vehicle into a new folder: one folder for each rig, ``vehicle.json`` and ``truth.json``.

    Parameters
    ----------
    folder
        New.
    config
        Light and cameras; the rigs are the stand's, the tyres the vehicle's.
    vehicle, stand
        What is rendered.
    turns
        Exposures of wheels that rollers turn; 0 for wheels that stand.
    rollers
        What turns them.
    tyre_width_sigma_mm
        Stated in ``vehicle.json``.
    wheel_done
        Called after each wheel.

    Returns
    -------
    VehicleTruthFile
        Also written.

    Raises
    ------
    FormatError
        When the folder holds something already or cannot be written.
    """
    truths: dict[str, WheelTruth] = {}
    for wheel in FOUR_WHEELS:
        drawn = vehicle.scene(wheel, stand)
        scene = replace(drawn, ambient=config.ambient, optics=Optics(**config.optics.model_dump()))
        photographer = Photographer(vehicle, stand, wheel, config.cameras.settings())
        if turns:
            exposures = photographer.turning(scene, rollers or Rollers(), turns)
            truths[wheel] = write_turning_wheel(folder / wheel, exposures, stand.rigs[wheel])
        else:
            truths[wheel] = truth_of(scene)
            shot = photographer.shot(scene, 1)
            write_simulated_wheel(folder / wheel, shot, truths[wheel], stand.rigs[wheel])
        wheel_done()
    truth = truth_of_vehicle(vehicle, stand, truths, turns > 0)
    write_vehicle(folder / VEHICLE_TRUTH_FILE, truth)
    write_vehicle(folder / VEHICLE_FILE, stated_vehicle(vehicle, tyre_width_sigma_mm))
    return truth


class Photographer:
    """Takes the shots of one wheel, each with noise of its own."""

    def __init__(self, vehicle: Vehicle, stand: SimulatedStand, wheel: str, settings: CameraSettings) -> None:
        self._rng = np.random.default_rng([vehicle.seed, 9, FOUR_WHEELS.index(wheel)])
        self._calibration, self._settings = stand.rigs[wheel], settings

    def shot(self, scene: WheelScene, number: int) -> WheelShot:
        """Take one shot."""
        return simulate_shot(
            scene,
            self._calibration,
            self._rng,
            settings=self._settings,
            time_utc=datetime.now(UTC),
            trigger_counter=number,
        )

    def turning(
        self, scene: WheelScene, rollers: Rollers, turns: int
    ) -> Iterator[tuple[WheelShot, WheelTruth]]:
        """Take the shots of a wheel on rollers, each with its truth."""
        wheel = TurningWheel(scene, rollers, self._rng, self._settings.exposure_ms)
        for number in range(1, turns + 1):
            seen = wheel.exposure(number)
            yield self.shot(seen, number), truth_of(seen)


def stated_vehicle(vehicle: Vehicle, tyre_width_sigma_mm: float) -> VehicleFile:
    """Return what ``vehicle.json`` says of a vehicle before a rig for each wheel."""
    spec = vehicle.spec
    return VehicleFile(
        name=spec.name,
        wheelbase_mm=spec.wheelbase_mm,
        track_front_mm=spec.track_front_mm,
        track_rear_mm=spec.track_rear_mm,
        tyre_width_mm=spec.tyre_width_mm,
        tyre_width_sigma_mm=tyre_width_sigma_mm,
        road_z_mm=ROAD_Z_MM,
        rigs={wheel: wheel for wheel in FOUR_WHEELS},
    )
