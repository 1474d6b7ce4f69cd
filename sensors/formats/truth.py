"""What a simulated wheel really was, schema ``truewheel.truth/1``. The measuring code never opens it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from os import PathLike
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from alignment.values import Side
from sensors.formats.files import write_bytes
from sensors.formats.validation import StrictModel, dump_json, load_json, validate

_Degrees = Annotated[float, Field(ge=-45, le=45)]
_Millimetres = Annotated[float, Field(ge=-1000, le=1000)]


@dataclass(frozen=True)
class WheelTruth:
    """The angles of one simulated wheel, signs as the conventions say.

    Attributes
    ----------
    side
        Side of the vehicle.
    seed
        Of the random generator that made the scene and its noise.
    camber_deg, toe_deg
        Of the tyre plane at this exposure, degrees: what one exposure can measure.
    spin_camber_deg, spin_toe_deg
        Of the spin axis, degrees; without run-out the same.
    spin_angle_deg
        How far the wheel was turned about its spin axis, degrees.
    runout_mm
        Axial run-out, peak to peak at `runout_radius_mm`.
    runout_radius_mm
        Radius at which `runout_mm` is stated.
    centre_mm
        (x, y, z) of the wheel's centre, rig frame.
    """

    side: Side
    seed: int
    camber_deg: float
    toe_deg: float
    spin_camber_deg: float
    spin_toe_deg: float
    spin_angle_deg: float = 0.0
    runout_mm: float = 0.0
    runout_radius_mm: float = 300.0
    centre_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)


class TruthFile(StrictModel):
    """What a truth file holds."""

    schema_: Literal["truewheel.truth/1"] = Field(alias="schema", description="Kind and version of this file")
    side: Literal["left", "right"] = Field(description="Side of the vehicle")
    seed: int = Field(ge=0, lt=2**64, description="Seed of the scene and its noise")
    camber_deg: _Degrees = Field(description="Camber of the tyre plane at this exposure, degrees")
    toe_deg: _Degrees = Field(description="Toe of the tyre plane at this exposure, degrees")
    spin_camber_deg: _Degrees = Field(description="Camber of the spin axis, degrees")
    spin_toe_deg: _Degrees = Field(description="Toe of the spin axis, degrees")
    spin_angle_deg: float = Field(
        ge=-3600, le=3600, description="Turn of the wheel about its spin axis, degrees"
    )
    runout_mm: float = Field(ge=0, le=100, description="Axial run-out, peak to peak, millimetres")
    runout_radius_mm: float = Field(
        gt=0, le=1000, description="Radius at which the run-out is stated, millimetres"
    )
    centre_mm: tuple[_Millimetres, _Millimetres, _Millimetres] = Field(
        description="Centre of the wheel in the rig frame, millimetres"
    )


def read_truth(path: str | PathLike[str]) -> WheelTruth:
    """Read the truth of a simulated wheel.

    Raises
    ------
    FormatError
        When the file is missing, is no JSON, or any field is missing, unknown or out of range.
    """
    path = Path(path)
    found = validate(TruthFile, load_json(path, "the truth of a simulated wheel"), file=path)
    return WheelTruth(**found.model_dump(exclude={"schema_"}))


def write_truth(path: str | PathLike[str], truth: WheelTruth) -> None:
    """Write the truth of a simulated wheel, whole or not at all.

    Raises
    ------
    FormatError
        When a value is out of the format's range, or the file cannot be written.
    """
    path = Path(path)
    data = {"schema": "truewheel.truth/1", **asdict(truth)}
    write_bytes(path, dump_json(validate(TruthFile, data, file=path)))
