"""Left–right correspondence of light lines: epipolar geometry gives the candidates of each point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array, Index
from alignment.imaging.lines import LEAST_SINE, LightLines
from alignment.kernels import njit, prange
from alignment.stereo.rectification import Rectification, rectify
from alignment.values import HeadCalibration

#: Columns of `Candidates.light`.
RATIO, LEAN, GAIN = 0, 1, 2

BRIDGE_PX = 5.0
"""Longest gap of a right line that is interpolated over."""


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
    spread
        (N,) variance of the light line's profile on the surface, millimetres squared.
    left_point
        (N,) index of the left line point; candidates of one point stand together.
    left_line
        (N,) number of its line.
    right_point
        (N,) index of a right line point next to the intersection.
    light
        (N, 3) what moves a line's centre: light of the left over that of the right camera; lean dx/dy of the
        line in the left image; and way along the ray that the centre's shift means, millimetres squared:
        times the change of the log ratio per millimetre it is that way, for an upright line.
    offered
        Left line points that cross the epipolar lines well enough to be matched at all.
    every
        One left line point of how many was looked at; more than 1 where a pattern is so ambiguous that the
        candidates of all would be too many.
    """

    points: Array
    sigma: Array
    rays: Array
    spread: Array
    left_point: Index
    left_line: Index
    right_point: Index
    light: Array
    offered: int
    every: int = 1


@njit(cache=True, nogil=True, error_model="numpy")
def line_slopes(uv: Array, starts: Index, out: Array) -> None:
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
def _thin(
    every: int, points: Array, rays: Array, sigma: Array, spread: Array, light: Array, indices: Index
) -> int:
    """Keep the candidates of every so many left line points, in place; returns how many there are then."""
    n = 0
    for i in range(sigma.size):
        if indices[0, i] % every == 0:
            for k in range(3):
                points[n, k], rays[n, k], light[n, k] = points[i, k], rays[i, k], light[i, k]
                indices[k, n] = indices[k, i]
            sigma[n], spread[n] = sigma[i], spread[i]
            n += 1
    return n


@njit(cache=True, nogil=True, error_model="numpy")
def write_point(
    n: int,
    z: float,
    origin: tuple[float, float, float],
    ray_of_one: tuple[float, float, float],
    norm: float,
    baseline: float,
    variance: float,
    su: float,
    sr: float,
    left_strength: float,
    right_strength: float,
    along_x: float,
    along_y: float,
    points: Array,
    rays: Array,
    sigma: Array,
    spread: Array,
    light: Array,
) -> None:
    """Point at depth z of a left ray, into row n of the last five; see `Candidates`.

    The ray is that of depth 1, of length `norm`; `su` and `sr` are deviations of the left and the right
    place along the epipolar line, `along_x` and `along_y` the direction of the line in the left image.
    """
    point, ray = points[n], rays[n]
    for k in range(3):
        point[k], ray[k] = origin[k] + ray_of_one[k] * z, ray_of_one[k] / norm
    sigma[n] = z * z / baseline * np.sqrt(su * su + sr * sr) * norm
    light[n, RATIO] = left_strength / max(right_strength, 1e-12)
    light[n, LEAN] = along_x / (along_y if along_y != 0.0 else 1e-9)
    spread[n] = z * z * variance
    # Disparity errs by variance · d ln ratio/du, and a step in u is z millimetres there.
    light[n, GAIN] = z / baseline * spread[n] * norm


@njit(cache=True, nogil=True, error_model="numpy")
def _match(
    left: Array,
    left_starts: Index,
    left_sine: Array,
    left_sigma: Array,
    left_strength: Array,
    left_tangents: Array,
    right: Array,
    right_starts: Index,
    right_sine: Array,
    right_sigma: Array,
    right_strength: Array,
    variance: float,
    rig_from_rectified: Array,
    origin: Array,
    baseline: float,
    zmin: float,
    zmax: float,
    flattest: float,
    bridge: float,
    points: Array,
    rays: Array,
    sigma: Array,
    spread: Array,
    light: Array,
    indices: Index,
) -> tuple[int, int, int]:
    """Candidates into the rows of the last six; how many, of how many points, and `Candidates.every`.

    `variance` is that of the lines' profile, in the units of `left`, squared.
    """
    capacity = points.shape[0]
    n = offered = 0
    every = 1
    r00, r01, r02 = rig_from_rectified[0, 0], rig_from_rectified[0, 1], rig_from_rectified[0, 2]
    r10, r11, r12 = rig_from_rectified[1, 0], rig_from_rectified[1, 1], rig_from_rectified[1, 2]
    r20, r21, r22 = rig_from_rectified[2, 0], rig_from_rectified[2, 1], rig_from_rectified[2, 2]
    ox, oy, oz = origin[0], origin[1], origin[2]
    by_low, by_high = baseline / (zmin - oz), baseline / (zmax - oz)
    rows = right_starts.size - 1
    pointer = np.empty(rows, np.int64)
    lowest, highest = np.full(rows, np.inf), np.full(rows, -np.inf)
    leftmost, rightmost = np.full(rows, np.inf), np.full(rows, -np.inf)
    for b in range(rows):
        for j in range(right_starts[b], right_starts[b + 1]):
            if right_sine[j] >= flattest:
                leftmost[b] = min(leftmost[b], right[j, 0])
                rightmost[b] = max(rightmost[b], right[j, 0])
                lowest[b] = min(lowest[b], right[j, 1])
                highest[b] = max(highest[b], right[j, 1])
    for a in range(left_starts.size - 1):
        for b in range(rows):
            pointer[b] = right_starts[b]
        for i in range(left_starts[a], left_starts[a + 1]):
            if left_sine[i] < flattest or (every > 1 and i % every != 0):
                continue
            offered += 1
            u, v = left[i, 0], left[i, 1]
            dx, dy, dz = r00 * u + r01 * v + r02, r10 * u + r11 * v + r12, r20 * u + r21 * v + r22
            # Disparities that the depth range allows; dz < 0, the cameras look at the wheel.
            dmin, dmax = by_low * dz, by_high * dz
            if not (0.0 < dmin < dmax):
                continue
            norm = np.sqrt(dx * dx + dy * dy + dz * dz)
            for b in range(rows):
                if v < lowest[b] or v > highest[b] or u - rightmost[b] > dmax or u - leftmost[b] < dmin:
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
                # A pattern this ambiguous is thinned, not refused: by whole points, all over the image.
                while n == capacity:
                    every *= 2
                    n = _thin(every, points, rays, sigma, spread, light, indices)
                if every > 1 and i % every != 0:
                    break
                tangent = left_tangents[i]
                write_point(
                    n, baseline / disparity, (ox, oy, oz), (dx, dy, dz), norm, baseline, variance,
                    left_sigma[i] / left_sine[i], right_sigma[j] / right_sine[j],
                    left_strength[i], right_strength[j], tangent[0], tangent[1],
                    points, rays, sigma, spread, light,
                )  # fmt: skip
                indices[0, n], indices[1, n], indices[2, n] = i, a, j
                n += 1
    if every > 1:
        offered = 0
        for i in range(0, left_sine.size, every):
            offered += left_sine[i] >= flattest
    return n, offered, every


@njit(cache=True, nogil=True, parallel=True, error_model="numpy")
def _match_all(
    pixels: Array,
    starts: Index,
    sigmas: Array,
    strengths: Array,
    tangents: Array,
    variances: Array,
    first_points: Index,
    first_lines: Index,
    packed: Array,
    turns: Array,
    rotations: Array,
    origins: Array,
    baselines: Array,
    depth_range: tuple[float, float],
    flattest: float,
    bridge: Array,
    points: Array,
    rays: Array,
    sigma: Array,
    spread: Array,
    light: Array,
    indices: Index,
    counts: Index,
) -> None:
    """All heads; images 2k and 2k + 1 are the left and the right one of head k.

    The tables of the images stand one behind the other: the points of image i from `first_points[i]` on, the
    starts of its lines, which count from its first point, from `first_lines[i]` on.
    """
    uv, sine = np.empty_like(pixels), np.empty_like(sigmas)
    images = first_points.size - 1
    for index in prange(images):
        i = np.int64(index)
        lo, hi = first_points[i], first_points[i + 1]
        rectify(pixels[lo:hi], packed[i], turns[i], uv[lo:hi])
        line_slopes(uv[lo:hi], starts[first_lines[i] : first_lines[i + 1]], sine[lo:hi])
    for head in prange(images // 2):
        left, right = np.int64(2 * head), np.int64(2 * head + 1)
        a, b, c = first_points[left], first_points[right], first_points[right + 1]
        counts[head, 0], counts[head, 1], counts[head, 2] = _match(
            uv[a:b], starts[first_lines[left] : first_lines[right]], sine[a:b], sigmas[a:b],
            strengths[a:b], tangents[a:b],
            uv[b:c], starts[first_lines[right] : first_lines[right + 1]], sine[b:c], sigmas[b:c],
            strengths[b:c],
            variances[head],
            rotations[head], origins[head], baselines[head], depth_range[0], depth_range[1],
            flattest, bridge[head], points[head], rays[head], sigma[head], spread[head],
            light[head], indices[head],
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class StereoGeometry:
    """Tables of the cameras of H heads, as the kernels want them; images are left and right of each head.

    Attributes
    ----------
    focal
        (2 H,) focal length of each image, pixels.
    packed
        (2 H, …) camera of each image, packed.
    turns
        (2 H, 3, 3) rotation from camera to rectified axes of each image.
    rotations
        (H, 3, 3) rotation from rectified to rig axes.
    origins
        (H, 3) centres of the left cameras, rig frame, millimetres.
    baselines
        (H,) distances of the cameras' centres, millimetres.
    """

    focal: Array
    packed: Array
    turns: Array
    rotations: Array
    origins: Array
    baselines: Array

    @classmethod
    def of(cls, heads: Sequence[HeadCalibration]) -> StereoGeometry:
        """Build from the posed cameras of the heads.

        Raises
        ------
        DegenerateInputError
            As `Rectification.of`.
        """
        frames = [Rectification.of(head.left, head.right) for head in heads]
        cameras = [camera for head in heads for camera in head.cameras]
        return cls(
            focal=np.array([0.5 * (camera.model.fx + camera.model.fy) for camera in cameras]),
            packed=np.array([camera.model.packed() for camera in cameras]),
            turns=np.array(
                [
                    frame.rectified_from_rig @ camera.rig_from_camera.rotation
                    for frame, head in zip(frames, heads, strict=True)
                    for camera in head.cameras
                ]
            ),
            rotations=np.array([frame.rectified_from_rig.T for frame in frames]),
            origins=np.array([frame.origin for frame in frames]),
            baselines=np.array([frame.baseline for frame in frames]),
        )


def match_heads(
    lines: Sequence[tuple[LightLines, LightLines]],
    geometry: StereoGeometry,
    depth_range: tuple[float, float],
) -> list[Candidates]:
    """Intersect the epipolar line of every left line point with every right line, for every head.

    Parameters
    ----------
    lines
        Light lines of the left and the right image of each head.
    geometry
        Of their posed cameras.
    depth_range
        Lowest and highest z of the surface, rig frame, millimetres.

    Returns
    -------
    list of Candidates
        All intersections inside the depth range; a point may have several, or none. Where there are more than
        four for each point, some points are left out, evenly (`Candidates.every`).
    """
    heads = len(geometry.baselines)
    every = [each for pair in lines for each in pair]
    numbers = [len(each.points) for each in every]
    capacity = 4 * max(numbers) + 1024
    points, rays = np.empty((heads, capacity, 3)), np.empty((heads, capacity, 3))
    sigma, spread = np.empty((2, heads, capacity))
    light = np.empty((heads, capacity, 3))
    widths = np.array([each.width for each in every]) / geometry.focal
    indices = np.empty((heads, 3, capacity), np.int64)
    counts = np.zeros((heads, 3), np.int64)
    _match_all(
        np.concatenate([each.points for each in every]),
        np.concatenate([each.starts for each in every]),
        np.concatenate([each.sigma for each in every]) / np.repeat(geometry.focal, numbers),
        np.concatenate([each.strength for each in every]),
        np.concatenate([each.tangents for each in every]),
        widths[::2] * widths[1::2],
        np.cumsum([0, *numbers]),
        np.cumsum([0, *(len(each.starts) for each in every)]),
        geometry.packed,
        geometry.turns,
        geometry.rotations,
        geometry.origins,
        geometry.baselines,
        (float(depth_range[0]), float(depth_range[1])),
        LEAST_SINE,
        BRIDGE_PX / geometry.focal[::2],
        points,
        rays,
        sigma,
        spread,
        light,
        indices,
        counts,
    )
    return [
        Candidates(
            points=points[k, :n],
            sigma=sigma[k, :n],
            rays=rays[k, :n],
            spread=spread[k, :n],
            left_point=indices[k, 0, :n],
            left_line=indices[k, 1, :n],
            right_point=indices[k, 2, :n],
            light=light[k, :n],
            offered=int(offered),
            every=int(every),
        )
        for k, (n, offered, every) in enumerate(counts)
    ]


def match_lines(
    left: LightLines, right: LightLines, head: HeadCalibration, depth_range: tuple[float, float]
) -> Candidates:
    """Candidates of one head; see `match_heads`."""
    return match_heads([(left, right)], StereoGeometry.of([head]), depth_range)[0]
