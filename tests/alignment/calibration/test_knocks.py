"""Predicted signs of knocks against signs of cameras that were moved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from alignment.calibration.crosses import CrossPairs
from alignment.calibration.knocks import knock_model
from alignment.calibration.prediction import NominalWheel, wheel_points
from alignment.calibration.row_equations import row_differences, stepped, with_camera
from alignment.stereo.rows import TERMS, RowView
from alignment.values import RigCalibration
from alignment.wheel.agreement import MOVES
from sensors.simulation.rigs import RIG_SPECS, build_rig


@pytest.fixture(scope="module")
def rig() -> RigCalibration:
    return build_rig(RIG_SPECS["standard"], "rig", "left", np.random.default_rng(4))


@pytest.mark.parametrize("side", [0, 1])
def test_predicted_row_fields_are_those_of_a_moved_camera(rig: RigCalibration, side: int) -> None:
    head = rig.heads[1]
    points = wheel_points(head, NominalWheel())
    pairs = CrossPairs(head.left.project(points), head.right.project(points))
    view = RowView.of(head)
    terms = view.terms(view.seen(0, pairs.left))
    knock = knock_model(rig).knocks[3 + side]
    assert knock.name == f"{head.name} {('left', 'right')[side]}"
    first = MOVES * len(rig.heads) + TERMS
    for axis in range(6):
        scale = (1.5e-3 if axis < 3 else 0.25) / 50.0
        step = np.zeros(6 + len(head.cameras[side].model.parameters))
        step[axis] = scale
        moved = with_camera(rig, 1, side, stepped(head.cameras[side], step)).heads[1]
        field = np.linalg.lstsq(terms, row_differences(moved, pairs), rcond=None)[0]
        assert knock.signs[first : first + TERMS, axis] / 50.0 == pytest.approx(field, abs=2e-3)


def test_a_shift_of_a_whole_head_lifts_its_patch_and_leaves_its_rows(rig: RigCalibration) -> None:
    knock = knock_model(rig).knocks[5]
    assert knock.name == rig.heads[1].name
    assert knock.signs[MOVES : MOVES + 3, 5] == pytest.approx([0.25, 0.0, 0.0], abs=1e-6)
    assert knock.signs[MOVES * len(rig.heads) :] == pytest.approx(0.0, abs=0.01)


def test_a_calibration_without_covariance_is_taken_to_be_as_good_as_a_hundredth_of_a_millimetre(
    rig: RigCalibration,
) -> None:
    deviations = np.sqrt(np.diag(knock_model(replace(rig, covariance=None)).covariance))
    assert deviations[0] == pytest.approx(0.007)
    assert deviations[-1] == pytest.approx(0.2)
