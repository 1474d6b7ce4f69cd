"""The wheel among the candidates: which matching of the lines is real, and the surface that fits it.

Several hypotheses may each find a surface near them: ghosts, of which a periodic pattern makes many, bend
and lean differently for each head, so that the true wheel fits best. Something before one head may spoil the
fit of all; it is told by what the other heads fit without it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array, Mask
from alignment.errors import DegenerateInputError
from alignment.stereo.pool import PointPool
from alignment.stereo.surface import PlaneHypothesis, nearest_candidates
from alignment.wheel.agreement import head_sums
from alignment.wheel.gloss import without_gloss
from alignment.wheel.revolution import RevolutionFit, fit_revolution

_PLANE_GATE = 30.0  # mm; relief of a sidewall about its mean plane
SURFACE_GATE = 2.0  # mm; a ghost is farther than that from the fitted surface
_SURE_SCALE = 1.5  # residuals in units of the image noise below which no other hypothesis needs a look
_GOOD_SCALE = 3.0  # and above which something that is not a wheel spoils the fit; a ghost comes near it
_FEW_OF_MEDIAN = 0.3  # of the weight that the points of the middle one of the heads have
_FEW_OF_BEST = 0.3  # and that those of the best one have
_ROUNDS = 6  # of choosing points and fitting, where the first choice was bad
# mm; where the axis may stand when it is not near the rig's: a fit finds one that is so far from its start
_CENTRES = tuple((40.0 * math.cos(k * math.pi / 3.0), 40.0 * math.sin(k * math.pi / 3.0)) for k in range(6))


@dataclass(frozen=True, eq=False)
class WheelSurface:
    """A fitted wheel, which candidates it chose, and these alone, without the shift that gloss gave them."""

    fit: RevolutionFit
    chosen: Mask
    points: PointPool


def find_surface(pool: PointPool, hypotheses: Sequence[PlaneHypothesis], axes: Array) -> WheelSurface | None:
    """Fit the hypotheses in turn; the one with the least residuals in units of the noise is the wheel.

    Parameters
    ----------
    pool
        Candidates of all heads.
    hypotheses
        Planes near which the sidewall may lie, the likeliest first.
    axes
        (H, 3, 2) directions of the rows and columns of the heads' left images, rig frame.

    Returns
    -------
    WheelSurface or None
        None where the points of no hypothesis lie around one axis.
    """
    best: WheelSurface | None = None
    likeliest: PlaneHypothesis | None = None
    for hypothesis in hypotheses:
        try:
            surface = _fit_hypothesis(pool, hypothesis, axes)
        except DegenerateInputError:
            continue
        if best is None or surface.fit.scale < best.fit.scale:
            best, likeliest = surface, hypothesis
        if best.fit.scale < _SURE_SCALE:
            break
    if best is not None and likeliest is not None and best.fit.scale >= _GOOD_SCALE:
        best = _off_axis(pool, likeliest, axes) or best
    if best is not None and (best.fit.scale >= _GOOD_SCALE or _one_head_is_off(best, int(pool.head[-1]) + 1)):
        best = _without_intruder(pool, best, axes)
    return best


def _off_axis(pool: PointPool, hypothesis: PlaneHypothesis, axes: Array) -> WheelSurface | None:
    """Look for a wheel that stands beside the rig's axis, which a fit that starts on it may miss."""
    for centre in _CENTRES:
        try:
            surface = _fit_hypothesis(pool, hypothesis, axes, centre)
        except DegenerateInputError:
            continue
        if surface.fit.scale < _SURE_SCALE:
            return surface
    return None


def _fit_hypothesis(
    pool: PointPool, hypothesis: PlaneHypothesis, axes: Array, centre: tuple[float, float] = (0.0, 0.0)
) -> WheelSurface:
    c = hypothesis.coefficients
    heights = pool.points[:, 2] - (c[0] + c[1] * pool.points[:, 0] + c[2] * pool.points[:, 1])
    chosen = nearest_candidates(heights, pool.group, _PLANE_GATE)
    surface = fit_chosen(pool, chosen, np.array([-c[1], -c[2], 1.0]), np.array([*centre, c[0]]), axes)
    # Near the plane's gate a neighbour may have been nearer to it than the true partner: choose again.
    again = nearest_candidates(surface.fit.height(pool.points), pool.group, SURFACE_GATE)
    if np.count_nonzero(again & ~chosen) > 0.01 * np.count_nonzero(chosen):
        surface = fit_chosen(pool, again, surface.fit.normal, surface.fit.centre, axes)
    return surface


def _weights_of_heads(surface: WheelSurface, heads: int) -> Array:
    """(H,) weight of the points of each head, the least first."""
    fit = surface.fit
    return np.sort(head_sums(surface.points.head, heads, fit.weights, fit.residuals)[1])


def _one_head_is_off(surface: WheelSurface, heads: int) -> bool:
    """Tell whether the wheel was fitted to hardly any points of one head: it may look at something else."""
    weights = _weights_of_heads(surface, heads)
    return bool(weights[0] < _FEW_OF_MEDIAN * weights[len(weights) // 2])


def _others_carry(surface: WheelSurface, heads: int) -> bool:
    """Tell whether all heads but one carry the wheel: a ghost fits one head well and others by chance."""
    weights = _weights_of_heads(surface, heads)
    return bool(weights[1] >= _FEW_OF_BEST * weights[-1])


def _without_intruder(pool: PointPool, surface: WheelSurface, axes: Array) -> WheelSurface:
    """Start again from all heads but one: something before that head may have spoilt the fit."""
    best, most = surface, 0
    if surface.fit.scale < _GOOD_SCALE:
        most = int(np.count_nonzero(surface.fit.weights))
    heads = int(pool.head.max()) + 1
    for head in range(heads if heads > 1 else 0):
        chosen = surface.chosen & (pool.head != head)
        try:
            other = fit_chosen(pool, chosen, surface.fit.normal, surface.fit.centre, axes)
            for _ in range(_ROUNDS):
                chosen = nearest_candidates(other.fit.height(pool.points), pool.group, SURFACE_GATE)
                other = fit_chosen(pool, chosen, other.fit.normal, other.fit.centre, axes)
                if other.fit.scale < _GOOD_SCALE:
                    break
        except DegenerateInputError:
            continue
        # Of those that fit, the one on which most points lie.
        fits = other.fit.scale < _GOOD_SCALE and _others_carry(other, heads)
        if fits and np.count_nonzero(other.fit.weights) > most:
            best, most = other, int(np.count_nonzero(other.fit.weights))
    return best


def fit_chosen(pool: PointPool, chosen: Mask, normal: Array, centre: Array, axes: Array) -> WheelSurface:
    """Fit the chosen candidates (N,) from start values of the normal and a point near the axis."""
    mine = without_gloss(pool.where(chosen), axes, normal, centre)
    fit = fit_revolution(
        mine.points, mine.sigma, mine.rays, mine.cluster, normal, centre, line=mine.line, spread=mine.spread
    )
    return WheelSurface(fit, chosen, mine)
