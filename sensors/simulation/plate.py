"""A plate with round marks as a camera sees it: dark marks and rings on a bright ground.

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

from alignment.arrays import Array, Index, Mask, Singles
from alignment.geometry import CameraModel, PosedCamera, RigidTransform
from alignment.imaging import Plate
from alignment.kernels import njit
from alignment.values import Image
from sensors.camera import CameraSettings
from sensors.simulation.optics import Optics, develop, integrate

_PARTS = 2
_CELL = 4
_REACH = 0.75  # pixels: an edge beyond half the diagonal does not cross the pixel
_GRAZING = 1e-6  # rays that are flatter than this pass the plate
_NO_DISTANCE_MM = 1e-9  # in a mark's very centre no direction leads to its rim


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
def covered(distance: float, gx: float, gy: float) -> float:
    """Share of a unit square on the inner side of a straight edge.

    Parameters
    ----------
    distance
        Of the edge from the square's centre, positive when the centre is inside, in sides of the square.
    gx, gy
        Direction across the edge, any length and sign.
    """
    length = max(math.sqrt(gx * gx + gy * gy), 1e-12)
    a, b = abs(gx) / length, abs(gy) / length
    if a < b:
        a, b = b, a
    if abs(distance) >= (a + b) / 2:
        return 1.0 if distance > 0 else 0.0
    if abs(distance) <= (a - b) / 2:
        return 0.5 + distance / a
    corner = ((a + b) / 2 - abs(distance)) ** 2 / (2 * a * b)
    return 1.0 - corner if distance > 0 else corner


@njit(cache=True, nogil=True, error_model="numpy")
def _place(
    u: float, v: float, column: int, row: int, nodes: Array, rotation: Array, origin: Array
) -> tuple[bool, float, float, float, float, float, float, float, float]:
    """Where a pixel looks, through the cell of `nodes` at (row, column).

    Returns whether it looks towards the plate; x and y in the plate; how much x and y grow with the height
    over the plate; the derivatives dx/du, dy/du, dx/dv, dy/dv.
    """
    fu, fv = (u + 0.5) / _CELL - column, (v + 0.5) / _CELL - row
    x = y = xu = yu = xv = yv = 0.0
    for corner in range(4):
        right, below = corner % 2, corner // 2
        wu, wv = fu if right else 1.0 - fu, fv if below else 1.0 - fv
        su, sv = (2.0 * right - 1.0) * wv / _CELL, (2.0 * below - 1.0) * wu / _CELL
        nx, ny = nodes[row + below, column + right, 0], nodes[row + below, column + right, 1]
        x += wu * wv * nx
        y += wu * wv * ny
        xu += su * nx
        yu += su * ny
        xv += sv * nx
        yv += sv * ny
    dz = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2]
    sx = (rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2]) / dz
    sy = (rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2]) / dz
    along = -origin[2] / dz
    dzu = rotation[2, 0] * xu + rotation[2, 1] * yu
    dzv = rotation[2, 0] * xv + rotation[2, 1] * yv
    return (
        dz < -_GRAZING,
        origin[0] - origin[2] * sx,
        origin[1] - origin[2] * sy,
        sx,
        sy,
        along * (rotation[0, 0] * xu + rotation[0, 1] * yu - sx * dzu),
        along * (rotation[1, 0] * xu + rotation[1, 1] * yu - sy * dzu),
        along * (rotation[0, 0] * xv + rotation[0, 1] * yv - sx * dzv),
        along * (rotation[1, 0] * xv + rotation[1, 1] * yv - sy * dzv),
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _plate_radiance(
    nodes: Array,
    rotation: Array,
    origin: Array,
    centres: Array,
    hollow: Mask,
    rows_of: Index,
    grid: Array,
    levels: Array,
    out: Singles,
) -> None:
    """Radiance of every part of every pixel.

    `nodes` (·, ·, 2) are normalised coordinates at the corners of cells; `rotation`, `origin` take them to
    the plate; `rows_of` gives the mark at a place of the grid or −1; `grid` is first column, first row,
    pitch, radius of the marks and of light centres; `levels` are ground, mark, beyond.
    """
    first_i, first_j, pitch, radius, hollow_radius = grid
    ground, dark, beyond = levels
    count_i, count_j = rows_of.shape
    low_x, low_y = (first_i - 1.0) * pitch, (first_j - 1.0) * pitch
    high_x, high_y = (first_i + count_i) * pitch, (first_j + count_j) * pitch
    for v in range(out.shape[0] // _PARTS):
        for u in range(out.shape[1] // _PARTS):
            # Part 0 is the whole pixel: it finds the nearest mark, and whether any edge is near.
            mark = -1
            plain = beyond
            for part in range(_PARTS * _PARTS + 1):
                size, du, dv = 1.0, 0.0, 0.0
                if part > 0:
                    size = 1.0 / _PARTS
                    du = ((part - 1) % _PARTS + 0.5) * size - 0.5
                    dv = ((part - 1) // _PARTS + 0.5) * size - 0.5
                faces, x, y, sx, sy, xu, yu, xv, yv = _place(
                    u + du, v + dv, u // _CELL, v // _CELL, nodes, rotation, origin
                )
                if not faces:
                    break
                # Distances to the plate's border and to the rims of the mark, pixels.
                border_x = min(x - low_x, high_x - x) / math.sqrt(xu * xu + xv * xv)
                border_y = min(y - low_y, high_y - y) / math.sqrt(yu * yu + yv * yv)
                if part == 0:
                    if border_x < -_REACH or border_y < -_REACH:
                        break
                    i = math.floor(x / pitch + 0.5) - int(first_i)
                    j = math.floor(y / pitch + 0.5) - int(first_j)
                    if 0 <= i < count_i and 0 <= j < count_j:
                        mark = rows_of[i, j]
                rim, hole, gu, gv = -np.inf, -np.inf, 1.0, 0.0
                if mark >= 0:
                    qx = x + centres[mark, 2] * sx - centres[mark, 0]
                    qy = y + centres[mark, 2] * sy - centres[mark, 1]
                    distance = max(math.sqrt(qx * qx + qy * qy), _NO_DISTANCE_MM)
                    gu, gv = (qx * xu + qy * yu) / distance, (qx * xv + qy * yv) / distance
                    step = max(math.sqrt(gu * gu + gv * gv), _NO_DISTANCE_MM)
                    rim = (radius - distance) / step
                    if hollow[mark]:
                        hole = (hollow_radius - distance) / step
                if part == 0:
                    plain = dark if rim > 0 >= hole else ground
                    if min(border_x, border_y, abs(rim), abs(hole)) > _REACH:
                        break
                    continue
                share = covered(rim / size, gu, gv) - covered(hole / size, gu, gv)
                on = covered(border_x / size, xu, xv) * covered(border_y / size, yu, yv)
                out[v * _PARTS + (part - 1) // _PARTS, u * _PARTS + (part - 1) % _PARTS] = (
                    beyond + (ground + (dark - ground) * share - beyond) * on
                )
                plain = -1.0
            if plain >= 0.0:
                for part in range(_PARTS * _PARTS):
                    out[v * _PARTS + part // _PARTS, u * _PARTS + part % _PARTS] = plain


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
    rows, columns = -(-model.height // _CELL), -(-model.width // _CELL)
    v, u = np.mgrid[0 : rows + 1, 0 : columns + 1] * float(_CELL) - 0.5
    nodes = model.normalise(np.column_stack([u.ravel(), v.ravel()])).reshape(rows + 1, columns + 1, 2)
    first = plate.indices.min(axis=0)
    rows_of = np.full(plate.indices.max(axis=0) - first + 1, -1, dtype=np.int64)
    rows_of[tuple((plate.indices - first).T)] = np.arange(len(plate.indices))
    # The pitch is what the grid of true places has on average: only the nearest mark is looked up with it.
    steps = np.ptp(plate.points[:, :2], axis=0) / np.ptp(plate.indices, axis=0)
    pitch = float(steps.mean())
    samples = np.empty((model.height * _PARTS, model.width * _PARTS), dtype=np.float32)
    _plate_radiance(
        nodes,
        np.ascontiguousarray(plate_from_camera.rotation),
        plate_from_camera.translation.copy(),
        plate.points,
        plate.hollow,
        rows_of,
        np.array([first[0], first[1], pitch, plate.mark_radius_mm, plate.hollow_radius_mm]),
        np.array([look.ground, look.mark, look.beyond]),
        samples,
    )
    return integrate(samples, _PARTS, blur_px) * light.over(model)


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
