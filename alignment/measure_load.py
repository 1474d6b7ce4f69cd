"""One load of a wheel that is shot at several positions of the steering: told by all exposures together.

Each exposure tells the load anew, and errs anew: most of what a loaded wheel's angles scatter is that. The
load over the angle from the contact patch and the radius is the same in all of them, since the road stays
below the wheel. The mean of what the exposures tell is taken off each in place of its own; the axis answers
to first order, as the fit does whose profile is free.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from alignment.arrays import Array
from alignment.calibration.prediction import profile_basis
from alignment.wheel.load import LoadedWheel
from alignment.wheel.load_cells import angle_from
from alignment.wheel.revolution_kernels import BASIS

_ANGLES: Array = np.radians(np.arange(-180.0, 181.0, 2.0))
_RADII: Array = np.arange(180.0, 361.0, 3.0)  # mm
_MOST_POINTS = 2500  # of an exposure, that answer


@dataclass(frozen=True, eq=False)
class LoadSeen:
    """What one exposure tells of the load, and how its axis answers to another one; a hundred kilobytes.

    Attributes
    ----------
    lift
        (A, R) by which the load lifts the sidewall over angle and radius, millimetres.
    places
        (n, 2) angle from the contact and radius of some of its points, radians and millimetres.
    own
        (n,) lift that was taken off them.
    answer
        (3, n) change of the normal, rig frame, by a height that is added to each of them.
    normal
        (3,) as it was measured.
    """

    lift: Array
    places: Array
    own: Array
    answer: Array
    normal: Array

    @classmethod
    def of(cls, loaded: LoadedWheel) -> LoadSeen:
        """Keep what is needed of a wheel whose load was taken off."""
        fit, model = loaded.surface.fit, loaded.model
        used = np.flatnonzero(fit.weights > 0.0)
        used = used[:: max(1, len(used) // _MOST_POINTS)]
        across = (loaded.surface.points.points[used] - fit.centre) @ fit.tilt_axes.T
        radius = np.hypot(across[:, 0], across[:, 1])
        pieces = np.lib.stride_tricks.sliding_window_view(fit.profile, 4) @ BASIS
        at = (radius - fit.knots_start) / fit.knots_step
        interval = np.clip(np.floor(at).astype(np.int64), 0, len(pieces) - 1)
        t, piece = at - interval, pieces[interval]
        slope = (piece[:, 1] + t * (2.0 * piece[:, 2] + 3.0 * t * piece[:, 3])) / fit.knots_step
        design = np.hstack([across, -(slope / radius)[:, None] * across, profile_basis(radius)])
        root = np.sqrt(fit.weights[used])
        solve = np.linalg.pinv(design * root[:, None], rcond=1e-8)[:2] * root
        contact = model.contact
        angle, wide = np.meshgrid(_ANGLES, _RADII, indexing="ij")
        beside = np.array([-contact[1], contact[0]])
        grid = (wide * np.cos(angle))[..., None] * contact + (wide * np.sin(angle))[..., None] * beside
        return cls(
            lift=model.height(grid.reshape(-1, 2)).reshape(angle.shape),
            places=np.column_stack([angle_from(across, contact), radius]),
            own=model.height(across),
            # Heights that rise along an axis lean the normal away.
            answer=-fit.tilt_axes.T @ solve,
            normal=fit.normal,
        )

    def turned(self, lift: Array) -> Array:
        """(3,) change of the normal where another load (A, R) is taken off in place of its own."""
        there = RegularGridInterpolator((_ANGLES, _RADII), lift, bounds_error=False, fill_value=None)
        out: Array = self.answer @ (self.own - there(self.places))
        return out


def shared_load(seen: Sequence[LoadSeen]) -> Array:
    """(A, R) lift of the load by all exposures together, millimetres."""
    out: Array = np.mean([one.lift for one in seen], axis=0)
    return out
