"""A projector that draws a grid of crossing lines, as a point of light behind a mask.

The mask lets light through where a line of either family is open, so crosses are not brighter than lines.
The edges of a line are blurred by the lens, more so out of focus; the blur of two crossing families
separates, so the formula is exact. Left out: distortion of the projector's lens, and the size of its pupil
for shadows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from alignment.arrays import Array
from alignment.errors import DegenerateInputError
from alignment.geometry import RigidTransform
from sensors.simulation.surface import kernel, part

_REACH = 3.7  # standard deviations beyond which a blurred edge is over: 1e-4 of the light
_ROOT_HALF = math.sqrt(0.5)
_ERF_END, _ERF_PIECES = 6.0, 256
_BORDER_SHARE = 0.4  # of a pitch: how far the lines run on beyond the last crossing


@dataclass(frozen=True)
class LinePattern:
    """Two families of parallel lines, as they fall on a plane at the projector's reference distance.

    Attributes
    ----------
    columns, rows
        How many lines cross the projector's x axis, and its y axis.
    column_pitch_mm, row_pitch_mm
        Their spacing.
    width_mm
        Width of the open bar.
    edge_mm
        Standard deviation of the blur at focus: well below the width gives a bar with soft edges, above it a
        Gaussian.
    missing_columns, missing_rows
        Lines that are dark, by index.
    """

    columns: int = 13
    rows: int = 9
    column_pitch_mm: float = 15.0
    row_pitch_mm: float = 17.0
    width_mm: float = 0.7
    edge_mm: float = 0.3
    missing_columns: tuple[int, ...] = ()
    missing_rows: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        reach = self.width_mm / 2 + _REACH * self.edge_mm
        if min(self.columns, self.rows) < 1 or not 0 < reach < min(self.column_pitch_mm, self.row_pitch_mm):
            raise DegenerateInputError(
                field="pattern",
                expected="at least one line each way, and lines that do not run together",
                seen=f"{self.columns} × {self.rows} lines that reach {reach:.2f} mm",
            )


@dataclass(frozen=True, eq=False)
class Projector:
    """A posed projector; its frame is a camera's: x along the rows, y down the columns, z into the scene.

    Attributes
    ----------
    rig_from_projector
        Its pose.
    pattern
        What it draws.
    distance_mm
        Reference distance, at which the pattern has its stated size and `level` holds.
    level
        Irradiance in the middle of the pattern there: a white surface facing the projector then fills the
        sensor's range `level` times at the reference exposure.
    falloff
        Share of the light lost at the edge midpoints of the pattern; grows with the square of the distance
        from its centre.
    focus_mm, aperture_mm
        Distance of sharpest lines and diameter of the pupil, for the blur elsewhere.
    """

    rig_from_projector: RigidTransform
    pattern: LinePattern = field(default_factory=LinePattern)
    distance_mm: float = 400.0
    level: float = 8.0
    falloff: float = 0.3
    focus_mm: float = 405.0
    aperture_mm: float = 6.0

    def packed(self, tyre_from_rig: RigidTransform) -> tuple[Array, Array]:
        """Vector (`PACKED`,) and brightness of the lines (2, n) that the compiled kernels read."""
        p, d = self.pattern, self.distance_mm
        tyre_from_projector = tyre_from_rig @ self.rig_from_projector
        half = (p.columns - 1) / 2 * p.column_pitch_mm, (p.rows - 1) / 2 * p.row_pitch_mm
        border = [
            (h + _BORDER_SHARE * q) / d
            for h, q in zip(half, (p.column_pitch_mm, p.row_pitch_mm), strict=True)
        ]
        vector = np.concatenate(
            [
                tyre_from_projector.translation,
                tyre_from_projector.rotation.T.ravel(),
                [-half[0] / d, p.column_pitch_mm / d, p.columns, -half[1] / d, p.row_pitch_mm / d, p.rows],
                [p.width_mm / d / 2, p.edge_mm / d, self.aperture_mm / 4, 1 / self.focus_mm],
                [*border, self.falloff / min(border) ** 2, self.level * d * d],
            ]
        )
        lines = np.ones((2, max(p.columns, p.rows)))
        lines[0, list(p.missing_columns)] = 0.0
        lines[1, list(p.missing_rows)] = 0.0
        return vector, lines


PACKED = 26


# The kernels below read row k of all packed projectors: a view of the row would cost reference counting.


@part
def mask_place(x: float, y: float, z: float, k: int, p: Array) -> tuple[float, float, float]:
    """Slopes a, b and depth of a point (tyre frame) as projector k sees it; depth 0 is behind it."""
    dx, dy, dz = x - p[k, 0], y - p[k, 1], z - p[k, 2]
    w = p[k, 9] * dx + p[k, 10] * dy + p[k, 11] * dz
    if w <= 1.0:
        return 0.0, 0.0, 0.0
    inverse = 1.0 / w
    a = (p[k, 3] * dx + p[k, 4] * dy + p[k, 5] * dz) * inverse
    b = (p[k, 6] * dx + p[k, 7] * dy + p[k, 8] * dz) * inverse
    return a, b, w


@part
def blur_at(depth: float, k: int, p: Array) -> float:
    """Standard deviation of the lines' blur at a depth, as a slope."""
    defocus = p[k, 20] * (1.0 / depth - p[k, 21])
    return math.sqrt(p[k, 19] * p[k, 19] + defocus * defocus)


def _erf_pieces() -> Array:
    """Cubics (pieces, 4) in 0..1 that follow erf(x / √2) from 0 to `_ERF_END` within 1e-9."""
    x = np.linspace(0.0, _ERF_END, _ERF_PIECES + 1)
    step = _ERF_END / _ERF_PIECES
    value = np.array([math.erf(s * _ROOT_HALF) for s in x])
    slope = step * math.sqrt(2.0 / math.pi) * np.exp(-0.5 * x * x)
    rise = np.diff(value)
    return np.column_stack(
        [value[:-1], slope[:-1], 3 * rise - 2 * slope[:-1] - slope[1:], slope[:-1] + slope[1:] - 2 * rise]
    )


_ERF = _erf_pieces()


@part
def _erf(x: float) -> float:
    """erf(x / √2)."""
    u = abs(x) * (_ERF_PIECES / _ERF_END)
    if u >= _ERF_PIECES:
        return math.copysign(1.0, x)
    i = int(u)
    f = u - i
    return math.copysign(_ERF[i, 0] + f * (_ERF[i, 1] + f * (_ERF[i, 2] + f * _ERF[i, 3])), x)


@part
def _family(
    a: float, first: float, pitch: float, count: float, half: float, sigma: float,
    k: int, family: int, lines: Array,
) -> float:  # fmt: skip
    """Transmission 0..1 of one family of lines at slope a."""
    low = math.floor((a - first) / pitch)
    total = 0.0
    for i in range(max(low, 0), min(low + 2, int(count))):
        d = a - first - i * pitch
        if abs(d) < half + _REACH * sigma:
            s = 1.0 / sigma
            total += lines[k, family, i] * 0.5 * (_erf((d + half) * s) - _erf((d - half) * s))
    return total


@part
def _border(a: float, limit: float, sigma: float) -> float:
    """Transmission of the pattern's outer edge."""
    room = limit - abs(a)
    if room > _REACH * sigma:
        return 1.0
    if room < -_REACH * sigma:
        return 0.0
    return 0.5 * (1.0 + _erf(room / sigma))


@part
def irradiance(x: float, y: float, z: float, k: int, p: Array, lines: Array) -> float:
    """Irradiance by projector k on a surface at (x, y, z), tyre frame, that faces it."""
    a, b, depth = mask_place(x, y, z, k, p)
    if depth == 0.0:
        return 0.0
    sigma = blur_at(depth, k, p)
    inside = _border(a, p[k, 22], sigma) * _border(b, p[k, 23], sigma)
    if inside == 0.0:
        return 0.0
    columns = _family(a, p[k, 12], p[k, 13], p[k, 14], p[k, 18], sigma, k, 0, lines)
    rows = _family(b, p[k, 15], p[k, 16], p[k, 17], p[k, 18], sigma, k, 1, lines)
    light = columns + rows - columns * rows
    rho = a * a + b * b
    fall = 1.0 - p[k, 24] * rho
    if light == 0.0 or fall <= 0.0:
        return 0.0
    value: float = light * inside * fall * p[k, 25] / (depth * depth * (1.0 + rho))
    return value


@kernel
def _touches(low: float, high: float, first: float, pitch: float, count: float, reach: float) -> bool:
    k = max(math.ceil((low - reach - first) / pitch), 0.0)
    return k < count and first + k * pitch <= high + reach


@kernel
def may_light(points: Array, margin: float, k: int, p: Array) -> bool:
    """Tell whether light of projector k can fall between points (N, 3), tyre frame.

    `margin` widens the lines, as a slope. Never false where there is light.
    """
    a_low, a_high, b_low, b_high, nearest, farthest = 1e9, -1e9, 1e9, -1e9, 1e9, 1.0
    for i in range(points.shape[0]):
        a, b, depth = mask_place(points[i, 0], points[i, 1], points[i, 2], k, p)
        if depth == 0.0:
            return True
        a_low, a_high = min(a_low, a), max(a_high, a)
        b_low, b_high = min(b_low, b), max(b_high, b)
        nearest, farthest = min(nearest, depth), max(farthest, depth)
    blur = _REACH * max(blur_at(nearest, k, p), blur_at(farthest, k, p)) + margin
    right, bottom = p[k, 22] + blur, p[k, 23] + blur
    if a_low > right or a_high < -right or b_low > bottom or b_high < -bottom:
        return False
    reach = p[k, 18] + blur
    return _touches(a_low, a_high, p[k, 12], p[k, 13], p[k, 14], reach) or _touches(
        b_low, b_high, p[k, 15], p[k, 16], p[k, 17], reach
    )
