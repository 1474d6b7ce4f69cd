"""A load that was found, kept for the exposures after it: its height from a table.

While somebody turns a tie rod the weight stays on the tyre, and its contact with the road stays below. To
find the load takes longer than all the rest of a measurement, to look its height up hardly any time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array
from alignment.kernels import njit
from alignment.wheel.load import LoadedWheel

_RADIUS_STEP, _ANGLE_STEPS = 1.0, 720  # mm, and steps of a whole turn
_BESIDE = 10.0  # mm beyond the radii of the wheel's profile


@dataclass(frozen=True, eq=False)
class HeldLoad:
    """The load of a wheel.

    Attributes
    ----------
    loaded
        As it was found.
    start
        Least radius of the table, millimetres.
    table
        (R, A) heights by radius and angle, millimetres; its last column is the first again.
    """

    loaded: LoadedWheel
    start: float
    table: Array

    @classmethod
    def of(cls, loaded: LoadedWheel) -> HeldLoad:
        """Tabulate a load."""
        fit = loaded.surface.fit
        start = max(fit.knots_start - _BESIDE, 1.0)
        radius = np.arange(start, fit.knots_start + fit.knots_step * len(fit.profile) + _BESIDE, _RADIUS_STEP)
        angle = np.linspace(0.0, 2.0 * math.pi, _ANGLE_STEPS + 1)
        places = radius[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        heights = loaded.model.height(places.reshape(-1, 2))
        return cls(loaded, float(start), np.ascontiguousarray(heights.reshape(len(radius), len(angle))))

    def heights(self, points: Array, centre: Array, tilt_axes: Array) -> Array:
        """(N,) by how much the load lifts points (N, 3) of a wheel about an axis, millimetres.

        `centre` (3,) and `tilt_axes` (2, 3) are those of the wheel's fit.
        """
        return _look_up(np.ascontiguousarray(points), centre, tilt_axes, self.start, self.table)


@njit(cache=True, nogil=True, error_model="numpy")
def _look_up(points: Array, centre: Array, axes: Array, start: float, table: Array) -> Array:
    """Heights (N,) by the four entries around each place."""
    out = np.empty(points.shape[0])
    last, whole = table.shape[0] - 2, table.shape[1] - 1
    per_angle = whole / (2.0 * math.pi)
    for i in range(points.shape[0]):
        qx, qy, qz = points[i, 0] - centre[0], points[i, 1] - centre[1], points[i, 2] - centre[2]
        x = axes[0, 0] * qx + axes[0, 1] * qy + axes[0, 2] * qz
        y = axes[1, 0] * qx + axes[1, 1] * qy + axes[1, 2] * qz
        g = (math.sqrt(x * x + y * y) - start) / _RADIUS_STEP
        h = math.atan2(y, x) * per_angle
        h += whole if h < 0.0 else 0.0
        k, m = min(max(int(g), 0), last), min(int(h), whole - 1)
        s, t = min(max(g - k, 0.0), 1.0), h - m
        low = (1.0 - t) * table[k, m] + t * table[k, m + 1]
        high = (1.0 - t) * table[k + 1, m] + t * table[k + 1, m + 1]
        out[i] = (1.0 - s) * low + s * high
    return out
