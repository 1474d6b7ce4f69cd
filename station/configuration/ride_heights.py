"""What a vehicle type says of its ride height: design heights, and how camber and toe change with them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated

from pydantic import Field, model_validator

from alignment.errors import DegenerateInputError
from alignment.vehicle import RideHeightCurve
from sensors.formats import StrictModel

LEAST_HEIGHT_MM, MOST_HEIGHT_MM = 50.0, 1500.0
"""Between these lies a ride height, millimetres, wherever on the body it is measured."""
_Height = Annotated[float, Field(ge=LEAST_HEIGHT_MM, le=MOST_HEIGHT_MM)]
_Part = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,40}$")]
_MOST_RISE_DEG_PER_MM = {"camber_deg": 0.2, "toe_deg": 0.05}
"""Steepest believable course; a suspension's lies far below, and arcminutes far above."""


class HeightPoint(StrictModel):
    """Camber and toe of a wheel at one ride height; only their differences along the curve count."""

    height_mm: _Height = Field(description="Ride height, millimetres")
    camber_deg: float = Field(ge=-15, le=15, description="Camber there, degrees")
    toe_deg: float = Field(ge=-5, le=5, description="Individual toe there, degrees")


class HeightCurve(StrictModel):
    """Camber and toe of the wheels of an axle, or of one wheel, over their ride height."""

    design_mm: _Height = Field(description="Ride height at which camber and toe are judged, millimetres")
    points: tuple[HeightPoint, ...] = Field(
        strict=False, min_length=2, max_length=50, description="By rising height; between them a smooth curve"
    )

    @model_validator(mode="after")
    def _is_a_curve(self) -> HeightCurve:
        for before, after in zip(self.points, self.points[1:], strict=False):
            step = after.height_mm - before.height_mm
            if step <= 0.0:
                raise DegenerateInputError(
                    field="points",
                    expected="heights that rise from point to point",
                    seen=f"{before.height_mm:g}, then {after.height_mm:g}",
                )
            for name, most in _MOST_RISE_DEG_PER_MM.items():
                rise = abs(getattr(after, name) - getattr(before, name))
                if rise > most * step * (1.0 + 1e-9):
                    raise DegenerateInputError(
                        field="points",
                        expected=f"{name} that changes by at most {most:g}° per millimetre",
                        seen=f"{rise:g}° from {before.height_mm:g} to {after.height_mm:g} mm",
                        cure="Check the unit: degrees are asked for",
                    )
        low, high = self.points[0].height_mm, self.points[-1].height_mm
        if not low <= self.design_mm <= high:
            raise DegenerateInputError(
                field="design_mm",
                expected=f"a height on the curve, {low:g} to {high:g}",
                seen=f"{self.design_mm:g}",
            )
        return self

    def curve(self, largest_mm: float) -> RideHeightCurve:
        """Return the curve for the mathematics; corrected is up to `largest_mm` from its design height."""
        return RideHeightCurve(
            tuple(point.height_mm for point in self.points),
            tuple(math.radians(point.camber_deg) for point in self.points),
            tuple(math.radians(point.toe_deg) for point in self.points),
            largest_mm,
        )


class RideHeightOptions(StrictModel):
    """By how much camber and toe are brought to the design height, and from how far."""

    require: bool = Field(
        default=True,
        description="Whether a wheel of unknown ride height is not judged; else it is judged as it stands, "
        "and the result says that its height is not known",
    )
    sigma_mm: float = Field(
        default=1.0,
        ge=0.01,
        le=20,
        description="Spread of a told height about the true one, one standard deviation, millimetres",
    )
    oldest_s: float = Field(
        default=60.0, gt=0, le=3600, description="Age beyond which a told height counts for nothing, seconds"
    )
    largest_mm: float = Field(
        default=30.0,
        gt=0,
        le=300,
        description="Farthest from the design height from which a wheel is corrected, millimetres; beyond it "
        "is not judged",
    )
    at: dict[_Part, HeightCurve] = Field(
        min_length=1,
        max_length=24,
        description="Curve of an axle ('front'), or of a single wheel ('front_left'), which goes before",
    )

    def of(self, wheel: str) -> HeightCurve | None:
        """Return the curve of a wheel: its own, else that of its axle; None where the type has none."""
        return self.at.get(wheel) or self.at.get(wheel.rpartition("_")[0])

    def check_parts(self, axles: Iterable[str]) -> None:
        """Refuse curves of what the vehicle type has not."""
        known = {f"{axle}{end}" for axle in axles for end in ("", "_left", "_right")}
        unknown = sorted(set(self.at) - known)
        if unknown:
            raise DegenerateInputError(
                field="ride_height.at",
                expected=f"axles or wheels of this type: {', '.join(sorted(known))}",
                seen=", ".join(unknown),
            )
