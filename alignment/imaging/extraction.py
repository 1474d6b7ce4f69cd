"""The whole way from pixels to clean line points, compiled, all images of a shot at once on all cores."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from alignment.arrays import Array, Index
from alignment.imaging import chains, ridges
from alignment.imaging.centre_noise import SECOND_DIFFERENCE, centre_deviation
from alignment.imaging.crosses import find_crosses
from alignment.imaging.ridges import STRENGTH, WIDTH2, X, Y, row_of
from alignment.imaging.tracing import follow
from alignment.kernels import njit, prange

#: Rows of the noise table: deviation across the line, strength.
SIGMA, POINT_STRENGTH = range(2)
#: Columns of the cross table: place, steep line, flat line, slope dx/dy of the steep and dy/dx of the flat.
CROSS_COLUMNS = 6
#: Entries of the counts: points, lines, steep lines, crosses, width in 1/1000 px (0: no lines), points before
#: they were thinned, whether there was more than can be thinned; and, in millionths, what the search went by:
#: the least contrast, and the spreads of steep and of flat lines.
POINTS, LINES, STEEP_LINES, CROSSES, MILLIWIDTH, FOUND, CROWDED = range(7)
CONTRAST, STEEP_SPREAD, FLAT_SPREAD = range(7, 10)
COUNT_ENTRIES = 10

#: More points and crosses are thinned evenly; more lines are none of a projector's.
MAX_POINTS, MAX_LINES, MAX_CROSSES = 1 << 16, 1 << 12, 1 << 12
LEAST_SHARE = 0.25
"""Of the points of an image that are kept; with fewer the lines would come apart."""

_PROBE_SIGMA = 1.5
_PROBE_STEP = 32
_ENOUGH_PER_PROBE = 2.2  # line's deviation over the probe's: a wider one needs a larger probe
_LARGEST_PER_PROBE = 4.0  # and the most that a probe tells
_NARROW = 0.35  # quantile of the widths that the lines of a direction show
_WIDEST = 8.0  # pixels; the largest probe
_SPACING_PER_STEP = 10.0  # distance of lines over that of scanned rows: none is mistaken for the next
_STEP_PER_WIDTH = 2.7  # distance of scanned rows over a line's width: no end of it is overlooked
_MOST_STEP = 8
_STEEPEST = 1.05  # slope to the scan direction; steeper points belong to the other scan
_GATE = 1.5  # pixels from a chain's prediction; a crossing line pulls its points aside by about one
_FILTER = 1.1  # of the lines' spread: little noise, and little of the relief beside a point
_DISTURBED = 3.6  # line widths within which another line disturbs a centre
_QUANTISATION = math.sqrt(1.0 / 12.0)
_CROSS_POINTS = 3.5  # looked at points on either side of a cross that tell where a line runs
_HISTOGRAM = 4096
_MOST_CHAINS = 1 << 14  # pieces of lines; each is compared with each


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
def contrast_of(image: Any, view: Index, bits: int) -> float:
    """Least height over both flanks, grey levels, that a ridge in a part must have to be a candidate.

    Above the noise of the dark part (its second differences), and a few per cent of the light's swing.
    """
    width, height = view[2] - view[0], view[3] - view[1]
    shift = max(0, bits - 12)
    grey_levels = min(2**bits, _HISTOGRAM)
    noise = np.zeros(4 * grey_levels, np.int64)
    levels = np.zeros(grey_levels, np.int64)
    for y in range(_PROBE_STEP // 4, height, _PROBE_STEP // 2):
        row = row_of(image, view, y)
        for x in range(1, width - 1, 3):
            a, b, c = np.int64(row[x - 1]), np.int64(row[x]), np.int64(row[x + 1])
            levels[b >> shift] += 1
            second = int(abs(a - 2 * b + c))
            noise[min(second, noise.size - 1)] += 1
    sigma = max(_share(noise, 0.5) / 0.6745 / SECOND_DIFFERENCE, _QUANTISATION)
    swing = (_share(levels, 0.995) - _share(levels, 0.5)) * 2**shift
    return float(max(3.0, 5.0 * sigma, 0.03 * swing))


@njit(cache=True, nogil=True, error_model="numpy")
def _shown_width(s: float, probe: float, box: int) -> float:
    """WIDTH2 that a Gaussian line of deviation s shows under a probe.

    Four pixels make the top, and the flanks of a wide line are still lit.
    """
    top = 0.5 * (math.exp(-0.125 / (s * s)) + math.exp(-1.125 / (s * s)))
    return float((s * s + probe * probe) ** 1.5 / s * (top - math.exp(-2.0 * box * box / (s * s))))


@njit(cache=True, nogil=True, error_model="numpy")
def line_width(image: Any, view: Index, contrast: float, step: int) -> tuple[float, float]:
    """Spread along the rows of the lines' profile, its standard deviation, and how close lines stand, pixels.

    From every `step`-th row; 0 without lines. Lines of the other direction lie aslant to the rows and show
    too wide, so the narrow part counts. Only a quarter of the neighbours stand closer than the stated
    distance. A probe too small for the line says little of it, so a wide line is looked at again with a
    larger one.
    """
    probe = _PROBE_SIGMA
    while True:
        weights, box = ridges.derivative_weights(probe), round(2.0 * probe)
        table, rows = ridges.scan_rows(image, view, box, weights, contrast, step)
        if table.shape[0] < 8:
            return 0.0, np.inf
        shown = np.sort(table[:, WIDTH2])[int(_NARROW * (table.shape[0] - 1))]
        s = probe / math.sqrt(2.0)  # no line shows less
        while s < _LARGEST_PER_PROBE * probe and _shown_width(s, probe, box) < shown:
            s += 0.02
        if s < _ENOUGH_PER_PROBE * probe or probe > _WIDEST:
            break
        probe = min(0.7 * s, 2.0 * probe)
    gaps = np.empty(table.shape[0])
    n = 0
    for j in range(rows.size - 1):
        for i in range(rows[j] + 1, rows[j + 1]):
            gaps[n] = table[i, X] - table[i - 1, X]
            n += 1
    return s, np.sort(gaps[:n])[n // 4] if n >= 8 else np.inf


@njit(cache=True, nogil=True, error_model="numpy")
def _across(spread: float, slope: Array) -> float:
    """Standard deviation across lines whose spread along the rows and slopes are given."""
    some = np.abs(slope[:: max(1, slope.size // 400)])
    some = some[some <= _STEEPEST]
    return spread / math.sqrt(1.0 + np.median(some) ** 2) if some.size > 0 else spread


@njit(cache=True, nogil=True, error_model="numpy")
def probe_of(width: float) -> tuple[float, int]:
    """Deviation of the filter that locates lines of a spread, half the distance of their flanks; pixels."""
    return min(max(_FILTER * width, 1.0), 9.0), max(2, round(1.25 * width))


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
def _scan_step(width: float, spacing: float, along_x: float, along_y: float) -> int:
    """Distance of the rows that show the lines' course at first."""
    step = int(max(min(spacing / _SPACING_PER_STEP, _STEP_PER_WIDTH * width, _MOST_STEP), 1.0))
    return 2 * step if abs(along_x) < abs(along_y) else step  # along the epipolar lines hardly worth more


@njit(cache=True, nogil=True, error_model="numpy")
def _reach(width: float, step: int, spacing: float, clear: float) -> float:
    """How far from a cross its lines are fitted, pixels: some looked at points, none near the next cross."""
    least = 8.0 * width + 8.0
    return max(least, min(_CROSS_POINTS * step, spacing - clear))


@njit(cache=True, nogil=True, error_model="numpy")
def _trace(
    image: Any,
    view: Index,
    flat: bool,
    width: float,
    spacing: float,
    contrast: float,
    along_x: float,
    along_y: float,
    least: float,
) -> tuple[Array, Index, Array, bool]:
    """Chains of one scan direction, rows or columns.

    Ridge table in chain order, first row of each, slopes, and whether they are worth every row.

    Some rows show the lines' course; along those that are worth it every row is looked at.
    """
    probe, box = probe_of(width)
    one: Any = np.int64(1)  # a literal would make a function of its own
    weights = ridges.derivative_weights(probe)
    step = _scan_step(width, spacing, along_x, along_y)
    if flat:
        some = ridges.columns_of(image, view, step)
        table, rows = ridges.scan_rows(some, ridges.whole(some), box, weights, contrast, one)
        for i in range(table.shape[0]):
            table[i, Y] *= step
    else:
        table, rows = ridges.scan_rows(image, view, box, weights, contrast, step)
    shortest = max(12.0, 3.4 * width)
    gap = max(6.0, 2.5 * width)
    order, starts = ridges.link_rows(
        table, rows, step, _GATE, math.ceil(gap / step), max(4, int(shortest / step))
    )
    if starts.size > _MOST_CHAINS:
        linked = _take(table, order)
        return linked, starts, chains.chain_slopes(linked, starts), False
    # A crossing line may hide the ridge for several widths.
    order, starts = ridges.join_chains(table, order, starts, 10.0 * width + 4.0 * step, _GATE)
    linked = _take(table, order)
    slope = chains.chain_slopes(linked, starts)
    if not _serves(linked, slope, along_x, along_y, least):
        return linked, starts, slope, False
    if flat:
        every = ridges.columns_of(image, view, one)
        linked, starts = follow(every, ridges.whole(every), box, weights, contrast, step, linked, starts)
    else:
        linked, starts = follow(image, view, box, weights, contrast, step, linked, starts)
    return linked, starts, chains.chain_slopes(linked, starts), True


@njit(cache=True, nogil=True, error_model="numpy")
def _clean(
    table: Array,
    starts: Index,
    slope: Array,
    other: Array,
    other_starts: Index,
    other_slope: Array,
    shape: tuple[int, int],
    other_width: float,
    serves: bool,
) -> tuple[Array, Index]:
    """One direction's undisturbed points, and the first of each chain; no points where it does not serve.

    All chains stay, if empty, so that their numbers do not change.
    """
    kept_starts = np.zeros_like(starts)
    if not serves:
        return np.empty((0, table.shape[1])), kept_starts
    radius = _DISTURBED * other_width
    shadow = chains.shadow(other, other_starts, other_slope, _STEEPEST, radius, (shape[1], shape[0]))
    keep = chains.undisturbed(table, slope, _STEEPEST, shadow, shape, 2.0 * radius)
    for c in range(starts.size - 1):
        count = 0
        for i in range(starts[c], starts[c + 1]):
            count += keep[i]
        kept_starts[c + 1] = kept_starts[c] + count
    return _take(table, np.flatnonzero(keep)), kept_starts


@njit(cache=True, nogil=True, error_model="numpy")
def write_lines(
    kept: Array,
    starts: Index,
    flat: bool,
    points: Array,
    tangents: Array,
    noise: Array,
    offset: int,
    line_starts: Index,
    line: int,
    corner: tuple[float, float],
    found: int,
) -> int:
    """Write one direction's points behind `offset` and its lines behind `line`.

    Of the `found` points of both directions as many are taken as there is room for, evenly along all lines.
    Points count in the image, whose part starts at `corner`; chains in the part. Returns the new number of
    points.
    """
    lean = chains.chain_slopes(kept, starts)
    sigma = centre_deviation(kept, starts)
    room = min(points.shape[0], found)
    first, second = (1, 0) if flat else (0, 1)
    k, due = offset, 0
    for c in range(starts.size - 1):
        for i in range(starts[c], starts[c + 1]):
            due += room
            if due < found:
                continue
            due -= found
            along = math.sqrt(1.0 + lean[i] * lean[i])
            points[k, first] = kept[i, X] + corner[first]
            points[k, second] = kept[i, Y] + corner[second]
            tangents[k, first] = lean[i] / along
            tangents[k, second] = 1.0 / along
            noise[SIGMA, k] = sigma[i] / along
            noise[POINT_STRENGTH, k] = kept[i, STRENGTH]
            k += 1
        line_starts[line + c + 1] = k
    return k


@njit(cache=True, nogil=True, error_model="numpy")
def _extract(
    image: Any,
    view: Index,
    bits: int,
    along: Array,
    least_sine: float,
    with_crosses: bool,
    points: Array,
    tangents: Array,
    noise: Array,
    line_starts: Index,
    crosses: Array,
    counts: Index,
) -> None:
    """Lines of one image, into the given tables."""
    counts[:] = 0
    line_starts[0] = 0
    contrast = contrast_of(image, view, bits)
    # Steps and flags as plain numbers: a literal would make a function of its own for each.
    every: Any = np.int64(1)
    none: Any = np.int64(0)
    step: Any = np.int64(_PROBE_STEP)
    no: Any = np.bool_(False)
    yes: Any = np.bool_(True)
    some = ridges.columns_of(image, view, step)
    steep_spread, steep_spacing = line_width(image, view, contrast, step)
    flat_spread, flat_spacing = line_width(some, ridges.whole(some), contrast, every)
    if steep_spread == 0.0 and flat_spread == 0.0:
        return
    # A direction without lines is searched as the other is.
    if steep_spread == 0.0:
        steep_spread = flat_spread
    if flat_spread == 0.0:
        flat_spread = steep_spread
    counts[CONTRAST] = round(1e6 * contrast)
    counts[STEEP_SPREAD], counts[FLAT_SPREAD] = round(1e6 * steep_spread), round(1e6 * flat_spread)
    steep, steep_starts, steep_slope, steep_serves = _trace(
        image, view, no, steep_spread, steep_spacing, contrast, along[0], along[1], least_sine
    )
    flat, flat_starts, flat_slope, flat_serves = _trace(
        image, view, yes, flat_spread, flat_spacing, contrast, along[1], along[0], least_sine
    )
    steep_width, flat_width = _across(steep_spread, steep_slope), _across(flat_spread, flat_slope)
    shape, corner = (view[3] - view[1], view[2] - view[0]), (float(view[0]), float(view[1]))
    steep_lines, flat_lines = steep_starts.size - 1, flat_starts.size - 1
    if steep_lines + flat_lines + 1 > line_starts.size:
        counts[CROWDED] = 1
        return
    clear_steep, clear_steep_starts = _clean(
        steep, steep_starts, steep_slope, flat, flat_starts, flat_slope, shape, flat_width, steep_serves
    )
    clear_flat, clear_flat_starts = _clean(
        flat, flat_starts, flat_slope, steep, steep_starts, steep_slope, (shape[1], shape[0]), steep_width,
        flat_serves,
    )  # fmt: skip
    found = clear_steep.shape[0] + clear_flat.shape[0]
    counts[FOUND] = found
    if points.shape[0] < LEAST_SHARE * found:
        counts[CROWDED] = 1
        return
    n = write_lines(
        clear_steep, clear_steep_starts, no, points, tangents, noise, none, line_starts, none, corner, found
    )
    n = write_lines(
        clear_flat,
        clear_flat_starts,
        yes,
        points,
        tangents,
        noise,
        n,
        line_starts,
        steep_lines,
        corner,
        found,
    )
    width = 0.5 * (steep_width + flat_width)
    if steep_serves != flat_serves:
        width = steep_width if steep_serves else flat_width
    counts[POINTS] = n
    counts[LINES] = steep_lines + flat_lines
    counts[STEEP_LINES] = steep_lines
    if with_crosses:
        clear = 2.5 * width
        steep_step = 1 if steep_serves else _scan_step(steep_spread, steep_spacing, along[0], along[1])
        flat_step = 1 if flat_serves else _scan_step(flat_spread, flat_spacing, along[1], along[0])
        counts[CROSSES] = find_crosses(
            steep, steep_starts, flat, flat_starts, clear,
            _reach(width, steep_step, flat_spacing, clear), _reach(width, flat_step, steep_spacing, clear),
            crosses,
        )  # fmt: skip
    counts[MILLIWIDTH] = round(1000.0 * width)


@njit(cache=True, nogil=True, error_model="numpy")
def level_share(image: Any, points: Array, top: int) -> float:
    """Share of the points (N, 2) whose pixel reaches the level `top`, or, for −1, the highest among them."""
    n = points.shape[0]
    levels = np.empty(n, np.int64)
    for i in range(n):
        levels[i] = image[round(points[i, 1]), round(points[i, 0])]
    if n == 0:
        return 0.0
    return float(np.sum(levels >= (levels.max() if top < 0 else top)) / n)


@njit(cache=True, nogil=True, parallel=True, error_model="numpy")
def extract_all(
    images: Any,
    views: Index,
    bits: int,
    along: Array,
    least_sine: float,
    with_crosses: bool,
    points: Array,
    tangents: Array,
    noise: Array,
    line_starts: Index,
    crosses: Array,
    counts: Index,
) -> None:
    """Lines of several images, one a core.

    Parameters
    ----------
    images
        Typed list of n contiguous images, one type.
    views
        (n, 4) part of each image; see `ridges.row_of`. Crosses count in the part, points in the image.
    bits
        8 or 16.
    along
        (n, 2) direction, in each image, of the epipolar lines; (0, 0) where unknown. Lines nearly parallel
        to it cannot be matched and are looked at in some rows only: they show crosses and what they disturb,
        and yield no points.
    least_sine
        Of the angle between a line and the epipolar lines for a line to be worth every row.
    with_crosses
        Whether crosses are wanted.
    points, tangents, noise, line_starts, crosses, counts
        Work space and result, one layer an image; see the column names of this module.
    """
    for index in prange(len(images)):
        k = np.int64(index)
        _extract(
            images[k], views[k], bits, along[k], least_sine, with_crosses,
            points[k], tangents[k], noise[k], line_starts[k], crosses[k], counts[k],
        )  # fmt: skip
