"""The limits that the gate applies by itself: what lies just inside is accepted, just outside refused."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from alignment.calibration.adjustment import Adjustment
from alignment.calibration.gate import CalibrationProblem, camera_figures, judge_calibration, judge_input
from alignment.calibration.observations import CalibrationInput
from alignment.calibration.prediction import predict_angle_uncertainty
from alignment.geometry.transforms import RigidTransform
from alignment.imaging.plate import MarkObservations
from alignment.units import ARCMIN
from tests.station.calibrations import adjusted

CAMERA, NUMBER = ("head_2", "right"), 3


def judged(changed: Adjustment) -> CalibrationProblem | None:
    return judge_calibration(changed, adjusted()[1]).problem


def mine() -> np.ndarray:
    """Rows of the observations of one camera."""
    return np.flatnonzero(adjusted()[0].camera == NUMBER)


def edge(figure: Callable[[float], float], value: float, low: float, high: float) -> float:
    """The size of a change that brings a figure, which grows with it, to a value."""
    for _ in range(20):
        middle = 0.5 * (low + high)
        if figure(middle) < value:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def test_what_was_adjusted_is_accepted() -> None:
    assert judged(adjusted()[0]) is None


@pytest.mark.parametrize(
    ("change", "inside", "outside", "problem"),
    [
        ("noise_scale", 2.99, 3.01, CalibrationProblem.NOISY),
        ("condition", 0.99e9, 1.01e9, CalibrationProblem.ILL_CONDITIONED),
    ],
)
def test_figures_of_the_adjustment(
    change: str, inside: float, outside: float, problem: CalibrationProblem
) -> None:
    found = adjusted()[0]

    def with_value(value: float) -> Adjustment:
        if change == "condition":
            return replace(found, condition=value)
        return replace(found, noise_scale=found.noise_scale | {CAMERA: value})

    assert judged(with_value(inside)) is None
    assert judged(with_value(outside)) is problem


def test_a_twentieth_of_the_marks_may_be_outliers() -> None:
    found, rows = adjusted()[0], mine()

    def spoilt(share: float) -> Adjustment:
        weights = found.weights.copy()
        weights[rows[: round(share * len(rows))]] = 0.0
        return replace(found, weights=weights)

    assert judged(spoilt(0.048)) is None
    answer = judge_calibration(spoilt(0.053), adjusted()[1])
    assert answer.problem is CalibrationProblem.NOISY
    assert "head_2 right: 5 % of its marks do not fit, allowed are 5 %" in answer.reason


def test_marks_must_cover_half_of_each_image() -> None:
    found, rows = adjusted()[0], mine()
    share = camera_figures(found)[NUMBER].image_share
    assert share > 0.6

    def shrunk(to: float) -> Adjustment:
        pixels = found.pixels.copy()
        middle = pixels[rows].mean(axis=0)
        pixels[rows] = middle + math.sqrt(to / share) * (pixels[rows] - middle)
        return replace(found, pixels=pixels)

    assert judged(shrunk(0.505)) is None
    assert judged(shrunk(0.495)) is CalibrationProblem.COVERAGE


def test_marks_must_lie_in_three_hundredths_of_the_distance() -> None:
    found = adjusted()[0]

    def flattened(height: float) -> Adjustment:
        poses = tuple(
            RigidTransform(pose.rotation, pose.translation * np.array([1.0, 1.0, height]))
            for pose in found.rig_from_plate
        )
        return replace(found, rig_from_plate=poses)

    at = edge(lambda f: min(c.depth_share for c in camera_figures(flattened(f))), 0.03, 0.0, 1.0)
    assert judged(flattened(1.02 * at)) is None
    assert judged(flattened(0.98 * at)) is CalibrationProblem.VIEWS_TOO_ALIKE


def test_residuals_may_hang_together_by_a_quarter() -> None:
    found, rows = adjusted()[0], mine()
    wave = np.sin(found.pixels[rows] / 150.0) * found.residuals[rows].std()

    def structured(size: float) -> Adjustment:
        residuals = found.residuals.copy()
        residuals[rows] += size * wave
        return replace(found, residuals=residuals)

    at = edge(lambda size: camera_figures(structured(size))[NUMBER].structure, 0.25, 0.0, 5.0)
    assert judged(structured(0.97 * at)) is None
    assert judged(structured(1.03 * at)) is CalibrationProblem.STRUCTURED


@pytest.mark.parametrize("angle", [0, 1])
def test_either_angle_may_be_uncertain_by_six_hundredths_of_an_arcminute(angle: int) -> None:
    """At 95 %, that is twice the standard uncertainty, of camber and of toe alike."""
    found, calibration = adjusted()
    assert calibration.covariance is not None
    size = len(calibration.parameter_names)
    # A turn of all cameras about x leans the wheel, about y it turns it: one angle alone.
    turn = np.zeros(size)
    for row, name in enumerate(calibration.parameter_names):
        if name.endswith((".rx", ".ry", ".rz")):
            camera = calibration.heads[int(name[5]) - 1]
            pose = (camera.left if ".left." in name else camera.right).rig_from_camera
            turn[row] = pose.rotation[angle, "xyz".index(name[-1])]
        elif name.endswith(("cx_mm", "cy_mm", "cz_mm")):
            camera = calibration.heads[int(name[5]) - 1]
            pose = (camera.left if ".left." in name else camera.right).rig_from_camera
            axis = np.eye(3)[angle]
            turn[row] = np.cross(axis, pose.translation)["xyz".index(name[-4])]

    def with_u95(arcmin: float) -> tuple[CalibrationProblem | None, tuple[float, float]]:
        covariance = np.outer(turn, turn) * (0.5 * arcmin * ARCMIN) ** 2
        answer = judge_calibration(found, replace(calibration, covariance=covariance))
        assert answer.camber_u95 is not None
        assert answer.toe_u95 is not None
        return answer.problem, (answer.camber_u95 / ARCMIN, answer.toe_u95 / ARCMIN)

    problem, u95 = with_u95(0.0595)
    assert problem is None
    assert u95[angle] == pytest.approx(0.0595, rel=1e-3)
    assert u95[1 - angle] < 1e-3
    assert with_u95(0.0605)[0] is CalibrationProblem.UNCERTAIN
    # The figure in the verdict is that which is predicted, twice.
    answer = judge_calibration(found, calibration)
    assert (answer.camber_u95, answer.toe_u95) == pytest.approx(
        [2.0 * u for u in predict_angle_uncertainty(calibration)]
    )


def test_a_hundred_marks_of_each_camera_and_three_views_are_needed() -> None:
    data = adjusted()[0].data

    def with_marks(count: int) -> CalibrationInput:
        views, left = [], count
        for view in data.views[:3]:
            seen = view.observations[CAMERA]
            share = min(left, count // 3 + 1)
            left -= share
            kept = MarkObservations(seen.marks[:share], seen.pixels[:share], seen.covariance[:share])
            views.append(replace(view, observations={**view.observations, CAMERA: kept}))
        return replace(data, views=tuple(views))

    assert judge_input(with_marks(100))
    refused = judge_input(with_marks(99))
    assert refused.problem is CalibrationProblem.TOO_FEW_MARKS
    assert "head_2 right saw 99 marks in all views, at least 100" in refused.reason
    assert judge_input(replace(data, views=data.views[:3]))
    refused = judge_input(replace(data, views=data.views[:2]))
    assert refused.problem is CalibrationProblem.TOO_FEW_VIEWS
