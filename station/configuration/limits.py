"""The limits of an angle or a length."""

from __future__ import annotations

import math
from dataclasses import dataclass

from alignment.errors import DegenerateInputError


@dataclass(frozen=True)
class Limits:
    """Lowest and highest accepted value, radians or millimetres, both accepted themselves."""

    low: float
    high: float

    def __post_init__(self) -> None:
        if not -math.inf < self.low < self.high < math.inf:
            raise DegenerateInputError(
                field="limits", expected="finite, low below high", seen=f"{self.low} to {self.high}"
            )
