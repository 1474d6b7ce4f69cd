"""What the line tells of the vehicle that stands there: its steering wheel's angle and its ride heights.

Angles are in degrees and lengths in millimetres, as on the bus. A steering wheel's angle is positive when it
is turned to the left. What is too old or cannot be, the vehicle type judges; nothing here does.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from alignment.errors import InputError


class SteeringSource(enum.StrEnum):
    """Who measured the steering wheel's angle; the words of the DBC's value table.

    VEHICLE: the vehicle's own sensor. LEVEL: a levelling device on the wheel. OPERATOR: said by hand.
    """

    NONE = "none"
    VEHICLE = "vehicle"
    LEVEL = "level"
    OPERATOR = "operator"


@dataclass(frozen=True)
class SteeringWheel:
    """The steering wheel as it was told last.

    Attributes
    ----------
    angle_deg
        Positive when turned to the left; None where the controller says that it is not valid.
    age_s
        Since it was measured, seconds: the age that the controller told, and the time since then.
    source
        Who measured it.
    sample
        Counts the sensor's measurements, 0 to 255 and again: one that stands is a sensor that stands.

    Raises
    ------
    InputError
        For a number that is not finite, or a negative age.
    """

    angle_deg: float | None
    age_s: float = 0.0
    source: SteeringSource = SteeringSource.VEHICLE
    sample: int = 0

    def __post_init__(self) -> None:
        if self.angle_deg is not None and not math.isfinite(self.angle_deg):
            raise InputError(field="angle_deg", expected="a finite angle, or none", seen=str(self.angle_deg))
        _require_age(self.age_s)

    @property
    def valid(self) -> bool:
        """Whether there is an angle."""
        return self.angle_deg is not None

    def fresh(self, oldest_s: float) -> bool:
        """Whether there is an angle that is no older than this."""
        return self.valid and self.age_s <= oldest_s


@dataclass(frozen=True)
class RideHeights:
    """The ride heights as they were told last.

    Attributes
    ----------
    heights_mm
        By wheel, such as ``front_left``; of a wheel that is not named no valid height is known.
    ages_s
        Since each was measured, seconds; of the same wheels.

    Raises
    ------
    InputError
        For a number that is not finite, a negative age, or heights and ages of different wheels.
    """

    heights_mm: Mapping[str, float]
    ages_s: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for wheel, height in self.heights_mm.items():
            if not math.isfinite(height):
                raise InputError(field=f"heights_mm.{wheel}", expected="a finite height", seen=str(height))
        ages = dict(self.ages_s) or dict.fromkeys(self.heights_mm, 0.0)
        if set(ages) != set(self.heights_mm):
            raise InputError(
                field="ages_s", expected="one age for each height", seen=", ".join(ages) or "none"
            )
        for age in ages.values():
            _require_age(age)
        # What is told of a vehicle must not change while it is measured.
        object.__setattr__(self, "heights_mm", MappingProxyType(dict(self.heights_mm)))
        object.__setattr__(self, "ages_s", MappingProxyType(ages))

    def of(self, wheel: str, oldest_s: float = math.inf) -> float | None:
        """Height at a wheel, millimetres; None where it is not known or is older than this."""
        height = self.heights_mm.get(wheel)
        return height if height is not None and self.ages_s[wheel] <= oldest_s else None


def _require_age(age_s: float) -> None:
    if not (math.isfinite(age_s) and age_s >= 0.0):
        raise InputError(field="age_s", expected="a finite age of 0 or more", seen=str(age_s))


@dataclass(frozen=True)
class ToldOfVehicle:
    """All that the line told of the vehicle, at one moment; what it never told, or long ago, is None."""

    steering: SteeringWheel | None = None
    heights: RideHeights | None = None


NOTHING_TOLD = ToldOfVehicle()
