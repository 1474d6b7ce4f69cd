"""Compiled kernels that find bright ridges along the rows of an image and link them into chains.

A row kernel sees lines that run steeper than about 45° to the rows; the same kernels on the transposed image
see the others. Positions are sub-pixel: the zero of a derivative-of-Gaussian response, which does not feel a
constant background, and which a cubic through four responses locates without locking to the pixel grid.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from alignment.arrays import Array, Index, Mask, Singles
from alignment.kernels import njit

#: Columns of a table of ridge points; the width stands last, where it is known.
X, Y, STRENGTH, LEVEL, WIDTH2 = 0, 1, 2, 3, 4
COLUMNS = 5
_PER_ROW = 192  # ridges that a row has room for at first
_OPEN = 256  # chains that are open at once, at first
_BLOCK = 32
_TILE = 64
_PULLED = 6  # points at a chain's end that a crossing line may have pulled aside
_MEMORY = 16  # points over which a chain's direction is taken
_OVERLAP = 64.0  # pixels; ridges of a row stand in order but for those of two lively stretches


@njit(cache=True, nogil=True, error_model="numpy")
def derivative_weights(sigma: float) -> Singles:
    """Weights (M,) for 1 … M pixels to the right, M = ⌈3σ⌉, of a derivative-of-Gaussian correlation.

    The weights to the left are their negatives. The response to an image I(x) = a x is a: the unit is grey
    levels per pixel.
    """
    half = math.ceil(3.0 * sigma)
    weights = np.zeros(half)
    total = 0.0
    for k in range(1, half + 1):
        weights[k - 1] = k * math.exp(-0.5 * (k / sigma) ** 2)
        total += 2.0 * k * weights[k - 1]
    return (weights / total).astype(np.float32)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def zero_of_cubic(a: float, b: float, c: float, d: float) -> float:
    """Zero in [0, 1] of the cubic through (−1, a), (0, b), (1, c), (2, d), with b > 0 ≥ c."""
    t = b / (b - c)
    c3 = (d - a) / 6.0 + (b - c) / 2.0
    c2 = (a + c) / 2.0 - b
    c1 = c - b - c2 - c3
    # Without branches, for loops over many.
    for _ in range(2):
        f = b + t * (c1 + t * (c2 + t * c3))
        df = c1 + t * (2.0 * c2 + t * 3.0 * c3)
        t -= f / df if df < 0.0 else 0.0
    return min(max(t, 0.0), 1.0)


@njit(cache=True, nogil=True, error_model="numpy")
def _mark_lively(row: Any, contrast: float, lively: Mask) -> None:
    """Tell which blocks of a row swing by more than the contrast; noise alone does not."""
    width = row.size
    for block in range(lively.size):
        part = row[block * _BLOCK : min((block + 1) * _BLOCK, width)]
        low, high = part[0], part[0]
        for x in range(part.size):
            low = min(low, part[x])
            high = max(high, part[x])
        lively[block] = float(high) - float(low) >= contrast


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _respond(
    row: Any,
    lo: int,
    hi: int,
    pad: int,
    weights: Singles,
    grey: Singles,
    response: Singles,
) -> None:
    """Responses at lo … hi − 1 of a row, into `response`; the row from lo − pad on, into `grey`."""
    count = hi - lo
    source = row[lo - pad : hi + pad]
    for k in range(source.size):
        grey[k] = source[k]
    # Slices, because an index that might be negative keeps the compiler from using vector instructions.
    out = response[:count]
    out[:] = np.float32(0.0)
    # Two weights at a time: fewer ways to the memory and back.
    paired = weights.size - weights.size % 2
    for k in range(0, paired, 2):
        w, next_w = weights[k], weights[k + 1]
        ahead = grey[pad + k + 1 : pad + k + 1 + count]
        behind = grey[pad - k - 1 : pad - k - 1 + count]
        next_ahead = grey[pad + k + 2 : pad + k + 2 + count]
        next_behind = grey[pad - k - 2 : pad - k - 2 + count]
        for x in range(count):
            out[x] += w * (ahead[x] - behind[x]) + next_w * (next_ahead[x] - next_behind[x])
    for k in range(paired, weights.size):
        w = weights[k]
        ahead = grey[pad + k + 1 : pad + k + 1 + count]
        behind = grey[pad - k - 1 : pad - k - 1 + count]
        for x in range(count):
            out[x] += w * (ahead[x] - behind[x])


@njit(cache=True, nogil=True, error_model="numpy")
def row_of(image: Any, view: Index, y: int) -> Any:
    """Row of a part of an image, without a copy.

    Parameters
    ----------
    image
        (height, width), contiguous.
    view
        (4,) first column and row of the part, and those behind its last.
    y
        Row, counted in the part.
    """
    return image[view[1] + y][view[0] : view[2]]


@njit(cache=True, nogil=True, error_model="numpy")
def columns_of(image: Any, view: Index, step: int) -> Any:
    """Every `step`-th column of a part of an image as a row (columns, height) of another."""
    height, width, pitch = view[3] - view[1], view[2] - view[0], image.shape[1]
    out = np.empty(((width + step - 1) // step, height), image.dtype)
    pixels = image.ravel()
    # Few rows at a time, so that they stay in the nearest cache; down the columns, because writing to many
    # columns in turn hits the same few places of that cache where the height is a power of two.
    for top in range(0, height, _TILE):
        rows = min(_TILE, height - top)
        for j in range(out.shape[0]):
            first = (view[1] + top) * pitch + view[0] + j * step
            column = out[j][top : top + rows]
            for y in range(rows):
                column[y] = pixels[first + y * pitch]
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def whole(image: Any) -> Index:
    """View of a whole image."""
    return np.array([0, 0, image.shape[1], image.shape[0]])


@njit(cache=True, nogil=True, error_model="numpy")
def _stretch(lively: Mask, start: int) -> tuple[int, int]:
    """First block and block behind the last of the next lively stretch from `start` on; alike for none."""
    first = start
    while first < lively.size and not lively[first]:
        first += 1
    behind = first
    while behind < lively.size and lively[behind]:
        behind += 1
    return first, behind


@njit(cache=True, nogil=True, error_model="numpy")
def _levels(grey: Singles, flank: int) -> tuple[float, float, float]:
    """Grey level of a ridge in the middle of its neighbours, and of its left and its right flank."""
    top = grey[flank : flank + 4]
    left = (grey[0] + grey[1] + grey[2]) / 3.0
    right = (grey[2 * flank + 1] + grey[2 * flank + 2] + grey[2 * flank + 3]) / 3.0
    return 0.25 * (top[0] + top[1] + top[2] + top[3]), left, right


@njit(cache=True, nogil=True, error_model="numpy")
def _roomier(full: Any) -> Any:
    """Return the rows of a full table in one with room for twice as many."""
    out = np.empty((2 * full.shape[0], full.shape[1]), full.dtype)
    out[: full.shape[0]] = full
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def scan_rows(
    image: Any,
    view: Index,
    box: int,
    weights: Singles,
    contrast: float,
    step: int,
) -> tuple[Array, Index]:
    """Ridge points of every `step`-th row.

    Parameters
    ----------
    image, view
        As for `row_of`, 8 or 16 bit; coordinates count in the part.
    box
        Half the distance of the flanks from the ridge, pixels; about 1.6 times the line's sigma.
    weights
        Of `derivative_weights`.
    contrast
        Least height of a ridge over both flanks, grey levels.
    step
        Rows between scanned rows.

    Returns
    -------
    table
        (N, 5): x, y, strength (slope of the response, grey levels per pixel², the amplitude times a constant
        of the profile), level (grey level at the ridge), squared width of the profile (pixels²).
    starts
        (rows + 1,) first table row of each scanned image row.
    """
    width, height = view[2] - view[0], view[3] - view[1]
    half = weights.size
    flank = 2 * box
    pad = max(half, flank + 2)
    margin = pad + 1
    rows = (height + step - 1) // step
    starts = np.zeros(rows + 1, np.int64)
    table = np.empty((rows * _PER_ROW, COLUMNS))  # pages that stay unused cost nothing
    blocks = (width + _BLOCK - 1) // _BLOCK
    lively = np.zeros(blocks, np.bool_)
    grey = np.empty(width + 2 * pad, np.float32)
    response = np.empty(width, np.float32)
    n = 0
    for j in range(rows):
        y = j * step
        row = row_of(image, view, y)
        _mark_lively(row, contrast, lively)
        behind = 0
        while behind < blocks:
            first, behind = _stretch(lively, behind)
            # A ridge on the border of a lively stretch still needs its flanks.
            lo = max(margin, first * _BLOCK - box)
            hi = min(width - margin, behind * _BLOCK + box)
            if first == behind or hi - lo < 4:
                continue
            _respond(row, lo, hi, pad, weights, grey, response)
            for x in range(1, hi - lo - 2):
                b, c = response[x], response[x + 1]
                if not (b > 0.0 and c <= 0.0):
                    continue
                centre, left, right = _levels(grey[x + pad - flank - 1 : x + pad + flank + 3], flank)
                if centre - max(left, right) < contrast:
                    continue
                a, d = response[x - 1], response[x + 2]
                slope = float(b - c)
                if n == table.shape[0]:
                    table = _roomier(table)
                out = table[n]
                out[X] = lo + x + zero_of_cubic(float(a), float(b), float(c), float(d))
                out[Y] = y
                out[STRENGTH] = slope
                out[LEVEL] = centre
                # A Gaussian of height A has slope A/σ² at its top.
                out[WIDTH2] = (centre - min(left, right)) / slope
                n += 1
        starts[j + 1] = n
    return table[:n], starts


@njit(cache=True, nogil=True, error_model="numpy")
def _claim(
    table: Array,
    lo: int,
    hi: int,
    y: float,
    step: int,
    gate: float,
    c: int,
    tail: Index,
    slope: Array,
    length: Index,
    taken: Index,
) -> None:
    """Let chain c take the point of row y, table rows lo to hi − 1, that is nearest to its prediction.

    Of two chains that want one point the nearer wins; `taken` tells whose each point is.
    """
    last = tail[c]
    dy = y - table[last, Y]
    expected = table[last, X] + slope[c] * dy
    width = gate * (1.0 + 0.1 * (dy / step - 1.0))
    if length[c] < 4:
        width += step
    best, best_distance = -1, width
    first, behind = lo, hi
    while first < behind:
        middle = (first + behind) // 2
        if table[middle, X] < expected - width - _OVERLAP:
            first = middle + 1
        else:
            behind = middle
    for i in range(first, hi):
        if table[i, X] > expected + width + _OVERLAP:
            break
        distance = abs(table[i, X] - expected)
        if distance < best_distance:
            best, best_distance = i, distance
    if best < 0:
        return
    rival = taken[best - lo]
    if rival >= 0:
        other = tail[rival]
        rival_expected = table[other, X] + slope[rival] * (y - table[other, Y])
        if abs(table[best, X] - rival_expected) <= best_distance:
            return
    taken[best - lo] = c


@njit(cache=True, nogil=True, error_model="numpy")
def _longer(full: Any) -> Any:
    """Return the numbers of a full list in one with room for twice as many."""
    out = np.empty(2 * full.size, full.dtype)
    for i in range(full.size):
        out[i] = full[i]
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def link_rows(
    table: Array, starts: Index, step: int, gate: float, gap: int, shortest: int
) -> tuple[Index, Index]:
    """Link ridge points of successive rows into chains.

    Parameters
    ----------
    table, starts
        Of `scan_rows`.
    step
        Rows between scanned rows.
    gate
        Largest distance of a point from its chain's prediction, pixels.
    gap
        Scanned rows a chain may miss before it ends.
    shortest
        Fewer points do not make a chain.

    Returns
    -------
    order
        (M,) table rows, chain after chain, each from top to bottom.
    chain_starts
        (chains + 1,) first entry of each chain in `order`.
    """
    n = table.shape[0]
    rows = starts.size - 1
    follower = np.full(n, -1, np.int64)
    is_head = np.ones(n, np.bool_)
    tail = np.empty(_OPEN, np.int64)  # last point of each open chain
    anchor = np.empty(_OPEN, np.int64)  # a point some way back: the slope between both outlives a crossing
    slope = np.empty(_OPEN)
    length = np.empty(_OPEN, np.int64)
    open_chains = most = 0
    for j in range(rows):
        most = max(most, starts[j + 1] - starts[j])
    taken = np.empty(most, np.int64)
    for j in range(rows):
        lo, hi = starts[j], starts[j + 1]
        for i in range(hi - lo):
            taken[i] = -1
        for c in range(open_chains):
            _claim(table, lo, hi, float(j * step), step, gate, c, tail, slope, length, taken)
        # Points that a chain took extend it; the others open chains.
        for i in range(lo, hi):
            c = taken[i - lo]
            if c >= 0:
                last = tail[c]
                follower[last] = i
                is_head[i] = False
                tail[c] = i
                length[c] += 1
                if length[c] > _MEMORY:
                    anchor[c] = follower[anchor[c]]
                a = anchor[c]
                slope[c] = (table[i, X] - table[a, X]) / (table[i, Y] - table[a, Y])
        kept = 0
        for c in range(open_chains):
            if float(j * step) - table[tail[c], Y] <= gap * step:
                tail[kept], slope[kept], length[kept] = tail[c], slope[c], length[c]
                anchor[kept] = anchor[c]
                kept += 1
        open_chains = kept
        for i in range(lo, hi):
            if taken[i - lo] < 0:
                if open_chains == tail.size:
                    tail, anchor, slope, length = (
                        _longer(tail), _longer(anchor), _longer(slope), _longer(length),
                    )  # fmt: skip
                tail[open_chains] = anchor[open_chains] = i
                slope[open_chains] = 0.0
                length[open_chains] = 1
                open_chains += 1
    return _in_order(follower, is_head, shortest)


@njit(cache=True, nogil=True, error_model="numpy")
def _in_order(follower: Index, is_head: Mask, shortest: int) -> tuple[Index, Index]:
    """Order and starts of the chains, see `link_rows`, from the point that follows each one; −1 for none."""
    n = follower.size
    order = np.empty(n, np.int64)
    chain_starts = np.empty(n + 1, np.int64)
    chain_starts[0] = 0
    chains = 0
    m = 0
    for i in range(n):
        if not is_head[i]:
            continue
        first = m
        k = i
        while k >= 0:
            order[m] = k
            m += 1
            k = follower[k]
        if m - first < shortest:
            m = first
        else:
            chains += 1
            chain_starts[chains] = m
    return order[:m], chain_starts[: chains + 1]


@njit(cache=True, nogil=True, error_model="numpy")
def _end_line(table: Array, order: Index, first: int, last: int, head: bool) -> tuple[float, float]:
    """Straight line x = a + b (y − y_end) at one end of a chain, from points a little way in: a, b."""
    n = last - first
    inner = min(_PULLED, max(0, n // 2 - 2))
    outer = min(inner + _MEMORY, n)
    end = order[first] if head else order[last - 1]
    sy = sx = syy = sxy = 0.0
    for k in range(inner, outer):
        i = order[first + k] if head else order[last - 1 - k]
        dy = table[i, Y] - table[end, Y]
        sy += dy
        sx += table[i, X]
        syy += dy * dy
        sxy += dy * table[i, X]
    m = outer - inner
    det = m * syy - sy * sy
    if m < 2 or not det > 0.0:
        return table[end, X], 0.0
    b = (m * sxy - sy * sx) / det
    return (sx - b * sy) / m, b


@njit(cache=True, nogil=True, error_model="numpy")
def join_chains(table: Array, order: Index, starts: Index, reach: float, gate: float) -> tuple[Index, Index]:
    """Join chains that a crossing line has cut: an end and a start that lie on one straight line.

    Parameters
    ----------
    table, order, starts
        Ridge points and chains of `link_rows`.
    reach
        Longest gap, pixels.
    gate
        Largest distance between the two lines in the middle of the gap, pixels.
    """
    count = starts.size - 1
    following = np.full(count, -1, np.int64)
    preceded = np.zeros(count, np.bool_)
    head = np.empty((count, 2))
    tail = np.empty((count, 2))
    for c in range(count):
        head[c, 0], head[c, 1] = _end_line(table, order, starts[c], starts[c + 1], True)
        tail[c, 0], tail[c, 1] = _end_line(table, order, starts[c], starts[c + 1], False)
    for c in range(count):
        end = table[order[starts[c + 1] - 1], Y]
        best, best_distance = -1, gate
        for d in range(count):
            gap = table[order[starts[d]], Y] - end
            if preceded[d] or not 0.0 < gap <= reach:
                continue
            distance = abs(tail[c, 0] + 0.5 * gap * tail[c, 1] - head[d, 0] + 0.5 * gap * head[d, 1])
            if distance < best_distance:
                best, best_distance = d, distance
        if best >= 0:
            following[c] = best
            preceded[best] = True
    joined = np.empty_like(order)
    joined_starts = np.zeros(count + 1, np.int64)
    n = chains = 0
    for c in range(count):
        if preceded[c]:
            continue
        d = c
        while d >= 0:
            for k in range(starts[d], starts[d + 1]):
                joined[n] = order[k]
                n += 1
            d = following[d]
        chains += 1
        joined_starts[chains] = n
    return joined, joined_starts[: chains + 1]
