"""The compiled kernels of the fit against plain, slow arithmetic."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BSpline

from alignment.arrays import Array
from alignment.wheel import revolution_kernels as kernels
from alignment.wheel.revolution_steps import frame_of, solve_arrow

START, STEP, KNOTS = 205.0, 4.0, 30
END = START + STEP * (KNOTS - 3)


class Case:
    """Points around an axis, some beyond the profile, at a working point near it."""

    def __init__(self, seed: int, count: int = 700) -> None:
        rng = np.random.default_rng(seed)
        radius, angle = rng.uniform(START - 10.0, END + 10.0, count), rng.uniform(0.0, 6.28, count)
        height = 0.05 * rng.standard_normal(count) + 3.0
        self.points = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), height])
        rays = np.array([0.0, 0.0, -1.0]) + 0.2 * rng.standard_normal((count, 3))
        self.rays = rays / np.linalg.norm(rays, axis=1, keepdims=True)
        self.sigma = rng.uniform(0.01, 0.05, count)
        self.spread = rng.uniform(0.0, 0.2, count)
        self.centre = rng.uniform(-5.0, 5.0, 3)
        self.frame = frame_of(np.array([*rng.uniform(-0.08, 0.08, 2), 1.0]))
        self.profile = 2.0 + 0.3 * rng.standard_normal(KNOTS)
        self.table = np.full((kernels.ROWS, count), np.nan)
        self.first = np.full(count, -7)
        kernels.rows(
            self.points, self.sigma, self.rays, self.spread, self.centre, self.frame, START, STEP,
            self.profile, self.table, self.first,
        )  # fmt: skip
        self.inside = self.first >= 0

    def height(self, change: Array) -> Array:
        """Residuals within the profile after a change of (2 tilts, 2 shifts, K coefficients)."""
        frame = self.frame.copy()
        frame[2] += change[0] * frame[0] + change[1] * frame[1]
        frame = frame_of(frame[2])
        centre = self.centre + change[2] * self.frame[0] + change[3] * self.frame[1]
        local = (self.points[self.inside] - centre) @ frame.T
        return np.asarray(local[:, 2] - self.spline(change[4:])(np.hypot(local[:, 0], local[:, 1])))

    def spline(self, change: Array) -> BSpline:
        knots = START + STEP * np.arange(-3, KNOTS + 1)
        return BSpline(knots, self.profile + change, 3)

    def derivatives(self) -> Array:
        size, step = kernels.AXIS + KNOTS, 1e-5
        steps = step * np.eye(size)
        return np.column_stack([(self.height(s) - self.height(-s)) / (2.0 * step) for s in steps])


@given(st.integers(0, 2**31))
@settings(max_examples=20)
def test_residuals_are_heights_above_the_spline_and_none_is_claimed_beyond_it(seed: int) -> None:
    case = Case(seed)
    local = (case.points - case.centre) @ case.frame.T
    radius = np.hypot(local[:, 0], local[:, 1])
    np.testing.assert_array_equal(case.inside, (radius >= START) & (radius < END))
    expected = case.height(np.zeros(kernels.AXIS + KNOTS))
    np.testing.assert_allclose(case.table[kernels.VALUE, case.inside], expected, atol=1e-10)
    above = kernels.heights(case.points, case.centre, case.frame, START, STEP, case.profile)
    np.testing.assert_allclose(above[case.inside], expected, atol=1e-10)
    assert np.isnan(above[~case.inside]).all()


@given(st.integers(0, 2**31))
@settings(max_examples=10)
def test_a_points_deviation_is_that_of_its_height_along_its_ray_on_a_slope_and_in_a_bend(seed: int) -> None:
    case = Case(seed)
    step = 1e-4
    moved = case.points + step * case.rays
    before = kernels.heights(case.points, case.centre, case.frame, START, STEP, case.profile)
    after = kernels.heights(moved, case.centre, case.frame, START, STEP, case.profile)
    local = (case.points - case.centre) @ case.frame.T
    radius, spline = np.hypot(local[:, 0], local[:, 1]), case.spline(np.zeros(KNOTS))
    slope, bend = spline.derivative()(radius), spline.derivative(2)(radius)
    along = case.sigma * np.maximum(np.abs(after - before) / step, 0.1)
    bent = np.minimum(kernels.BEND * case.spread * np.abs(bend), along)
    expected = np.hypot(np.hypot(along, kernels.ACROSS * slope), bent)
    # Where the step crosses a knot the difference is a mean of two cubics.
    seen = case.inside & np.isfinite(after)
    np.testing.assert_allclose(case.table[kernels.DEVIATION, seen], expected[seen], rtol=1e-3)


@given(st.integers(0, 2**31))
@settings(max_examples=10)
def test_normal_equations_are_those_of_the_derivatives(seed: int) -> None:
    case = Case(seed)
    scale = kernels.weigh(case.table, case.first, 4.0, 0.3)
    assert scale > 0.0
    weight, values = case.table[kernels.WEIGHT, case.inside], case.table[kernels.VALUE, case.inside]
    jacobian = case.derivatives()
    expected = jacobian.T @ (weight[:, None] * jacobian)
    corner, side, band = kernels.normal_matrix(case.table, case.first, KNOTS)
    found = np.zeros_like(expected)
    found[:4, :4], found[4:, :4], found[:4, 4:] = corner, side, side.T
    for k in range(KNOTS):
        for below in range(min(4, KNOTS - k)):
            found[4 + k + below, 4 + k] = found[4 + k, 4 + k + below] = band[k, below]
    unit = np.sqrt(np.maximum(np.diag(expected), 1e-9))
    np.testing.assert_allclose(found / np.outer(unit, unit), expected / np.outer(unit, unit), atol=2e-6)
    pull = jacobian.T @ (weight * values)
    np.testing.assert_allclose(
        kernels.gradient(case.table, case.first, KNOTS) / unit,
        pull / unit,
        atol=1e-6 * np.sqrt(weight @ values**2),
    )


@given(st.integers(0, 2**31))
@settings(max_examples=10)
def test_pulls_of_clusters_are_those_of_the_dense_inverse(seed: int) -> None:
    case = Case(seed)
    kernels.weigh(case.table, case.first, 4.0, 0.3)
    cluster = np.arange(len(case.first)) // 9
    weight, values = case.table[kernels.WEIGHT, case.inside], case.table[kernels.VALUE, case.inside]
    jacobian = case.derivatives()
    matrix = jacobian.T @ (weight[:, None] * jacobian) + 1e-6 * np.eye(jacobian.shape[1])
    solution = np.linalg.inv(matrix)[:, :2]
    pulls = np.zeros((cluster.max() + 1, 2))
    np.add.at(pulls, cluster[case.inside], (weight * values)[:, None] * (jacobian @ solution))
    found, used = kernels.cluster_pulls(case.table, case.first, cluster, len(pulls), solution)
    expected = pulls.T @ pulls
    np.testing.assert_allclose(found, expected, atol=1e-4 * np.trace(expected))
    assert used == len(np.unique(cluster[case.inside][weight > 0.0]))


def test_an_arrow_is_solved_as_the_whole_matrix_would_be() -> None:
    rng = np.random.default_rng(3)
    jacobian = np.zeros((200, 4 + KNOTS))
    jacobian[:, :4] = rng.standard_normal((200, 4))
    for row, k in zip(jacobian, rng.integers(0, KNOTS - 3, 200), strict=True):
        row[4 + k : 8 + k] = rng.uniform(0.1, 1.0, 4)
    whole = jacobian.T @ jacobian + 0.1 * np.eye(4 + KNOTS)
    band = np.array(
        [[whole[4 + k + b, 4 + k] if k + b < KNOTS else 0.0 for b in range(4)] for k in range(KNOTS)]
    )
    right = rng.standard_normal((4 + KNOTS, 2))
    found = right.copy()
    assert solve_arrow(whole[:4, :4].copy(), whole[4:, :4].copy(), band, found)
    np.testing.assert_allclose(found, np.linalg.solve(whole, right), rtol=1e-9)


def test_a_point_on_the_axis_or_far_away_spoils_nothing() -> None:
    case = Case(1)
    points = np.vstack([case.centre, case.points, [1e6, 0.0, 0.0]])
    count = len(points)
    table, first = np.full((kernels.ROWS, count), np.nan), np.zeros(count, np.int64)
    sigma, rays = np.full(count, 0.02), np.tile([0.0, 0.0, -1.0], (count, 1))
    kernels.rows(
        points, sigma, rays, np.zeros(count), case.centre, case.frame, START, STEP, case.profile, table, first
    )
    assert first[0] == first[-1] == -1
    assert kernels.weigh(table, first, 4.0, 0.3) > 0.0
    assert np.isfinite(kernels.gradient(table, first, KNOTS)).all()
    assert all(np.isfinite(part).all() for part in kernels.normal_matrix(table, first, KNOTS))


@pytest.mark.parametrize("step", [1.0, 8.0])
def test_a_start_profile_follows_the_medians_and_fills_gaps(step: float) -> None:
    rng = np.random.default_rng(4)
    radius = np.r_[rng.uniform(210.0, 240.0, 700), rng.uniform(260.0, 300.0, 700)]
    angle = rng.uniform(0.0, 6.28, len(radius))
    points = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), 0.01 * radius])
    points[::10, 2] += 50.0
    start, profile = kernels.local_medians(points, np.zeros(3), np.eye(3), step)
    knots = start + step * (np.arange(len(profile)) - 1)
    seen = ((knots > 211.0) & (knots < 239.0)) | ((knots > 261.0) & (knots < 299.0))
    np.testing.assert_allclose(profile[seen], 0.01 * knots[seen], atol=0.01 * step)
    assert np.isfinite(profile).all()
    assert knots[-1] > 300.0
