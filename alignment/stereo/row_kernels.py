"""Pairs of crosses and the fit of a row field; see `rows`."""

from __future__ import annotations

import math

import numpy as np

from alignment import robust
from alignment.arrays import Array, Index, Mask
from alignment.geometry.symmetric import LEAST_PIVOT, solve
from alignment.kernels import njit
from alignment.stereo.rectification import rectify

TERMS = 5
"""Numbers of a row field: 1, u, v, u·v and v², u and v from −1 to 1 over the left image's width."""
FEWEST = 15  # pairs of crosses that make a field

_EVERY = 16  # of a head's matched points tells which lines belong together
_ROUNDS = 3
_TINY = 1e-9
_LEAST_SIGMA_PX = 0.02


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _line_partners(lines: int, right_starts: Index, left_line: Index, right_point: Index, on: Mask) -> Index:
    """(L,) right line of each left line by matched points that are `on` the wheel; −1 for none."""
    width = right_starts.size - 1
    votes = np.zeros((lines, width), np.int64)
    seen = 0
    for i in range(on.size):
        if on[i]:
            if seen % _EVERY == 0:
                lo, hi = 0, width
                while hi - lo > 1:
                    middle = (lo + hi) // 2
                    if right_starts[middle] <= right_point[i]:
                        lo = middle
                    else:
                        hi = middle
                votes[left_line[i], lo] += 1
            seen += 1
    partners = np.empty(lines, np.int64)
    for a in range(lines):
        total = best = 0
        for b in range(width):
            total += votes[a, b]
            if votes[a, b] > votes[a, best]:
                best = b
        # Two lines that share a partner are pieces or a mistake: a clear majority is asked for.
        partners[a] = best if 2 * votes[a, best] > total else -1
    return partners


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _some_rectified(
    pixels: Array, lines: Index, partners: Index, packed: Array, turn: Array
) -> tuple[Array, Index]:
    """Rectified places (N, 2) of the crosses (M, 2) whose line has a partner, and that partner (N,)."""
    some, partner = np.empty((lines.size, 2)), np.empty(lines.size, np.int64)
    n = 0
    for i in range(lines.size):
        line = partners[lines[i]]
        if line >= 0:
            some[n, 0], some[n, 1], partner[n] = pixels[i, 0], pixels[i, 1], line
            n += 1
    uv = np.empty((n, 2))
    rectify(some[:n], packed, turn, uv)
    return uv, partner


@njit(cache=True, nogil=True, error_model="numpy")
def cross_pairs(
    left_starts: Index,
    right_starts: Index,
    left: Array,
    left_lines: Index,
    right: Array,
    right_lines: Index,
    left_line: Index,
    right_point: Index,
    on_wheel: Mask,
    packed: Array,
    turns: Array,
    farthest: float,
    places: Array,
    first: int,
) -> int:
    """Pair the crosses of one head; returns how many rows of `places` are filled then.

    Parameters
    ----------
    left_starts, right_starts
        (L + 1,) first point of each line.
    left, left_lines, right, right_lines
        (N, 2) pixels and (N, 2) lines of the crosses.
    left_line, right_point, on_wheel
        (M,) of `Candidates`, and whether each lies on the wheel.
    packed, turns
        (2, P) cameras and (2, 3, 3) rotations to rectified axes, left and right.
    farthest
        Rows that a partner may be off its row, rectified.
    places
        (capacity, 4) rectified u and v of the left and of the right cross, written from row `first` on.
    """
    partners = _line_partners(left_starts.size - 1, right_starts, left_line, right_point, on_wheel)
    steep = flat = 0
    for i in range(left_lines.shape[0]):
        steep += partners[left_lines[i, 0]] >= 0
        flat += partners[left_lines[i, 1]] >= 0
    column = 0 if steep >= flat else 1
    uv, partner = _some_rectified(left, left_lines[:, column].copy(), partners, packed[0], turns[0])
    other = np.empty((right.shape[0], 2))
    rectify(right, packed[1], turns[1], other)
    n = first
    for i in range(uv.shape[0]):
        nearest, distance = -1, farthest
        for j in range(other.shape[0]):
            if right_lines[j, column] == partner[i]:
                away = abs(other[j, 1] - uv[i, 1])
                if away < distance:
                    nearest, distance = j, away
        if nearest >= 0:
            places[n, 0], places[n, 1] = uv[i, 0], uv[i, 1]
            places[n, 2], places[n, 3] = other[nearest, 0], other[nearest, 1]
            n += 1
    return n


@njit(cache=True, nogil=True, error_model="numpy")
def pair_figures(
    places: Array,
    bounds: Index,
    frames: Array,
    origins: Array,
    baselines: Array,
    middles: Array,
    halves: Array,
    focals: Array,
) -> tuple[Array, Array, Array]:
    """Points (N, 3), rig frame, terms (N, 5) and row differences (N,), pixels, of pairs of crosses.

    Parameters
    ----------
    places, bounds
        (N, 4) of `cross_pairs`; head h has the pairs bounds[h] to bounds[h + 1] − 1.
    frames, origins, baselines
        (H, 3, 3) rotations, (H, 3) and (H,) of `Rectification`; a pair without disparity has no point, NaN.
    middles, halves, focals
        (H, 2), (H,) and (H,) of `RowView`.
    """
    count = bounds[-1]
    points, terms, values = np.empty((count, 3)), np.empty((count, TERMS)), np.empty(count)
    for h in range(bounds.size - 1):
        for i in range(bounds[h], bounds[h + 1]):
            u, v = places[i, 0], places[i, 1]
            disparity = u - places[i, 2]
            depth = baselines[h] / disparity if disparity > 0.0 else np.nan
            for a in range(3):
                ray = u * frames[h, 0, a] + v * frames[h, 1, a] + frames[h, 2, a]
                points[i, a] = origins[h, a] + depth * ray
            values[i] = (v - places[i, 3]) * focals[h]
            u, v = (u - middles[h, 0]) / halves[h], (v - middles[h, 1]) / halves[h]
            terms[i, 0], terms[i, 1], terms[i, 2], terms[i, 3], terms[i, 4] = 1.0, u, v, u * v, v * v
    return points, terms, values


@njit(cache=True, nogil=True, error_model="numpy")
def _lower_median(values: Array, spare: Array) -> float:
    """Median of values (N,), of two middle ones the lower, by Hoare's FIND (1961) in `spare` (N,).

    Numpy's partition takes seconds to compile.
    """
    for i in range(values.size):
        spare[i] = values[i]
    middle = (values.size - 1) // 2
    first, last = 0, values.size - 1
    while first < last:
        pivot, i, j = spare[middle], first, last
        while i <= j:
            while spare[i] < pivot:
                i += 1
            while pivot < spare[j]:
                j -= 1
            if i <= j:
                spare[i], spare[j] = spare[j], spare[i]
                i += 1
                j -= 1
        if j < middle:
            first = i
        if middle < i:
            last = j
    return float(spare[middle])


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _fit(terms: Array, values: Array, field: Array, information: Array) -> float:
    """Fit one field to row differences (N,), by terms (N, 5); returns their RMS without those that are wrong.

    `field` (5,) and `information` (5, 5) are written.
    """
    n = values.size
    weight, rest, spare = np.empty(n), np.empty(n), np.empty(n)
    middle = _lower_median(values, spare)
    for i in range(n):
        rest[i] = abs(values[i] - middle)
    scale = max(robust.DEVIATION_OF_MEDIAN * _lower_median(rest, spare), _LEAST_SIGMA_PX)
    for i in range(n):
        weight[i] = 1.0 if rest[i] <= 2.0 * robust.BIWEIGHT * scale else 0.0
    normal, right = np.empty((TERMS, TERMS)), np.empty((TERMS, 1))
    for _ in range(_ROUNDS):
        for a in range(TERMS):
            total = 0.0
            for i in range(n):
                total += weight[i] * terms[i, a] * values[i]
            right[a, 0] = total
            for b in range(a + 1):
                total = 0.0
                for i in range(n):
                    total += weight[i] * terms[i, a] * terms[i, b]
                information[a, b] = information[b, a] = total
                normal[a, b] = total
            normal[a, a] += _TINY
        solve(normal, right, LEAST_PIVOT)  # positive by the tiny part
        for a in range(TERMS):
            field[a] = right[a, 0]
        for i in range(n):
            total = values[i]
            for a in range(TERMS):
                total -= terms[i, a] * field[a]
            rest[i] = abs(total)
        scale = max(robust.DEVIATION_OF_MEDIAN * _lower_median(rest, spare), _LEAST_SIGMA_PX)
        for i in range(n):
            u = rest[i] / (robust.BIWEIGHT * scale)
            inside = max(1.0 - u * u, 0.0)
            weight[i] = inside * inside
    total = squares = 0.0
    for i in range(n):
        total += weight[i]
        squares += weight[i] * values[i] * values[i]
    # Five numbers were taken from few pairs, so that these seem quieter than they are.
    freedom = max(1.0 - TERMS / max(n, TERMS + 1), 0.2)
    for a in range(TERMS):
        for b in range(TERMS):
            information[a, b] *= freedom / (scale * scale)
    return math.sqrt(squares / total) if total > 0.0 else np.nan


@njit(cache=True, nogil=True, error_model="numpy")
def fit_fields(terms: Array, values: Array, near: Mask, bounds: Index) -> tuple[Index, Array, Array, Array]:
    """Fit the field of each head to its row differences; wrong pairs lose their weight (Tukey).

    Parameters
    ----------
    terms
        (N, 5) basis at the places of all heads' pairs; head h has bounds[h] to bounds[h + 1] − 1.
    values
        (N,) row differences, pixels.
    near
        (N,) which of the pairs count.
    bounds
        (H + 1,).

    Returns
    -------
    pairs, rms, field, information
        As `RowFields`.
    """
    heads = bounds.size - 1
    pairs, rms = np.zeros(heads, np.int64), np.full(heads, np.nan)
    field, information = np.zeros((heads, TERMS)), np.zeros((heads, TERMS, TERMS))
    some, mine = np.empty((values.size, TERMS)), np.empty(values.size)
    for h in range(heads):
        n = 0
        for i in range(bounds[h], bounds[h + 1]):
            if near[i]:
                for a in range(TERMS):
                    some[n, a] = terms[i, a]
                mine[n] = values[i]
                n += 1
        pairs[h] = n
        if n >= FEWEST:
            rms[h] = _fit(some[:n], mine[:n], field[h], information[h])
    return pairs, rms, field, information
