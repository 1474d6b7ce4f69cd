"""What a movement explains, computed without images: intact rigs stay below the limit, moved ones are named.

Tyres that are not round raised false alarms: how badly surfaces fit was compared with their points' noise.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from alignment.calibration.prediction import angle_sensitivity
from alignment.calibration.refreshing import Movement
from alignment.calibration.row_equations import Equations, camera_rows, stepped
from alignment.calibration.suspicion import (
    Explanation,
    contradiction_limit,
    explanations,
    is_whole_head,
)
from alignment.geometry.transforms import RigidTransform
from alignment.values import RigCalibration
from sensors.simulation.rigs import RIG_SPECS, build_rig

COUNT = 80
ALLOWED = Movement().covariance


def rig() -> RigCalibration:
    true = build_rig(RIG_SPECS["standard"], "front_left", "left", np.random.default_rng(1))
    return replace(true, covariance=1e-14 * np.eye(len(true.parameter_names)))


def derivatives(calibration: RigCalibration, rng: np.random.Generator) -> np.ndarray:
    """(COUNT, P) of equations that know the poses of head 2's cameras to 2e-5 rad and 5 µm."""
    out = np.zeros((COUNT, len(calibration.parameter_names)))
    for rows in camera_rows(calibration)[2:4]:
        out[:, rows.start : rows.start + 3] = rng.normal(0.0, 5e4, (COUNT, 3))
        out[:, rows.start + 3 : rows.start + 6] = rng.normal(0.0, 200.0, (COUNT, 3))
    return out


def seen(step: np.ndarray | None = None, noise: float = 1.0, seed: int = 3) -> tuple[Explanation, ...]:
    """Explanations of what a step of all parameters does, with noise of so many standard deviations."""
    rng, known = np.random.default_rng(seed), rig()
    h = derivatives(known, rng)
    values = noise * rng.standard_normal(COUNT) + (0.0 if step is None else h @ step)
    return explanations(known, 1, Equations(values, h), ALLOWED)


def camera_step(number: int, turn: float) -> np.ndarray:
    known = rig()
    out = np.zeros(len(known.parameter_names))
    out[camera_rows(known)[number].start + 1] = turn
    return out


def head_step(turn: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """The step of both cameras of head 2 when it moves as one body, by moving it."""
    known = rig()
    cameras = known.heads[1].cameras
    middle = 0.5 * (cameras[0].rig_from_camera.translation + cameras[1].rig_from_camera.translation)
    move = RigidTransform.from_rotvec(turn, np.zeros(3))
    out = np.zeros(len(known.parameter_names))
    for camera, rows in zip(cameras, camera_rows(known)[2:4], strict=True):
        pose = camera.rig_from_camera
        now = RigidTransform(
            move.rotation @ pose.rotation, move.apply(pose.translation - middle) + middle + shift
        )
        out[rows.start : rows.start + 3] = (pose.inverse() @ now).rotvec()
        out[rows.start + 3 : rows.start + 6] = now.translation - pose.translation
        after = stepped(camera, out[rows])
        np.testing.assert_allclose(after.rig_from_camera.rotation, now.rotation, atol=1e-9)
    return out


@pytest.mark.parametrize("noise", [1.0, 3.0, 10.0])
def test_a_rig_that_has_not_changed_stays_below_the_limit_however_badly_surfaces_fit(noise: float) -> None:
    gains = [max(each.gain for each in seen(noise=noise, seed=seed)) for seed in range(40)]
    assert max(gains) < contradiction_limit(10)
    # Calibrated on its noise: six numbers take six parts of it.
    assert 0.5 < float(np.mean([seen(noise=noise, seed=seed)[0].gain for seed in range(40)])) < 1.6


@pytest.mark.parametrize(("number", "part"), [(2, "left"), (3, "right")])
@pytest.mark.parametrize("noise", [1.0, 3.0])
def test_the_camera_that_turned_by_half_an_arcminute_is_named(number: int, part: str, noise: float) -> None:
    found = seen(camera_step(number, 1.5e-4), noise)
    best = max(found, key=lambda each: each.gain)
    assert (best.head, best.part) == (1, part)
    assert best.gain > contradiction_limit(3)
    assert best.rest < 1.5 * noise**2 * COUNT
    assert not is_whole_head(found, COUNT, 10.0)


@pytest.mark.parametrize(
    ("turn", "shift"), [((0.0, 3e-4, 0.0), (0.0, 0.0, 0.0)), ((1e-4, 0.0, 2e-4), (0.1, 0.0, 0.2))]
)
def test_a_head_that_moved_as_one_is_named(
    turn: tuple[float, float, float], shift: tuple[float, float, float]
) -> None:
    found = seen(head_step(np.array(turn), np.array(shift)))
    best = max(found, key=lambda each: each.gain)
    assert best.part == "head"
    assert best.rest < 1.5 * COUNT
    assert is_whole_head(found, COUNT, 10.0)


def test_a_camera_that_is_not_clearly_better_than_its_head_is_not_named() -> None:
    def found(head_rest: float) -> list[Explanation]:
        return [
            Explanation(1, "left", 50.0, 200.0, (0.0, 0.0)),
            Explanation(1, "right", 49.0, 205.0, (0.0, 0.0)),
            Explanation(1, "head", 48.0, head_rest, (0.0, 0.0)),
            Explanation(0, "head", 10.0, 100.0, (0.0, 0.0)),
        ]

    # Twice the noise of its hundred equations: 20 of misfit are 10 of evidence.
    assert is_whole_head(found(219.0), 100, 10.0)
    assert not is_whole_head(found(221.0), 100, 10.0)


def test_few_wheels_must_contradict_more_clearly() -> None:
    limits = [contradiction_limit(wheels) for wheels in (3, 4, 6, 10, 100)]
    assert limits == sorted(limits, reverse=True)
    np.testing.assert_allclose(limits[:2], [21.1, 13.2], rtol=0.01)


def test_what_stays_unseen_is_what_the_equations_leave_open() -> None:
    """Nothing known: the whole movement that is allowed; noise three times as large: three times as much."""
    known = rig()
    nothing = Equations(np.zeros(COUNT), np.zeros((COUNT, len(known.parameter_names))))
    left = explanations(known, 1, nothing, ALLOWED)[0]
    rows = camera_rows(known)[2]
    turns = angle_sensitivity(known)[:, rows.start : rows.start + 6]
    expected = np.sqrt(np.einsum("ai,ij,aj->a", turns, ALLOWED, turns))
    np.testing.assert_allclose(left.unseen, expected, rtol=1e-9)
    quiet, loud = seen(noise=1.0)[0], seen(noise=3.0)[0]
    assert 2.0 < loud.unseen[1] / quiet.unseen[1] < 3.3
