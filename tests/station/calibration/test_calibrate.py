"""From images of a plate to a judged calibration."""

from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime

import cv2
import numpy as np
import pytest

from alignment.calibration.gate import CalibrationProblem, GateLimits
from alignment.calibration.observations import CameraKey
from alignment.units import ARCMIN
from alignment.values import Image, RigCalibration
from sensors.formats import PlateSession, SessionView
from sensors.simulation.rigs import RIG_SPECS, build_rig
from station.calibration.calibrate import (
    Calibrated,
    CalibrateSettings,
    Method,
    calibrate_session,
    calibration_id,
)
from tests.station.calibrations import plate_session, true_rig

NOW = datetime(2026, 5, 4, 12, 30, tzinfo=UTC)
QUICK = CalibrateSettings(model="brown5")
ONE: CameraKey = ("head_2", "right")


@pytest.fixture(scope="module")
def rig() -> RigCalibration:
    return true_rig()


@pytest.fixture(scope="module")
def session() -> PlateSession:
    return plate_session()


def run(session: PlateSession, settings: CalibrateSettings = QUICK) -> Calibrated:
    return calibrate_session(session, settings, NOW, lambda done, doing: None)


def with_view(session: PlateSession, name: str, change: Callable[[SessionView], SessionView]) -> PlateSession:
    return replace(session, views=tuple(change(v) if v.name == name else v for v in session.views))


def with_image(session: PlateSession, change: Callable[[Image], Image]) -> PlateSession:
    """The session with one image of the middle view changed."""
    return with_view(
        session, "middle", lambda v: replace(v, images={**v.images, ONE: change(np.array(v.images[ONE]))})
    )


@pytest.mark.slow
def test_a_session_is_accepted_and_told_while_it_runs(session: PlateSession, rig: RigCalibration) -> None:
    told: list[tuple[float, str]] = []
    found = calibrate_session(
        session, CalibrateSettings(), NOW, lambda done, doing: told.append((done, doing))
    )
    assert found.judgement, found.judgement.reason
    assert found.calibration is not None
    assert found.calibration.rig == "front_left"
    assert found.calibration.id.startswith("front_left-20260504T123000-")
    assert found.choice is not None
    assert found.choice.left_out == "marks"
    assert found.rms_px is not None
    assert found.rms_px < 0.05
    assert found.judgement.toe_u95 is not None
    assert found.judgement.toe_u95 < 0.06 * ARCMIN
    fractions = [done for done, _ in told]
    assert fractions == sorted(fractions)
    assert any("head_3 right" in doing for _, doing in told)
    assert found.calibration.covariance is not None
    deviations = np.sqrt(np.diag(found.calibration.covariance)).reshape(6, -1)
    pairs = zip(
        (c for h in found.calibration.heads for c in h.cameras),
        (c for h in rig.heads for c in h.cameras),
        strict=True,
    )
    for k, (camera, true) in enumerate(pairs):
        shift = camera.rig_from_camera.translation - true.rig_from_camera.translation
        assert (np.abs(shift) < 5.0 * deviations[k, 3:6]).all()


def test_heads_first_then_poses_gives_a_calibration_without_covariance(session: PlateSession) -> None:
    found = run(session, replace(QUICK, method=Method.HEADS_THEN_POSES))
    assert found.calibration is not None
    assert found.calibration.covariance is None
    assert found.judgement.camber_u95 is None
    assert found.rms_px is not None


def blurred(image: Image) -> Image:
    return np.asarray(cv2.GaussianBlur(image, (0, 0), 12.0))


def saturated(image: Image) -> Image:
    return np.full_like(image, 255)


def covered(image: Image) -> Image:
    image[:, image.shape[1] // 2 :] = 30
    return image


@pytest.mark.parametrize("spoil", [blurred, saturated, covered, np.zeros_like])
def test_a_spoilt_image_is_named(session: PlateSession, spoil: Callable[[Image], Image]) -> None:
    found = run(with_image(session, spoil))
    assert found.calibration is None
    assert not found.judgement
    assert "middle" in found.judgement.reason
    assert "head_2 right" in found.judgement.reason


def test_a_view_without_an_image_of_one_camera_is_named(session: PlateSession) -> None:
    def without(view: SessionView) -> SessionView:
        return replace(view, images={key: image for key, image in view.images.items() if key != ONE})

    found = run(with_view(session, "high", without))
    assert found.judgement.problem is CalibrationProblem.MISSING_VIEW
    assert "high" in found.judgement.reason
    assert "head_2 right" in found.judgement.reason


def test_a_stage_position_with_the_wrong_sign_is_named(session: PlateSession) -> None:
    def turned(view: SessionView) -> SessionView:
        assert view.stage_mm is not None
        return replace(view, stage_mm=view.stage_mm * [1.0, 1.0, -1.0])

    found = run(with_view(session, "low", turned))
    assert found.judgement.problem is CalibrationProblem.WRONG_INPUT
    assert "view low" in found.judgement.reason
    assert "wrong sign in z" in found.judgement.reason
    assert found.calibration is None


def test_swapped_left_and_right_images_are_named(session: PlateSession) -> None:
    def swapped(view: SessionView) -> SessionView:
        images = dict(view.images)
        images["head_1", "left"], images["head_1", "right"] = (
            images["head_1", "right"],
            images["head_1", "left"],
        )
        return replace(view, images=images)

    found = run(replace(session, views=tuple(map(swapped, session.views))))
    assert found.judgement.problem is CalibrationProblem.SWAPPED_IMAGES
    assert "head_1" in found.judgement.reason


def test_an_uncertain_calibration_is_not_given_out(session: PlateSession) -> None:
    found = run(session, replace(QUICK, limits=GateLimits(angle_u95=1e-4 * ARCMIN)))
    assert found.judgement.problem is CalibrationProblem.UNCERTAIN
    assert found.calibration is None
    assert found.adjustment is not None


def test_identities_differ_with_the_cameras_and_the_time(rig: RigCalibration) -> None:
    other = build_rig(RIG_SPECS["standard"], "front_left", "left", np.random.default_rng(2))
    later = datetime(2026, 5, 4, 12, 31, tzinfo=UTC)
    assert len({calibration_id(rig, NOW), calibration_id(other, NOW), calibration_id(rig, later)}) == 3
    assert calibration_id(rig, NOW) == calibration_id(rig, NOW)
