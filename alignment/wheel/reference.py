"""The place of a wheel: where its axis meets the plane of the outermost ring of the sidewall.

The ring is where the fitted profile is highest along the axis, elevations by letters, bands and ribs left
out: between those of both sidewalls lies the section width (as UN Regulation 30 defines it). It is part of
the tyre, not of what the heads happen to see of it, so two exposures of a wheel have it at one place. A rib
that is hardly wider than a light line would not do: how high it appears depends on the line.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

from alignment.arrays import Array, Index
from alignment.robust import deviation_of
from alignment.values import RigCalibration, WheelMeasurement, WheelReference
from alignment.vehicle.angles import camber_toe_jacobian
from alignment.wheel.revolution import RevolutionFit
from alignment.wheel.revolution_kernels import BASIS
from alignment.wheel.spin import SpinMeasurement

_MOST_POINTS = 2000  # tell where the profile is known, and how well
_FEWER = 2  # of which one says how well; the fit's own covariance gives the size
_SUPPORT = 0.2  # of the weight that intervals have at the median, below which the profile is a guess
_FEWEST_PLACES = 4  # of a turning wheel
_PER_STEP = 2  # heights that are looked at from knot to knot
_BROAD_MM = 15.0  # ribs and grooves that are narrower than half of that do not say where the crest is
CREST_MM = 25.0  # to both sides of the highest place, where the form of the sidewall is a polynomial
FORM_DEGREE = 4
_AROUND_MM = 8.0  # to both sides of a crest; what is seen of less tells of no ring
_FEWEST_HEIGHTS = 15  # for that polynomial
_FLOOR_MM = 0.02  # least scale of what leaves that form
_LEAST, _TUKEY = 10, 4  # rounds by least absolute values, and by Tukey's biweight after them
_CUT = 3.0
_PLACES, _EDGE_SHARE = 501, 0.05  # that are tried for the crest; nearer to an end of them it is none
_FORM = 0.5  # of the scale that ribs leave: how far they may shift the crest, one standard deviation


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
        `RevolutionFit.tilt_axes` (radians, millimetres) and of the height (millimetres); the height's holds
        what ribs and grooves may have shifted it, too.
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
    pieces = _pieces(fit.profile)
    weight = np.bincount(seen.interval, seen.weight, len(pieces))
    known = np.repeat(weight > _SUPPORT * np.median(weight[weight > 0.0]), _PER_STEP)
    place = (np.arange(len(known)) + 0.5) / _PER_STEP
    t = (place - np.floor(place))[:, None] ** np.arange(4)
    height = np.einsum("nm,nm->n", np.repeat(pieces, _PER_STEP, axis=0), t)
    crest = _crest(fit.knots_step * place[known], height[known], fit.knots_step / _PER_STEP)
    if crest is None:
        return None
    at, top, form_u = crest
    ring = min(int(at / fit.knots_step), len(pieces) - 1)
    covariance = _covariance(fit, seen, ring)
    covariance[4, 4] += form_u**2
    return OutermostRing(fit.knots_start + at, top, covariance)


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


def moved_reference(known: WheelReference, before: RevolutionFit, after: RevolutionFit) -> WheelReference:
    """Return the place of a wheel that moved, from where it was.

    The ring is part of the tyre, so that it keeps its place on the profile.

    Parameters
    ----------
    known
        The place before.
    before, after
        Fits of the wheel, the second one from the first one's profile on (`fit_near`).
    """
    height = float((known.point - before.centre) @ before.normal)
    rise = after.profile - before.profile
    # NumPy's median takes ten times as long.
    height += float(np.partition(rise, len(rise) // 2)[len(rise) // 2])
    return WheelReference(after.centre + height * after.normal, known.covariance)


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

    def every(self, step: int) -> _Seen:
        """One of so many."""
        return _Seen(self.across[::step], self.radius[::step], self.interval[::step], self.weight[::step])


def _pieces(profile: Array) -> Array:
    """Coefficients (K − 3, 4) of the profile's cubics in t, 0 to 1 from knot to knot, constant first."""
    four = np.lib.stride_tricks.sliding_window_view(profile, 4)
    out: Array = four @ BASIS
    return out


def _crest(place: Array, height: Array, step: float) -> tuple[float, float, float] | None:
    """Place and height of a profile's crest but for ribs and grooves, and how far these may have shifted it.

    Of heights (n,) at places (n,), most of them a `step` apart, millimetres; None where the profile rises
    to its ends.
    """
    if len(place) < _FEWEST_HEIGHTS:
        return None
    broad = median_filter(height, size=2 * round(0.5 * _BROAD_MM / step) + 1, mode="nearest")
    top = float(place[int(broad.argmax())])
    near = np.abs(place - top) < CREST_MM
    if near.sum() < _FEWEST_HEIGHTS:
        return None
    x, z = (place[near] - top) / CREST_MM, height[near]
    rows = np.vander(x, FORM_DEGREE + 1)
    form, scale = _broad_form(rows, z)
    fine = np.linspace(max(x[0], -1.0), min(x[-1], 1.0), _PLACES)
    heights = np.vander(fine, FORM_DEGREE + 1) @ form
    best = int(heights.argmax())
    if not _EDGE_SHARE * _PLACES < best < (1.0 - _EDGE_SHARE) * _PLACES:
        return None
    at = top + CREST_MM * float(fine[best])
    if min(at - place[0], place[-1] - at) < _AROUND_MM:
        return None
    return at, float(heights[best]), _FORM * scale


def _broad_form(rows: Array, z: Array) -> tuple[Array, float]:
    """Coefficients of z (n,) by rows (n, m) but for ribs and grooves, and the scale of what leaves that form.

    An M-estimate with the scale of the least absolute values that it starts from (Yohai 1987).
    """
    products = (rows[:, :, None] * rows[:, None, :]).reshape(len(rows), -1)
    shape = (rows.shape[1], rows.shape[1])
    weight: Array = np.ones(len(z))
    scale = _FLOOR_MM
    form: Array = np.zeros(shape[0])
    for round_ in range(_LEAST + _TUKEY):
        solved = np.linalg.solve((weight @ products).reshape(shape), (weight * z) @ rows)
        form = np.asarray(solved, dtype=np.float64)
        left = np.abs(z - rows @ form)
        if round_ < _LEAST - 1:
            weight = 1.0 / np.maximum(left, _FLOOR_MM)
            continue
        if round_ == _LEAST - 1:
            scale = max(deviation_of(left), _FLOOR_MM)
        weight = np.maximum(1.0 - np.square(left / (_CUT * scale)), 0.0) ** 2
    return form, scale


def _covariance(fit: RevolutionFit, seen: _Seen, ring: int) -> Array:
    """(5, 5) of two tilts, two shifts and the height in the interval `ring`.

    The points give its shape, the profile being free in every interval; its size is that of the fit's own
    covariance of the tilts, which knows how alike neighbours err.
    """
    seen = seen.every(_FEWER)
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
    # Light lines may miss the ring's own interval: what lies around it says where the points are.
    half = max(1, round(CREST_MM / fit.knots_step))
    near = slice(max(ring - half, 0), ring + half + 1)
    there = total[near].sum(axis=0) / weight[near].sum()
    out[4, :4] = out[:4, 4] = inverse @ there
    out[4, 4] = there @ inverse @ there
    # The fit's covariance of the tilts stands as it is; what it says more than the points' is in all.
    out *= scale
    # The middle of a polynomial of the fourth degree has 3.5 times the variance of the mean.
    out[4, 4] += 3.5 * scale / weight[near].sum()
    return out
