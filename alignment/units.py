"""Units of angles that a person reads; everything else is in radians."""

from __future__ import annotations

import math

ARCMIN = math.pi / (180.0 * 60.0)
"""One arcminute, radians."""


def in_arcminutes(angle: float, sign: str = "") -> str:
    """Return an angle, radians, as a person reads it: ``10′``, with ``"+"`` for the sign ``+10′``."""
    return f"{60.0 * math.degrees(angle):{sign}.4g}′"


def in_degrees(angle: float | None) -> float | None:
    """Return an angle, radians, in degrees; None for one that there is not."""
    return None if angle is None else math.degrees(angle)
