"""The driver ``simulated``: cameras that look at simulated wheels. Loads the renderer only to make some."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from sensors.drivers.driver import KnownCalibration, RigDriver, RigPlace
from sensors.formats.validation import StrictModel
from sensors.rig import Rig


class SimulatedOptions(StrictModel):
    """Cameras that look at a simulated wheel, a new one for every trigger."""

    seed: int = Field(ge=0, lt=2**32, description="Of the rig and of all its wheels")
    rig: Literal["standard", "dense", "central", "ccir"] = Field(
        default="standard", description="Geometry, cameras and light of the rig"
    )
    camber_deg: float = Field(default=0.0, ge=-5, le=5, description="Mean camber of the wheels, degrees")
    toe_deg: float = Field(default=0.0, ge=-5, le=5, description="Mean toe of the wheels, degrees")
    spread_deg: float = Field(
        default=0.1, ge=0, le=3, description="Standard deviation of both angles, degrees"
    )


def _make(options: SimulatedOptions, place: RigPlace) -> Rig:
    from sensors.simulation.simulated_rig import SimulatedRig, angles_about, true_calibration

    return SimulatedRig(
        true_calibration(place.rig, place.side, options.rig, options.seed),
        options.rig,
        options.seed,
        angles_about(options.camber_deg, options.toe_deg, options.spread_deg),
        place.settings,
        place.tolerance,
    )


def _calibration(options: SimulatedOptions, place: RigPlace) -> KnownCalibration:
    from sensors.simulation.simulated_rig import (
        TRUE_CALIBRATION_METHOD,
        TRUE_CALIBRATION_UTC,
        true_calibration,
    )

    true = true_calibration(place.rig, place.side, options.rig, options.seed)
    return KnownCalibration(true, TRUE_CALIBRATION_METHOD, TRUE_CALIBRATION_UTC)


DRIVER = RigDriver(SimulatedOptions, _make, calibration=_calibration, simulates=True)
"""The driver ``simulated``."""
