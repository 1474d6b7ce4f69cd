"""The driver ``simulated``: cameras that look at simulated wheels. Loads the renderer only to make some."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Literal

from pydantic import Field, model_validator

from alignment.errors import ConfigurationError, DegenerateInputError
from alignment.values import RigCalibration
from sensors.drivers.driver import KnownCalibration, RigDriver, RigPlace
from sensors.formats.gauge_frame import GaugeFrame, read_gauge_frame
from sensors.formats.planned_views import MOST_PLANNED
from sensors.formats.plate import read_plate
from sensors.formats.truth import LoadOptions
from sensors.formats.validation import FilePath, StrictModel
from sensors.rig import Rig

if TYPE_CHECKING:
    from sensors.simulation.scene import WheelScene
    from sensors.simulation.simulated_rig import WheelSource


class RollerOptions(StrictModel):
    """Rollers that turn the wheel while it is shot; every exposure is the next one of the same wheel."""

    speed_deg_s: float = Field(
        default=170.0, ge=-720, le=720, description="Of the wheel, degrees per second, forward"
    )
    interval_s: float = Field(default=0.28, gt=0, le=10, description="Mean time between exposures, seconds")
    wander_mm: float = Field(
        default=1.0, ge=0, le=20, description="Most that the wheel's centre wanders, slowly"
    )
    wander_deg: float = Field(
        default=0.05, ge=0, le=2, description="Most that camber and toe wander, degrees"
    )


class VehicleOptions(StrictModel):
    """Vehicles that come one after the other; every arming of a rig is the next one's wheel."""

    yaw_deg: float = Field(default=0.0, ge=0, le=2, description="Most that a vehicle is turned, degrees")
    offset_mm: float = Field(
        default=0.0, ge=0, le=25, description="Most that a vehicle stands off along and across, millimetres"
    )
    load_mm: float = Field(default=0.0, ge=0, le=15, description="Bulge of the front tyres; 0: in the air")
    runout_mm: float = Field(default=0.0, ge=0, le=5, description="Largest run-out of a tyre, peak to peak")
    tyre_width_sigma_mm: float = Field(default=0.0, ge=0, le=5, description="Spread of the tyres' widths")


class SunOptions(StrictModel):
    """A beam of sun on the tyre, which casts no shadows."""

    level: float = Field(
        default=5.0, gt=0, le=50, description="Irradiance; the projector's lines have 8 in their middle"
    )
    radius_mm: float = Field(default=40.0, gt=0, le=500, description="Of the beam")


class PlateOptions(StrictModel):
    """A calibration plate in place of the wheel, moved from view to view of the plan by every arming."""

    file: FilePath = Field(description="Description of the plate, relative to the station's file")


class GaugeOptions(StrictModel):
    """A gauge frame in place of the wheels; its plate before this rig."""

    frame: FilePath = Field(description="Description of the frame, relative to the station's file")
    askew_deg: float = Field(
        default=0.0,
        ge=0,
        le=5,
        description="By which rigs are turned from their plan, one standard deviation; wheels are rendered"
        " before rigs that stand as planned",
    )


_OF_SINGLE_WHEELS = {
    "camber_deg",
    "toe_deg",
    "spread_deg",
    "run_out_deg",
    "second_harmonic_mm",
    "rim_runout_mm",
    "load",
}


class SimulatedOptions(StrictModel):
    """Cameras that look at a simulated wheel, a new one for every arming."""

    seed: int = Field(ge=0, lt=2**32, description="Of the rig and of all its wheels")
    rig: Literal["standard", "dense", "central", "lifted", "upper", "turned", "ccir"] = Field(
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
    vehicle: VehicleOptions | None = Field(
        default=None,
        description="Wheels of whole vehicles, the same for all rigs of one seed; their angles are their own",
    )

    stays: bool = Field(default=False, description="The first wheel stays there, however often is armed")
    ambient: float = Field(
        default=0.15, ge=0, le=20, description="Light from all around; the projector's lines have 8"
    )
    sun: SunOptions | None = Field(default=None, description="Sun on the tyre")
    plate: PlateOptions | None = Field(default=None, description="A plate stands there, and no wheel")
    gauge: GaugeOptions | None = Field(default=None, description="A gauge frame stands there, and no wheel")

    @model_validator(mode="after")
    def _one_thing_stands_there(self) -> SimulatedOptions:
        if self.plate is not None and self.gauge is not None:
            raise DegenerateInputError(field="gauge", expected="none beside plate", seen="both")
        return self

    @model_validator(mode="after")
    def _wheels_come_from_one_source(self) -> SimulatedOptions:
        given = sorted(self.model_fields_set & _OF_SINGLE_WHEELS)
        if self.vehicle is not None and given:
            raise DegenerateInputError(
                field=given[0], expected="none beside vehicle, which has its own", seen="both"
            )
        return self


def _make(options: SimulatedOptions, place: RigPlace) -> Rig:
    if options.plate is not None or options.gauge is not None:
        return _plate_rig(options, place)
    from sensors.simulation.deformation import Wobble
    from sensors.simulation.scene import Sun
    from sensors.simulation.simulated_rig import Road, SimulatedRig, Surroundings, angles_about
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
        _true(options, place),
        options.rig,
        options.seed,
        angles_about(options.camber_deg, options.toe_deg, options.spread_deg, options.run_out_deg),
        place.settings,
        place.tolerance,
        Road(load, wobble, rollers),
        _wheels(options, place),
        Surroundings(
            options.ambient,
            None if options.sun is None else Sun(level=options.sun.level, radius_mm=options.sun.radius_mm),
        ),
        options.stays,
    )


def _plate_rig(options: SimulatedOptions, place: RigPlace) -> Rig:
    import numpy as np

    from sensors.simulation.gauge import draw_gauge_stand
    from sensors.simulation.plate_session import PlatePosition, plate_positions
    from sensors.simulation.simulated_plate import SimulatedPlateRig

    true = _true(options, place)
    if options.plate is not None:
        plate = read_plate(place.folder / options.plate.file)
        rng = np.random.default_rng([options.seed, 2])
        positions = plate_positions(MOST_PLANNED)
        return SimulatedPlateRig(true, plate, positions, rng, place.settings, place.tolerance)
    frame, gauge = _gauge_frame(options, place)
    stand = draw_gauge_stand(frame, place.rig, options.seed, gauge.askew_deg)
    positions = (PlatePosition("gauge", rig_from_plate=stand.rig_from_plate),)
    plate = frame.plates[place.rig].plate
    return SimulatedPlateRig(true, plate, positions, stand.rng, place.settings, place.tolerance)


def _gauge_frame(options: SimulatedOptions, place: RigPlace) -> tuple[GaugeFrame, GaugeOptions]:
    assert options.gauge is not None
    frame = read_gauge_frame(place.folder / options.gauge.frame)
    if place.rig not in frame.plates:
        raise ConfigurationError(
            field="gauge.frame",
            expected=f"a gauge frame with a plate for {place.rig}",
            seen=f"'{options.gauge.frame}' with plates for {', '.join(frame.plates)}",
        )
    return frame, options.gauge


def _check(options: SimulatedOptions, place: RigPlace) -> None:
    """Read what stands before the rig."""
    if options.plate is not None:
        read_plate(place.folder / options.plate.file)
    if options.gauge is not None:
        _gauge_frame(options, place)


def _true(options: SimulatedOptions, place: RigPlace) -> RigCalibration:
    from sensors.simulation.simulated_rig import true_calibration
    from sensors.simulation.vehicle import VehicleSpec, build_stand

    if options.vehicle is None:
        return true_calibration(place.rig, place.side, options.rig, options.seed)
    rigs = build_stand(VehicleSpec(), options.seed, options.rig).rigs
    if place.rig not in rigs:
        raise ConfigurationError(
            field=f"rigs.{place.rig}.simulated.vehicle",
            expected=f"a rig of a vehicle with four wheels: {', '.join(rigs)}",
            seen=place.rig,
        )
    return rigs[place.rig]


def _wheels(options: SimulatedOptions, place: RigPlace) -> WheelSource | None:
    from sensors.simulation.vehicle import VehicleDraw, VehicleSpec, build_stand, passing_vehicle

    vehicle = options.vehicle
    if vehicle is None:
        return None
    stand = build_stand(VehicleSpec(), options.seed, options.rig)
    draw = VehicleDraw(
        tyre_width_sigma_mm=vehicle.tyre_width_sigma_mm, load_mm=vehicle.load_mm, runout_mm=vehicle.runout_mm
    )
    yaw = math.radians(vehicle.yaw_deg)

    def wheel(number: int) -> WheelScene:
        return passing_vehicle(options.seed, number, draw, yaw, vehicle.offset_mm).scene(place.rig, stand)

    return wheel


def _calibration(options: SimulatedOptions, place: RigPlace) -> KnownCalibration:
    from sensors.simulation.simulated_rig import (
        TRUE_CALIBRATION_METHOD,
        TRUE_CALIBRATION_UTC,
    )

    return KnownCalibration(_true(options, place), TRUE_CALIBRATION_METHOD, TRUE_CALIBRATION_UTC)


DRIVER = RigDriver(SimulatedOptions, _make, check=_check, calibration=_calibration, simulates=True)
"""The driver ``simulated``."""
