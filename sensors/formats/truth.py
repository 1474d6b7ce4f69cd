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
class TyreLoad:
    """How a tyre on the road differs from the same tyre in the air; it stays where the road is.

    Every part moves the sidewall along the tyre's axis, has its own shape over the angle from the contact
    patch and its own radial profile, and leaves the bead where it is.

    Attributes
    ----------
    bulge_mm
        Largest bulge outboard, over the contact patch.
    width_deg
        Half width of the bulge: the standard deviation of a Gaussian; a wave is as wide at half height.
    shape
        ``gaussian``; ``wave``: decays and swings back, as a ring on an elastic foundation.
    side_mm
        Shift of the tread by side force, outboard positive.
    side_width_deg
        Half width of that shift, as `width_deg`; broader than the bulge.
    longitudinal_mm
        Largest bulge ahead of the contact patch, and hollow behind it, by longitudinal force; either sign.
    crest
        Where the bulge is greatest: 0 at the rim's edge, 1 at the tread.
    tread
        About the share of the bulge that is left at the tread.
    """

    bulge_mm: float = 0.0
    width_deg: float = 24.0
    shape: Literal["gaussian", "wave"] = "gaussian"
    side_mm: float = 0.0
    side_width_deg: float = 48.0
    longitudinal_mm: float = 0.0
    crest: float = 0.55
    tread: float = 0.2


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
    load
        What the road did to the tyre; None for a wheel in the air.
    rim_runout_mm
        Axial run-out of the rim against the spin axis, peak to peak at its edge.
    second_harmonic_mm
        Second harmonic of the tyre's run-out, peak to peak at the tread.
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
    load: TyreLoad | None = None
    rim_runout_mm: float = 0.0
    second_harmonic_mm: float = 0.0


class LoadOptions(StrictModel):
    """What the road does to a tyre; fields as `TyreLoad`."""

    bulge_mm: float = Field(
        default=0.0, ge=0, le=30, description="Largest bulge of the sidewall, millimetres"
    )
    width_deg: float = Field(default=24.0, ge=5, le=60, description="Half width of the bulge, degrees")
    shape: Literal["gaussian", "wave"] = Field(
        default="gaussian", description="How the bulge falls off over the angle; a wave swings back"
    )
    side_mm: float = Field(
        default=0.0, ge=-30, le=30, description="Shift of the tread by side force, millimetres"
    )
    side_width_deg: float = Field(default=48.0, ge=5, le=120, description="Half width of that shift, degrees")
    longitudinal_mm: float = Field(
        default=0.0,
        ge=-10,
        le=10,
        description="Bulge ahead of the contact patch, hollow behind it, millimetres",
    )
    crest: float = Field(
        default=0.55, ge=0.2, le=0.8, description="Where the bulge is greatest: 0 rim's edge, 1 tread"
    )
    tread: float = Field(
        default=0.2, ge=0, le=0.9, description="About the share of the bulge left at the tread"
    )

    @classmethod
    def of(cls, load: TyreLoad) -> LoadOptions:
        """Return what a file says of a load."""
        return cls(**asdict(load))

    def load(self) -> TyreLoad:
        """Return the value that the renderer takes."""
        return TyreLoad(**self.model_dump())


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
    load: LoadOptions | None = Field(
        default=None, description="What the road did to the tyre; null in the air"
    )
    rim_runout_mm: float = Field(
        default=0.0,
        ge=0,
        le=100,
        description="Axial run-out of the rim, peak to peak at its edge, millimetres",
    )
    second_harmonic_mm: float = Field(
        default=0.0,
        ge=0,
        le=100,
        description="Second harmonic of the tyre's run-out at the tread, millimetres",
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
    load = None if found.load is None else found.load.load()
    return WheelTruth(**found.model_dump(exclude={"schema_", "load"}), load=load)


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
