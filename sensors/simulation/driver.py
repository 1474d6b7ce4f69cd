"""The driver ``simulated``: cameras that look at simulated wheels. Loads the renderer only to make some."""

from __future__ import annotations

import math
from typing import Literal

from pydantic import Field

from sensors.drivers.driver import KnownCalibration, RigDriver, RigPlace
from sensors.formats.truth import LoadOptions
from sensors.formats.validation import StrictModel
from sensors.rig import Rig


class RollerOptions(StrictModel):
    """Rollers that turn the wheel while it is shot; every exposure is the next one of the same wheel."""

    speed_deg_s: float = Field(default=170.0, ge=-720, le=720, description="Of the wheel, degrees per second")
    interval_s: float = Field(default=0.14, gt=0, le=10, description="Mean time between exposures, seconds")
    wander_mm: float = Field(
        default=1.0, ge=0, le=20, description="Most that the wheel's centre wanders, slowly"
    )
    wander_deg: float = Field(
        default=0.05, ge=0, le=2, description="Most that camber and toe wander, degrees"
    )


class SimulatedOptions(StrictModel):
    """Cameras that look at a simulated wheel, a new one for every arming."""

    seed: int = Field(ge=0, lt=2**32, description="Of the rig and of all its wheels")
    rig: Literal["standard", "dense", "central", "ccir"] = Field(
        default="standard", description="Geometry, cameras and light of the rig"
    )
    camber_deg: float = Field(default=0.0, ge=-5, le=5, description="Mean camber of the wheels, degrees")
    toe_deg: float = Field(default=0.0, ge=-5, le=5, description="Mean toe of the wheels, degrees")
    spread_deg: float = Field(
        default=0.1, ge=0, le=3, description="Standard deviation of both angles, degrees"
    )
    run_out_deg: float = Field(
        default=0.0, ge=0, le=2, description="Angle between tyre plane and spin axis, degrees"
    )
    second_harmonic_mm: float = Field(
        default=0.0,
        ge=0,
        le=5,
        description="Second harmonic of the tyre's run-out, peak to peak at the tread",
    )
    rim_runout_mm: float = Field(
        default=0.0, ge=0, le=5, description="Run-out of the rim, peak to peak at its edge"
    )
    load: LoadOptions | None = Field(default=None, description="What the road does to the tyres")
    rollers: RollerOptions | None = Field(default=None, description="What turns the wheels")


def _make(options: SimulatedOptions, place: RigPlace) -> Rig:
    from sensors.simulation.deformation import Wobble
    from sensors.simulation.simulated_rig import Road, SimulatedRig, angles_about, true_calibration
    from sensors.simulation.turning import Rollers

    wobble = rollers = None
    if options.second_harmonic_mm or options.rim_runout_mm:
        wobble = Wobble(second_mm=options.second_harmonic_mm, rim_mm=options.rim_runout_mm)
    if options.rollers is not None:
        rollers = Rollers(
            math.radians(options.rollers.speed_deg_s),
            options.rollers.interval_s,
            wander_mm=options.rollers.wander_mm,
            wander=math.radians(options.rollers.wander_deg),
        )
    load = None if options.load is None else options.load.load()
    return SimulatedRig(
        true_calibration(place.rig, place.side, options.rig, options.seed),
        options.rig,
        options.seed,
        angles_about(options.camber_deg, options.toe_deg, options.spread_deg, options.run_out_deg),
        place.settings,
        place.tolerance,
        Road(load, wobble, rollers),
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
