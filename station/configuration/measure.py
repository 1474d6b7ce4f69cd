"""What a station's file may choose of the measurement."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field, field_validator, model_validator

from alignment.errors import DegenerateInputError
from alignment.values import MeasureSettings, PlaneMethod
from sensors.formats import StrictModel

SMALLEST_K, LARGEST_K = 1.6, 5.0
"""Believable coverage factors: 1.645 stands for 90 %."""
_Millimetres = Annotated[float, Field(ge=-500, le=500)]


class MeasureOptions(StrictModel):
    """Choices of the measurement."""

    depth_range_mm: tuple[_Millimetres, _Millimetres] = Field(
        default=(-60.0, 60.0), description="Lowest and highest z of the tyre's surface in the rig frame"
    )
    method: PlaneMethod = Field(
        default="revolution",
        description="Surface of revolution with a free profile; robust plane, or plane through nine bends of "
        "the light lines, for comparison",
    )
    minimum_points: int = Field(
        default=300, ge=10, le=1_000_000, description="Fewer points per head refuse the measurement"
    )
    maximum_angle_deg: float = Field(
        default=10.0, gt=0, le=15, description="Largest believable camber or toe, degrees"
    )
    coverage_factor: float = Field(
        default=2.0,
        ge=SMALLEST_K,
        le=LARGEST_K,
        description="k of the expanded uncertainty; 2 for about 95 %",
    )

    allow_lost_head: bool = Field(
        default=False, description="The other heads measure when one is lost; the result is marked degraded"
    )

    @field_validator("coverage_factor", mode="before")
    @classmethod
    def _is_expanded(cls, k: object) -> object:
        """Say what else the number would be; other kinds of values are left to the field's type."""
        if isinstance(k, int | float) and not SMALLEST_K <= k <= LARGEST_K:
            cure = "2 stands for about 95 %, 3 for 99.7 %"
            if 0.5 < k < 1.0 or 50.0 < k < 100.0:
                cure += f"; {k:g} would be a level of confidence, not a factor"
            elif k == 1.0:
                cure += "; 1 would make every u95 a standard uncertainty"
            raise DegenerateInputError(
                expected=f"a factor from {SMALLEST_K:g} to {LARGEST_K:g}", seen=f"{k:g}", cure=cure
            )
        return k

    @model_validator(mode="after")
    def _range_is_in_order(self) -> MeasureOptions:
        low, high = self.depth_range_mm
        if low >= high:
            raise DegenerateInputError(
                field="depth_range_mm", expected="the lower value first", seen=f"{low}, {high}"
            )
        return self

    def settings(self) -> MeasureSettings:
        """Return the value that the mathematics uses."""
        return MeasureSettings(
            depth_range_mm=self.depth_range_mm,
            method=self.method,
            minimum_points=self.minimum_points,
            maximum_angle=math.radians(self.maximum_angle_deg),
            coverage_factor=self.coverage_factor,
            allow_lost_head=self.allow_lost_head,
        )
