"""Vehicle types: which angles the wheels of a vehicle may have; one TOML file each."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from alignment.errors import ConfigurationError, DegenerateInputError, FormatError
from alignment.vehicle import TyreWidths
from alignment.wheel import FEWEST_EXPOSURES, MOST_EXPOSURES, most_turn
from sensors.formats import StrictModel, entries
from station.configuration.adjusters import AxleAdjusters
from station.configuration.lengths import LengthTolerances
from station.configuration.ride_heights import RideHeightOptions
from station.configuration.steering import SteeringAxisTolerances, SteeringOptions
from station.configuration.sweeps import SweepPlan
from station.configuration.tolerances import Tolerance, check_width
from station.configuration.toml import read_toml

WIDEST_DEG = {
    "camber": 3.0,
    "toe": 1.0,
    "total_toe": 2.0,
    "camber_difference": 3.0,
    "thrust_angle": 1.0,
    "yaw": 3.0,
}
"""Largest believable accepted deviation to both sides of each angle, degrees; arcminutes lie above."""
TyreWidth = Annotated[float, Field(ge=80, le=500)]
LEAST_TURN_DEG, MOST_TURN_DEG = 120.0, 10_710.0
"""Of a turn that a series must cover, degrees; less says too little of where its centre is."""
Measured = Literal["tyre_plane", "spin_axis"]
"""What is measured and judged: the plane of the tyre as it stands, or the axis about which it turns."""
QUANTITY = (
    "'tyre_plane': one exposure of each wheel; 'spin_axis': a series of exposures while rollers turn the "
    "wheels, free of run-out"
)
Label = Annotated[str, Field(min_length=1, max_length=80, pattern=r"^[^\x00-\x1f\x7f]+$")]
AxleName = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,30}$")]


def check_series(exposures: int, least_turn_deg: float) -> None:
    """Refuse a turn of which so many exposures cannot tell."""
    most = math.degrees(most_turn(exposures))
    if least_turn_deg > most:
        raise DegenerateInputError(
            field="least_turn_deg",
            expected=f"at most {most:.0f}, of which {exposures} exposures can tell",
            seen=f"{least_turn_deg:g}",
            cure="Take more exposures, or ask for less",
        )


class AxleTolerances(StrictModel):
    """Limits of one axle; signs: camber positive when the top leans outboard, toe positive for toe-in."""

    camber: Tolerance = Field(description="Camber of each wheel")
    toe: Tolerance = Field(description="Individual toe of each wheel")
    total_toe: Tolerance | None = Field(default=None, description="Left plus right toe; not judged without")
    camber_difference: Tolerance | None = Field(
        default=None, description="Left minus right camber; not judged without"
    )
    tyre_width_mm: TyreWidth | None = Field(
        default=None,
        description="Section width of this axle's tyres, where it is not the vehicle's, millimetres",
    )
    run_out_mm: float | None = Field(
        default=None,
        ge=0.05,
        le=20,
        description="Largest run-out of each tyre where the spin axis is measured, millimetres peak to peak; "
        "not judged without",
    )

    @model_validator(mode="after")
    def _are_believable(self) -> AxleTolerances:
        for name, widest_deg in WIDEST_DEG.items():
            check_width(name, getattr(self, name, None), widest_deg)
        return self


class VehicleType(StrictModel):
    """What is accepted of one type of vehicle."""

    number: int = Field(ge=0, le=65_535, description="Number by which the line names this type")
    name: Label = Field(description="Name, for people and records")
    guard_band: bool = Field(
        default=True,
        description="Narrow the limits by the expanded uncertainty before the verdict (ISO 14253-1)",
    )
    thrust_sign: Literal["left_positive", "right_positive"] = Field(
        default="left_positive", description="Which side a positive thrust angle points to"
    )
    axles: dict[AxleName, AxleTolerances] = Field(
        min_length=1, max_length=8, description="Limits per axle; 'front' and 'rear' for a car"
    )
    thrust_angle: Tolerance | None = Field(
        default=None, description="Direction in which the rear axle rolls; not judged without"
    )

    yaw: Tolerance | None = Field(
        default=None,
        description="How far the vehicle may be turned on the stand, positive to the left; not judged"
        " without, nor where the rigs stand in no common frame",
    )
    lengths: LengthTolerances = Field(
        default=LengthTolerances(),
        description="Wheelbase, track, setback, offsets; not judged where the rigs stand in no common frame",
    )
    tyre_width_mm: TyreWidth | None = Field(
        default=None,
        description="Section width of the tyres, from sidewall to sidewall without letters, millimetres; with"
        " it lengths are measured between contact centres, without it between sidewalls",
    )
    tyre_width_sigma_mm: float = Field(
        default=0.5,
        ge=0,
        le=5,
        description="Spread of single tyres about their width, one standard deviation, millimetres; it is in"
        " the uncertainty of individual toe and thrust angle",
    )
    measure: Measured | None = Field(default=None, description=f"{QUANTITY}; as the station says without")
    exposures: int | None = Field(
        default=None,
        ge=FEWEST_EXPOSURES,
        le=MOST_EXPOSURES,
        description="Exposures of a wheel that turns; as the station says without",
    )
    least_turn_deg: float | None = Field(
        default=None,
        ge=LEAST_TURN_DEG,
        le=MOST_TURN_DEG,
        description="Least turn from the first of them to the last, degrees; as the station says without",
    )
    run_out_radius_mm: float = Field(
        default=300.0, ge=100, le=1000, description="Radius at which run-out is told, millimetres"
    )
    steering: SteeringOptions | None = Field(
        default=None, description="Steering wheel, and straight ahead; without it front toe is taken as it is"
    )
    ride_height: RideHeightOptions | None = Field(
        default=None, description="Design heights and curves; without it camber and toe are taken as they are"
    )
    steering_axis: SteeringAxisTolerances = Field(
        default=SteeringAxisTolerances(),
        description="Caster, kingpin inclination and what belongs to them, in the mode sweep",
    )
    sweep: SweepPlan | None = Field(
        default=None, description="How the steering is swept; without it there is no mode sweep"
    )
    adjusting: dict[AxleName, AxleAdjusters] = Field(
        default={},
        max_length=8,
        description="What can be turned, per axle; without the table nobody is guided in mode adjust",
    )

    @model_validator(mode="after")
    def _angles_are_believable(self) -> VehicleType:
        check_width("thrust_angle", self.thrust_angle, WIDEST_DEG["thrust_angle"])
        check_width("yaw", self.yaw, WIDEST_DEG["yaw"])
        for axle in self.adjusting:
            if axle not in self.axles:
                raise DegenerateInputError(
                    field=f"adjusting.{axle}",
                    expected=f"an axle with limits: {', '.join(self.axles)}",
                    seen=f"'{axle}'",
                )
        judged = [*self.lengths.stated, *([] if self.yaw is None else ["yaw"])]
        if self.steering is not None and self.steering.offset is not None:
            judged.append("steering.offset")
        if judged and self.thrust_angle is None:
            # Record and line have one verdict of the vehicle, which rests on the thrust angle's limits.
            raise DegenerateInputError(
                field="thrust_angle",
                expected=f"limits, because {', '.join(judged)} has some: they are one verdict of the vehicle",
                seen="none",
            )
        if self.ride_height is not None:
            self.ride_height.check_parts(self.axles)
        return self

    def tyre_widths(self) -> TyreWidths:
        """Return the widths as the mathematics takes them."""
        front, rear = (
            None if axle is None or axle.tyre_width_mm is None else axle.tyre_width_mm
            for axle in (self.axles.get("front"), self.axles.get("rear"))
        )
        return TyreWidths(
            self.tyre_width_mm if front is None else front,
            self.tyre_width_mm if rear is None else rear,
            self.tyre_width_sigma_mm,
        )


def read_vehicle_type(path: Path) -> VehicleType:
    """Read one vehicle type; errors as `station.toml.read_toml`."""
    return read_toml(VehicleType, path, "a vehicle type")


def read_vehicle_types(folder: Path) -> Mapping[int, VehicleType]:
    """Read all vehicle types of a folder, by their number.

    Raises
    ------
    ConfigurationError
        When there is none, one cannot be read, or two have the same number or name.
    """
    try:
        paths = entries(folder, "*.toml", "vehicle types")
    except FormatError as error:
        raise ConfigurationError(
            file=folder, expected=error.expected, seen=error.seen, cure=error.cure, remedy=error.remedy
        ) from error
    if not paths:
        raise ConfigurationError(
            file=folder, expected="a folder with one TOML file per vehicle type", seen="none"
        )
    found: dict[int, VehicleType] = {}
    origin: dict[int | str, Path] = {}
    for path in paths:
        kind = read_vehicle_type(path)
        for field, key in (("number", kind.number), ("name", kind.name)):
            if key in origin:
                raise ConfigurationError(
                    file=path,
                    field=field,
                    expected="one that no other vehicle type has",
                    seen=f"{key!r}, as in {origin[key].name}",
                )
            origin[key] = path
        found[kind.number] = kind
    return found
