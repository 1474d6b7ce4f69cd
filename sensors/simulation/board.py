"""A chessboard or ChArUco board as a camera sees it: squares whose corners lie where they are said to.

Corners may lie off the grid and off the plane; each takes the squares about it along. Every pixel is split
into 2 × 2 parts; what light squares cover of each is computed, not sampled, near the edges of squares;
markers, which no corner touches, are sampled at 4 × 4 points of each part. Limits: as
`sensors.simulation.plate`.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from alignment.arrays import Array, Index, Singles
from alignment.imaging import Pattern, PatternKind, Plate, charuco_board
from alignment.kernels import njit
from sensors.simulation.plate_rays import EDGE_REACH, PIXEL_PARTS, covered, place

_BLEND = 0.3  # of a square, about its middle, in which the shift of one corner becomes that of the next
_POINTS = 4  # along each side of a part, in markers
_BORDER_BITS = 1


@njit(cache=True, nogil=True, error_model="numpy")
def _moved(x: float, y: float, sx: float, sy: float, grid: Array, away: Array) -> tuple[float, float]:
    """Columns and rows from the outer corner of a point of the plane, as if corners lay on the grid."""
    i, j = x / grid[2] - grid[0], y / grid[3] - grid[1]
    count_j, count_i = away.shape[0], away.shape[1]
    a = min(max(math.floor(i), 0), count_i - 2)
    b = min(max(math.floor(j), 0), count_j - 2)
    # A corner takes the squares about it along: between two corners the shift changes in the middle.
    s = min(max((i - a - 0.5) / _BLEND + 0.5, 0.0), 1.0)
    t = min(max((j - b - 0.5) / _BLEND + 0.5, 0.0), 1.0)
    dx = dy = dz = 0.0
    for k in range(4):
        right, up = k % 2, k // 2
        w = (s if right else 1.0 - s) * (t if up else 1.0 - t)
        dx += w * away[b + up, a + right, 0]
        dy += w * away[b + up, a + right, 1]
        dz += w * away[b + up, a + right, 2]
    return i + (dz * sx - dx) / grid[2], j + (dz * sy - dy) / grid[3]


@njit(cache=True, nogil=True, error_model="numpy")
def _light_share(i: float, j: float, bits: Index, cells: int, edge: float) -> float:
    """1 where a point in columns and rows from the outer corner is light: squares, and what is in them."""
    a, b = math.floor(i), math.floor(j)
    # The square above the first corner to its right is (1, 1).
    if bits[b, a, 0] == -2:
        return 0.0
    if bits[b, a, 0] == -1 or cells == 0:
        return 1.0
    s, t = (i - a - edge) / (1.0 - 2.0 * edge), (j - b - edge) / (1.0 - 2.0 * edge)
    if not (0.0 <= s < 1.0 and 0.0 <= t < 1.0):
        return 1.0
    # Markers are stored from their top.
    return float(bits[b, a, (cells - 1 - int(t * cells)) * cells + int(s * cells)])


@njit(cache=True, nogil=True, error_model="numpy")
def board_radiance(
    nodes: Array,
    rotation: Array,
    origin: Array,
    away: Array,
    bits: Index,
    grid: Array,
    levels: Array,
    out: Singles,
) -> None:
    """Radiance of every part of every pixel.

    `nodes`, `rotation`, `origin`, `levels` and `out` are those of `sensors.simulation.plate`; `away`
    (rows + 2, columns + 2, 3) is where corners lie beside the grid, the board's outer ones too; `bits`
    (rows + 1, columns + 1, cells²) are −2 first for a dark square, −1 for a light one, else a marker's cells;
    `grid` is column and row of the outer corner, pitches, a light rim's width and the markers' distance from
    the edges in squares.
    """
    ground, dark, beyond = levels
    count_i, count_j = away.shape[1] - 1, away.shape[0] - 1
    rim, edge = grid[4], grid[5]
    cells = round(math.sqrt(bits.shape[2])) if bits.shape[2] > 1 else 0
    for v in range(out.shape[0] // PIXEL_PARTS):
        for u in range(out.shape[1] // PIXEL_PARTS):
            for part in range(PIXEL_PARTS * PIXEL_PARTS):
                size = 1.0 / PIXEL_PARTS
                du = (part % PIXEL_PARTS + 0.5) * size - 0.5
                dv = (part // PIXEL_PARTS + 0.5) * size - 0.5
                faces, x, y, sx, sy, xu, yu, xv, yv = place(u + du, v + dv, nodes, rotation, origin)
                value = beyond
                if faces:
                    i, j = _moved(x, y, sx, sy, grid, away)
                    iu, iv, ju, jv = xu / grid[2], xv / grid[2], yu / grid[3], yv / grid[3]
                    step_i, step_j = math.sqrt(iu * iu + iv * iv), math.sqrt(ju * ju + jv * jv)
                    outer_i = min(i + rim, count_i + rim - i) / step_i
                    outer_j = min(j + rim, count_j + rim - j) / step_j
                    on = covered(outer_i / size, iu, iv) * covered(outer_j / size, ju, jv)
                    if on > 0.0:
                        share = 1.0
                        inner_i = min(i, count_i - i) / step_i
                        inner_j = min(j, count_j - j) / step_j
                        if inner_i > -EDGE_REACH and inner_j > -EDGE_REACH:
                            share = _share_of_part(
                                i,
                                j,
                                iu,
                                iv,
                                ju,
                                jv,
                                step_i,
                                step_j,
                                size,
                                bits,
                                cells,
                                edge,
                                count_i,
                                count_j,
                            )
                        value = beyond + (dark + (ground - dark) * share - beyond) * on
                out[v * PIXEL_PARTS + part // PIXEL_PARTS, u * PIXEL_PARTS + part % PIXEL_PARTS] = value


@njit(cache=True, nogil=True, error_model="numpy")
def _share_of_part(
    i: float,
    j: float,
    iu: float,
    iv: float,
    ju: float,
    jv: float,
    step_i: float,
    step_j: float,
    size: float,
    bits: Index,
    cells: int,
    edge: float,
    count_i: int,
    count_j: int,
) -> float:
    """Share of a part of a pixel that is light."""
    # Beside the nearest line of each direction the board has one colour on either side.
    line_i = min(max(math.floor(i + 0.5), 0.0), float(count_i))
    line_j = min(max(math.floor(j + 0.5), 0.0), float(count_j))
    right = covered((i - line_i) / step_i / size, iu, iv)
    above = covered((j - line_j) / step_j / size, ju, jv)
    if right * (1.0 - right) == 0.0 and above * (1.0 - above) == 0.0:
        if cells == 0 or not (0.0 < i < count_i and 0.0 < j < count_j):
            return _square(i, j, bits, count_i, count_j)
        a, b = math.floor(i), math.floor(j)
        if bits[b, a, 0] < 0:
            return 0.0 if bits[b, a, 0] == -2 else 1.0
        # Well within one cell of the marker, or in the light about it, one point tells.
        cell = (1.0 - 2.0 * edge) / cells
        s, t = (i - a - edge) / cell, (j - b - edge) / cell
        away_i = abs(s - math.floor(s + 0.5)) * cell
        away_j = abs(t - math.floor(t + 0.5)) * cell
        if away_i > (abs(iu) + abs(iv)) * size and away_j > (abs(ju) + abs(jv)) * size:
            return _light_share(i, j, bits, cells, edge)
        total = 0.0
        for k in range(_POINTS * _POINTS):
            pu = ((k % _POINTS + 0.5) / _POINTS - 0.5) * size
            pv = ((k // _POINTS + 0.5) / _POINTS - 0.5) * size
            total += _light_share(
                min(max(i + iu * pu + iv * pv, a + 1e-9), a + 1.0 - 1e-9),
                min(max(j + ju * pu + jv * pv, b + 1e-9), b + 1.0 - 1e-9),
                bits, cells, edge,
            )  # fmt: skip
        return total / (_POINTS * _POINTS)
    share = 0.0
    for k in range(4):
        to_right, up = k % 2, k // 2
        weight = (right if to_right else 1.0 - right) * (above if up else 1.0 - above)
        if weight > 0.0:
            share += weight * _square(line_i + to_right - 0.5, line_j + up - 0.5, bits, count_i, count_j)
    return share


@njit(cache=True, nogil=True, error_model="numpy")
def _square(i: float, j: float, bits: Index, count_i: int, count_j: int) -> float:
    """1 for a light square, and for the rim; 0 for a dark one."""
    if not (0.0 <= i < count_i and 0.0 <= j < count_j):
        return 1.0
    return 0.0 if bits[math.floor(j), math.floor(i), 0] == -2 else 1.0


def board_tables(plate: Plate, points: Array) -> tuple[Array, Index, Array]:
    """Return `away`, `bits` and `grid` of `board_radiance`.

    Parameters
    ----------
    plate
        As its maker describes it.
    points
        (M, 3) where its corners really are, millimetres.
    """
    pattern, first = plate.pattern, plate.indices.min(axis=0)
    columns, rows = (int(n) for n in np.ptp(plate.indices, axis=0) + 1)
    away = np.zeros((rows + 2, columns + 2, 3))
    nominal = plate.indices - first + 1
    pitch = np.array(
        [float(np.ptp(points[:, k]) / np.ptp(plate.indices[:, k])) for k in range(2)], dtype=np.float64
    )
    stated = np.column_stack([plate.indices * pitch, np.zeros(len(points))])
    away[nominal[:, 1], nominal[:, 0]] = points - stated
    # The board's outer edges go on as the corners beside them.
    away[0], away[-1] = away[1], away[-2]
    away[:, 0], away[:, -1] = away[:, 1], away[:, -2]
    rim = 0.5
    grid = np.array([first[0] - 1.0, first[1] - 1.0, *pitch, rim, (1.0 - pattern.marker_share) / 2.0])
    return away, _bits(pattern, columns, rows), grid


def _bits(pattern: Pattern, columns: int, rows: int) -> Index:
    j, i = np.mgrid[: rows + 1, : columns + 1]
    if pattern.kind is PatternKind.CHESSBOARD:
        dark = ((i + j) % 2 == 0) == pattern.first_dark
        return np.where(dark, -2, -1)[..., None].astype(np.int64)
    board = charuco_board(pattern, columns, rows)
    dictionary = board.getDictionary()
    cells = int(dictionary.markerSize) + 2 * _BORDER_BITS
    bits = np.full((rows + 1, columns + 1, cells * cells), -1, dtype=np.int64)
    bits[..., 0] = -2
    for number, corners in zip(np.asarray(board.getIds()).ravel(), board.getObjPoints(), strict=True):
        # The board's own y axis points down from its top.
        x, y = np.asarray(corners)[:, :2].mean(axis=0)
        marker = cv2.aruco.generateImageMarker(dictionary, int(number), cells, borderBits=_BORDER_BITS)
        bits[rows - int(y), int(x)] = (np.asarray(marker) > 0).ravel()
    return bits
