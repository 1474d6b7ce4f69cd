"""The plate of another program: three views of 18 images calibrate the rig that measures its wheels."""

from pathlib import Path

import numpy as np
import pytest

from alignment.calibration.adjustment import AdjustmentSettings, adjust
from alignment.calibration.gate import judge_calibration
from alignment.calibration.observations import CalibrationInput, PlateView
from alignment.imaging.plate import MarkObservations
from alignment.imaging.plate_grid import observe_plate
from alignment.measure import measure_wheel
from alignment.values import MeasureSettings, RigCalibration, WheelMeasurement, nominal_vehicle_from_rig
from tests import path_traced, path_traced_plate
from tests.assertions import assert_angle_within


@pytest.fixture(scope="module")
def folder(published_data: Path) -> Path:
    return published_data / "path_traced"


@pytest.fixture(scope="module")
def observations(folder: Path) -> CalibrationInput:
    session = path_traced_plate.session(folder)
    views = []
    for view in session.views:
        seen = {}
        for key, image in view.images.items():
            found = observe_plate(image, session.plate.seen_by(key[0]), corrected=False)
            assert isinstance(found, MarkObservations)
            seen[key] = found
        views.append(PlateView(view.name, view.stage_mm, seen))
    return CalibrationInput(session.plate.plate, tuple(views), dict(session.sizes), session.stage_sigma_mm)


def calibration(observations: CalibrationInput, model: str) -> RigCalibration:
    result = adjust(observations, AdjustmentSettings(model))
    found = result.rig_calibration("plate", "path_traced", "left", nominal_vehicle_from_rig("left"))
    judgement = judge_calibration(result, found)
    assert judgement, judgement.reason
    return found


@pytest.mark.parametrize("model", ["division", "brown5"])
def test_its_wheels_are_measured_to_a_twentieth_of_a_minute(
    folder: Path, observations: CalibrationInput, model: str
) -> None:
    found = calibration(observations, model)
    for wheel in path_traced.WHEELS:
        result = measure_wheel(path_traced.images(folder, wheel), found, MeasureSettings())
        assert isinstance(result, WheelMeasurement)
        truth = path_traced.truth(folder, wheel)
        assert_angle_within(result.camber, np.radians(truth.camber_deg), 0.05, "camber")
        assert_angle_within(result.toe, np.radians(truth.toe_deg), 0.05, "toe")


def test_the_cameras_are_the_true_ones_within_the_covariance(
    folder: Path, observations: CalibrationInput
) -> None:
    found, true = calibration(observations, "brown5"), path_traced.calibration(folder)
    assert found.covariance is not None
    deviations = np.sqrt(np.diag(found.covariance)).reshape(6, -1)
    cameras = zip(
        (c for h in found.heads for c in h.cameras), (c for h in true.heads for c in h.cameras), strict=True
    )
    ratios = []
    for k, (camera, truth) in enumerate(cameras):
        turn = (truth.rig_from_camera.inverse() @ camera.rig_from_camera).rotvec()
        shift = camera.rig_from_camera.translation - truth.rig_from_camera.translation
        lens = camera.model.parameters - truth.model.parameters
        ratios.append(np.concatenate([turn, shift, lens]) / deviations[k])
    assert np.sqrt(np.square(ratios).mean()) < 2.0
    assert np.abs(ratios).max() < 5.0
