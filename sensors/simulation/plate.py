"""A plate as a camera sees it: marks and rings on their ground; boards of squares by `simulation.board`.

Each mark lies where it is said to, off the grid and off the plane.

Every pixel is split into 2 × 2 parts; the area that a mark covers of each part is computed, not sampled (its
edge taken as straight within the part), before the lens blurs it (`sensors.simulation.optics`). Limits: marks
are perfect circles, black and ground are even, the light falls off smoothly over the image, the lens is sharp
at all distances but for one constant blur, nothing is in the way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array, Index, Singles
from alignment.geometry import CameraModel, PosedCamera, RigidTransform
from alignment.imaging import Plate, place_table
from alignment.kernels import njit
from alignment.values import Image
from sensors.camera import CameraSettings
from sensors.simulation.board import board_radiance, board_tables
from sensors.simulation.optics import Optics, develop, integrate
from sensors.simulation.plate_rays import EDGE_REACH, PIXEL_PARTS, RAY_CELL, covered, place, ray_nodes

_NO_DISTANCE_MM = 1e-9  # in a mark's very centre no direction leads to its rim
_CELL_REACH = 1.1 * (EDGE_REACH + math.sqrt(0.5) * RAY_CELL)
"""Pixels: an edge that is farther from the middle of a cell crosses no pixel of it, in perspective too."""
_EVEN = 0.97


@dataclass(frozen=True)
class PlateLook:
    """Radiance of the plate; 1 fills the sensor's range at the reference exposure.

    Attributes
    ----------
    ground, mark, beyond
        Of the bright ground and light centres, of the marks, and of what is seen beside the plate.
    fall_off
        Share of the light that is missing at the corners of the image.
    """

    ground: float = 0.7
    mark: float = 0.04
    beyond: float = 0.02
    fall_off: float = 0.12


@dataclass(frozen=True)
class PlateLight:
    """Light over the image of one camera, 1 at most: a smooth hill with its top at some place of the image.

    Attributes
    ----------
    top
        (x, y) of the brightest place, in half widths and half heights from the middle of the image.
    fall_off
        Share of the light that is missing at the farthest corner.
    """

    top: tuple[float, float] = (0.0, 0.0)
    fall_off: float = 0.0

    def over(self, model: CameraModel) -> Singles:
        """Factors (height, width) of the radiance."""
        x = (np.arange(model.width) - (model.width - 1) / 2) / (model.width / 2) - self.top[0]
        y = (np.arange(model.height) - (model.height - 1) / 2) / (model.height / 2) - self.top[1]
        farthest = (1.0 + abs(self.top[0])) ** 2 + (1.0 + abs(self.top[1])) ** 2
        return (1.0 - self.fall_off / farthest * (x**2 + y[:, None] ** 2)).astype(np.float32)


@njit(cache=True, nogil=True, error_model="numpy")
def _nearest(i: float, j: float, rows_of: Index, pitch_x: float, pitch_y: float) -> int:
    """Mark at a place in columns and rows, or the nearest beside a place without; −1 where none is near."""
    a, b = math.floor(i + 0.5), math.floor(j + 0.5)
    best, mark = np.inf, -1
    for k in range(5):
        p = a + (1 if k == 1 else -1 if k == 2 else 0)
        q = b + (1 if k == 3 else -1 if k == 4 else 0)
        if 0 <= p < rows_of.shape[0] and 0 <= q < rows_of.shape[1] and rows_of[p, q] >= 0:
            if k == 0:
                return int(rows_of[p, q])
            away = ((i - p) * pitch_x) ** 2 + ((j - q) * pitch_y) ** 2
            if away < best:
                best, mark = away, rows_of[p, q]
    return int(mark)


@njit(cache=True, nogil=True, error_model="numpy")
def _shade_pixel(
    v: int, u: int, nodes: Array, rotation: Array, origin: Array, centres: Array, radii: Array,
    rows_of: Index, grid: Array, levels: Array, out: Singles,
) -> None:  # fmt: skip
    """Radiance of the parts of one pixel; parameters as `_plate_radiance`."""
    first_i, first_j, pitch_x, pitch_y = grid
    ground, dark, beyond = levels
    count_i, count_j = rows_of.shape
    low_x, low_y = (first_i - 1.0) * pitch_x, (first_j - 1.0) * pitch_y
    high_x, high_y = (first_i + count_i) * pitch_x, (first_j + count_j) * pitch_y
    # Part 0 is the whole pixel: it finds the nearest mark, and whether any edge is near.
    mark = -1
    plain = beyond
    for part in range(PIXEL_PARTS * PIXEL_PARTS + 1):
        size, du, dv = 1.0, 0.0, 0.0
        if part > 0:
            size = 1.0 / PIXEL_PARTS
            du = ((part - 1) % PIXEL_PARTS + 0.5) * size - 0.5
            dv = ((part - 1) // PIXEL_PARTS + 0.5) * size - 0.5
        faces, x, y, sx, sy, xu, yu, xv, yv = place(u + du, v + dv, nodes, rotation, origin)
        if not faces:  # past the horizon
            if part == 0:
                break
            out[v * PIXEL_PARTS + (part - 1) // PIXEL_PARTS, u * PIXEL_PARTS + (part - 1) % PIXEL_PARTS] = (
                beyond
            )
            plain = -1.0
            continue
        # Distances to the plate's border and to the rims of the mark, pixels.
        border_x = min(x - low_x, high_x - x) / math.sqrt(xu * xu + xv * xv)
        border_y = min(y - low_y, high_y - y) / math.sqrt(yu * yu + yv * yv)
        if part == 0:
            if border_x < -EDGE_REACH or border_y < -EDGE_REACH:
                break
            mark = _nearest(x / pitch_x - first_i, y / pitch_y - first_j, rows_of, pitch_x, pitch_y)
        rim, hole, gu, gv = -np.inf, -np.inf, 1.0, 0.0
        if mark >= 0:
            qx = x + centres[mark, 2] * sx - centres[mark, 0]
            qy = y + centres[mark, 2] * sy - centres[mark, 1]
            distance = max(math.sqrt(qx * qx + qy * qy), _NO_DISTANCE_MM)
            gu, gv = (qx * xu + qy * yu) / distance, (qx * xv + qy * yv) / distance
            step = max(math.sqrt(gu * gu + gv * gv), _NO_DISTANCE_MM)
            rim = (radii[mark, 0] - distance) / step
            if radii[mark, 1] > 0.0:
                hole = (radii[mark, 1] - distance) / step
        if part == 0:
            plain = dark if rim > 0 >= hole else ground
            if min(border_x, border_y, abs(rim), abs(hole)) > EDGE_REACH:
                break
            continue
        share = covered(rim / size, gu, gv) - covered(hole / size, gu, gv)
        on = covered(border_x / size, xu, xv) * covered(border_y / size, yu, yv)
        out[v * PIXEL_PARTS + (part - 1) // PIXEL_PARTS, u * PIXEL_PARTS + (part - 1) % PIXEL_PARTS] = (
            beyond + (ground + (dark - ground) * share - beyond) * on
        )
        plain = -1.0
    if plain >= 0.0:
        for part in range(PIXEL_PARTS * PIXEL_PARTS):
            out[v * PIXEL_PARTS + part // PIXEL_PARTS, u * PIXEL_PARTS + part % PIXEL_PARTS] = plain


@njit(cache=True, nogil=True, error_model="numpy")
def _plain_cell(
    row: int, column: int, nodes: Array, rotation: Array, origin: Array, centres: Array, radii: Array,
    rows_of: Index, grid: Array, levels: Array,
) -> float:  # fmt: skip
    """Radiance of a cell of `RAY_CELL` × `RAY_CELL` pixels that no edge comes near; −1 for another."""
    # Slopes towards the plate at the corners: where they differ, scales do, and near the horizon everything.
    steepest, flattest = -np.inf, np.inf
    for corner in range(4):
        a, b = row + corner // 2, column + corner % 2
        slope = -(rotation[2, 0] * nodes[a, b, 0] + rotation[2, 1] * nodes[a, b, 1] + rotation[2, 2])
        steepest, flattest = max(steepest, slope), min(flattest, slope)
    if flattest < _EVEN * steepest:
        return -1.0
    middle = 0.5 * (RAY_CELL - 1)
    faces, x, y, sx, sy, xu, yu, xv, yv = place(
        RAY_CELL * column + middle, RAY_CELL * row + middle, nodes, rotation, origin
    )
    if not faces:
        return -1.0
    # A pixel is at most so many millimetres on the plate: the larger singular value of the derivative.
    square, area = xu * xu + yu * yu + xv * xv + yv * yv, xu * yv - xv * yu
    reach = _CELL_REACH * math.sqrt(0.5 * (square + math.sqrt(max(square * square - 4.0 * area * area, 0.0))))
    i, j = x / grid[2] - grid[0], y / grid[3] - grid[1]
    inside = min(min(i + 1.0, rows_of.shape[0] - i) * grid[2], min(j + 1.0, rows_of.shape[1] - j) * grid[3])
    if inside < -reach:
        return float(levels[2])
    if inside < reach:
        return -1.0
    a, b = math.floor(i + 0.5), math.floor(j + 0.5)
    level = levels[0]
    for p in range(max(a - 2, 0), min(a + 3, rows_of.shape[0])):
        for q in range(max(b - 2, 0), min(b + 3, rows_of.shape[1])):
            mark = rows_of[p, q]
            if mark >= 0:
                qx = x + centres[mark, 2] * sx - centres[mark, 0]
                qy = y + centres[mark, 2] * sy - centres[mark, 1]
                distance = math.sqrt(qx * qx + qy * qy)
                rim, hole = radii[mark, 0], radii[mark, 1]
                if abs(distance - rim) < reach or (hole > 0.0 and abs(distance - hole) < reach):
                    return -1.0
                if hole <= distance < rim:
                    level = levels[1]
    return float(level)


@njit(cache=True, nogil=True, error_model="numpy")
def _plate_radiance(
    nodes: Array,
    rotation: Array,
    origin: Array,
    centres: Array,
    radii: Array,
    rows_of: Index,
    grid: Array,
    levels: Array,
    out: Singles,
) -> None:
    """Radiance of every part of every pixel.

    `nodes` (·, ·, 2) are normalised coordinates at the corners of cells; `rotation`, `origin` take them to
    the plate; `radii` (·, 2) are those of the marks and of their centres, 0 for full marks; `rows_of` gives
    the mark at a place of the grid or −1; `grid` is first column, first row, pitch in x and in y; `levels`
    are ground, mark, beyond.
    """
    height, width = out.shape[0] // PIXEL_PARTS, out.shape[1] // PIXEL_PARTS
    for row in range(nodes.shape[0] - 1):
        for column in range(nodes.shape[1] - 1):
            plain = _plain_cell(row, column, nodes, rotation, origin, centres, radii, rows_of, grid, levels)
            for v in range(RAY_CELL * row, min(RAY_CELL * (row + 1), height)):
                for u in range(RAY_CELL * column, min(RAY_CELL * (column + 1), width)):
                    if plain < 0.0:
                        _shade_pixel(
                            v, u, nodes, rotation, origin, centres, radii, rows_of, grid, levels, out
                        )
                        continue
                    for part in range(PIXEL_PARTS * PIXEL_PARTS):
                        out[v * PIXEL_PARTS + part // PIXEL_PARTS, u * PIXEL_PARTS + part % PIXEL_PARTS] = (
                            plain
                        )


def plate_light(
    plate: Plate,
    camera: PosedCamera,
    rig_from_plate: RigidTransform,
    look: PlateLook,
    blur_px: float,
    light: PlateLight,
) -> Singles:
    """Light (height, width) that the pixels of a camera collect of a plate.

    Parameters
    ----------
    plate
        Marks where they really are; `Plate.sigma_mm` does not count.
    camera, rig_from_plate
        Where camera and plate are.
    look, light
        How bright it is.
    blur_px
        Standard deviation of the lens's blur, pixels.
    """
    model = camera.model
    plate_from_camera = rig_from_plate.inverse() @ camera.rig_from_camera
    nodes = ray_nodes(model)
    rotation = np.ascontiguousarray(plate_from_camera.rotation)
    origin = plate_from_camera.translation.copy()
    samples = np.empty((model.height * PIXEL_PARTS, model.width * PIXEL_PARTS), dtype=np.float32)
    levels = np.array([look.ground, look.mark, look.beyond])
    if plate.pattern.bright:
        levels = np.array([look.mark, look.ground, look.beyond])
    if plate.pattern.has_squares:
        board_radiance(nodes, rotation, origin, *board_tables(plate, plate.points), levels, samples)
    else:
        _plate_radiance(nodes, rotation, origin, *_mark_tables(plate), levels, samples)
    return integrate(samples, PIXEL_PARTS, blur_px) * light.over(model)


def _mark_tables(plate: Plate) -> tuple[Array, Array, Index, Array]:
    """Centres, radii, rows by place, and grid of `_plate_radiance`, the corner mark among them."""
    indices, points = plate.indices, plate.points
    radii = np.zeros((len(indices), 2))
    radii[:, 0] = plate.mark_radius_mm
    radii[plate.hollow, 1] = plate.hollow_radius_mm
    # The pitch is what the grid of true places has on average: only the nearest mark is looked up with it.
    steps = np.ptp(points[:, :2], axis=0) / np.ptp(indices, axis=0)
    corner = plate.pattern.corner
    if corner is not None and corner.radius_mm > 0.0:
        indices = np.vstack([indices, corner.index])
        points = np.vstack([points, [*(np.array(corner.index) * steps), 0.0]])
        radii = np.vstack([radii, [corner.radius_mm, 0.0]])
    rows_of, first = place_table(indices)
    return points, radii, rows_of, np.array([*first, *steps], dtype=np.float64)


def plate_image(
    plate: Plate,
    camera: PosedCamera,
    rig_from_plate: RigidTransform,
    rng: np.random.Generator | None,
    *,
    look: PlateLook = PlateLook(),
    optics: Optics = Optics(),  # noqa: B008  (frozen)
    light: PlateLight = PlateLight(),
    settings: CameraSettings = CameraSettings(),  # noqa: B008  (frozen)
) -> Image:
    """Image (height, width) of a plate in one camera; parameters as `plate_light`; without `rng` no noise."""
    collected = plate_light(plate, camera, rig_from_plate, look, optics.blur_px, light)
    return develop(collected, optics, rng, settings.exposure_ms, settings.gain_db)
