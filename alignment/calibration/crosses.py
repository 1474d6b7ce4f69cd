"""Crosses of light lines that left and right image share: what ordinary wheels tell of a head's cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array, Index, Mask
from alignment.imaging.lines import LightLines, extract_many
from alignment.stereo.correspondence import match_lines
from alignment.stereo.rectification import Rectification
from alignment.stereo.surface import nearest_candidates, plane_hypotheses
from alignment.values import HeadCalibration, MeasureSettings, RigCalibration, StereoImages

_FARTHEST_ROW = 25.0  # pixels by which a moved camera may shift the epipolar lines
_GATE = 25.0  # mm from the wheel's mean plane


@dataclass(frozen=True, eq=False)
class CrossPairs:
    """Crosses seen by both cameras of a head, (N, 2) pixels each."""

    left: Array
    right: Array


def joined(pairs: Sequence[CrossPairs]) -> CrossPairs:
    """Return the pairs of several shots as one."""
    return CrossPairs(
        np.concatenate([p.left for p in pairs]).reshape(-1, 2),
        np.concatenate([p.right for p in pairs]).reshape(-1, 2),
    )


SeenWheel = tuple[tuple[LightLines, LightLines] | None, ...]
"""Light lines of one shot, left and right per head; None for a head that shows none."""


def seen_wheel(images: Sequence[StereoImages]) -> SeenWheel:
    """Find the light lines of one shot."""
    lines = extract_many([image for pair in images for image in (pair.left, pair.right)])
    return tuple(
        None if left is None or right is None else (left, right)
        for left, right in zip(lines[::2], lines[1::2], strict=True)
    )


def cross_pairs(
    wheel: SeenWheel, calibration: RigCalibration, settings: MeasureSettings
) -> tuple[CrossPairs, ...]:
    """Pair the crosses of each head; cameras that have moved by some pixels still find their pairs.

    The points where lines meet epipolar lines give the wheel's mean plane; of the crosses that lie within 25
    pixels of a left cross's epipolar line, the one that belongs nearest to that plane is its partner, and the
    other way round.

    Parameters
    ----------
    wheel
        Light lines of one shot, head by head in the order of `calibration.heads`.
    calibration
        As in force.
    settings
        Depth range and largest angle count.

    Returns
    -------
    tuple of CrossPairs
        One per head; empty where a head shows no lines or no plane was found.
    """
    points, groups = [], []
    first = 0
    for pair, head in zip(wheel, calibration.heads, strict=True):
        if pair is None:
            continue
        found = match_lines(*pair, head, settings.depth_range_mm)
        points.append(found.points)
        groups.append(found.left_point + first)
        first += len(pair[0].points)
    nothing = CrossPairs(np.zeros((0, 2)), np.zeros((0, 2)))
    if not points:
        return (nothing,) * len(calibration.heads)
    slope = float(np.tan(settings.maximum_angle)) + 0.05
    planes = plane_hypotheses(np.concatenate(points), np.concatenate(groups), settings.depth_range_mm, slope)
    if not planes:
        return (nothing,) * len(calibration.heads)
    plane = planes[0].coefficients
    return tuple(
        nothing if pair is None else _pair(*pair, head, plane)
        for pair, head in zip(wheel, calibration.heads, strict=True)
    )


def _pair(left: LightLines, right: LightLines, head: HeadCalibration, plane: Array) -> CrossPairs:
    frame = Rectification.of(head.left, head.right)
    of_left, of_right = left.crosses.points, right.crosses.points
    uv_left, _ = frame.coordinates(head.left, of_left)
    uv_right, _ = frame.coordinates(head.right, of_right)
    i, j = np.nonzero(np.abs(uv_left[:, None, 1] - uv_right[None, :, 1]) < _FARTHEST_ROW / head.left.model.fx)
    disparity = uv_left[i, 0] - uv_right[j, 0]
    ahead = disparity > 0
    i, j, disparity = i[ahead], j[ahead], disparity[ahead]
    rays = np.column_stack([uv_left[i], np.ones(len(i))])
    points = frame.origin + (rays * (frame.baseline / disparity)[:, None]) @ frame.rectified_from_rig
    height = points[:, 2] - (plane[0] + points[:, :2] @ plane[1:])
    forward = _nearest(height, i)
    backward = _nearest(height, j)
    both = forward & backward
    return CrossPairs(of_left[i[both]], of_right[j[both]])


def _nearest(height: Array, group: Index) -> Mask:
    """Mark of each group the candidate nearest to the plane; groups need not stand together."""
    order = np.argsort(group, kind="stable")
    keep = np.zeros(len(group), dtype=np.bool_)
    keep[order] = nearest_candidates(height[order], group[order].astype(np.int64), _GATE)
    return keep
