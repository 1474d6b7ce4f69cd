"""Limits of a vehicle's lengths and of how it stands: millimetres, where those of its angles are degrees."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

from pydantic import Field, model_validator

from alignment.errors import DegenerateInputError
from alignment.vehicle import LENGTHS
from sensors.formats import StrictModel
from station.configuration.limits import Limits

_Millimetres = Annotated[float, Field(ge=-10_000, le=10_000)]
_RANGES_MM = {"wheelbase": (1200.0, 8000.0), "track": (700.0, 2800.0), "sidewall_track": (700.0, 3200.0)}
"""Between these lies what is accepted of a length; of a difference, a setback or an offset about zero."""
_WIDEST_MM, _FARTHEST_MM = 50.0, 100.0
_UNITS = {"metres": 1000.0, "centimetres": 10.0, "inches": 25.4, "micrometres": 0.001}


class LengthTolerance(StrictModel):
    """Limits of one length: nominal ± tolerance, or lower and upper."""

    nominal_mm: _Millimetres | None = Field(default=None, description="Nominal value, millimetres")
    tolerance_mm: float | None = Field(
        default=None, gt=0, le=10_000, description="Accepted deviation to both sides, millimetres"
    )
    lower_mm: _Millimetres | None = Field(default=None, description="Lowest accepted value, millimetres")
    upper_mm: _Millimetres | None = Field(default=None, description="Highest accepted value, millimetres")

    @model_validator(mode="after")
    def _is_one_of_the_two(self) -> LengthTolerance:
        given = [name for name in type(self).model_fields if getattr(self, name) is not None]
        if given not in (["nominal_mm", "tolerance_mm"], ["lower_mm", "upper_mm"]):
            raise DegenerateInputError(
                expected="either nominal_mm and tolerance_mm, or lower_mm and upper_mm",
                seen=" and ".join(given) or "none of them",
            )
        if self.lower_mm is not None and self.upper_mm is not None and self.lower_mm >= self.upper_mm:
            raise DegenerateInputError(
                field="upper_mm",
                expected=f"above lower_mm, {self.lower_mm:g}",
                seen=f"{self.upper_mm:g}",
                cure="It would fit with the two exchanged",
            )
        return self

    def limits(self) -> Limits:
        """Return the limits in millimetres."""
        if self.nominal_mm is not None and self.tolerance_mm is not None:
            return Limits(self.nominal_mm - self.tolerance_mm, self.nominal_mm + self.tolerance_mm)
        assert self.lower_mm is not None
        assert self.upper_mm is not None
        return Limits(self.lower_mm, self.upper_mm)


class LengthTolerances(StrictModel):
    """Limits of a vehicle's lengths; what is left out is measured and not judged."""

    wheelbase_left: LengthTolerance | None = Field(default=None, description="Wheelbase on the left")
    wheelbase_right: LengthTolerance | None = Field(default=None, description="Wheelbase on the right")
    wheelbase_difference: LengthTolerance | None = Field(
        default=None, description="Left minus right wheelbase"
    )
    track_front: LengthTolerance | None = Field(default=None, description="Track of the front axle")
    track_rear: LengthTolerance | None = Field(default=None, description="Track of the rear axle")
    setback_front: LengthTolerance | None = Field(
        default=None, description="Setback of the front axle, positive when its right wheel is behind"
    )
    setback_rear: LengthTolerance | None = Field(
        default=None, description="Setback of the rear axle, positive when its right wheel is behind"
    )
    axle_offset: LengthTolerance | None = Field(
        default=None,
        description="Lateral offset of the front axle from the thrust line, positive to the left",
    )
    offset_front: LengthTolerance | None = Field(
        default=None, description="How far left of the stand's middle the front axle may stand"
    )
    offset_rear: LengthTolerance | None = Field(
        default=None, description="How far left of the stand's middle the rear axle may stand"
    )

    @model_validator(mode="after")
    def _are_believable(self) -> LengthTolerances:
        for name, tolerance in self.stated.items():
            _check_length(name, tolerance)
        return self

    @property
    def stated(self) -> Mapping[str, LengthTolerance]:
        """The lengths that have limits."""
        given = {name: getattr(self, name) for name in type(self).model_fields}
        return {name: tolerance for name, tolerance in given.items() if tolerance is not None}


assert set(LengthTolerances.model_fields) <= set(LENGTHS)


def _check_length(name: str, tolerance: LengthTolerance) -> None:
    """Refuse limits where no such length lies, or so wide that every vehicle would be accepted."""
    limits = tolerance.limits()
    kind = name.rpartition("_")[0] if name != "wheelbase_difference" else name
    low, high = _RANGES_MM.get(kind, (-_FARTHEST_MM, _FARTHEST_MM))
    if not low <= limits.low < limits.high <= high:
        fits = [
            unit
            for unit, factor in _UNITS.items()
            if low <= factor * limits.low < factor * limits.high <= high and kind in _RANGES_MM
        ]
        raise DegenerateInputError(
            field=name,
            expected=f"limits from {low:g} to {high:g} mm",
            seen=f"{limits.low:g} to {limits.high:g}",
            cure=f"It would fit with {fits[0]}: millimetres are asked for" if fits else "Check the unit",
        )
    half = 0.5 * (limits.high - limits.low)
    widest = _FARTHEST_MM if name.startswith("offset") else _WIDEST_MM
    if half > widest * (1.0 + 1e-9):
        raise DegenerateInputError(
            field=name, expected=f"limits at most ±{widest:g} mm wide", seen=f"±{half:g} mm"
        )
