"""A vehicle is written rig by rig, with what its maker states; wheels of both sides roll forward."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from alignment.errors import FormatError
from alignment.vehicle.wheel_axes import FOUR_WHEELS
from sensors.formats import (
    read_calibration,
    read_shot,
    read_truth,
    read_vehicle_facts,
    read_vehicle_truth,
)
from sensors.simulation.rigs import RIG_SPECS
from sensors.simulation.scene import WheelScene
from sensors.simulation.turning import Rollers
from sensors.simulation.vehicle import (
    SimulatedStand,
    Vehicle,
    VehicleDraw,
    VehicleSpec,
    build_stand,
    draw_vehicle,
)
from station.rehearsal.simulation import SimulationConfig
from station.rehearsal.vehicle_simulation import write_simulated_vehicle

CONFIG = SimulationConfig(rig="ccir", ambient=0.3)
SPEC = VehicleSpec()


@pytest.fixture(scope="module")
def stand() -> SimulatedStand:
    return build_stand(SPEC, 3, "ccir")


@pytest.fixture(scope="module")
def vehicle() -> Vehicle:
    return draw_vehicle(4, SPEC, VehicleDraw(load_mm=5.0, runout_mm=1.0), 0.004, (3.0, -6.0))


@pytest.fixture
def seen(monkeypatch: pytest.MonkeyPatch) -> list[WheelScene]:
    """Exposures cost nothing: every camera sees noise; the scenes are kept."""
    scenes: list[WheelScene] = []

    def image(scene: WheelScene, rig: Any, head: int, side: str, rng: np.random.Generator, *_: Any) -> Any:
        scenes.append(scene)
        return rng.integers(0, 255, (32, 48), dtype=np.uint8)

    monkeypatch.setattr("sensors.simulation.render.camera_image", image)
    return scenes


def test_a_standing_vehicle_has_a_shot_for_each_rig(
    seen: list[WheelScene], vehicle: Vehicle, stand: SimulatedStand, tmp_path: Path
) -> None:
    folder = tmp_path / "vehicle"
    truth = write_simulated_vehicle(folder, CONFIG, vehicle, stand, tyre_width_sigma_mm=0.5)
    assert read_vehicle_truth(folder / "truth.json") == truth
    stated = read_vehicle_facts(folder / "vehicle.json")
    assert (stated.tyre_width_mm, stated.tyre_width_sigma_mm, stated.wheelbase_mm) == (195.0, 0.5, 2700.0)
    assert list(stated.rigs) == list(FOUR_WHEELS)
    for wheel, rig in stated.rigs.items():
        calibration = read_calibration(folder / rig / "calibration.json")
        assert read_shot(folder / rig).rig == calibration.rig == wheel
        assert np.sign(calibration.vehicle_from_rig.translation[:2]).tolist() == [
            1.0 if "front" in wheel else -1.0,
            1.0 if "left" in wheel else -1.0,
        ]
        own = read_truth(folder / rig / "truth.json")
        assert own.load == vehicle.corners[wheel].load
        assert own.toe_deg == truth.wheels[wheel].stand_toe_deg
        assert truth.wheels[wheel].kind == "tyre_plane"
    assert len(seen) == 24
    assert {scene.ambient for scene in seen} == {0.3}
    assert seen[0].projectors[0].pattern == RIG_SPECS["ccir"].pattern
    assert not (folder / "front_left" / "turn_01").exists()
    with pytest.raises(FormatError):
        write_simulated_vehicle(folder, CONFIG, vehicle, stand)


def test_wheels_on_rollers_roll_forward_on_both_sides(
    seen: list[WheelScene], vehicle: Vehicle, stand: SimulatedStand, tmp_path: Path
) -> None:
    """Seen from outboard the left wheels of a vehicle turn counter-clockwise, the right ones clockwise."""
    rollers = Rollers(wander_mm=0.0, wander=0.0)
    truth = write_simulated_vehicle(tmp_path / "v", CONFIG, vehicle, stand, turns=9, rollers=rollers)
    assert all(wheel.kind == "spin_axis" for wheel in truth.wheels.values())
    for wheel in FOUR_WHEELS:
        mean = read_truth(tmp_path / "v" / wheel / "truth.json")
        assert (mean.spin_angle_deg > 100.0) == wheel.endswith("left")
        assert (mean.spin_angle_deg < -100.0) == wheel.endswith("right")
        assert truth.wheels[wheel].toe_deg == pytest.approx(np.degrees(vehicle.corners[wheel].angles[1]))
        assert len(list((tmp_path / "v" / wheel).glob("turn_*"))) == 9
    assert all((scene.turning > 0) == (scene.side == "left") for scene in seen)
    assert truth.yaw_deg == pytest.approx(np.degrees(0.004), abs=1e-6)
