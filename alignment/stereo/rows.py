"""Do the two cameras of a head still see along the same rows? Crosses of light lines tell.

A cross of two light lines is one place of the tyre, so in the rectified head its left and its right image lie
on one row. By how much they do not is a smooth field over the view: a turned, shifted or refocused camera
bends, leans or lifts it. Five numbers hold that field; what is left is the noise of the crosses.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from alignment.imaging.lines import LightLines
from alignment.stereo.correspondence import Candidates
from alignment.stereo.rectification import Rectification, rectify
from alignment.values import HeadCalibration

Array = NDArray[np.float64]
Index = NDArray[np.int64]

TERMS = 5
"""Numbers of a row field: 1, u, v, u·v and v², u and v from −1 to 1 over the left image's width."""

_FARTHEST_ROW = 25.0  # pixels that a partner may be off its row; lines stand farther apart
_FARTHEST_MM = 3.0  # from the wheel's surface
_EVERY = 16  # of a head's matched points tells which lines belong together
_FEWEST = 15  # pairs of crosses that make a field
_ROUNDS = 3
_TINY = 1e-9 * np.eye(TERMS)
_TUKEY = 4.685
_LEAST_SIGMA_PX = 0.02


@dataclass(frozen=True, eq=False)
class RowFields:
    """Row differences, left less right, of the crosses of H heads.

    Attributes
    ----------
    pairs
        (H,) crosses that both cameras see; a head with fewer than fifteen has no field.
    rms_px
        (H,) RMS of their row differences, pixels, without those that are wrong; NaN without a field.
    field
        (H, 5) the smooth part, pixels; zero without a field.
    information
        (H, 5, 5) inverse covariance of `field` by the noise of the crosses, pixels⁻²; zero without one.
    """

    pairs: Index
    rms_px: Array
    field: Array
    information: Array

    @property
    def seen(self) -> NDArray[np.bool_]:
        """(H,) whether a head has a field."""
        return self.pairs >= _FEWEST


@dataclass(frozen=True, eq=False)
class RowView:
    """How the rows of one head are looked at: rectification, focal length, origin and scale of places."""

    frame: Rectification
    turns: tuple[Array, Array]
    packed: tuple[Array, Array]
    focal: float
    middle: Array
    half: float

    @classmethod
    def of(cls, head: HeadCalibration) -> RowView:
        """Build from a head's cameras."""
        frame = Rectification.of(head.left, head.right)
        left, right = head.cameras
        focal = 0.5 * (left.model.fx + right.model.fx)
        centre = np.array([[0.5 * (left.model.width - 1), 0.5 * (left.model.height - 1)]])
        return cls(
            frame=frame,
            turns=(
                frame.rectified_from_rig @ left.rig_from_camera.rotation,
                frame.rectified_from_rig @ right.rig_from_camera.rotation,
            ),
            packed=(left.model.packed(), right.model.packed()),
            focal=focal,
            middle=frame.coordinates(left, centre)[0][0],
            half=0.5 * left.model.width / focal,
        )

    def seen(self, side: int, pixels: Array) -> Array:
        """Rectified (u, v) (N, 2) of pixels (N, 2) of the left (0) or right (1) camera."""
        uv = np.empty((len(pixels), 2))
        rectify(np.ascontiguousarray(pixels), self.packed[side], self.turns[side], uv)
        return uv

    def points(self, left: Array, right: Array) -> Array:
        """(N, 3) points of pairs of rectified places (N, 2), rig frame; NaN for no disparity."""
        disparity = left[:, 0] - right[:, 0]
        depth = self.frame.baseline / np.where(disparity > 0.0, disparity, np.nan)
        rays = np.column_stack([left, np.ones(len(left))])
        out: Array = self.frame.origin + (rays * depth[:, None]) @ self.frame.rectified_from_rig
        return out

    def terms(self, uv: Array) -> Array:
        """(N, 5) basis of the field at places (N, 2) of the left camera."""
        u, v = ((uv - self.middle) / self.half).T
        return np.column_stack([np.ones(len(u)), u, v, u * v, v * v])


@lru_cache(maxsize=64)
def row_view(head: HeadCalibration) -> RowView:
    """As `RowView.of`, computed once for each head."""
    return RowView.of(head)


def row_fields(
    lines: Sequence[tuple[LightLines, LightLines]],
    matched: Sequence[Candidates],
    chosen: NDArray[np.bool_],
    heads: Sequence[HeadCalibration],
    height: Callable[[Array], Array],
) -> RowFields:
    """Row differences of one shot.

    A cross on a left line has its partner on the right line that holds the wheel's points of the left one,
    where that crosses nearest to its row.

    Parameters
    ----------
    lines
        Light lines with their crosses, left and right image of each head.
    matched
        Candidates of each head, from these lines.
    chosen
        (N,) which of all heads' candidates lie on the wheel.
    heads
        Their cameras.
    height
        Heights (N,) above the wheel's surface of points (N, 3), rig frame, millimetres; crosses far from it
        are none of the wheel, or no pair.
    """
    offsets = np.cumsum([0, *(len(candidates.points) for candidates in matched)])
    places, differences = [], []
    for k, (pair, candidates, head) in enumerate(zip(lines, matched, heads, strict=True)):
        view = row_view(head)
        partners = _line_partners(pair, candidates, np.flatnonzero(chosen[offsets[k] : offsets[k + 1]]))
        left, right = _cross_partners(pair, partners, view)
        near = np.abs(height(view.points(left, right))) < _FARTHEST_MM
        left, right = left[near], right[near]
        places.append(view.terms(left))
        differences.append((left[:, 1] - right[:, 1]) * view.focal)
    return fitted_fields(places, differences)


def _line_partners(pair: tuple[LightLines, LightLines], candidates: Candidates, on_wheel: Index) -> Index:
    """(L,) right line of each left line; −1 for none."""
    left, right = pair
    some = on_wheel[::_EVERY]
    width = right.count
    of_right = np.searchsorted(right.starts, candidates.right_point[some], side="right") - 1
    votes = np.bincount(candidates.left_line[some] * width + of_right, minlength=left.count * width)
    votes = votes.reshape(left.count, width)
    best = votes.argmax(axis=1)
    # Two lines that share a partner are pieces or a mistake: a clear majority is asked for.
    clear = 2 * votes[np.arange(left.count), best] > votes.sum(axis=1)
    return np.where(clear, best, -1).astype(np.int64)


def _cross_partners(
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
    near = np.abs(key[nearest] - wanted) < _FARTHEST_ROW / view.focal
    return left[near], right[order[nearest[near]]]


def fitted_fields(places: Sequence[Array], differences: Sequence[Array]) -> RowFields:
    """Fit the smooth field of each head to its row differences; wrong pairs lose their weight (Tukey).

    Parameters
    ----------
    places
        (N, 5) of each head, as `RowView.terms`.
    differences
        (N,) of each head, pixels.
    """
    heads, most = len(places), max(1, *(len(each) for each in differences))
    terms, values, seen = np.zeros((heads, most, TERMS)), np.zeros((heads, most)), np.zeros((heads, most))
    numbers = np.array([len(each) for each in differences], dtype=np.int64)
    for k, n in enumerate(numbers):
        if n >= _FEWEST:
            terms[k, :n], values[k, :n], seen[k, :n] = places[k], differences[k], 1.0
    middle = _medians(values, seen)[:, None]
    rest = np.abs(values - middle)
    scale = np.maximum(1.4826 * _medians(rest, seen), _LEAST_SIGMA_PX)[:, None]
    weight = seen * (rest <= 2.0 * _TUKEY * scale)
    field: Array = np.zeros((heads, TERMS))
    normal: Array = np.zeros((heads, TERMS, TERMS))
    for _ in range(_ROUNDS):
        weighted = (terms * weight[:, :, None]).transpose(0, 2, 1)
        normal = weighted @ terms
        field = np.asarray(
            np.linalg.solve(normal + _TINY, weighted @ values[:, :, None])[:, :, 0], dtype=float
        )
        rest = np.abs(values - (terms @ field[:, :, None])[:, :, 0])
        scale = np.maximum(1.4826 * _medians(rest, seen), _LEAST_SIGMA_PX)[:, None]
        weight = seen * np.square(np.maximum(1.0 - np.square(rest / (_TUKEY * scale)), 0.0))
    total = weight.sum(axis=1)
    squares = (weight * np.square(values)).sum(axis=1)
    rms = np.sqrt(np.divide(squares, total, out=np.full(heads, np.nan), where=total > 0.0))
    # Five numbers were taken from few pairs, so that these seem quieter than they are.
    freedom = np.maximum(1.0 - TERMS / np.maximum(numbers, TERMS + 1), 0.2)
    return RowFields(numbers, rms, field, normal * (freedom[:, None] / np.square(scale))[:, :, None])


def _medians(values: Array, seen: Array) -> Array:
    """(H,) median over those of (H, N) values that are seen; 0 where none is."""
    number = seen.sum(axis=1).astype(np.int64)
    ordered = np.sort(np.where(seen > 0.0, values, np.inf), axis=1)
    middle: Array = ordered[np.arange(len(values)), number // 2 - (number > 0) * (number % 2 == 0)]
    return np.where(number > 0, middle, 0.0)
