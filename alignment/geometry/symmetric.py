"""Symmetric matrices: Cholesky factors and what they solve, eigenvectors, pseudo-inverses.

For matrices of a few rows inside compiled functions, where a library's call costs more than its work and
takes seconds to compile; and for those of a hundred or two unknowns, on which a threaded library waits for
its threads as soon as another process wants a core.
"""

from __future__ import annotations

import math

import numpy as np

from alignment.arrays import Array
from alignment.kernels import njit

_EPS = float(np.finfo(np.float64).eps)
_NOTHING = 1e-280  # a sum of squares below which digits get lost; its numbers are taken for zeros
_MOST_TURNS = 50  # for one eigenvalue; two are common
LEAST_PIVOT = 1e-14
"""Of a row's own value, below which rounding leaves nothing of it."""


@njit(cache=True, nogil=True, error_model="numpy")
def factor(matrix: Array, least: float) -> bool:
    """Cholesky factor of a matrix (n, n), in place in its lower triangle; False where it is not positive.

    Of each row there must be left more than `least` times its own diagonal value, once the rows before it are
    taken off; `LEAST_PIVOT` where nothing else is known.
    """
    for k in range(matrix.shape[0]):
        own = matrix[k, k]
        for j in range(k):
            matrix[k, k] -= matrix[k, j] * matrix[k, j]
        if not matrix[k, k] > least * own:
            return False
        root = math.sqrt(matrix[k, k])
        matrix[k, k] = root
        for i in range(k + 1, matrix.shape[0]):
            rest = matrix[i, k]
            for j in range(k):
                rest -= matrix[i, j] * matrix[k, j]
            matrix[i, k] = rest / root
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def solve_lower(lower: Array, right: Array) -> None:
    """Solve L x = right (n, m) in place; only the lower triangle is looked at."""
    for k in range(right.shape[0]):
        mine = right[k]
        for j in range(k):
            share, other = lower[k, j], right[j]
            for c in range(right.shape[1]):
                mine[c] -= share * other[c]
        per_root = 1.0 / lower[k, k]
        for c in range(right.shape[1]):
            mine[c] *= per_root


@njit(cache=True, nogil=True, error_model="numpy")
def solve_upper(lower: Array, right: Array) -> None:
    """Solve Lᵀ x = right (n, m) in place; only the lower triangle of L is looked at."""
    for k in range(right.shape[0] - 1, -1, -1):
        mine = right[k]
        for j in range(k + 1, right.shape[0]):
            share, other = lower[j, k], right[j]
            for c in range(right.shape[1]):
                mine[c] -= share * other[c]
        per_root = 1.0 / lower[k, k]
        for c in range(right.shape[1]):
            mine[c] *= per_root


@njit(cache=True, nogil=True, error_model="numpy")
def solve_factored(lower: Array, right: Array) -> None:
    """Solve L Lᵀ x = right (n, m) in place."""
    solve_lower(lower, right)
    solve_upper(lower, right)


@njit(cache=True, nogil=True, error_model="numpy")
def solve(matrix: Array, right: Array, least: float) -> bool:
    """Solve matrix · x = right (n, m) in place, and factor the matrix in place; False as `factor`."""
    if not factor(matrix, least):
        return False
    solve_factored(matrix, right)
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def inverse(matrix: Array, out: Array) -> bool:
    """Inverse of a positive matrix (n, n) into `out`; False, and nothing in it, where it is not positive."""
    n = matrix.shape[0]
    lower, root = matrix.copy(), np.zeros((n, n))
    if not factor(lower, LEAST_PIVOT):
        return False
    for k in range(n):
        root[k, k] = 1.0
    solve_lower(lower, root)
    for i in range(n):
        for j in range(i + 1):
            total = 0.0
            for k in range(i, n):
                total += root[k, i] * root[k, j]
            out[i, j] = out[j, i] = total
    return True


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _tridiagonal(matrix: Array, diagonal: Array, beside: Array, vectors: Array) -> None:
    """Reflect a matrix, which is overwritten, to tridiagonal form (Householder 1958).

    `vectors` (n, n) become the rows of the rotation: vectors · matrix · vectorsᵀ is tridiagonal.
    """
    n = matrix.shape[0]
    pull = np.empty(n)
    for k in range(n - 2):
        square = 0.0
        for i in range(k + 1, n):
            square += matrix[i, k] * matrix[i, k]
        # The reflection's vector is left in the column, unit length; zero where there is nothing to reflect.
        if square < _NOTHING:
            beside[k] = 0.0
            for i in range(k + 1, n):
                matrix[i, k] = 0.0
            continue
        away = -math.copysign(math.sqrt(square), matrix[k + 1, k])
        beside[k] = away
        matrix[k + 1, k] -= away
        per_length = 1.0 / math.sqrt(-2.0 * away * matrix[k + 1, k])
        for i in range(k + 1, n):
            matrix[i, k] *= per_length
        along = 0.0
        for i in range(k + 1, n):
            total = 0.0
            for j in range(k + 1, i + 1):
                total += matrix[i, j] * matrix[j, k]
            for j in range(i + 1, n):
                total += matrix[j, i] * matrix[j, k]
            pull[i] = total
            along += total * matrix[i, k]
        for i in range(k + 1, n):
            pull[i] -= along * matrix[i, k]
        for i in range(k + 1, n):
            for j in range(k + 1, i + 1):
                matrix[i, j] -= 2.0 * (matrix[i, k] * pull[j] + pull[i] * matrix[j, k])
    if n > 1:
        beside[n - 2] = matrix[n - 1, n - 2]
    beside[n - 1] = 0.0
    for i in range(n):
        diagonal[i] = matrix[i, i]
        for j in range(n):
            vectors[i, j] = 1.0 if i == j else 0.0
    for k in range(n - 3, -1, -1):
        for i in range(k + 1, n):
            total = 0.0
            for j in range(k + 1, n):
                total += vectors[i, j] * matrix[j, k]
            for j in range(k + 1, n):
                vectors[i, j] -= 2.0 * total * matrix[j, k]


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _turn(diagonal: Array, beside: Array, vectors: Array, first: int, last: int) -> None:
    """One sweep of implicit QL with Wilkinson's shift over rows `first` to `last` (Bowdler et al. 1968)."""
    g = (diagonal[first + 1] - diagonal[first]) / (2.0 * beside[first])
    r = math.sqrt(g * g + 1.0)
    g = diagonal[last] - diagonal[first] + beside[first] / (g + math.copysign(r, g))
    s = c = 1.0
    p = 0.0
    for i in range(last - 1, first - 1, -1):
        f, b = s * beside[i], c * beside[i]
        r = math.sqrt(f * f + g * g)
        beside[i + 1] = r
        if r == 0.0:  # falls apart in two here
            diagonal[i + 1] -= p
            beside[last] = 0.0
            return
        s, c = f / r, g / r
        g = diagonal[i + 1] - p
        r = (diagonal[i] - g) * s + 2.0 * c * b
        p = s * r
        diagonal[i + 1] = g + p
        g = c * r - b
        upper, lower = vectors[i], vectors[i + 1]
        for k in range(vectors.shape[1]):
            x, y = upper[k], lower[k]
            lower[k] = s * x + c * y
            upper[k] = c * x - s * y
    diagonal[first] -= p
    beside[first] = g
    beside[last] = 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def eigen(matrix: Array, values: Array, vectors: Array) -> None:
    """Eigenvalues (n,), in no order, and unit eigenvectors, the rows of (n, n), of a symmetric matrix.

    `matrix` is overwritten; only its lower triangle is looked at.
    """
    n = matrix.shape[0]
    beside = np.empty(n)
    _tridiagonal(matrix, values, beside, vectors)
    largest = 0.0
    for k in range(n):
        largest = max(largest, abs(values[k]) + abs(beside[k]))
    for first in range(n):
        for _ in range(_MOST_TURNS):
            last = first
            while last < n - 1:
                near = max(abs(values[last]) + abs(values[last + 1]), _EPS * largest)
                if abs(beside[last]) <= _EPS * near:
                    break
                last += 1
            if last == first:
                break
            _turn(values, beside, vectors, first, last)


@njit(cache=True, nogil=True, error_model="numpy")
def pseudo_inverse(matrix: Array, least: float, out: Array) -> None:
    """Inverse into `out` (n, n) without the eigenvalues of at most `least` times the largest.

    `matrix` is overwritten; only its lower triangle is looked at.
    """
    n = matrix.shape[0]
    values, vectors = np.empty(n), np.empty((n, n))
    eigen(matrix, values, vectors)
    largest = 0.0
    for k in range(n):
        largest = max(largest, abs(values[k]))
    for i in range(n):
        for j in range(n):
            out[i, j] = 0.0
    for k in range(n):
        if abs(values[k]) > least * largest:
            vector, per_value = vectors[k], 1.0 / values[k]
            for i in range(n):
                share, row = vector[i] * per_value, out[i]
                for j in range(n):
                    row[j] += share * vector[j]
