"""What a vehicle type says of its steering: straight ahead, and limits of the steering axes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

from pydantic import Field, model_validator

from alignment.errors import DegenerateInputError
from sensors.formats import StrictModel
from station.configuration.lengths import LengthTolerance
from station.configuration.tolerances import Tolerance, check_width

LARGEST_AXIS_DEG = 30.0
"""Largest angle of a steering axis, degrees: caster and kingpin inclination of vehicles lie far below."""
LARGEST_WHEEL_DEG = 90.0
"""Farthest from straight ahead, degrees of the steering wheel, from which front toe may be corrected."""
_AxisDegrees = Annotated[float, Field(ge=-LARGEST_AXIS_DEG, le=LARGEST_AXIS_DEG)]
_WIDEST_OFFSET_DEG, _WIDEST_AXIS_DEG, _FARTHEST_MM, _WIDEST_MM = 10.0, 5.0, 200.0, 50.0


class SteeringOptions(StrictModel):
    """The steering wheel of a vehicle type, and what straight ahead has to do with front toe."""

    ratio: float = Field(
        ge=5,
        le=40,
        description="Turn of the steering wheel for one of the front wheels, about straight ahead",
    )
    ratio_sigma: float = Field(
        default=0.3, ge=0, le=5, description="Spread of the ratio between vehicles, one standard deviation"
    )
    offset_deg: float = Field(
        default=0.0,
        ge=-45,
        le=45,
        description="What the line tells of a steering wheel that stands straight, degrees, left positive",
    )
    angle_sigma_deg: float = Field(
        default=0.2,
        ge=0.001,
        le=5,
        description="Spread of the told angle about the true one, one standard deviation, degrees",
    )
    oldest_s: float = Field(
        default=0.5, gt=0, le=60, description="Age beyond which a told angle counts for nothing, seconds"
    )
    largest_deg: float = Field(
        default=5.0,
        gt=0,
        le=LARGEST_WHEEL_DEG,
        description="Farthest from straight ahead from which front toe is corrected, degrees of the steering "
        "wheel; beyond it is not judged",
    )
    require_straight_ahead: bool = Field(
        default=True,
        description="Whether front toe without a fresh angle is not judged; else it is judged as it stands, "
        "and the result says that straight ahead was not checked",
    )
    offset: Tolerance | None = Field(
        default=None,
        description="How the steering wheel may stand when the vehicle drives straight ahead, left positive; "
        "not judged without",
    )

    @model_validator(mode="after")
    def _is_believable(self) -> SteeringOptions:
        check_width("offset", self.offset, _WIDEST_OFFSET_DEG)
        if self.largest_deg <= 3.0 * self.angle_sigma_deg:
            raise DegenerateInputError(
                field="largest_deg",
                expected=f"more than three times angle_sigma_deg, {self.angle_sigma_deg:g}",
                seen=f"{self.largest_deg:g}",
                cure="A steering wheel that stands straight would be refused for the spread of its angle",
            )
        return self


class AxisTolerance(Tolerance):
    """Limits of one angle of a steering axis, which is larger than any of a wheel."""

    nominal_deg: _AxisDegrees | None = Field(default=None, description="Nominal value, degrees")
    lower_deg: _AxisDegrees | None = Field(default=None, description="Lowest accepted value, degrees")
    upper_deg: _AxisDegrees | None = Field(default=None, description="Highest accepted value, degrees")


class SteeringAxisTolerances(StrictModel):
    """Limits of the steering axis of each front wheel, judged in the mode sweep; what is left out is not."""

    caster: AxisTolerance | None = Field(
        default=None, description="Caster of each wheel, positive when the top leans rearward"
    )
    kpi: AxisTolerance | None = Field(
        default=None,
        description="Kingpin inclination of each wheel, positive when the top leans inboard",
    )
    included_angle: AxisTolerance | None = Field(
        default=None, description="Kingpin inclination plus camber of each wheel"
    )
    toe_out: AxisTolerance | None = Field(
        default=None, description="Steered angle of the inner wheel less that of the outer one"
    )
    trail: LengthTolerance | None = Field(
        default=None,
        description="Caster trail at the road, positive when the axis meets it before the contact",
    )
    scrub: LengthTolerance | None = Field(
        default=None, description="Scrub radius at the road, positive when the axis meets it inboard"
    )
    caster_difference: AxisTolerance | None = Field(default=None, description="Left minus right caster")
    kpi_difference: AxisTolerance | None = Field(
        default=None, description="Left minus right kingpin inclination"
    )

    @model_validator(mode="after")
    def _are_believable(self) -> SteeringAxisTolerances:
        for name, tolerance in self.stated.items():
            if isinstance(tolerance, Tolerance):
                check_width(name, tolerance, _WIDEST_AXIS_DEG)
            else:
                _check_length(name, tolerance)
        return self

    @property
    def stated(self) -> Mapping[str, Tolerance | LengthTolerance]:
        """What has limits."""
        given = {name: getattr(self, name) for name in type(self).model_fields}
        return {name: tolerance for name, tolerance in given.items() if tolerance is not None}


def _check_length(name: str, tolerance: LengthTolerance) -> None:
    limits = tolerance.limits()
    half = 0.5 * (limits.high - limits.low)
    if not -_FARTHEST_MM <= limits.low < limits.high <= _FARTHEST_MM or half > _WIDEST_MM * (1.0 + 1e-9):
        raise DegenerateInputError(
            field=name,
            expected=f"limits within ±{_FARTHEST_MM:g} mm, at most ±{_WIDEST_MM:g} mm wide",
            seen=f"{limits.low:g} to {limits.high:g}",
            cure="Check the unit: millimetres are asked for",
        )
