"""Do the two cameras of a head still see along the same rows? Crosses of light lines tell.

A cross of two light lines is one place of the tyre, so in the rectified head its left and its right image lie
on one row. By how much they do not is a smooth field over the view: a turned, shifted or refocused camera
bends, leans or lifts it. Five numbers hold that field; what is left is the noise of the crosses.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array, Index, Mask
from alignment.imaging.lines import LightLines
from alignment.stereo.correspondence import Candidates
from alignment.stereo.rectification import Rectification, rectify
from alignment.stereo.row_kernels import FEWEST, TERMS, cross_pairs, fit_fields, pair_figures
from alignment.values import HeadCalibration

__all__ = ["TERMS", "RowFields", "RowView", "RowViews", "fitted_fields", "row_fields"]

_FARTHEST_ROW = 25.0  # pixels that a partner may be off its row; lines stand farther apart
_FARTHEST_MM = 3.0  # from the wheel's surface


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
    def seen(self) -> Mask:
        """(H,) whether a head has a field."""
        return self.pairs >= FEWEST


@dataclass(frozen=True, eq=False)
class RowView:
    """How the rows of one head are looked at.

    Attributes
    ----------
    frame
        The head in the normal case.
    turns, packed
        (2, 3, 3) rotations from camera to rectified axes, and the cameras packed, left and right.
    focal
        Focal length, pixels.
    middle, half
        Place (2,) that is the origin of a field, and the length of its unit, rectified.
    """

    frame: Rectification
    turns: Array
    packed: Array
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
            turns=np.array(
                [frame.rectified_from_rig @ each.rig_from_camera.rotation for each in head.cameras]
            ),
            packed=np.array([each.model.packed() for each in head.cameras]),
            focal=focal,
            middle=frame.coordinates(left, centre)[0][0],
            half=0.5 * left.model.width / focal,
        )

    def seen(self, side: int, pixels: Array) -> Array:
        """Rectified (u, v) (N, 2) of pixels (N, 2) of the left (0) or right (1) camera."""
        uv = np.empty((len(pixels), 2))
        rectify(np.ascontiguousarray(pixels), self.packed[side], self.turns[side], uv)
        return uv

    def terms(self, uv: Array) -> Array:
        """(N, 5) basis of the field at places (N, 2) of the left camera."""
        u, v = ((uv - self.middle) / self.half).T
        return np.column_stack([np.ones(len(u)), u, v, u * v, v * v])


@dataclass(frozen=True, eq=False)
class RowViews:
    """How the rows of the heads of a rig are looked at.

    Attributes
    ----------
    each
        Of each head.
    geometry
        The same as tables by head, in the order in which the kernels want them.
    """

    each: tuple[RowView, ...]
    geometry: tuple[Array, Array, Array, Array, Array, Array]

    @classmethod
    def of(cls, heads: Sequence[HeadCalibration]) -> RowViews:
        """Build from the cameras of the heads."""
        views = tuple(RowView.of(head) for head in heads)
        geometry = (
            np.array([view.frame.rectified_from_rig for view in views]),
            np.array([view.frame.origin for view in views]),
            np.array([view.frame.baseline for view in views]),
            np.array([view.middle for view in views]),
            np.array([view.half for view in views]),
            np.array([view.focal for view in views]),
        )
        return cls(views, geometry)


def row_fields(
    lines: Sequence[tuple[LightLines, LightLines]],
    matched: Sequence[Candidates],
    chosen: Mask,
    views: RowViews,
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
    views
        Of their cameras.
    height
        Heights (N,) above the wheel's surface of points (N, 3), rig frame, millimetres; crosses far from it
        are none of the wheel, or no pair.
    """
    places = np.empty((sum(len(left.crosses.points) for left, _ in lines), 4))
    bounds = np.zeros(len(views.each) + 1, np.int64)
    first = 0
    for k, ((left, right), candidates, view) in enumerate(zip(lines, matched, views.each, strict=True)):
        last = first + len(candidates.points)
        bounds[k + 1] = cross_pairs(
            left.starts, right.starts, left.crosses.points, left.crosses.lines,
            right.crosses.points, right.crosses.lines, candidates.left_line, candidates.right_point,
            chosen[first:last], view.packed, view.turns, _FARTHEST_ROW / view.focal, places, bounds[k],
        )  # fmt: skip
        first = last
    points, terms, values = pair_figures(places, bounds, *views.geometry)
    near = np.abs(height(points)) < _FARTHEST_MM
    return RowFields(*fit_fields(terms, values, near, bounds))


def fitted_fields(places: Sequence[Array], differences: Sequence[Array]) -> RowFields:
    """Fit the smooth field of each head to its row differences; wrong pairs lose their weight (Tukey).

    Parameters
    ----------
    places
        (N, 5) of each head, as `RowView.terms`.
    differences
        (N,) of each head, pixels.
    """
    bounds = np.cumsum([0, *(len(each) for each in differences)])
    values = np.concatenate(differences)
    return RowFields(*fit_fields(np.concatenate(places), values, np.ones(len(values), np.bool_), bounds))
