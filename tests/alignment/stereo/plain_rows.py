"""Row fields in plain arrays, as they are defined: what the compiled functions must agree with."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from alignment.imaging.lines import LightLines
from alignment.stereo.correspondence import Candidates
from alignment.stereo.rows import RowFields, RowView, RowViews

Array = NDArray[np.float64]
Index = NDArray[np.int64]

TERMS, FEWEST = 5, 15
FARTHEST_ROW, FARTHEST_MM = 25.0, 3.0
EVERY, ROUNDS, TUKEY, LEAST_SIGMA_PX = 16, 3, 4.685, 0.02


def row_fields(
    lines: Sequence[tuple[LightLines, LightLines]],
    matched: Sequence[Candidates],
    chosen: NDArray[np.bool_],
    views: RowViews,
    height: Callable[[Array], Array],
) -> RowFields:
    """As `alignment.stereo.rows.row_fields`."""
    offsets = np.cumsum([0, *(len(candidates.points) for candidates in matched)])
    places, differences = [], []
    for k, (pair, candidates, view) in enumerate(zip(lines, matched, views.each, strict=True)):
        partners = line_partners(pair, candidates, np.flatnonzero(chosen[offsets[k] : offsets[k + 1]]))
        left, right = cross_partners(pair, partners, view)
        near = np.abs(height(pair_points(view, left, right))) < FARTHEST_MM
        left, right = left[near], right[near]
        places.append(view.terms(left))
        differences.append((left[:, 1] - right[:, 1]) * view.focal)
    return fitted_fields(places, differences)


def pair_points(view: RowView, left: Array, right: Array) -> Array:
    """(N, 3) points of pairs of rectified places (N, 2), rig frame; NaN for no disparity."""
    disparity = left[:, 0] - right[:, 0]
    depth = view.frame.baseline / np.where(disparity > 0.0, disparity, np.nan)
    rays = np.column_stack([left, np.ones(len(left))])
    out: Array = view.frame.origin + (rays * depth[:, None]) @ view.frame.rectified_from_rig
    return out


def line_partners(pair: tuple[LightLines, LightLines], candidates: Candidates, on_wheel: Index) -> Index:
    """(L,) right line of each left line; −1 for none."""
    left, right = pair
    some = on_wheel[::EVERY]
    width = right.count
    of_right = np.searchsorted(right.starts, candidates.right_point[some], side="right") - 1
    votes = np.bincount(candidates.left_line[some] * width + of_right, minlength=left.count * width)
    votes = votes.reshape(left.count, width)
    best = votes.argmax(axis=1)
    # Two lines that share a partner are pieces or a mistake: a clear majority is asked for.
    clear = 2 * votes[np.arange(left.count), best] > votes.sum(axis=1)
    return np.where(clear, best, -1).astype(np.int64)


def cross_partners(
    pair: tuple[LightLines, LightLines], partners: Index, view: RowView
) -> tuple[Array, Array]:
    """Rectified places (N, 2) of corresponding crosses, left and right."""
    of_left, of_right = pair[0].crosses, pair[1].crosses
    column = int((partners[of_left.lines] >= 0).sum(axis=0).argmax()) if len(of_left.points) else 0
    line = partners[of_left.lines[:, column]]
    mine = line >= 0
    left, line = view.seen(0, of_left.points[mine]), line[mine]
    right, right_line = view.seen(1, of_right.points), of_right.lines[:, column]
    # One axis on which lines stand far apart, and rows along each.
    apart = 10.0
    order = np.argsort(right_line * apart + right[:, 1])
    key = (right_line * apart + right[:, 1])[order]
    if not len(key) or not len(left):
        return left[:0], right[:0]
    wanted = line * apart + left[:, 1]
    at = np.searchsorted(key, wanted)
    below, above = np.maximum(at - 1, 0), np.minimum(at, len(key) - 1)
    nearest = np.where(np.abs(key[below] - wanted) <= np.abs(key[above] - wanted), below, above)
    near = np.abs(key[nearest] - wanted) < FARTHEST_ROW / view.focal
    return left[near], right[order[nearest[near]]]


def fitted_fields(places: Sequence[Array], differences: Sequence[Array]) -> RowFields:
    """As `alignment.stereo.rows.fitted_fields`."""
    heads, most = len(places), max(1, *(len(each) for each in differences))
    terms, values, seen = np.zeros((heads, most, TERMS)), np.zeros((heads, most)), np.zeros((heads, most))
    numbers = np.array([len(each) for each in differences], dtype=np.int64)
    for k, n in enumerate(numbers):
        if n >= FEWEST:
            terms[k, :n], values[k, :n], seen[k, :n] = places[k], differences[k], 1.0
    middle = medians(values, seen)[:, None]
    rest = np.abs(values - middle)
    scale = np.maximum(1.4826 * medians(rest, seen), LEAST_SIGMA_PX)[:, None]
    weight = seen * (rest <= 2.0 * TUKEY * scale)
    field: Array = np.zeros((heads, TERMS))
    normal: Array = np.zeros((heads, TERMS, TERMS))
    for _ in range(ROUNDS):
        weighted = (terms * weight[:, :, None]).transpose(0, 2, 1)
        normal = weighted @ terms
        field = np.asarray(
            np.linalg.solve(normal + 1e-9 * np.eye(TERMS), weighted @ values[:, :, None])[:, :, 0],
            dtype=float,
        )
        rest = np.abs(values - (terms @ field[:, :, None])[:, :, 0])
        scale = np.maximum(1.4826 * medians(rest, seen), LEAST_SIGMA_PX)[:, None]
        weight = seen * np.square(np.maximum(1.0 - np.square(rest / (TUKEY * scale)), 0.0))
    total = weight.sum(axis=1)
    squares = (weight * np.square(values)).sum(axis=1)
    rms = np.sqrt(np.divide(squares, total, out=np.full(heads, np.nan), where=total > 0.0))
    # Five numbers were taken from few pairs, so that these seem quieter than they are.
    freedom = np.maximum(1.0 - TERMS / np.maximum(numbers, TERMS + 1), 0.2)
    return RowFields(numbers, rms, field, normal * (freedom[:, None] / np.square(scale))[:, :, None])


def medians(values: Array, seen: Array) -> Array:
    """(H,) median over those of (H, N) values that are seen; 0 where none is."""
    number = seen.sum(axis=1).astype(np.int64)
    ordered = np.sort(np.where(seen > 0.0, values, np.inf), axis=1)
    middle: Array = ordered[np.arange(len(values)), number // 2 - (number > 0) * (number % 2 == 0)]
    return np.where(number > 0, middle, 0.0)
