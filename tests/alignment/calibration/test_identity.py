"""Identities of calibrations: one digest, and those that are stored already can be computed again."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np

from alignment.calibration.identity import content_digest
from alignment.geometry.cameras import CameraModel, PosedCamera
from alignment.geometry.transforms import RigidTransform
from alignment.values import HeadCalibration, RigCalibration, nominal_vehicle_from_rig
from station.calibration.calibrate import calibration_id

CAMERA = PosedCamera(
    CameraModel(752, 582, 900.0, 930.5, 375.25, 290.5), RigidTransform(np.eye(3), np.arange(3.0))
)
MOVED = replace(CAMERA, rig_from_camera=RigidTransform(np.eye(3), np.array([0.0, 1.0, 2.5])))


def rig(*cameras: PosedCamera) -> RigCalibration:
    return RigCalibration(
        "some", "front_left", "left", (HeadCalibration("head_1", *cameras),), nominal_vehicle_from_rig("left")
    )


def test_identities_of_old_records_can_be_computed_again() -> None:
    """Three programs made them, each with bytes of its own; frozen here as they were made."""
    assert content_digest(rig(CAMERA, MOVED))[:12] == "cb33157eb4b5"
    at = datetime(2026, 11, 22, 12, tzinfo=UTC)
    assert calibration_id(rig(CAMERA, MOVED), at) == "front_left-20261122T120000-4f2cc826"


def test_what_a_calibration_says_changes_its_digest_and_its_name_does_not() -> None:
    one = rig(CAMERA, MOVED)
    assert content_digest(replace(one, id="other", rig="rear_left")) == content_digest(one)
    assert content_digest(rig(MOVED, CAMERA)) != content_digest(one)
    turned = replace(one, vehicle_from_rig=RigidTransform(np.eye(3), np.zeros(3)))
    assert content_digest(turned) == content_digest(one)
    assert content_digest(turned, in_vehicle=True) != content_digest(one, in_vehicle=True)
