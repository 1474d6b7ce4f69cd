"""Small symmetric matrices against numpy's linear algebra."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from alignment.geometry.symmetric import (
    LEAST_PIVOT,
    eigen,
    factor,
    inverse,
    pseudo_inverse,
    solve,
    solve_lower,
)

Array = NDArray[np.float64]


def drawn(seed: int, size: int, rank: int) -> Array:
    """A symmetric matrix with eigenvalues of either sign over six decades, and zeros."""
    rng = np.random.default_rng(seed)
    axes = np.linalg.qr(rng.normal(size=(size, size)))[0]
    values = 10.0 ** rng.uniform(-3.0, 3.0, size) * rng.choice([-1.0, 1.0], size)
    values[rank:] = 0.0
    out: Array = (axes * values) @ axes.T
    return 0.5 * (out + out.T)


def decomposed(matrix: Array) -> tuple[Array, Array]:
    values, vectors = np.empty(len(matrix)), np.empty(matrix.shape)
    # What stands above the diagonal is no part of the matrix.
    eigen(np.tril(matrix), values, vectors)
    return values, vectors


def assert_decomposed(matrix: Array) -> None:
    values, vectors = decomposed(matrix)
    scale = max(float(np.abs(matrix).max()), 1e-300)
    np.testing.assert_allclose(vectors @ vectors.T, np.eye(len(matrix)), atol=1e-13)
    np.testing.assert_allclose(np.sort(values), np.linalg.eigvalsh(matrix), atol=1e-13 * scale)
    np.testing.assert_allclose((vectors.T * values) @ vectors, matrix, atol=1e-13 * scale)


@given(st.integers(0, 2**31), st.integers(1, 16), st.integers(0, 5))
@settings(max_examples=60)
def test_eigenvectors_are_orthogonal_and_make_up_the_matrix(seed: int, size: int, lacking: int) -> None:
    assert_decomposed(drawn(seed, size, max(size - lacking, 0)))


@pytest.mark.parametrize(
    "matrix",
    [
        np.zeros((5, 5)),
        np.eye(6),
        np.diag([3.0, -1.0, 3.0, 0.0]),
        np.ones((7, 7)),
        np.array([[2.0, 1.0], [1.0, 2.0]]),
        np.kron(np.eye(3), np.array([[1.0, 2.0], [2.0, -5.0]])),
        np.diag(np.arange(6.0)) + 1e-160 * drawn(3, 6, 6),
        np.diag(np.arange(6.0)) + 1e-200,
        np.diag([1e9, 1e9, 1.0, 1e-3, 1e-3]) + 1e-4,
    ],
)
def test_matrices_that_fall_apart_or_repeat_a_value_are_decomposed(matrix: Array) -> None:
    assert_decomposed(matrix)


def test_a_matrix_that_is_no_number_ends_the_search_all_the_same() -> None:
    values, _ = decomposed(np.full((6, 6), np.nan))
    assert np.isnan(values).any()


@given(st.integers(0, 2**31), st.integers(1, 16), st.integers(1, 4))
@settings(max_examples=40)
def test_factor_inverse_and_solution_of_a_positive_matrix(seed: int, size: int, columns: int) -> None:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(size, size + 3))
    matrix, right = root @ root.T + 0.1 * np.eye(size), rng.normal(size=(size, columns))
    lower, out, solution = np.tril(matrix), np.empty((size, size)), right.copy()
    assert factor(lower, LEAST_PIVOT)
    np.testing.assert_allclose(lower, np.linalg.cholesky(matrix), atol=1e-12 * np.abs(matrix).max())
    solve_lower(lower, solution)
    np.testing.assert_allclose(lower @ solution, right, atol=1e-11)
    # What stands above the diagonal is no part of the matrix.
    assert solve(np.tril(matrix), right, LEAST_PIVOT)
    np.testing.assert_allclose(matrix @ right, lower @ solution, atol=1e-9)
    assert inverse(matrix, out)
    np.testing.assert_allclose(out @ matrix, np.eye(size), atol=1e-9)
    np.testing.assert_array_equal(out, out.T)


@pytest.mark.parametrize(
    "matrix", [np.zeros((3, 3)), np.ones((4, 4)), np.diag([1.0, -1.0]), np.full((2, 2), np.nan)]
)
def test_a_matrix_that_is_not_positive_has_neither_factor_nor_inverse(matrix: Array) -> None:
    assert not factor(matrix.copy(), LEAST_PIVOT)
    assert not solve(matrix.copy(), np.ones((len(matrix), 1)), LEAST_PIVOT)
    assert not inverse(matrix, np.empty(matrix.shape))


@given(st.integers(0, 2**31), st.integers(1, 15), st.integers(0, 5))
@settings(max_examples=40)
def test_the_pseudo_inverse_is_numpys(seed: int, size: int, lacking: int) -> None:
    matrix, out = drawn(seed, size, max(size - lacking, 0)), np.empty((size, size))
    expected = np.linalg.pinv(matrix, rcond=1e-8, hermitian=True)
    pseudo_inverse(matrix.copy(), 1e-8, out)
    np.testing.assert_allclose(out, expected, atol=1e-8 * max(float(np.abs(expected).max()), 1.0))


@pytest.mark.parametrize(("least", "solvable"), [(1e-9, False), (1e-13, True)])
def test_how_little_must_be_left_of_a_row_is_the_callers_choice(least: float, solvable: bool) -> None:
    """Marks, surfaces and cameras each had a solver of their own, and each its own idea of singular."""
    matrix = np.array([[1.0, 1.0], [1.0, 1.0 + 1e-11]])
    right = np.array([[2.0], [2.0]])
    assert solve(matrix, right, least) == solvable
    if solvable:
        np.testing.assert_allclose(right[:, 0], [2.0, 0.0], atol=1e-3)
