"""Which of the candidates of a point is real: hypotheses of one surface that all heads share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array, Index, Mask
from alignment.geometry.symmetric import solve
from alignment.kernels import njit

_GATE = 25.0  # mm; a sidewall's relief about its mean plane, with room for the first, rough plane
_TILTS = (-0.12, 0.0, 0.12)  # start values of dz/dx and dz/dy
_Z_STEP = 12.0
_NEAR_BEST = 0.75  # a hypothesis this much worse than the best is not worth a fit
_SAMPLES = 300
_SAME_PLANE = 3.0  # mm, over the rig
_UNDETERMINED = 1e-9  # left of a coefficient's own information, below which points do not tell it


@dataclass(frozen=True, eq=False)
class PlaneHypothesis:
    """The plane z = coefficients · (1, x, y), rig frame, and the share of line points it explains."""

    coefficients: Array
    score: float


@njit(cache=True, nogil=True, error_model="numpy")
def _known(plane: Array, planes: Array, reach: float) -> bool:
    """Tell whether one of the planes (P, 3) is nearly the same within `reach` of the origin."""
    for k in range(planes.shape[0]):
        away = abs(planes[k, 0] - plane[0])
        away += reach * (abs(planes[k, 1] - plane[1]) + abs(planes[k, 2] - plane[2]))
        if away < _SAME_PLANE:
            return True
    return False


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def _weigh(
    points: Array, several: Index, plane: Array, width: float, distance: Array, a: Array, b: Array
) -> float:
    """Normal equations of a plane on the nearest candidate of each group; returns the sum of the weights."""
    xs, ys, zs = points[0], points[1], points[2]
    p, q, r = plane[0], plane[1], plane[2]
    n = xs.size
    for i in range(n):
        distance[i] = abs(zs[i] - (p + q * xs[i] + r * ys[i]))
    for k in range(several.shape[0]):
        best = several[k, 0]
        for i in range(several[k, 0] + 1, several[k, 1]):
            if distance[i] < distance[best]:
                distance[best] = np.inf
                best = i
            else:
                distance[i] = np.inf
    per_width = 1.0 / width
    w0 = wx = wy = wxx = wxy = wyy = wz = wxz = wyz = 0.0
    for i in range(n):
        x, y, z, u = xs[i], ys[i], zs[i], min(distance[i] * per_width, 1.0)
        w = (1.0 - u * u) * (1.0 - u * u)
        w0 += w
        wx += w * x
        wy += w * y
        wxx += w * x * x
        wxy += w * x * y
        wyy += w * y * y
        wz += w * z
        wxz += w * x * z
        wyz += w * y * z
    a[0, 0], a[0, 1], a[0, 2], a[1, 1], a[1, 2], a[2, 2] = w0, wx, wy, wxx, wxy, wyy
    a[1, 0], a[2, 0], a[2, 1] = wx, wy, wxy
    b[0, 0], b[1, 0], b[2, 0] = wz, wxz, wyz
    return w0


@njit(cache=True, nogil=True, error_model="numpy")
def _grow(
    points: Array, several: Index, start: Array, gate: float, slope_limit: float, planes: Array, reach: float
) -> tuple[Array, float]:
    """Refine a plane on the nearest candidate of each group; the score counts groups by biweight.

    The score is 0 for a plane that is none, and for one that comes to one of the known planes. Points are
    (3, N); `several` are first and last + 1 (M, 2) of the groups that have more than one candidate.
    """
    plane = start.copy()
    score = 0.0
    distance, a, b = np.empty(points.shape[1]), np.empty((3, 3)), np.empty((3, 1))
    for iteration in range(8):
        width = gate * (2.0 if iteration < 2 else 1.0)
        score = _weigh(points, several, plane, width, distance, a, b)
        if not solve(a, b, _UNDETERMINED):
            return plane, 0.0
        p, q, r = b[0, 0], b[1, 0], b[2, 0]
        if abs(q) > slope_limit or abs(r) > slope_limit:
            return plane, 0.0
        moved = abs(p - plane[0]) + 300.0 * (abs(q - plane[1]) + abs(r - plane[2]))
        plane[0], plane[1], plane[2] = p, q, r
        if iteration > 1 and _known(plane, planes, reach):
            return plane, 0.0
        if iteration > 2 and moved < 0.1:
            break
    return plane, score


def plane_hypotheses(
    points: Array, group: Index, depth_range: tuple[float, float], slope_limit: float
) -> list[PlaneHypothesis]:
    """Planes near which as many line points as possible have a candidate, best first.

    Wrong neighbours of a periodic pattern form ghost surfaces of their own, a line spacing away in
    disparity; from each start value a plane grows on the candidates near it, all heads together.

    Parameters
    ----------
    points
        (N, 3) candidates of all heads, rig frame, millimetres.
    group
        (N,) candidates of one line point carry the same number and stand together.
    depth_range
        Lowest and highest z of the surface, millimetres.
    slope_limit
        Largest believable |dz/dx| and |dz/dy|.
    """
    if len(points) < 3:
        return []
    # Whole groups, evenly thinned.
    first = np.flatnonzero(np.r_[True, group[1:] != group[:-1]])
    last = np.r_[first[1:], len(group)]
    chosen = slice(None, None, max(1, len(first) // _SAMPLES))
    begin, count = first[chosen], last[chosen] - first[chosen]
    behind = np.cumsum(count)
    rows = np.arange(count.sum()) + np.repeat(begin - (behind - count), count)
    several = np.column_stack([behind - count, behind])[count > 1]
    lo, hi = depth_range
    heights = np.linspace(lo, hi, max(2, round((hi - lo) / _Z_STEP)))
    planes, scores = _grow_all(
        np.ascontiguousarray(points[rows].T), several, heights, np.array(_TILTS), _GATE, slope_limit
    )
    found = [
        PlaneHypothesis(plane, float(score) / len(first[chosen]))
        for plane, score in zip(planes, scores, strict=True)
    ]
    found.sort(key=lambda h: -h.score)
    return [h for h in found if h.score > _NEAR_BEST * found[0].score]


@njit(cache=True, nogil=True, error_model="numpy")
def _grow_all(
    points: Array, several: Index, heights: Array, tilts: Array, gate: float, slope_limit: float
) -> tuple[Array, Array]:
    """Grow a plane from every start value, see `_grow`; the different ones (P, 3) and their scores (P,)."""
    capacity = heights.size * tilts.size**2
    planes, scores = np.empty((capacity, 3)), np.empty(capacity)
    reach = np.abs(points[:2]).max()
    found = 0
    for z in heights:
        for tx in tilts:
            for ty in tilts:
                plane, score = _grow(
                    points, several, np.array([z, tx, ty]), gate, slope_limit, planes[:found], reach
                )
                if score > 0.0:
                    planes[found] = plane
                    scores[found] = score
                    found += 1
    return planes[:found], scores[:found]


@njit(cache=True, nogil=True, error_model="numpy")
def nearest_candidates(heights: Array, group: Index, gate: float) -> Mask:
    """Mark of each group the candidate with the least |height| above a surface, if below `gate`.

    Parameters
    ----------
    heights
        (N,) distance of each candidate from the surface, millimetres; NaN, where there is none, is not near.
    group
        (N,) as in `plane_hypotheses`.
    gate
        Largest distance, millimetres.
    """
    keep = np.zeros(heights.size, np.bool_)
    i = 0
    while i < heights.size:
        best, best_distance = -1, gate
        g = group[i]
        while i < heights.size and group[i] == g:
            if abs(heights[i]) < best_distance:
                best, best_distance = i, abs(heights[i])
            i += 1
        if best >= 0:
            keep[best] = True
    return keep
