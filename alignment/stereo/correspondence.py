"""Left–right correspondence of light lines: epipolar geometry gives the candidates of each point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from alignment.imaging.lines import LEAST_SINE, LightLines
from alignment.kernels import njit
from alignment.stereo.rectification import Rectification
from alignment.values import HeadCalibration

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_BRIDGE_PX = 3.0  # longest gap of a right line that is interpolated over


@dataclass(frozen=True, eq=False)
class Candidates:
    """Possible 3D points of the left line points of one head.

    Attributes
    ----------
    points
        (N, 3) rig frame, millimetres.
    sigma
        (N,) standard deviation along the left ray, millimetres.
    rays
        (N, 3) unit directions of the left rays, rig frame.
    left_point
        (N,) index of the left line point; candidates of one point stand together.
    left_line
        (N,) number of its line.
    right_point
        (N,) index of a right line point next to the intersection.
    offered
        Left line points that cross the epipolar lines well enough to be matched at all.
    """

    points: Array
    sigma: Array
    rays: Array
    left_point: Index
    left_line: Index
    right_point: Index
    offered: int


@njit(cache=True, nogil=True, error_model="numpy")
def _line_slopes(uv: Array, starts: Index, out: Array) -> None:
    """|sin| of the angle between each line and the epipolar direction, in the rectified view."""
    for a in range(starts.size - 1):
        first, last = starts[a], starts[a + 1]
        for i in range(first, last):
            lo, hi = max(i - 4, first), min(i + 4, last - 1)
            du = uv[hi, 0] - uv[lo, 0]
            dv = uv[hi, 1] - uv[lo, 1]
            length = np.sqrt(du * du + dv * dv)
            out[i] = abs(dv) / length if length > 0.0 else 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _match(
    left: Array,
    left_starts: Index,
    left_sine: Array,
    left_sigma: Array,
    right: Array,
    right_starts: Index,
    right_sine: Array,
    right_sigma: Array,
    rig_from_rectified: Array,
    origin: Array,
    baseline: float,
    zmin: float,
    zmax: float,
    flattest: float,
    bridge: float,
) -> tuple[Array, Array, Array, Index, Index, Index, int]:
    capacity = 4 * left.shape[0] + 1024
    points = np.empty((capacity, 3))
    sigma = np.empty(capacity)
    rays = np.empty((capacity, 3))
    point_of = np.empty(capacity, np.int64)
    line_of = np.empty(capacity, np.int64)
    right_of = np.empty(capacity, np.int64)
    n = 0
    offered = 0
    rows = right_starts.size - 1
    pointer = np.empty(rows, np.int64)
    lowest, highest = np.full(rows, np.inf), np.full(rows, -np.inf)
    for b in range(rows):
        for j in range(right_starts[b], right_starts[b + 1]):
            if right_sine[j] >= flattest:
                lowest[b] = min(lowest[b], right[j, 1])
                highest[b] = max(highest[b], right[j, 1])
    for a in range(left_starts.size - 1):
        for b in range(rows):
            pointer[b] = right_starts[b]
        for i in range(left_starts[a], left_starts[a + 1]):
            if left_sine[i] < flattest:
                continue
            offered += 1
            u, v = left[i, 0], left[i, 1]
            dx = rig_from_rectified[0, 0] * u + rig_from_rectified[0, 1] * v + rig_from_rectified[0, 2]
            dy = rig_from_rectified[1, 0] * u + rig_from_rectified[1, 1] * v + rig_from_rectified[1, 2]
            dz = rig_from_rectified[2, 0] * u + rig_from_rectified[2, 1] * v + rig_from_rectified[2, 2]
            norm = np.sqrt(dx * dx + dy * dy + dz * dz)
            # Disparities that the depth range allows; dz < 0, the cameras look at the wheel.
            near = (zmax - origin[2]) / dz
            far = (zmin - origin[2]) / dz
            if not (near > 0.0 and far > near):
                continue
            dmin, dmax = baseline / far, baseline / near
            for b in range(rows):
                if v < lowest[b] or v > highest[b]:
                    continue
                first, last = right_starts[b], right_starts[b + 1] - 1
                if last <= first:
                    continue
                # Lines run through v in one direction but for the flattest: walk to the segment around v.
                j = pointer[b]
                rising = right[last, 1] > right[first, 1]
                if rising:
                    while j < last - 1 and right[j + 1, 1] < v:
                        j += 1
                    while j > first and right[j, 1] > v:
                        j -= 1
                else:
                    while j < last - 1 and right[j + 1, 1] > v:
                        j += 1
                    while j > first and right[j, 1] < v:
                        j -= 1
                pointer[b] = j
                v0, v1 = right[j, 1], right[j + 1, 1]
                if (v - v0) * (v - v1) > 0.0 or abs(v1 - v0) > bridge:
                    continue
                if min(right_sine[j], right_sine[j + 1]) < flattest:
                    continue
                t = (v - v0) / (v1 - v0) if v1 != v0 else 0.5
                disparity = u - (right[j, 0] + t * (right[j + 1, 0] - right[j, 0]))
                if disparity < dmin or disparity > dmax:
                    continue
                if n == capacity:  # a pattern this ambiguous is thinned, not refused
                    continue
                z = baseline / disparity
                su = left_sigma[i] / left_sine[i]
                sr = right_sigma[j] / right_sine[j]
                points[n, 0] = origin[0] + dx * z
                points[n, 1] = origin[1] + dy * z
                points[n, 2] = origin[2] + dz * z
                sigma[n] = z * z / baseline * np.sqrt(su * su + sr * sr) * norm
                rays[n, 0], rays[n, 1], rays[n, 2] = dx / norm, dy / norm, dz / norm
                point_of[n] = i
                line_of[n] = a
                right_of[n] = j
                n += 1
    return points[:n], sigma[:n], rays[:n], point_of[:n], line_of[:n], right_of[:n], offered


def match_lines(
    left: LightLines, right: LightLines, head: HeadCalibration, depth_range: tuple[float, float]
) -> Candidates:
    """Intersect the epipolar line of every left line point with every right line.

    Parameters
    ----------
    left, right
        Light lines of the two images.
    head
        The two posed cameras.
    depth_range
        Lowest and highest z of the surface, rig frame, millimetres.

    Returns
    -------
    Candidates
        All intersections inside the depth range; a point may have several, or none.
    """
    frame = Rectification.of(head.left, head.right)
    views = []
    for lines, camera in ((left, head.left), (right, head.right)):
        uv, _ = frame.coordinates(camera, lines.points)
        sine = np.zeros(len(uv))
        _line_slopes(uv, lines.starts, sine)
        focal = 0.5 * (camera.model.fx + camera.model.fy)
        views.append((uv, lines.starts, sine, lines.sigma / focal, focal))
    (uv_l, starts_l, sine_l, sigma_l, focal), (uv_r, starts_r, sine_r, sigma_r, _) = views
    points, sigma, rays, left_point, left_line, right_point, offered = _match(
        uv_l,
        starts_l,
        sine_l,
        sigma_l,
        uv_r,
        starts_r,
        sine_r,
        sigma_r,
        np.ascontiguousarray(frame.rectified_from_rig.T),
        frame.origin,
        frame.baseline,
        *depth_range,
        LEAST_SINE,
        _BRIDGE_PX / focal,
    )
    return Candidates(points, sigma, rays, left_point, left_line, right_point, offered)
