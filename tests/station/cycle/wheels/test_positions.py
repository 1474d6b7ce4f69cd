"""A wheel position prepares its rig once, and lets it go with its calibration."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Sequence
from dataclasses import replace
from datetime import timedelta

from alignment.prepared import PreparedRig
from alignment.values import MeasureSettings, Refusal, RigCalibration, StereoImages, WheelMeasurement
from station.cycle.wheels.positions import CalibrationInForce, WheelPosition
from tests.sensors.samples import calibration as sample_calibration
from tests.station.bench import TODAY, FakeRig, measurement

DEEP = MeasureSettings(depth_range_mm=(-80.0, 40.0))


def position_of(calibration: RigCalibration, given: list[PreparedRig]) -> WheelPosition:
    def measure(
        images: Sequence[StereoImages], rig: PreparedRig, settings: MeasureSettings
    ) -> WheelMeasurement | Refusal:
        assert len(rig.shared_views) == 2 * len(images)
        assert len(rig.row_views.each) == len(rig.geometry.baselines) == len(images)
        given.append(rig)
        return measurement()

    in_force = CalibrationInForce(calibration, TODAY - timedelta(days=1), 30.0, {"id": calibration.id})
    rig = FakeRig(calibration.rig, [])
    return WheelPosition(rig, in_force, measure, DEEP, 1.0, now=lambda: TODAY)


def test_every_shot_of_a_position_is_measured_with_the_same_prepared_rig() -> None:
    given: list[PreparedRig] = []
    calibration = sample_calibration(rig="front_left", covariance=False)
    position = position_of(calibration, given)
    for _ in range(3):
        assert position.run().measurement is not None
    assert given[0] is given[1] is given[2]
    assert given[0].calibration is calibration
    assert given[0].depth_range_mm == DEEP.depth_range_mm


def test_a_calibration_that_is_replaced_is_let_go() -> None:
    """The calibrations of a station that was opened again stayed behind in hidden caches."""
    given: list[PreparedRig] = []
    first = replace(sample_calibration(rig="front_left", covariance=False), id="first")
    position = position_of(first, given)
    assert position.run().measurement is not None
    kept = weakref.ref(first)
    position = position_of(replace(first, id="second"), given)
    assert position.run().measurement is not None
    given.clear()
    del first
    gc.collect()
    assert kept() is None
