"""The place of a wheel: where its axis meets the plane of the outermost ring of the sidewall.

The ring is where the fitted profile is highest along the axis. It is part of the tyre, not of what the heads
happen to see of it, so two exposures of a wheel have it at one place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array, Index
from alignment.values import RigCalibration, WheelMeasurement, WheelReference
from alignment.vehicle.angles import camber_toe_jacobian
from alignment.wheel.revolution import RevolutionFit
from alignment.wheel.revolution_kernels import BASIS
from alignment.wheel.spin import SpinMeasurement

_MOST_POINTS = 4000  # tell where the profile is known, and how well
_SUPPORT = 0.2  # of the weight that intervals have at the median, below which the profile is a guess
_FEWEST_PLACES = 4  # of a turning wheel
_EDGE = 1  # intervals at either end of what is known; a height that still rises there is no ring


@dataclass(frozen=True, eq=False)
class OutermostRing:
    """The highest ring of a profile.

    Attributes
    ----------
    radius_mm
        Its radius.
    height_mm
        Its height above `RevolutionFit.centre` along the axis.
    covariance
        (5, 5) by the noise of the points: of the two tilts and two shifts of the axis along
        `RevolutionFit.tilt_axes` (radians, millimetres) and of the height (millimetres).
    """

    radius_mm: float
    height_mm: float
    covariance: Array

    @property
    def height_u(self) -> float:
        """Standard uncertainty of the height, millimetres."""
        return float(np.sqrt(self.covariance[4, 4]))


def outermost_ring(fit: RevolutionFit, points: Array) -> OutermostRing | None:
    """Find the outermost ring of a fitted sidewall.

    Parameters
    ----------
    fit
        The surface.
    points
        (N, 3) the points that it was fitted to, rig frame, millimetres, in the same order.

    Returns
    -------
    OutermostRing or None
        None where the profile still rises at the end of what was seen: the ring lies beyond, or is hidden.
    """
    seen = _Seen.of(fit, points)
    weight = np.bincount(seen.interval, seen.weight, len(fit.profile) - 3)
    known = weight > _SUPPORT * np.median(weight[weight > 0.0])
    highest, where = _highest(_pieces(fit.profile))
    highest = np.where(known, highest, -np.inf)
    best = int(highest.argmax())
    ends = np.flatnonzero(known)[[0, -1]]
    if best - ends[0] < _EDGE or ends[1] - best < _EDGE:
        return None
    radius = fit.knots_start + fit.knots_step * (best + float(where[best]))
    return OutermostRing(radius, float(highest[best]), _covariance(fit, seen, best))


def wheel_reference(
    fit: RevolutionFit, points: Array, calibration: RigCalibration, common: Array | None
) -> WheelReference | None:
    """Return the place of a wheel with its uncertainty, or None as `outermost_ring`.

    Parameters
    ----------
    fit, points
        As for `outermost_ring`.
    calibration
        Of the rig.
    common
        (5, 5) share of the calibration, `calibration.prediction.axis_covariance`; None where it states none.
    """
    ring = outermost_ring(fit, points)
    if ring is None:
        return None
    turn = calibration.vehicle_from_rig.rotation
    moves = np.zeros((5, 5))
    tilt = turn @ fit.tilt_axes.T
    moves[:2, :2] = camber_toe_jacobian(turn @ fit.normal, calibration.side) @ tilt
    moves[2:, :2] = ring.height_mm * tilt
    moves[2:, 2:4] = tilt
    moves[2:, 4] = turn @ fit.normal
    covariance = moves @ ring.covariance @ moves.T
    return WheelReference(
        point=fit.centre + ring.height_mm * fit.normal,
        covariance=covariance if common is None else covariance + common,
    )


def spin_reference(
    shots: Sequence[WheelMeasurement], spin: SpinMeasurement, common: Array | None
) -> WheelReference | None:
    """Return the place of a wheel that was turned between shots: the mean over the exposures.

    A tyre with run-out swings its axis about the spin axis, and its reference point with it: that part is
    fitted by the phases of the shots and taken off.

    Parameters
    ----------
    shots
        The tyre planes that the spin axis was fitted to, in their order.
    spin
        The axis.
    common
        (5, 5) what all shots share, `calibration.prediction.axis_covariance`; None where it is not known.

    Returns
    -------
    WheelReference or None
        None where fewer than half of the shots that were used saw the outermost ring.
    """
    shared = np.zeros((5, 5)) if common is None else common
    used = [k for k, (each, counts) in enumerate(zip(shots, spin.used, strict=True)) if counts]
    places = {k: reference for k in used if (reference := shots[k].reference) is not None}
    if 2 * len(places) < len(used) or len(places) < _FEWEST_PLACES:
        return None
    points = np.array([each.point for each in places.values()])
    rows = np.ones((len(points), 1))
    if spin.phases is not None:
        phase = np.array([spin.phases[k] for k in places])
        rows = np.column_stack([rows, np.cos(phase), np.sin(phase)])
    inverse = np.linalg.inv(rows.T @ rows)
    # Each shot's own noise: the wheel may wander meanwhile, and its place is the mean one.
    own = np.mean([each.covariance - shared for each in places.values()], axis=0)
    covariance = shared + float(inverse[0, 0]) * own
    covariance[:2, :2] = spin.angle_covariance
    return WheelReference(point=(inverse @ rows.T @ points)[0], covariance=covariance)


@dataclass(frozen=True, eq=False)
class _Seen:
    """Some of the points: place about the axis (n, 2), radius, interval of the profile, weight."""

    across: Array
    radius: Array
    interval: Index
    weight: Array

    @classmethod
    def of(cls, fit: RevolutionFit, points: Array) -> _Seen:
        used = np.flatnonzero(fit.weights > 0.0)
        used = used[:: max(1, len(used) // _MOST_POINTS)]
        across = (points[used] - fit.centre) @ fit.tilt_axes.T
        radius = np.hypot(across[:, 0], across[:, 1])
        interval = np.floor((radius - fit.knots_start) / fit.knots_step).astype(np.int64)
        last = len(fit.profile) - 4
        return cls(across, radius, np.clip(interval, 0, last), fit.weights[used])


def _pieces(profile: Array) -> Array:
    """Coefficients (K − 3, 4) of the profile's cubics in t, 0 to 1 from knot to knot, constant first."""
    four = np.lib.stride_tricks.sliding_window_view(profile, 4)
    out: Array = four @ BASIS
    return out


def _highest(pieces: Array) -> tuple[Array, Array]:
    """Largest value (K − 3,) of each cubic from knot to knot, and the t (K − 3,) where it is."""
    c1, c2, c3 = pieces[:, 1], pieces[:, 2], pieces[:, 3]
    # Where the slope is nothing and falls; of a parabola or a line the formula's limit.
    root = np.sqrt(np.maximum(c2 * c2 - 3.0 * c1 * c3, 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        top = c1 / (root - c2)
    top = np.where(np.isfinite(top), np.clip(top, 0.0, 1.0), 0.0)
    places = np.stack([np.zeros(len(pieces)), top, np.ones(len(pieces))])
    values = pieces[:, 0] + places * (c1 + places * (c2 + places * c3))
    best = values.argmax(axis=0)
    each = np.arange(len(pieces))
    return values[best, each], places[best, each]


def _covariance(fit: RevolutionFit, seen: _Seen, ring: int) -> Array:
    """(5, 5) of two tilts, two shifts and the height in the interval `ring`.

    The points give its shape, the profile being free in every interval; its size is that of the fit's own
    covariance of the tilts, which knows how alike neighbours err.
    """
    pieces = _pieces(fit.profile)[seen.interval]
    t = (seen.radius - fit.knots_start) / fit.knots_step - seen.interval
    slope = (pieces[:, 1] + t * (2.0 * pieces[:, 2] + 3.0 * t * pieces[:, 3])) / fit.knots_step
    rows = np.hstack([seen.across, (slope / seen.radius)[:, None] * seen.across])
    size = len(fit.profile) - 3
    weight = np.bincount(seen.interval, seen.weight, size)
    total = np.stack([np.bincount(seen.interval, seen.weight * row, size) for row in rows.T], axis=1)
    mean = total / np.maximum(weight, 1e-12)[:, None]
    free = rows - mean[seen.interval]
    inverse = np.linalg.pinv((seen.weight * free.T) @ free)
    scale = float(np.trace(fit.covariance) / np.trace(inverse[:2, :2]))
    out = np.zeros((5, 5))
    out[:4, :4] = inverse
    out[4, :4] = out[:4, 4] = inverse @ mean[ring]
    out[4, 4] = mean[ring] @ inverse @ mean[ring]
    # The fit's covariance of the tilts stands as it is; what it says more than the points' is in all.
    out *= scale
    out[4, 4] += scale / weight[ring]
    return out
