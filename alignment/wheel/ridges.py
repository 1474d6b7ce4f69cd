"""A plane through the bends that a circular ridge of the tyre gives the light lines (thesis 7.1, as built).

Where a light line crosses a circular ridge of the sidewall, it bends. Up to three bends per head on one
circle, nine points for three heads, lie in a plane across the wheel's axis. It is kept for comparison: nine
points know a plane some hundred times worse than the thousands of points along all lines.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from alignment.arrays import Array, Index
from alignment.errors import DegenerateInputError
from alignment.robust import deviation_of
from alignment.wheel.plane import PlaneFit
from alignment.wheel.revolution import RevolutionFit

BENDS_PER_HEAD = 3
_REACH = 4.0  # mm of radius on each side of a bend
_LEAST_SIDE = 6  # line points on each side
_ASIDE = 2.0  # mm; bends of one circle are nowhere farther from it
_GAP = 5.0  # mm; longest stretch without points
_CIRCLES = 12  # sharpest circles that are tried
_APART = 3.0  # mm between them
_OUTLIER = 3.5  # robust standard deviations


def fit_ridges(points: Array, head: Index, line: Index, surface: RevolutionFit, heads: int) -> PlaneFit:
    """Fit a plane to the bends of the light lines on one circle.

    The circle is the one, found from the points, on which the heads have most bends, the sharpest of those.

    Parameters
    ----------
    points
        (N, 3) triangulated points, rig frame, millimetres; those of a line stand together, in order.
    head, line
        (N,) whose they are: number of the head, and of the line, different between heads.
    surface
        Tells radii, and where its profile bends.
    heads
        How many there are.

    Returns
    -------
    PlaneFit
        Its weights and residuals are those of the bends.

    Raises
    ------
    DegenerateInputError
        When no circle has a bend in every head.
    """
    frame = np.vstack([surface.tilt_axes, surface.normal])
    local = (points - surface.centre) @ frame.T
    radius, height = np.hypot(local[:, 0], local[:, 1]), local[:, 2]
    bounds = np.r_[0, np.flatnonzero(line[1:] != line[:-1]) + 1, len(line)]
    best: tuple[Array, Index] | None = None
    for circle in _sharpest_circles(surface):
        found, of_head = [], []
        for first, last in pairwise(bounds):
            bend = _bend(points[first:last], radius[first:last], height[first:last], circle)
            if bend is not None:
                found.append(bend)
                of_head.append(int(head[first]))
        whose = np.array(of_head, dtype=np.int64)
        kept = np.concatenate([_spread(np.flatnonzero(whose == k), found) for k in range(heads)])
        if len(np.unique(whose[kept])) == heads and (best is None or len(kept) > len(best[1])):
            best = np.array(found)[kept], whose[kept]
        if best is not None and len(best[1]) == heads * BENDS_PER_HEAD:
            break
    if best is None:
        raise DegenerateInputError(
            field="points", expected="a circle on which the lines of every head bend", seen="none"
        )
    return plane_of_bends(*best, surface.normal)


def _sharpest_circles(surface: RevolutionFit) -> Array:
    """Radii (C,) where the profile bends most, sharpest first, at least `_APART` from each other."""
    span = max(1, round(2.0 / surface.knots_step))
    profile = np.convolve(surface.profile, np.full(span, 1.0 / span), "same")
    bend = np.zeros(len(profile))
    bend[2 * span : -2 * span] = np.abs(
        profile[3 * span : len(profile) - span]
        + profile[span : len(profile) - 3 * span]
        - 2.0 * profile[2 * span : -2 * span]
    )
    radii = surface.knots_start + surface.knots_step * (np.arange(len(profile)) - 1.0)
    chosen: list[float] = []
    for k in np.argsort(-bend):
        if bend[k] > 0 and all(abs(radii[k] - other) >= _APART for other in chosen):
            chosen.append(float(radii[k]))
        if len(chosen) == _CIRCLES:
            break
    return np.array(chosen)


def _bend(points: Array, radius: Array, height: Array, circle: float) -> Array | None:
    """Where a line bends near a circle, (3,): the corner of the two straight pieces that fit it best."""
    near = np.flatnonzero(np.abs(radius - circle) < _ASIDE + _REACH)
    if len(near) < 2 * _LEAST_SIDE:
        return None
    near = near[np.argsort(radius[near], kind="stable")]
    rho, z = radius[near] - circle, height[near]
    # A line along the circle, or with a gap, tells nothing.
    if rho[0] > -_REACH or rho[-1] < _REACH or np.diff(rho).max() > _GAP:
        return None
    corners = np.arange(-_ASIDE, _ASIDE + 0.01, 0.1)
    costs = np.full(len(corners), np.inf)
    for k, corner in enumerate(corners):
        inside = np.abs(rho - corner) < _REACH
        x = rho[inside] - corner
        if min(np.count_nonzero(x < 0), np.count_nonzero(x > 0)) < _LEAST_SIDE:
            continue
        design = np.column_stack([np.ones(len(x)), x, np.maximum(x, 0.0)])
        solution, rest, _, _ = np.linalg.lstsq(design, z[inside], rcond=None)
        costs[k] = float(rest[0]) / len(x) / max(abs(float(solution[2])), 1e-6) ** 2 if len(rest) else np.inf
    k = int(costs.argmin())
    if not 0 < k < len(corners) - 1 or not np.isfinite(costs[k - 1 : k + 2]).all():
        return None
    out: Array = np.array([np.interp(corners[k], rho, points[near, axis]) for axis in range(3)])
    return out


def _spread(which: Index, found: list[Array]) -> Index:
    """Of the bends of one head, those farthest apart and the one in the middle."""
    if len(which) <= BENDS_PER_HEAD:
        return which
    at = np.array([found[k] for k in which])
    direction = np.linalg.svd(at - at.mean(axis=0))[2][0]
    order = which[np.argsort(at @ direction)]
    return order[np.linspace(0, len(order) - 1, BENDS_PER_HEAD).round().astype(np.int64)]


def plane_of_bends(points: Array, head: Index, normal: Array) -> PlaneFit:
    """Fit a plane to a few bends (N, 3), millimetres; those far from it are put out one by one.

    A bend that is round and not sharp is found some tenths of a millimetre up or down the sidewall, its
    neighbours before the same head all alike: in the covariance they count as one. Three heads carry a plane
    whatever they err, so that the residuals do not show what the bends of a head share. Their heights along
    the wheel's axis do, which the surface of revolution knows far better. The variance of a height is taken
    from both, those of the bends that were put out among them.

    Parameters
    ----------
    points, head
        (N, 3) rig frame, and the number of the head that saw each (N,).
    normal
        (3,) the wheel's axis, outboard.

    Raises
    ------
    DegenerateInputError
        When the bends lie on a line.
    """
    kept = np.ones(len(points), dtype=np.bool_)
    while True:
        centroid = points[kept].mean(axis=0)
        _, spread, vectors = np.linalg.svd(points[kept] - centroid)
        if len(spread) < 3 or spread[1] < 1e-3 * spread[0]:
            raise DegenerateInputError(field="points", expected="bends that span a plane", seen="a line")
        n = vectors[2] * (1.0 if vectors[2] @ normal > 0 else -1.0)
        residuals = (points - centroid) @ n
        scale = deviation_of(residuals[kept])
        worst = int(np.argmax(np.where(kept, np.abs(residuals), -1.0)))
        if kept.sum() <= 4 or abs(residuals[worst]) <= _OUTLIER * scale:
            break
        kept[worst] = False
    axes = np.array([vectors[0], np.cross(n, vectors[0])])
    heights = points @ normal
    squares = np.square(residuals).sum() + np.square(heights - heights.mean()).sum()
    freedom = max(len(points) - 3, 1) + len(points) - 1
    along, whose = (points[kept] - centroid) @ axes.T, head[kept]
    pulls = np.zeros((2, 2))
    for k in np.unique(whose):
        mine = along[whose == k]
        apart = mine - mine.mean(axis=0)
        pulls += np.outer(mine.sum(axis=0), mine.sum(axis=0)) + apart.T @ apart
    inverse = np.linalg.inv(along.T @ along)
    covariance = squares / freedom * (inverse @ pulls @ inverse)
    return PlaneFit(n, centroid, kept.astype(np.float64), residuals, covariance, axes)
