"""A zero measurement from recorded shots of a master wheel, and what it adds to later wheels."""

from __future__ import annotations

import math
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from alignment.calibration.prediction import angle_covariance
from alignment.measure import measure_wheel
from alignment.values import MeasureSettings, RigCalibration, WheelMeasurement
from db.records import ZeroRecord
from sensors.camera import Frame
from sensors.formats import write_shot
from sensors.shot import HeadFrames, WheelShot
from station.calibration.master import MasterWheel
from station.calibration.zero import measure_zero
from station.cycle.wheels.zero import correction_of
from tests import rendered

SETTINGS = MeasureSettings()
CERTIFIED = MasterWheel(rendered.CAMBER + 1e-4, rendered.TOE - 2e-4, name="M-17")


@pytest.fixture(scope="module")
def shot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("master") / "shot"
    names = [head.name for head in rendered.rig().heads]
    frames = tuple(
        HeadFrames(
            name,
            Frame(f"{name}/left", pair.left, 1, 0.0, 0.0, 5.0),
            Frame(f"{name}/right", pair.right, 1, 0.0, 0.0, 5.0),
        )
        for name, pair in zip(names, rendered.images(), strict=True)
    )
    write_shot(folder, WheelShot("rig", datetime(2026, 11, 30, tzinfo=UTC), frames))
    return folder


def zero(shot: Path, calibration: RigCalibration, master: MasterWheel = CERTIFIED) -> ZeroRecord:
    found = measure_zero([shot], calibration, SETTINGS, master)
    assert isinstance(found, ZeroRecord), found
    return found


def corrected(record: ZeroRecord, calibration: RigCalibration) -> WheelMeasurement:
    wheel = measure_wheel(rendered.images(), calibration, SETTINGS)
    assert isinstance(wheel, WheelMeasurement), wheel
    return correction_of(record, calibration.side).corrected(wheel)


def test_the_master_counts_with_its_noise_and_the_wheel_with_its_calibration(shot: Path) -> None:
    """The calibration's share is common to both: it is counted once, with the wheel, and not twice."""
    known = rendered.known_rig(1e-4)
    share = angle_covariance(known)
    bare = zero(shot, rendered.rig())
    record = zero(shot, known)
    assert (record.camber_u, record.toe_u) == pytest.approx((bare.camber_u, bare.toe_u), rel=1e-5)
    assert record.correlation == pytest.approx(bare.correlation, abs=1e-4)
    assert record.camber_u < 0.05 * math.sqrt(share[0, 0])
    wheel = corrected(record, known)
    noise = np.diag([bare.camber_u**2, bare.toe_u**2])
    assert np.diag(wheel.angle_covariance) == pytest.approx(np.diag(share + 2.0 * noise), rel=1e-5)
    assert (wheel.camber, wheel.toe) == pytest.approx((CERTIFIED.camber, CERTIFIED.toe), abs=1e-12)


def test_the_certificates_uncertainty_counts_for_each_angle(shot: Path) -> None:
    bare = zero(shot, rendered.rig())
    record = zero(shot, rendered.rig(), replace(CERTIFIED, u=3e-5))
    assert record.camber_u == pytest.approx(math.hypot(bare.camber_u, 3e-5))
    assert record.toe_u == pytest.approx(math.hypot(bare.toe_u, 3e-5))
    wheel = corrected(record, rendered.rig())
    assert wheel.camber_u == pytest.approx(math.hypot(math.sqrt(2.0) * bare.camber_u, 3e-5), rel=1e-6)
    assert wheel.toe_u == pytest.approx(math.hypot(math.sqrt(2.0) * bare.toe_u, 3e-5), rel=1e-6)
