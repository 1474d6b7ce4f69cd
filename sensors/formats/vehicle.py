"""A vehicle before its rigs: what its maker states, and what a simulated one was.

A folder of a vehicle holds ``vehicle.json`` and one folder for each rig, with a shot or with the exposures
``turn_01`` … of a wheel that was turned, or ``pos_01`` … of one that was steered, and the calibration that
puts the rig into the stand's frame. A simulated one has a ``truth.json`` or a ``steering_truth.json``,
which the measuring code never opens.
"""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from alignment.vehicle import VehicleWheel
from sensors.formats.files import write_bytes
from sensors.formats.truth import LoadOptions
from sensors.formats.validation import Name, StrictModel, dump_json, load_json, validate

VEHICLE_FILE, VEHICLE_TRUTH_FILE, STEERING_TRUTH_FILE = "vehicle.json", "truth.json", "steering_truth.json"
_Degrees = Annotated[float, Field(ge=-45, le=45)]
_Length = Annotated[float, Field(ge=500, le=10_000)]
_Small = Annotated[float, Field(ge=-1000, le=1000)]
_Place = Annotated[float, Field(ge=-10_000, le=10_000)]
_Width = Annotated[float, Field(ge=50, le=500)]


class VehicleFile(StrictModel):
    """What is stated of a vehicle and its stand; what ``vehicle.json`` holds."""

    schema_: Literal["truewheel.vehicle/1"] = Field(
        default="truewheel.vehicle/1", alias="schema", description="Kind and version of this file"
    )
    name: str = Field(min_length=1, max_length=100, description="Of the vehicle type")
    wheelbase_mm: _Length = Field(description="Nominal wheelbase, millimetres")
    track_front_mm: _Length = Field(
        description="Nominal track of the front axle, between contact centres, millimetres"
    )
    track_rear_mm: _Length = Field(description="The same of the rear axle")
    tyre_width_mm: _Width | None = Field(
        default=None,
        description="Section width of the tyres, outermost ring to outermost ring; null when unknown",
    )
    tyre_width_sigma_mm: float = Field(
        default=0.0, ge=0, le=20, description="Spread of single tyres about it, one standard deviation"
    )
    road_z_mm: float | None = Field(
        default=None, ge=-2000, le=2000, description="Height of the wheel supports in the stand's frame"
    )
    rigs: dict[VehicleWheel, Name] = Field(
        min_length=1, description="By position of the wheel, the name of its rig and of its folder"
    )


class WheelOnVehicle(StrictModel):
    """One wheel of a simulated vehicle as it was."""

    kind: Literal["tyre_plane", "spin_axis"] = Field(
        description="What the angles are of: the tyre plane of one exposure, the mean spin axis of several"
    )
    camber_deg: _Degrees = Field(description="Against the normal of the wheel supports")
    toe_deg: _Degrees = Field(description="Against the vehicle's own centreline")
    stand_toe_deg: _Degrees = Field(description="Against X of the stand")
    spin_camber_deg: _Degrees = Field(description="Camber of the spin axis")
    spin_toe_deg: _Degrees = Field(description="Toe of the spin axis against the centreline")
    reference_mm: tuple[_Place, _Place, _Place] = Field(
        description="Where the axis meets the plane of the outermost ring of the sidewall, stand's frame"
    )
    tyre_width_mm: _Width = Field(description="Section width of this tyre")
    runout_mm: float = Field(ge=0, le=100, description="Axial run-out of the tyre, peak to peak")
    load: LoadOptions | None = Field(description="What the road did to the tyre; null in the air")
    rod_turns: float = Field(ge=-100, le=100, description="By which the tie rod was turned since the start")
    bolt_turns: float = Field(
        ge=-100, le=100, description="By which the camber bolt was turned since the start"
    )


class VehicleTruthFile(StrictModel):
    """What a simulated vehicle was; what its ``truth.json`` holds. Signs as the conventions say."""

    schema_: Literal["truewheel.vehicle-truth/1"] = Field(
        default="truewheel.vehicle-truth/1", alias="schema", description="Kind and version of this file"
    )
    seed: int = Field(ge=0, lt=2**64, description="Of the vehicle and its images")
    wheels: dict[VehicleWheel, WheelOnVehicle] = Field(description="By position")
    total_toe_front_deg: _Degrees = Field(description="Left and right together")
    total_toe_rear_deg: _Degrees = Field(description="The same of the rear axle")
    thrust_angle_deg: _Degrees = Field(description="Against the centreline; positive: steers to the left")
    yaw_deg: _Degrees = Field(description="Of the centreline against X of the stand; positive: to the left")
    place_mm: tuple[_Small, _Small] = Field(
        description="Middle between the axles' midpoints in the stand's frame, X and Y"
    )
    wheelbase_left_mm: _Length = Field(description="Between contact centres, along the centreline")
    wheelbase_right_mm: _Length = Field(description="The same on the right")
    track_front_mm: _Length = Field(description="Between contact centres, across the centreline")
    track_rear_mm: _Length = Field(description="The same of the rear axle")
    sidewall_track_front_mm: _Length = Field(description="The same between the wheels' reference points")
    sidewall_track_rear_mm: _Length = Field(description="The same of the rear axle")
    setback_front_mm: _Small = Field(
        description="By how far the left contact centre is ahead of the right one"
    )
    setback_rear_mm: _Small = Field(description="The same of the rear axle")


class SteeringTruth(StrictModel):
    """How one front wheel of a simulated vehicle is steered."""

    caster_deg: _Degrees = Field(description="Against the thrust line; positive: the top leans rearward")
    kpi_deg: _Degrees = Field(description="Kingpin inclination; positive: the top leans inboard")
    included_angle_deg: _Degrees = Field(description="Kingpin inclination and camber of the spin axis")
    trail_mm: _Small = Field(description="By how far the axis meets the road ahead of the contact centre")
    scrub_mm: _Small = Field(description="By how far it meets the road inboard of the contact centre")
    give_deg: _Degrees = Field(description="By which the axis leans inboard at 10° to the left; 0: it stands")
    angles_deg: tuple[_Degrees, ...] = Field(
        min_length=1, description="By which the wheel is steered about the axis at each position, to the left"
    )


class SteeringTruthFile(StrictModel):
    """How a simulated vehicle was steered; what its ``steering_truth.json`` holds."""

    schema_: Literal["truewheel.steering-truth/1"] = Field(
        default="truewheel.steering-truth/1", alias="schema", description="Kind and version of this file"
    )
    seed: int = Field(ge=0, lt=2**64, description="Of the vehicle, its steering and its images")
    wheels: dict[VehicleWheel, SteeringTruth] = Field(description="By front wheel")


def read_steering_truth(path: str | PathLike[str]) -> SteeringTruthFile:
    """Read how a simulated vehicle was steered; errors as `read_vehicle_facts`."""
    path = Path(path)
    return validate(SteeringTruthFile, load_json(path, "the truth of a simulated sweep"), file=path)


def read_vehicle_facts(path: str | PathLike[str]) -> VehicleFile:
    """Read what is stated of a vehicle.

    Raises
    ------
    FormatError
        When the file is missing, is no JSON, or any field is missing, unknown or out of range.
    """
    path = Path(path)
    return validate(VehicleFile, load_json(path, "a vehicle"), file=path)


def read_vehicle_truth(path: str | PathLike[str]) -> VehicleTruthFile:
    """Read the truth of a simulated vehicle; errors as `read_vehicle_facts`."""
    path = Path(path)
    return validate(VehicleTruthFile, load_json(path, "the truth of a simulated vehicle"), file=path)


def write_vehicle(
    path: str | PathLike[str], vehicle: VehicleFile | VehicleTruthFile | SteeringTruthFile
) -> None:
    """Write what is stated of a vehicle, or its truth, whole or not at all.

    Raises
    ------
    FormatError
        When the file cannot be written.
    """
    write_bytes(Path(path), dump_json(vehicle))
