"""A small calibration computed in memory, for the tests of its life."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from alignment.calibration.adjustment import Adjustment, AdjustmentSettings, adjust
from alignment.calibration.observations import cameras_of_rig
from alignment.values import RigCalibration
from sensors.formats import PlateSession, read_plate
from sensors.simulation.plate_session import PlatePosition, PlateSessionSpec, simulate_plate_session
from sensors.simulation.rigs import RIG_SPECS, build_rig
from station.studies.simulated_views import STAGES, observe, square_plate
from tests.once import once

PLATE = Path(__file__).parents[2] / "configs" / "plates" / "rig.toml"


@cache
def true_rig(seed: int = 1) -> RigCalibration:
    """The true cameras of a standard rig."""
    return build_rig(RIG_SPECS["standard"], "front_left", "left", np.random.default_rng(seed))


@once
def plate_session() -> PlateSession:
    """Rendered images of the plate at three positions before `true_rig`: low, middle, high."""
    positions = (
        PlatePosition("low", (0.0, 0.0, -30.0)),
        PlatePosition("middle", (7.5, -7.5, 0.0)),
        PlatePosition("high", (-7.5, 0.0, 30.0)),
    )
    spec = PlateSessionSpec(positions=positions)
    return simulate_plate_session(spec, read_plate(PLATE), true_rig(), np.random.default_rng(2))[0]


@once
def adjusted() -> tuple[Adjustment, RigCalibration]:
    """The joint adjustment of four simulated views of `true_rig`, and the calibration it gives."""
    true = true_rig()
    views = observe(cameras_of_rig(true), square_plate(), STAGES[:4], np.random.default_rng(5))
    result = adjust(views.data, AdjustmentSettings("radial"))
    return result, result.rig_calibration("cal-test", true.rig, true.side, true.vehicle_from_rig)
