"""Camber and toe at the design height, of a wheel that was measured at another ride height."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import PchipInterpolator

from alignment.arrays import Array
from alignment.errors import DegenerateInputError
from alignment.values import Refusal, RefusalCode

# Gauss–Hermite rule of three points: mean and ±√3 standard deviations (Abramowitz, Stegun, 25.4.46).
_NODES = np.array([-math.sqrt(3.0), 0.0, math.sqrt(3.0)])
_WEIGHTS = np.array([1.0, 4.0, 1.0]) / 6.0


@dataclass(frozen=True, eq=False)
class HeightCorrection:
    """What brings a wheel to its design height.

    Attributes
    ----------
    camber, toe
        To be added to the measured angles, radians.
    covariance
        (2, 2) of both, radians²: what is not known of the height. It is not part of the measured angles'
        own covariance, and independent of it.
    """

    camber: float
    toe: float
    covariance: Array


@dataclass(frozen=True, eq=False)
class RideHeightCurve:
    """Camber and toe of a wheel over its ride height, as a maker states them of a vehicle type.

    Between its points it is a cubic that rises and falls only where the points do (PCHIP, Fritsch and
    Butland 1984), so it makes no extreme of its own. Only differences along the curve count. Signs are those
    of the conventions, so one curve serves the wheels of both sides.

    Attributes
    ----------
    heights_mm
        (K,) rising, K ≥ 2, millimetres.
    camber, toe
        (K,) there, radians.
    limit_mm
        Farthest from the design height from which a wheel is corrected, millimetres.
    """

    heights_mm: Sequence[float]
    camber: Sequence[float]
    toe: Sequence[float]
    limit_mm: float = math.inf
    _curve: PchipInterpolator = field(init=False, repr=False)

    def __post_init__(self) -> None:
        heights = np.asarray(self.heights_mm, dtype=np.float64)
        if heights.ndim != 1 or len(heights) < 2 or not np.isfinite(heights).all():
            raise DegenerateInputError(
                field="heights_mm", expected="at least two finite heights", seen=_listed(self.heights_mm)
            )
        if not (np.diff(heights) > 0.0).all():
            raise DegenerateInputError(
                field="heights_mm",
                expected="heights that rise from point to point",
                seen=_listed(self.heights_mm),
            )
        for name in ("camber", "toe"):
            values = np.asarray(getattr(self, name), dtype=np.float64)
            if values.shape != heights.shape or not np.isfinite(values).all():
                raise DegenerateInputError(
                    field=name,
                    expected=f"{len(heights)} finite angles, one for each height",
                    seen=_listed(getattr(self, name)),
                )
        if not self.limit_mm > 0.0:
            raise DegenerateInputError(field="limit_mm", expected="above 0", seen=f"{self.limit_mm}")
        object.__setattr__(self, "_curve", PchipInterpolator(heights, np.array([self.camber, self.toe]).T))

    def correction(
        self, height_mm: float, design_mm: float, height_u_mm: float
    ) -> HeightCorrection | Refusal:
        """Return what brings angles that were measured at a height to those at the design height.

        Parameters
        ----------
        height_mm, design_mm
            Ride height as it is, and as the maker's angles stand for; as the curve counts it.
        height_u_mm
            Standard uncertainty of `height_mm` against `design_mm`.

        Returns
        -------
        HeightCorrection or Refusal
            A refusal when a height is no number, lies off the curve, or too far from the design height.

        Raises
        ------
        DegenerateInputError
            When the uncertainty is no number, or below 0.
        """
        if not (math.isfinite(height_u_mm) and height_u_mm >= 0.0):
            raise DegenerateInputError(
                field="height_u_mm", expected="a standard uncertainty, at least 0 mm", seen=f"{height_u_mm}"
            )
        refusal = self._refused(height_mm, design_mm)
        if refusal is not None:
            return refusal
        at = self._at(height_mm + height_u_mm * _NODES)
        # Not the slope alone: where a curve turns, it has none, and an uncertain height still makes an error.
        off = at - at[1]
        camber, toe = (float(angle) for angle in self._at(np.array([design_mm]))[0] - at[1])
        return HeightCorrection(camber, toe, (off * _WEIGHTS[:, None]).T @ off)

    def _at(self, heights: Array) -> Array:
        """(N, 2) camber and toe; beyond the ends the curve goes on straight."""
        ends = np.clip(heights, self.heights_mm[0], self.heights_mm[-1])
        out: Array = self._curve(ends) + (heights - ends)[:, None] * self._curve(ends, 1)
        return out

    def _refused(self, height_mm: float, design_mm: float) -> Refusal | None:
        low, high = self.heights_mm[0], self.heights_mm[-1]
        for name, height in (("the ride height", height_mm), ("the design height", design_mm)):
            # Not a number lies nowhere.
            if not low <= height <= high:
                return Refusal(
                    RefusalCode.RIDE_HEIGHT,
                    f"{name} of {height:g} mm is not on the curve of the vehicle type, from {low:g} to "
                    f"{high:g} mm; check how the height was measured, and the curve",
                )
        if not abs(height_mm - design_mm) <= self.limit_mm:
            return Refusal(
                RefusalCode.RIDE_HEIGHT,
                f"the ride height of {height_mm:g} mm is {abs(height_mm - design_mm):g} mm off the design "
                f"height of {design_mm:g} mm, corrected are at most {self.limit_mm:g} mm; load or unload the "
                "vehicle, and check its springs and tyres",
            )
        return None


def _listed(values: Sequence[float]) -> str:
    return ", ".join(f"{float(value):g}" for value in np.ravel(values)) or "none"
