"""What locking a nut usually adds, per vehicle type and station: "locked" less "taken" values teach it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from alignment.errors import DegenerateInputError

FIRST_WEIGHT = 0.25
"""What a vehicle type says of the drift counts as so many locked nuts: a guess, beside the first real one."""
MOST_WEIGHT = 60.0
"""More are not remembered, so that the mean follows a new tool or another batch of parts."""
_SAME_NUT = 0.3
"""Least share of what the last locking of this very nut did beyond the mean that is expected again."""
_FAR = 2.0


@dataclass(frozen=True)
class Drift:
    """What locking adds to the angle of one kind of adjuster, radians.

    Attributes
    ----------
    mean
        Of all that was seen, and of what the vehicle type says.
    bound
        Most that a target leaves room for, to either side; a sample beyond twice of it is no drift.
    used
        Whether a target leaves room for it.
    weight
        Locked nuts behind the mean.
    """

    mean: float
    bound: float
    used: bool = True
    weight: float = FIRST_WEIGHT

    def __post_init__(self) -> None:
        if not (math.isfinite(self.mean) and 0.0 <= self.bound < math.inf):
            raise DegenerateInputError(
                field="drift", expected="a finite mean and bound", seen=f"{self.mean}, {self.bound}"
            )

    def after(self, sample: float) -> Drift:
        """Return what is known after another nut was locked; what cannot be a drift teaches nothing."""
        if not abs(sample) <= _FAR * self.bound:
            return self
        weight = min(self.weight + 1.0, MOST_WEIGHT)
        return replace(self, mean=self.mean + (sample - self.mean) / weight, weight=weight)

    def expected(self, last: float | None = None) -> float:
        """Return what a target leaves room for, within the bound.

        `last` is what the last locking of this very nut did, within this adjusting.
        """
        if not self.used:
            return 0.0
        mean = self.mean
        if last is not None and abs(last) <= _FAR * self.bound:
            mean += max(_SAME_NUT, 1.0 / (1.0 + self.weight)) * (last - mean)
        return max(-self.bound, min(self.bound, mean))
