"""A small calibration computed in memory, for the tests of its life."""

from __future__ import annotations

from functools import cache

import numpy as np

from alignment.calibration.adjustment import Adjustment, AdjustmentSettings, adjust
from alignment.values import RigCalibration
from sensors.simulation.rigs import RIG_SPECS, build_rig
from station.studies.simulated_views import STAGES, cameras_of, observe, square_plate


@cache
def true_rig(seed: int = 1) -> RigCalibration:
    """The true cameras of a standard rig."""
    return build_rig(RIG_SPECS["standard"], "front_left", "left", np.random.default_rng(seed))


@cache
def adjusted() -> tuple[Adjustment, RigCalibration]:
    """The joint adjustment of four simulated views of `true_rig`, and the calibration it gives."""
    true = true_rig()
    views = observe(cameras_of(true), square_plate(), STAGES[:4], np.random.default_rng(5))
    result = adjust(views.data, AdjustmentSettings("radial"))
    return result, result.rig_calibration("cal-test", true.rig, true.side, true.vehicle_from_rig)
