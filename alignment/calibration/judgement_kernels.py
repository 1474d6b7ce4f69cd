"""The algebra of signs; see `judgement`."""

from __future__ import annotations

import math

import numpy as np

from alignment.arrays import Array, Index
from alignment.geometry.symmetric import LEAST_PIVOT, eigen, factor, inverse, pseudo_inverse, solve_lower
from alignment.kernels import njit
from alignment.stereo.row_kernels import FEWEST, TERMS
from alignment.wheel.agreement import MOVES

# What tyres do to the signs: light shifts a place on a bend or on shining rubber by hundredths of a mm.
_SKIN_SHIFT_MM = 0.015
_SYSTEMATIC_PX = 0.03  # what crosses of one shot have in common: the projector's lines, gloss
_FEWEST_HEADS = 3  # whose patches say more than that two of them meet on some surface
_NULL = 7e-4  # of an amount's own information, below which amounts are the profile's, which is free
_FREEDOM = 6  # of a knock
_SIZES = np.array([1.0, 0.25, 0.0625, 0.016])  # of knocks, in those that `KnockModel` tells of
_FOUND = 1.645  # deviations by which a movement must be clear of the warning: found in 95 of 100 shots
_LARGEST = 2.0  # knock that is asked after, in those that `KnockModel` tells of: 10′, 0.5 mm
_MOST_LN = 300.0  # of an evidence ratio; more is as good as certain
CLEAR = 14.0
"""Squared deviations that a movement must explain: where little is seen, evidence is even."""
SUSPECT = 2.5
"""2 ln of the evidence ratio from which a shot is measured with a warning."""


@njit(cache=True, nogil=True, error_model="numpy")
def row_figures(
    pairs: Index, field: Array, information: Array, covariance: Array, weights: Array
) -> tuple[Array, Array, Array]:
    """RMS over the view (H,) of each head's row field and its deviation (H,), NaN for heads without one.

    At last the field's covariance by noise (H, 5, 5), pixels²; NaN for heads without one, and for those whose
    crosses do not determine it. `covariance` is that of all signs by the calibration's errors.
    """
    heads = pairs.size
    figures, deviations = np.full(heads, np.nan), np.full(heads, np.nan)
    noise = np.full((heads, TERMS, TERMS), np.nan)
    for h in range(heads):
        if pairs[h] < FEWEST or not inverse(information[h], noise[h]):
            continue
        first = heads * MOVES + h * TERMS
        square = allowed = 0.0
        for a in range(TERMS):
            for b in range(TERMS):
                square += weights[h, a, b] * field[h, a] * field[h, b]
                allowed += weights[h, a, b] * (noise[h, a, b] + covariance[first + a, first + b])
        figures[h] = math.sqrt(max(square, 0.0))
        deviations[h] = math.sqrt(allowed + _SYSTEMATIC_PX * _SYSTEMATIC_PX)
    return figures, deviations, noise


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _without_common(normal: Array, target: Array, heads: int, unit: Array) -> tuple[Array, Array, Array]:
    """Normal equations in units (5 H,) of the amounts, less what all heads do together; and (5, 5 H) of that.

    What all heads do together is the axis, which the fit has found already: the amounts that it takes are
    the last of these times the amounts in their units.
    """
    size = target.size
    scaled, right = np.empty((size, size)), np.empty(size)
    of_common, middle = np.zeros((size, MOVES)), np.zeros((MOVES, MOVES))
    for i in range(size):
        for j in range(size):
            scaled[i, j] = normal[i, j] / (unit[i] * unit[j])
            of_common[i, j % MOVES] += scaled[i, j] * unit[j]
        for b in range(MOVES):
            middle[i % MOVES, b] += unit[i] * of_common[i, b]
    inner, free = np.empty((MOVES, MOVES)), np.zeros((MOVES, size))
    pseudo_inverse(middle, 1e-8, inner)
    of_target = np.zeros(MOVES)
    for i in range(size):
        for a in range(MOVES):
            for b in range(MOVES):
                free[a, i] += inner[a, b] * of_common[i, b]
        of_target[i % MOVES] += target[i]
    for i in range(size):
        right[i] = target[i] / unit[i]
        for a in range(MOVES):
            right[i] -= free[a, i] * of_target[a]
            for j in range(size):
                scaled[i, j] -= free[a, i] * of_common[j, a]
    return scaled, right, free


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _tilted(rows: Array, wheel: Array) -> None:
    """Turn rows (N, 5 H) of amounts of a patch to those across the rig's axes, in place.

    Along the wheel's axis a patch rises by its shift across the rig's, too.
    """
    for i in range(rows.shape[0]):
        for k in range(0, rows.shape[1], MOVES):
            rows[i, k + 3] -= rows[i, k] * wheel[0] / wheel[2]
            rows[i, k + 4] -= rows[i, k] * wheel[1] / wheel[2]


@njit(cache=True, nogil=True, error_model="numpy")
def patch_signs(normal: Array, target: Array, rms: float, wheel: Array) -> tuple[Array, Array, Array]:
    """Signs that the patches show (n,), noise 1, and what of the amounts they are (n, 5 H).

    At last (2, 5 H), the leans that the fit takes the amounts for.
    """
    size = target.size
    heads = size // MOVES
    unit = np.empty(size)
    for i in range(size):
        unit[i] = math.sqrt(max(normal[i, i], 1e-30))
    scaled, right, free = _without_common(normal, target, heads, unit)
    values, vectors = np.empty(size), np.empty((size, size))
    eigen(scaled, values, vectors)
    signs, amounts, leans = np.empty(size), np.empty((size, size)), np.empty((2, size))
    n = 0
    for k in range(size):
        if heads >= _FEWEST_HEADS and values[k] > _NULL:
            root, per_rms = math.sqrt(values[k]), 1.0 / max(rms, 1e-6)
            total = 0.0
            for i in range(size):
                total += vectors[k, i] * right[i]
                amounts[n, i] = vectors[k, i] * unit[i] * root * per_rms
            signs[n] = total * per_rms / root
            n += 1
    for i in range(size):
        leans[0, i], leans[1, i] = free[1, i] * unit[i], free[2, i] * unit[i]
    _tilted(amounts[:n], wheel)
    _tilted(leans, wheel)
    return signs[:n], amounts[:n], leans


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _spread(amounts: Array, noise: Array, seen: Index, covariance: Array) -> Array:
    """Covariance of the signs (S, S), its lower triangle, by noise, tyre and calibration.

    `seen` (S − n,) are the numbers of the row fields' signs among all that a rig has.
    """
    n, size = amounts.shape
    count = n + seen.size
    out, part = np.zeros((count, count)), np.zeros(covariance.shape[0])
    for i in range(n):
        for p in range(part.size):
            part[p] = 0.0
        for q in range(size):
            share = amounts[i, q]
            for p in range(part.size):
                part[p] += share * covariance[q, p]
            if q % MOVES >= 3:
                part[q] += share * _SKIN_SHIFT_MM * _SKIN_SHIFT_MM
        for j in range(i + 1):
            for q in range(size):
                out[i, j] += part[q] * amounts[j, q]
        out[i, i] += 1.0
        for j in range(seen.size):
            out[n + j, i] = part[seen[j]]
    for i in range(seen.size):
        h, a = (seen[i] - size) // TERMS, (seen[i] - size) % TERMS
        for j in range(i + 1):
            out[n + i, n + j] = covariance[seen[i], seen[j]]
            if (seen[j] - size) // TERMS == h:
                out[n + i, n + j] += noise[h, a, (seen[j] - size) % TERMS]
        out[n + i, n + i] += _SYSTEMATIC_PX * _SYSTEMATIC_PX
    for i in range(count):
        out[i, i] *= 1.0 + 1e-9
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def whitened(
    patches: Array, amounts: Array, field: Array, noise: Array, covariance: Array, responses: Array
) -> tuple[Array, bool]:
    """Answers of the signs (S, 6 K) to each knock, and the signs, the last column; all in units of noise.

    False where no sign is seen, or their noise is no covariance.

    Parameters
    ----------
    patches, amounts
        Of `patch_signs`.
    field, noise
        (H, 5) row fields and their covariance, see `row_figures`.
    covariance, responses
        (10 H, 10 H) and (10 H, 6 K) of `KnockModel`.
    """
    n, size = amounts.shape
    seen, rows = np.empty(field.size, np.int64), 0
    for h in range(field.shape[0]):
        for a in range(TERMS):
            if not np.isnan(noise[h, a, a]):
                seen[rows] = size + TERMS * h + a
                rows += 1
    seen = seen[:rows]
    width = responses.shape[1]
    out = np.zeros((n + rows, width + 1))
    for i in range(n):
        mine = out[i]
        for q in range(size):
            share, other = amounts[i, q], responses[q]
            for c in range(width):
                mine[c] += share * other[c]
        mine[width] = patches[i]
    for i in range(rows):
        at = seen[i]
        for c in range(width):
            out[n + i, c] = responses[at, c]
        out[n + i, width] = field[(at - size) // TERMS, (at - size) % TERMS]
    spread = _spread(amounts, noise, seen, covariance)
    if not factor(spread, LEAST_PIVOT):
        return out, False
    solve_lower(spread, out)
    return out, n + rows > 0


@njit(cache=True, nogil=True, error_model="numpy")
def knock_axes(answers: Array, turned: Array) -> tuple[Array, Array, Array]:
    """Each knock along the eigenvectors of its information: there it is six knocks, each by itself.

    Parameters
    ----------
    answers
        (S, 6 K + 1) of `whitened`.
    turned
        (2, 6 K) change of the angles by each knock.

    Returns
    -------
    strength, pull
        (K, 6) squared deviations by a knock of one unit, and what the signs say of its size.
    turned
        (K, 2, 6) change of the angles by it, radians.
    """
    count, width = answers.shape[0], answers.shape[1] - 1
    knocks = width // _FREEDOM
    strength, pull = np.empty((knocks, _FREEDOM)), np.zeros((knocks, _FREEDOM))
    along = np.zeros((knocks, 2, _FREEDOM))
    information, axes = np.empty((_FREEDOM, _FREEDOM)), np.empty((_FREEDOM, _FREEDOM))
    of_signs = np.empty(_FREEDOM)
    for k in range(knocks):
        first = k * _FREEDOM
        for a in range(_FREEDOM):
            of_signs[a] = 0.0
            for b in range(_FREEDOM):
                information[a, b] = 0.0
        for s in range(count):
            row = answers[s]
            for a in range(_FREEDOM):
                share = row[first + a]
                of_signs[a] += share * row[width]
                for b in range(a + 1):
                    information[a, b] += share * row[first + b]
        eigen(information, strength[k], axes)
        for b in range(_FREEDOM):
            strength[k, b] = max(strength[k, b], 0.0)
            for a in range(_FREEDOM):
                pull[k, b] += axes[b, a] * of_signs[a]
                along[k, 0, b] += axes[b, a] * turned[0, first + a]
                along[k, 1, b] += axes[b, a] * turned[1, first + a]
    return strength, pull, along


@njit(cache=True, nogil=True, error_model="numpy")
def evidences(strength: Array, pull: Array, turned: Array) -> tuple[Array, Array, Array, Array]:
    """Evidence of each assumed size of each knock.

    Parameters
    ----------
    strength, pull, turned
        Of `knock_axes`.

    Returns
    -------
    evidence, explained
        (K, S) 2 ln of the evidence ratio, and squared deviations that the knock explains.
    errors, scatter
        (K, S, 2) change of the angles by the likeliest knock, radians, and (K, S, 2, 2) the covariance that
        remains of it.
    """
    knocks, sizes = strength.shape[0], _SIZES.size
    evidence, explained = np.zeros((knocks, sizes)), np.zeros((knocks, sizes))
    errors, scatter = np.zeros((knocks, sizes, 2)), np.zeros((knocks, sizes, 2, 2))
    for k in range(knocks):
        for s in range(sizes):
            square = _SIZES[s] * _SIZES[s]
            for b in range(_FREEDOM):
                expected = square * strength[k, b]
                kept = square / (1.0 + expected)
                gain = kept * pull[k, b] * pull[k, b]
                explained[k, s] += gain
                evidence[k, s] += gain - math.log1p(expected)
                for e in range(2):
                    errors[k, s, e] += turned[k, e, b] * kept * pull[k, b]
                    for f in range(2):
                        scatter[k, s, e, f] += kept * turned[k, e, b] * turned[k, f, b]
    return evidence, explained, errors, scatter


@njit(cache=True, nogil=True, error_model="numpy")
def together(
    evidence: Array, explained: Array, errors: Array, scatter: Array
) -> tuple[float, float, int, Array, Array, Array]:
    """All possibilities together, each by its evidence. Parameters as `evidences` returns them.

    Returns
    -------
    twice_ln, most
        2 ln of the evidence that something moved over that nothing did, and the most that one explains.
    best, angles
        The knock that explains best, and the change of the angles (2,) if it is so, radians.
    squares, remains
        (2, 2) mean products of the errors of the angles, and mean of the covariance that remains, radians².
    """
    knocks, sizes = evidence.shape
    total = most = highest = 0.0
    best = 0
    angles, squares, remains = np.zeros(2), np.zeros((2, 2)), np.zeros((2, 2))
    mine = np.empty(2)
    for k in range(knocks):
        of_knock = mine[0] = mine[1] = 0.0
        for s in range(sizes):
            ratio = math.exp(min(0.5 * evidence[k, s], _MOST_LN)) / evidence.size
            of_knock += ratio
            most = max(most, explained[k, s])
            for e in range(2):
                mine[e] += ratio * errors[k, s, e]
                for f in range(2):
                    squares[e, f] += ratio * errors[k, s, e] * errors[k, s, f]
                    remains[e, f] += ratio * scatter[k, s, e, f]
        total += of_knock
        if of_knock > highest:
            highest, best = of_knock, k
            angles[0], angles[1] = mine[0] / of_knock, mine[1] / of_knock
    for e in range(2):
        for f in range(2):
            squares[e, f] /= total
            remains[e, f] /= total
    return 2.0 * math.log(total), most, best, angles, squares, remains


@njit(cache=True, nogil=True, error_model="numpy")
def unseen(strength: Array, turned: Array) -> Array:
    """(2,) largest change of the angles that movements make which are not found with 95 % probability.

    A movement a along the axes explains Σ w (√λ a + z)² of the signs, z being their noise: a noncentral χ²,
    taken as normal with its mean and variance. Each assumed size finds what lifts that above its own
    threshold; a movement passes unseen only where all sizes miss it. Parameters as for `evidences`.
    """
    knocks, sizes = strength.shape[0], _SIZES.size
    # One size of one knock alone must outweigh all that are asked.
    alone = SUSPECT + 2.0 * math.log(knocks * sizes)
    clear = _FOUND * _FOUND
    out, weight = np.zeros(2), np.empty(_FREEDOM)
    for k in range(knocks):
        smallest_0 = smallest_1 = np.inf
        for s in range(sizes):
            freedom, threshold = 0.0, alone
            for b in range(_FREEDOM):
                expected = _SIZES[s] * _SIZES[s] * strength[k, b]
                weight[b] = expected / (1.0 + expected)
                freedom += weight[b]
                threshold += math.log1p(expected)
            above = max(threshold, CLEAR) - freedom
            # above = x − _FOUND √(2 freedom + 4 x), solved for what a movement must add on the average.
            root = math.sqrt(max(4.0 * clear * (above + clear) + 2.0 * clear * freedom, 0.0))
            least = max(above + 2.0 * clear + root, 1.0)
            most_0 = most_1 = 0.0
            for b in range(_FREEDOM):
                held = weight[b] * strength[k, b] / least + 1.0 / _LARGEST**2
                most_0 += turned[k, 0, b] * turned[k, 0, b] / held
                most_1 += turned[k, 1, b] * turned[k, 1, b] / held
            smallest_0, smallest_1 = min(smallest_0, most_0), min(smallest_1, most_1)
        out[0], out[1] = max(out[0], smallest_0), max(out[1], smallest_1)
    out[0], out[1] = math.sqrt(out[0]), math.sqrt(out[1])
    return out
