"""The whole way from pixels to clean line points, compiled, all images of a shot at once on all cores."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from alignment.imaging import chains, ridges
from alignment.imaging.crosses import find_crosses
from alignment.imaging.ridges import LEVEL, STRENGTH, WIDTH2, X, Y
from alignment.kernels import njit, prange

Array = NDArray[np.float64]
Index = NDArray[np.int64]

#: Columns of the point table: place, unit tangent, deviation across the line, strength.
POINT_X, POINT_Y, TANGENT_X, TANGENT_Y, SIGMA, POINT_STRENGTH = range(6)
POINT_COLUMNS = 6
#: Columns of the cross table: place, steep line, flat line, slope dx/dy of the steep and dy/dx of the flat.
CROSS_COLUMNS = 6
#: Entries of the counts: points, lines, steep lines, crosses, width in 1/1000 px (0: no lines).
POINTS, LINES, STEEP_LINES, CROSSES, MILLIWIDTH = range(5)

MAX_POINTS, MAX_LINES, MAX_CROSSES = 1 << 16, 1 << 12, 1 << 12

_PROBE_SIGMA = 1.5
_PROBE_STEP = 32
_COARSE = 8  # rows between scanned rows where a direction cannot be matched
_STEEPEST = 1.05  # slope to the scan direction; steeper points belong to the other scan
_GATE = 1.5  # pixels from a chain's prediction; a crossing line pulls its points aside by about one
_FILTER = 1.4  # of the line's deviation: near the optimum for shot noise, and good for read noise
_DISTURBED = 4.0  # line widths within which another line disturbs a centre
_SECOND_DIFFERENCE = math.sqrt(6.0)  # standard deviation of a − 2b + c for unit noise
_QUANTISATION = math.sqrt(1.0 / 12.0)
_MEAN_OF_MODULUS = math.sqrt(2.0 / math.pi)
_UNKNOWN_SIGMA = 0.1  # pixels, where there are too few points to tell
_LEAST_SIGMA = 0.005
_HISTOGRAM = 4096
_CLASSES = 8


@njit(cache=True, nogil=True, error_model="numpy")
def _share(counts: Index, share: float) -> float:
    """Value below which `share` of a histogram of integers lies."""
    limit = share * counts.sum()
    total = 0.0
    for value in range(counts.size):
        total += counts[value]
        if total >= limit:
            return float(value)
    return float(counts.size - 1)


@njit(cache=True, nogil=True, error_model="numpy")
def contrast_of(image: Any, bits: int) -> float:
    """Least height over both flanks, grey levels, that a ridge must have to be a candidate.

    Above the noise of the dark part (its second differences), and a few per cent of the light's swing.
    """
    height, width = image.shape
    shift = max(0, bits - 12)
    noise = np.zeros(4 * _HISTOGRAM, np.int64)
    levels = np.zeros(_HISTOGRAM, np.int64)
    for y in range(_PROBE_STEP // 4, height, _PROBE_STEP // 2):
        for x in range(1, width - 1, 3):
            a, b, c = np.int64(image[y, x - 1]), np.int64(image[y, x]), np.int64(image[y, x + 1])
            levels[b >> shift] += 1
            second = int(abs(a - 2 * b + c))
            noise[min(second, noise.size - 1)] += 1
    sigma = max(_share(noise, 0.5) / 0.6745 / _SECOND_DIFFERENCE, _QUANTISATION)
    swing = (_share(levels, 0.995) - _share(levels, 0.5)) * 2**shift
    return float(max(3.0, 5.0 * sigma, 0.03 * swing))


@njit(cache=True, nogil=True, error_model="numpy")
def line_width(image: Any, transposed: Any, contrast: float) -> float:
    """Standard deviation of the lines' cross profile, pixels, from some rows and columns; 0 without lines.

    A ridge that lies aslant shows too wide, so of each direction the narrow half counts.
    """
    weights = ridges.derivative_weights(_PROBE_SIGMA)
    narrowest = np.inf
    for direction in range(2):
        table, _ = ridges.scan_rows(transposed if direction else image, 3, weights, contrast, _PROBE_STEP)
        if table.shape[0] >= 8:
            shown = np.sort(table[:, WIDTH2])
            narrowest = min(narrowest, shown[int(0.4 * (shown.size - 1))])
    if narrowest == np.inf:
        return 0.0
    # A Gaussian line of deviation s shows WIDTH2 = (s² + p²)^1.5 / s under a probe of deviation p.
    s = _PROBE_SIGMA / math.sqrt(2.0)
    while s < 15.0 and (s * s + _PROBE_SIGMA**2) ** 1.5 / s < narrowest:
        s += 0.02
    return s


@njit(cache=True, nogil=True, error_model="numpy")
def _take(table: Array, rows: Index) -> Array:
    """Rows of a table; the loop is several times faster than compiled fancy indexing."""
    out = np.empty((rows.size, table.shape[1]))
    for i in range(rows.size):
        source, target = table[rows[i]], out[i]
        for k in range(table.shape[1]):
            target[k] = source[k]
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _trace(image: Any, width: float, contrast: float, step: int) -> tuple[Array, Index, Array]:
    """Chains of one scan direction: ridge table in chain order, first row of each, slopes."""
    weights = ridges.derivative_weights(min(max(_FILTER * width, 1.0), 9.0))
    table, rows = ridges.scan_rows(image, max(2, round(1.6 * width)), weights, contrast, step)
    shortest = max(12.0, 4.0 * width)
    gap = max(6.0, 3.0 * width)
    order, starts = ridges.link_rows(
        table, rows, step, _GATE, math.ceil(gap / step), max(4, int(shortest / step))
    )
    # A crossing line may hide the ridge for several widths.
    order, starts = ridges.join_chains(table, order, starts, 12.0 * width + 4.0 * step, _GATE)
    linked = _take(table, order)
    return linked, starts, chains.chain_slopes(linked, starts)


@njit(cache=True, nogil=True, error_model="numpy")
def _serves(table: Array, slope: Array, along_x: float, along_y: float, least: float) -> bool:
    """Tell whether a tenth of a direction's points cross the given direction (0, 0: any) steeply enough."""
    if along_x == 0.0 and along_y == 0.0:
        return True
    mine = good = 0
    for i in range(slope.size):
        if abs(slope[i]) <= _STEEPEST:
            mine += 1
            sine = abs(slope[i] * along_y - along_x) / math.sqrt(1.0 + slope[i] * slope[i])
            good += sine >= least
    return good > 0.1 * mine


@njit(cache=True, nogil=True, error_model="numpy")
def centre_deviation(table: Array, starts: Index, step: int) -> Array:
    """Standard deviation of each centre along its row, pixels.

    Second differences along the lines show the noise itself. The variance of a centre is
    (a + b·level)/strength², with read noise in a and shot noise in b: both come from the means of a few
    classes of brightness, with outliers cut off.
    """
    n = table.shape[0]
    out = np.full(n, _UNKNOWN_SIGMA)
    residual = np.full(n, np.nan)
    lo, hi, count = np.inf, -np.inf, 0
    for c in range(starts.size - 1):
        for i in range(starts[c] + 1, starts[c + 1] - 1):
            if table[i + 1, Y] - table[i - 1, Y] == 2.0 * step:
                second = table[i + 1, X] - 2.0 * table[i, X] + table[i - 1, X]
                residual[i] = abs(second) / _SECOND_DIFFERENCE * table[i, STRENGTH]
                lo, hi = min(lo, table[i, LEVEL]), max(hi, table[i, LEVEL])
                count += 1
    if count < 64:
        return out
    # Two passes: the mean modulus of each class, then again without what exceeds four times it.
    limit = np.full(_CLASSES, np.inf)
    number = np.zeros(_CLASSES)
    modulus = np.zeros(_CLASSES)
    level = np.zeros(_CLASSES)
    for _ in range(2):
        number[:] = 0.0
        modulus[:] = 0.0
        level[:] = 0.0
        for i in range(n):
            if residual[i] == residual[i]:
                k = min(_CLASSES - 1, int(_CLASSES * (table[i, LEVEL] - lo) / max(hi - lo, 1e-9)))
                if residual[i] < limit[k]:
                    number[k] += 1.0
                    modulus[k] += residual[i]
                    level[k] += table[i, LEVEL]
        for k in range(_CLASSES):
            limit[k] = 4.0 * modulus[k] / max(number[k], 1.0) + 1e-12
    # Weighted line through the classes' variances; neither noise source is negative.
    total = sx = sy = 0.0
    for k in range(_CLASSES):
        if number[k] > 0.0:
            level[k] /= number[k]
            modulus[k] = (modulus[k] / number[k] / _MEAN_OF_MODULUS) ** 2
            total += number[k]
            sx += number[k] * level[k]
            sy += number[k] * modulus[k]
    mean_level, mean_variance = sx / total, sy / total
    sxx = sxy = 0.0
    for k in range(_CLASSES):
        sxx += number[k] * (level[k] - mean_level) ** 2
        sxy += number[k] * (level[k] - mean_level) * modulus[k]
    b = sxy / sxx if sxx > 1e-9 else 0.0
    b = min(max(b, 0.0), mean_variance / max(mean_level, 1e-9))
    a = mean_variance - b * mean_level
    for i in range(n):
        variance = max(a + b * table[i, LEVEL], 0.0)
        out[i] = max(math.sqrt(variance) / max(table[i, STRENGTH], 1e-9), _LEAST_SIGMA)
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _clean(
    table: Array,
    starts: Index,
    slope: Array,
    step: int,
    other: Array,
    other_starts: Index,
    other_slope: Array,
    shape: tuple[int, int],
    width: float,
    flat: bool,
    points: Array,
    offset: int,
    line_starts: Index,
    line: int,
) -> int:
    """Write one direction's undisturbed points behind `offset` and its lines behind `line`.

    All chains stay, if empty, so that their numbers do not change. Returns the new number of points.
    """
    radius = _DISTURBED * width
    shadow = chains.shadow(other, other_starts, other_slope, _STEEPEST, radius, (shape[1], shape[0]))
    keep = chains.undisturbed(table, slope, _STEEPEST, shadow, 2.0 * radius)
    kept = _take(table, np.flatnonzero(keep))
    kept_starts = np.zeros_like(starts)
    for c in range(starts.size - 1):
        count = 0
        for i in range(starts[c], starts[c + 1]):
            count += keep[i]
        kept_starts[c + 1] = kept_starts[c] + count
    lean = chains.chain_slopes(kept, kept_starts)
    chains.take_off_light_shift(kept, kept_starts, lean, width)
    sigma = centre_deviation(kept, kept_starts, step)
    room = points.shape[0] - offset
    count = min(kept.shape[0], room)
    first, second = (1, 0) if flat else (0, 1)
    for i in range(count):
        along = math.sqrt(1.0 + lean[i] * lean[i])
        row = points[offset + i]
        row[first] = kept[i, X]
        row[second] = kept[i, Y]
        row[2 + first] = lean[i] / along
        row[2 + second] = 1.0 / along
        row[SIGMA] = sigma[i] / along
        row[POINT_STRENGTH] = kept[i, STRENGTH]
    for c in range(starts.size - 1):
        line_starts[line + c + 1] = offset + min(kept_starts[c + 1], room)
    return int(offset + count)


@njit(cache=True, nogil=True, error_model="numpy")
def _extract(
    image: Any,
    transposed: Any,
    bits: int,
    along: Array,
    least_sine: float,
    points: Array,
    line_starts: Index,
    crosses: Array,
    counts: Index,
) -> None:
    """Lines of one image, into the given tables."""
    counts[:] = 0
    line_starts[0] = 0
    contrast = contrast_of(image, bits)
    width = line_width(image, transposed, contrast)
    if width == 0.0:
        return
    # A first look at every eighth row tells which direction is worth every row.
    steep, steep_starts, steep_slope = _trace(image, width, contrast, _COARSE)
    flat, flat_starts, flat_slope = _trace(transposed, width, contrast, _COARSE)
    steep_step = flat_step = _COARSE
    if _serves(steep, steep_slope, along[0], along[1], least_sine):
        steep, steep_starts, steep_slope = _trace(image, width, contrast, 1)
        steep_step = 1
    if _serves(flat, flat_slope, along[1], along[0], least_sine):
        flat, flat_starts, flat_slope = _trace(transposed, width, contrast, 1)
        flat_step = 1
    shape = (image.shape[0], image.shape[1])
    steep_lines, flat_lines = steep_starts.size - 1, flat_starts.size - 1
    if steep_lines + flat_lines + 1 > line_starts.size:
        return
    n = _clean(
        steep, steep_starts, steep_slope, steep_step, flat, flat_starts, flat_slope,
        shape, width, False, points, 0, line_starts, 0,
    )  # fmt: skip
    n = _clean(
        flat, flat_starts, flat_slope, flat_step, steep, steep_starts, steep_slope,
        (shape[1], shape[0]), width, True, points, n, line_starts, steep_lines,
    )  # fmt: skip
    counts[POINTS] = n
    counts[LINES] = steep_lines + flat_lines
    counts[STEEP_LINES] = steep_lines
    counts[CROSSES] = find_crosses(steep, steep_starts, flat, flat_starts, width, crosses)
    counts[MILLIWIDTH] = round(1000.0 * width)


@njit(cache=True, nogil=True, parallel=True, error_model="numpy")
def extract_all(
    images: Any,
    transposed: Any,
    bits: int,
    along: Array,
    least_sine: float,
    points: Array,
    line_starts: Index,
    crosses: Array,
    counts: Index,
) -> None:
    """Lines of several images, one a core.

    Parameters
    ----------
    images, transposed
        Typed lists of n images, one type, and of their transposes.
    bits
        8 or 16.
    along
        (n, 2) direction, in each image, of the epipolar lines; (0, 0) where unknown. Lines nearly parallel
        to it cannot be matched and are scanned coarsely: they still show what they disturb, and crosses.
    least_sine
        Of the angle between a line and the epipolar lines for a line to be worth every row.
    points, line_starts, crosses, counts
        Work space and result, one layer an image; see the column names of this module.
    """
    for index in prange(len(images)):
        k = np.int64(index)
        _extract(
            images[k], transposed[k], bits, along[k], least_sine,
            points[k], line_starts[k], crosses[k], counts[k],
        )  # fmt: skip
