"""Limits of one angle as a vehicle type states them: degrees, nominal ± tolerance or lower and upper."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field, model_validator

from alignment.errors import DegenerateInputError
from sensors.formats import StrictModel
from station.configuration.limits import Limits

LARGEST_DEG = 10.0
_Degrees = Annotated[float, Field(ge=-LARGEST_DEG, le=LARGEST_DEG)]


class Tolerance(StrictModel):
    """Limits of one angle: nominal ± tolerance, or lower and upper."""

    nominal_deg: _Degrees | None = Field(default=None, description="Nominal value, degrees")
    tolerance_deg: float | None = Field(
        default=None, gt=0, le=LARGEST_DEG, description="Accepted deviation to both sides, degrees"
    )
    lower_deg: _Degrees | None = Field(default=None, description="Lowest accepted value, degrees")
    upper_deg: _Degrees | None = Field(default=None, description="Highest accepted value, degrees")

    @model_validator(mode="after")
    def _is_one_of_the_two(self) -> Tolerance:
        given = [name for name in type(self).model_fields if getattr(self, name) is not None]
        if given not in (["nominal_deg", "tolerance_deg"], ["lower_deg", "upper_deg"]):
            raise DegenerateInputError(
                expected="either nominal_deg and tolerance_deg, or lower_deg and upper_deg",
                seen=" and ".join(given) or "none of them",
            )
        if self.lower_deg is not None and self.upper_deg is not None and self.lower_deg >= self.upper_deg:
            raise DegenerateInputError(
                field="upper_deg",
                expected=f"above lower_deg, {self.lower_deg}",
                seen=str(self.upper_deg),
                cure="It would fit with the two exchanged",
            )
        return self

    def limits(self) -> Limits:
        """Return the limits in radians."""
        if self.nominal_deg is not None and self.tolerance_deg is not None:
            low, high = self.nominal_deg - self.tolerance_deg, self.nominal_deg + self.tolerance_deg
        else:
            assert self.lower_deg is not None
            assert self.upper_deg is not None
            low, high = self.lower_deg, self.upper_deg
        return Limits(math.radians(low), math.radians(high))


def check_width(name: str, tolerance: Tolerance | None, widest_deg: float) -> None:
    """Refuse limits so wide that every vehicle would be accepted; they are in another unit."""
    if tolerance is None:
        return
    limits = tolerance.limits()
    half = 0.5 * math.degrees(limits.high - limits.low)
    if half > widest_deg * (1.0 + 1e-9):
        raise DegenerateInputError(
            field=name,
            expected=f"limits at most ±{widest_deg:g}° wide",
            seen=f"±{half:g}°",
            cure=f"It would fit with arcminutes taken for degrees: {half:g}′ are {half / 60.0:.4g}°",
        )
