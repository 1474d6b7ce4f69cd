"""Correction functions: chosen by left-out points, applied only when they help there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from alignment.calibration.correction import (
    choose_correction,
    fit_correction,
    left_out_errors,
    standard_candidates,
)
from alignment.errors import DegenerateInputError
from alignment.geometry.cameras import Array

CANDIDATES = standard_candidates(2)


def grid(n: int = 7, step: float = 25.0) -> Array:
    at = (np.arange(n) - (n - 1) / 2) * step
    x, y = np.meshgrid(at, at)
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])


def surface(p: Array) -> Array:
    """Quadratic in x, linear in y; millimetres."""
    return np.column_stack([0.3 * (p[:, 0] / 75) ** 2 - 0.1 * p[:, 1] / 75, p[:, 0] / 300, 0 * p[:, 0]])


def test_noise_alone_is_not_corrected() -> None:
    rng = np.random.default_rng(1)
    points = grid()
    helped = [fit_correction(points, rng.normal(0, 0.02, points.shape)).helps for _ in range(5)]
    assert np.mean(helped) < 0.1


def test_systematic_errors_are_found_and_taken_off() -> None:
    rng = np.random.default_rng(2)
    points = grid()
    correction = fit_correction(points, surface(points) + rng.normal(0, 0.01, points.shape))
    assert correction.helps == (True, True, False)
    between = grid(5, 31.0)
    left = correction.apply(between + surface(between)) - between
    assert np.abs(left[:, :2]).max() < 0.025
    np.testing.assert_array_equal(left[:, 2], 0.0)


def test_left_out_errors_are_those_of_fits_without_the_point() -> None:
    """The closed formula against fitting again, for every form."""
    rng = np.random.default_rng(3)
    points = grid(5)[:, :2] / 50
    errors = rng.normal(size=len(points))
    for candidate in CANDIDATES:
        whole = choose_correction(points, errors + 1e3, [candidate])
        if whole.name != candidate.name:
            continue
        few = choose_correction(points[1:], errors[1:] + 1e3, [candidate])
        alone = errors[0] + 1e3 - few(points[:1])[0]
        assert whole.left_out[0] == pytest.approx(alone, rel=1e-5, abs=1e-7), candidate.name


def test_correction_does_not_extrapolate() -> None:
    points = grid()
    correction = fit_correction(points, surface(points))
    far = correction.errors(np.array([[500.0, 0.0, 40.0]]))
    np.testing.assert_allclose(far, correction.errors(np.array([[75.0, 0.0, 0.0]])))


def test_errors_along_a_plane_do_not_explain_themselves() -> None:
    """Measured heights of a plane differ by their errors alone; as a coordinate they would null them."""
    rng = np.random.default_rng(5)
    true = grid()
    errors = np.column_stack([np.zeros((len(true), 2)), rng.normal(0, 0.1, len(true))])
    correction = fit_correction(true + errors, errors)
    assert correction.axes == (0, 1)
    assert correction.helps == (False, False, False)


@pytest.mark.parametrize("axes", [(0,), (0, 1), (0, 1, 2)])
def test_points_may_differ_in_one_two_or_three_coordinates(axes: tuple[int, ...]) -> None:
    rng = np.random.default_rng(4)
    points = np.zeros((60, 3))
    points[:, axes] = rng.uniform(-50, 50, (60, len(axes)))
    errors = np.tile(0.01 * points[:, axes].sum(axis=1)[:, None], 3)
    correction = fit_correction(points, errors)
    assert correction.axes == axes
    np.testing.assert_allclose(correction.apply(points), points - errors, atol=1e-6)


def test_bad_input_is_named() -> None:
    points = grid()
    with pytest.raises(DegenerateInputError, match="at least 8 known errors"):
        fit_correction(points[:5], points[:5])
    with pytest.raises(DegenerateInputError, match="different places"):
        fit_correction(np.zeros((20, 3)), np.zeros((20, 3)))
    with pytest.raises(DegenerateInputError, match="shapes"):
        fit_correction(points, points[:, :2])


@pytest.fixture(scope="module")
def printed(published_data: Path) -> tuple[Array, Array]:
    file = published_data.parent / "seed" / "nonparallel_errors.csv"
    if not file.is_file():
        pytest.skip(f"printed errors not present: {file} does not exist")
    rows = np.genfromtxt(file, delimiter=",", skip_header=1)
    places = np.column_stack([25.0 * rows[:, :2] - 75.0, np.zeros(len(rows))])
    return places, rows[:, 2:]


def test_printed_errors_shrink_below_the_published_residuals(printed: tuple[Array, Array]) -> None:
    points, errors = printed
    correction = fit_correction(points, errors)
    for model, published in zip(correction.models, (0.13, 0.12, 0.15), strict=True):
        assert np.abs(model.residuals).max() < published
        assert model.left_out_rms < 0.07


def test_printed_errors_left_out_of_fit_and_choice(printed: tuple[Array, Array]) -> None:
    points, errors = printed
    correction = fit_correction(points, errors)
    for column, limit in ((0, 0.045), (2, 0.055)):
        known = np.isfinite(errors[:, column])
        left = left_out_errors(correction.scaled(points)[known], errors[known, column], CANDIDATES, 12)
        assert np.sqrt(np.square(left).mean()) < limit
