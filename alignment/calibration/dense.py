"""Small dense and block algebra of the adjustment, in one thread.

A threaded BLAS makes the systems of a rig (a hundred or two unknowns) many times slower as soon as another
process wants a core; these loops take milliseconds whatever else runs.
"""

from __future__ import annotations

import numpy as np

from alignment.arrays import Array, Index
from alignment.errors import DegenerateInputError
from alignment.geometry.symmetric import solve
from alignment.kernels import njit

_SINGULAR = 1e-15  # left of an unknown's own information, below which the others explain all of it


def solve_symmetric(matrix: Array, rows: Array) -> Array:
    """Solve matrix · x = b for every row b of `rows` (K, n); (n, n) symmetric positive definite.

    The diagonal is brought to 1 first, so that units do not matter.

    Raises
    ------
    DegenerateInputError
        When the matrix is singular: something is not determined.
    """
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    out = np.ascontiguousarray((rows * scale).T)
    if not solve(matrix * np.outer(scale, scale), out, _SINGULAR):
        raise DegenerateInputError(
            field="views",
            expected="views that determine every camera",
            seen="a singular adjustment",
            cure="Add views: other heights of the stage, and marks over the whole image.",
        )
    # Row by row, as whoever reads it goes through it.
    solved: Array = np.ascontiguousarray(out.T) * scale
    return solved


@njit(cache=True, nogil=True, error_model="numpy")
def products(a: Array, b: Array) -> Array:
    """Aᵀ B (p, q) of (N, p) and (N, q)."""
    out = np.zeros((a.shape[1], b.shape[1]))
    for n in range(a.shape[0]):
        for i in range(a.shape[1]):
            value = a[n, i]
            if value != 0.0:
                for j in range(b.shape[1]):
                    out[i, j] += value * b[n, j]
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def eliminate(
    matrix: Array, vector: Array, coupling: Array, inverse_blocks: Array, block_vector: Array
) -> tuple[Array, Array]:
    """Schur complement over 3 × 3 blocks: A − Wᵀ V⁻¹ W and a − Wᵀ V⁻¹ b.

    Parameters
    ----------
    matrix, vector
        A (n, n), a (n,).
    coupling
        (M, 3, n) W, mostly zero.
    inverse_blocks, block_vector
        (M, 3, 3) V⁻¹, (M, 3) b.
    """
    n = vector.size
    reduced, right = matrix.copy(), vector.copy()
    used = np.empty(n, np.int64)
    gain = np.empty((3, n))
    for m in range(coupling.shape[0]):
        w, inverse = coupling[m], inverse_blocks[m]
        count = 0
        for a in range(n):
            if w[0, a] != 0.0 or w[1, a] != 0.0 or w[2, a] != 0.0:
                used[count] = a
                for e in range(3):
                    gain[e, count] = (
                        inverse[e, 0] * w[0, a] + inverse[e, 1] * w[1, a] + inverse[e, 2] * w[2, a]
                    )
                count += 1
        for s in range(count):
            a = used[s]
            g0, g1, g2 = gain[0, s], gain[1, s], gain[2, s]
            right[a] -= g0 * block_vector[m, 0] + g1 * block_vector[m, 1] + g2 * block_vector[m, 2]
            for t in range(s + 1):
                b = used[t]
                reduced[a, b] -= g0 * w[0, b] + g1 * w[1, b] + g2 * w[2, b]
    for a in range(n):
        for b in range(a):
            reduced[b, a] = reduced[a, b]
    return reduced, right


@njit(cache=True, nogil=True, error_model="numpy")
def leverage(
    columns: Index,
    mark: Index,
    by_local: Array,
    by_mark: Array,
    weight: Array,
    coupling: Array,
    inverse_blocks: Array,
    covariance: Array,
) -> Array:
    """(N,) trace of each observation's 2 × 2 block of the hat matrix; arguments as `equations.leverages`."""
    n = covariance.shape[0]
    out = np.zeros(mark.size)
    row = np.empty(n)
    used = np.empty(n, np.int64)
    for i in range(mark.size):
        w, inverse = coupling[mark[i]], inverse_blocks[mark[i]]
        for e in range(2):
            j0, j1, j2 = by_mark[i, e, 0], by_mark[i, e, 1], by_mark[i, e, 2]
            h0 = inverse[0, 0] * j0 + inverse[0, 1] * j1 + inverse[0, 2] * j2
            h1 = inverse[1, 0] * j0 + inverse[1, 1] * j1 + inverse[1, 2] * j2
            h2 = inverse[2, 0] * j0 + inverse[2, 1] * j1 + inverse[2, 2] * j2
            count = 0
            for a in range(n):
                value = -(h0 * w[0, a] + h1 * w[1, a] + h2 * w[2, a])
                row[a] = value
            for k in range(columns.shape[1]):
                if columns[i, k] >= 0:
                    row[columns[i, k]] += by_local[i, e, k]
            for a in range(n):
                if row[a] != 0.0:
                    used[count] = a
                    count += 1
            total = j0 * h0 + j1 * h1 + j2 * h2
            for s in range(count):
                a = used[s]
                part = 0.5 * covariance[a, a] * row[a]
                for t in range(s):
                    part += covariance[a, used[t]] * row[used[t]]
                total += 2.0 * row[a] * part
            out[i] += weight[i] * total
    return out
