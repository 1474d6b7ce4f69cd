"""A turning wheel is written exposure by exposure, each with its truth, and the mean axis beside them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from alignment.errors import FormatError
from sensors.formats import TyreLoad, read_calibration, read_shot, read_truth
from sensors.shot import WheelShot
from sensors.simulation.scene import WheelPose, WheelScene
from sensors.simulation.simulated_rig import Road
from sensors.simulation.turning import Rollers
from station.rehearsal import simulation

POSE = WheelPose(math.radians(-0.8), math.radians(0.15), run_out=math.radians(0.2))


@pytest.fixture
def dark(monkeypatch: pytest.MonkeyPatch) -> list[WheelScene]:
    """Exposures cost nothing: every camera sees noise; what was asked for is kept."""
    seen: list[WheelScene] = []
    shoot = simulation.simulate_shot

    def image(scene: WheelScene, rig: Any, head: int, side: str, rng: np.random.Generator, *_: Any) -> Any:
        model = rig.heads[head].left.model
        return rng.integers(0, 255, (model.height, model.width), dtype=np.uint8)

    monkeypatch.setattr("sensors.simulation.render.camera_image", image)

    def noted(scene: WheelScene, *arguments: Any, **options: Any) -> WheelShot:
        seen.append(scene)
        return shoot(scene, *arguments, **options)

    monkeypatch.setattr(simulation, "simulate_shot", noted)
    return seen


def test_a_turning_wheel_is_written_shot_by_shot_with_the_truth_of_each(
    dark: list[WheelScene], tmp_path: Path
) -> None:
    config = simulation.SimulationConfig(rig="ccir")
    road = Road(load=TyreLoad(5.0), rollers=Rollers())
    exposures, calibration = simulation.simulate_turning_wheel(config, "left", POSE, 7, road, 9)
    assert not dark  # rendered when asked for
    mean = simulation.write_turning_wheel(tmp_path / "wheel", exposures, calibration)
    assert sorted(p.name for p in (tmp_path / "wheel").iterdir()) == sorted(
        ["calibration.json", "truth.json", *(f"turn_{k:02d}" for k in range(1, 10))]
    )
    assert read_truth(tmp_path / "wheel" / "truth.json") == mean
    known = read_calibration(tmp_path / "wheel" / "calibration.json")
    shots = [read_shot(tmp_path / "wheel" / f"turn_{k:02d}", known) for k in range(1, 10)]
    assert [shot.heads[0].left.trigger_counter for shot in shots] == list(range(1, 10))
    truths = [read_truth(tmp_path / "wheel" / f"turn_{k:02d}" / "truth.json") for k in range(1, 10)]
    assert [t.spin_angle_deg for t in truths] == [math.degrees(scene.pose.spin) for scene in dark]
    assert np.diff([t.spin_angle_deg for t in truths]).min() > 10.0
    assert mean.spin_camber_deg == pytest.approx(np.mean([t.spin_camber_deg for t in truths]), abs=1e-6)
    assert all(scene.load == road.load and scene.turning > 0 for scene in dark)
    with pytest.raises(FormatError):
        simulation.write_turning_wheel(tmp_path / "wheel", iter([(shots[0], truths[0])]), calibration)
