"""From rendered or foreign images, through the recorded formats, to angles: how far from the truth?"""

from __future__ import annotations

import math
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from alignment.measure import measure_wheel
from alignment.values import MeasureSettings, Side, WheelMeasurement
from sensors.camera import Frame
from sensors.formats import read_calibration, read_shot, write_calibration, write_shot
from sensors.shot import HeadFrames, WheelShot
from sensors.simulation.render import simulate_shot
from sensors.simulation.rigs import RIG_SPECS, build_rig
from sensors.simulation.scene import draw_pose, draw_scene, truth_of
from tests import path_traced
from tests.assertions import assert_angle_within

POSES = [(camber, toe) for camber in (-3.0, 0.0, 3.0) for toe in (-3.0, 0.0, 3.0)]


@pytest.mark.slow
@pytest.mark.parametrize(("camber", "toe"), POSES)
def test_nine_poses_with_noise_and_lettering_stay_below_three_hundredths_of_an_arcminute(
    camber: float, toe: float
) -> None:
    seed = POSES.index((camber, toe)) + 100
    rng = np.random.default_rng(seed)
    side: Side = "left" if seed % 2 else "right"
    spec = RIG_SPECS["standard"]
    calibration = build_rig(spec, "rig", side, rng)
    scene = draw_scene(spec, side, draw_pose(rng, math.radians(camber), math.radians(toe)), rng, seed=seed)
    result = measure_wheel(simulate_shot(scene, calibration, rng).images, calibration, MeasureSettings())
    assert isinstance(result, WheelMeasurement)
    truth = truth_of(scene)
    assert_angle_within(result.camber, math.radians(truth.camber_deg), 0.03, "camber")
    assert_angle_within(result.toe, math.radians(truth.toe_deg), 0.03, "toe")


@pytest.mark.parametrize("wheel", path_traced.WHEELS)
def test_path_traced_wheels_survive_the_recorded_format(
    wheel: str, published_data: Path, tmp_path: Path
) -> None:
    folder = published_data / "path_traced"
    calibration = path_traced.calibration(folder)
    frames = [
        HeadFrames(head.name, *(Frame(f"{head.name}/{k}", image, 1, 0.0, 0.0, 5.0) for k, image in pair))
        for head, pair in zip(
            calibration.heads,
            [(("left", p.left), ("right", p.right)) for p in path_traced.images(folder, wheel)],
            strict=True,
        )
    ]
    now = datetime(2026, 1, 1, tzinfo=UTC)
    write_shot(tmp_path / "shot", WheelShot(calibration.rig, now, tuple(frames)))
    write_calibration(tmp_path / "calibration.json", calibration, method="given", created_utc=now)

    again = read_calibration(tmp_path / "calibration.json")
    result = measure_wheel(read_shot(tmp_path / "shot", again).images, again, MeasureSettings())
    assert isinstance(result, WheelMeasurement)
    truth = path_traced.truth(folder, wheel)
    assert_angle_within(result.camber, math.radians(truth.camber_deg), 0.03, "camber")
    assert_angle_within(result.toe, math.radians(truth.toe_deg), 0.03, "toe")
