import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from alignment.errors import DegenerateInputError
from alignment.units import ARCMIN
from alignment.wheel.plane import fit_plane
from alignment.wheel.revolution import RevolutionFit, fit_revolution

UP, DOWN = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -1.0])
SPREAD = 0.6  # mm²; lines of 0.8 mm


def profile(radius: np.ndarray) -> np.ndarray:
    """A bulged sidewall with two rings; the fit knows nothing of it."""
    bulge = -0.002 * (radius - 262.0) ** 2
    rings = sum(0.5 * np.exp(-0.5 * ((radius - r) / 1.5) ** 2) for r in (232.0, 291.0))
    return np.asarray(bulge + rings)


def wheel_points(
    tilt: tuple[float, float],
    shift: tuple[float, float],
    rng: np.random.Generator,
    *,
    count: int = 6000,
    noise: float = 0.04,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Radial stretches of 20 points on three 35° sectors of a wheel, their clusters, and the true normal."""
    stretches = count // 20
    angle = rng.choice([90.0, 210.0, 330.0], stretches) + rng.uniform(-17.0, 17.0, stretches)
    angle = np.radians(np.repeat(angle, 20))
    radius = np.repeat(rng.uniform(205.0, 315.0, stretches), 20) + np.tile(np.linspace(0, 3, 20), stretches)
    height = profile(radius)
    local = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), height])
    normal = np.array([tilt[0], tilt[1], 1.0])
    normal /= np.linalg.norm(normal)
    e1 = np.array([1.0, 0.0, 0.0]) - normal[0] * normal
    e1 /= np.linalg.norm(e1)
    frame = np.array([e1, np.cross(normal, e1), normal])
    points = local @ frame + np.array([shift[0], shift[1], 3.0])
    points[:, 2] += noise * rng.standard_normal(len(points))
    return points, np.arange(len(points)) // 20, normal


def fit(points: np.ndarray, cluster: np.ndarray, sigma: float = 0.04) -> RevolutionFit:
    return fit_revolution(
        points,
        np.full(len(points), sigma),
        np.tile(DOWN, (len(points), 1)),
        cluster,
        np.array([0.0, 0.0, 1.0]),
        np.zeros(3),
    )


def tilt_error(found: np.ndarray, true: np.ndarray) -> float:
    return math.acos(min(1.0, float(found @ true))) / ARCMIN


@given(
    st.tuples(st.floats(-0.09, 0.09), st.floats(-0.09, 0.09)),
    st.tuples(st.floats(-8, 8), st.floats(-8, 8)),
    st.integers(0, 2**31),
)
@settings(max_examples=25)
def test_any_tilt_and_position_is_recovered(
    tilt: tuple[float, float], shift: tuple[float, float], seed: int
) -> None:
    points, cluster, normal = wheel_points(tilt, shift, np.random.default_rng(seed))
    result = fit(points, cluster)
    assert tilt_error(result.normal, normal) < 0.05
    # The axis passes through the shifted centre.
    along = (np.array([*shift, 3.0]) - result.centre) @ result.tilt_axes.T
    assert np.abs(along).max() < 0.2


@pytest.mark.parametrize("seed", range(3))
def test_a_bend_within_a_wide_light_line_turns_the_wheel_less_where_the_width_is_known(seed: int) -> None:
    # What a line meets in a bend depends on its direction; before one head something hides the hollows.
    rng = np.random.default_rng(seed)
    points, cluster, normal = wheel_points((0.0, 0.0), (0.0, 0.0), rng, count=60000, noise=0.03)
    radius, step = np.hypot(points[:, 0], points[:, 1]), 0.01
    bend = (profile(radius + step) - 2.0 * profile(radius) + profile(radius - step)) / step**2
    above = points[:, 1] > 100.0
    points[:, 2] += np.where(above, 0.5, 0.05) * SPREAD * bend
    shown = ~above | (bend < 0.02)
    points, cluster = points[shown], cluster[shown]
    sigma, rays = np.full(len(points), 0.03), np.tile(DOWN, (len(points), 1))
    errors = [
        tilt_error(fit_revolution(points, sigma, rays, cluster, UP, np.zeros(3), spread=known).normal, normal)
        for known in (np.full(len(points), SPREAD), None)
    ]
    assert errors[0] < 0.9 * errors[1]


def test_without_noise_only_the_spline_is_left() -> None:
    points, cluster, normal = wheel_points((0.03, -0.05), (5.0, -6.0), np.random.default_rng(1), noise=0.0)
    assert tilt_error(fit(points, cluster).normal, normal) < 0.003


def test_raised_letters_and_a_valve_lose_their_weight() -> None:
    rng = np.random.default_rng(2)
    points, cluster, normal = wheel_points((0.02, 0.04), (3.0, 2.0), rng)
    clean = tilt_error(fit(points, cluster).normal, normal)
    letters = (cluster % 7 == 0) & (points[:, 1] > 0)  # one head sees most of the lettering
    points[letters, 2] += 0.6
    result = fit(points, cluster)
    assert result.weights[letters].mean() < 0.02
    assert tilt_error(result.normal, normal) < clean + 0.02


def test_predicted_covariance_is_the_scatter() -> None:
    """Within 25 % as before, a covariance half as large again passed; within 10 %, the slope of the
    weights taken once for twice."""
    errors, stated = [], []
    for seed in range(250):
        points, cluster, normal = wheel_points(
            (0.0, 0.0), (0.0, 0.0), np.random.default_rng(seed), count=20000
        )
        result = fit(points, cluster)
        errors.append(result.normal[:2] - normal[:2])
        stated.append(result.covariance)
    # 500 errors know a standard deviation to 3 %.
    ratio = math.sqrt(np.square(errors).mean() / np.mean([np.trace(c) / 2.0 for c in stated]))
    # A twentieth too much is stated; of too little hardly anything.
    assert ratio == pytest.approx(0.96, abs=0.06)


def test_a_plane_is_biased_where_the_heads_see_different_parts_of_the_sidewall() -> None:
    points, cluster, normal = wheel_points((0.0, 0.0), (8.0, 0.0), np.random.default_rng(4))
    top = points[:, 1] > 150.0
    keep = ~top | (np.hypot(points[:, 0] - 8.0, points[:, 1]) > 270.0)
    revolution = fit(points[keep], cluster[keep])
    plane = fit_plane(points[keep], revolution.radii(points[keep]), np.array([0.0, 0.0, 1.0]))
    assert tilt_error(revolution.normal, normal) < 0.1
    assert tilt_error(plane.normal, normal) > 1.0


def test_a_plane_of_points_gives_its_normal() -> None:
    rng = np.random.default_rng(5)
    xy = rng.uniform(-300, 300, (2000, 2))
    points = np.column_stack([xy, 0.05 * xy[:, 0] + 0.01 * rng.standard_normal(2000)])
    points[:200, 2] += 5.0
    result = fit_plane(points, np.hypot(*xy.T), np.array([0.0, 0.0, 1.0]))
    true = np.array([-0.05, 0.0, 1.0]) / math.hypot(0.05, 1.0)
    assert tilt_error(result.normal, true) < 0.05


@pytest.mark.parametrize(("deviations", "counts"), [(4.0, True), (5.5, False), (9.0, False), (13.0, False)])
def test_points_five_deviations_from_a_plane_do_not_count(deviations: float, counts: bool) -> None:
    """Letters of a third of a millimetre on one side of the tyre: a wider limit lets them turn the plane."""
    rng, sigma = np.random.default_rng(8), 0.05
    xy = rng.uniform(-300, 300, (2000, 2))
    points = np.column_stack([xy, sigma * rng.standard_normal(2000)])
    raised = (np.arange(2000) < 400) & (xy[:, 0] > 150.0)
    points[raised, 2] = deviations * sigma
    result = fit_plane(points, np.hypot(*xy.T), UP)
    assert (result.weights[raised] > 0.0).all() == counts
    if not counts:
        assert (result.weights[raised] == 0.0).all()
        assert tilt_error(result.normal, UP) < 3.0 * math.sqrt(np.trace(result.covariance)) / ARCMIN


def test_the_stated_covariance_of_a_plane_is_that_of_many_to_a_tenth() -> None:
    """The slope of the weights was left out: a sixth too little was stated."""
    rng = np.random.default_rng(6)
    errors, stated = [], []
    for _ in range(300):
        xy = rng.uniform(-300, 300, (400, 2))
        points = np.column_stack([xy, 0.05 * rng.standard_normal(400)])
        result = fit_plane(points, np.hypot(*xy.T), UP)
        errors.append(result.normal[:2])
        stated.append(np.trace(result.covariance) / 2.0)
    assert math.sqrt(np.square(errors).mean() / np.mean(stated)) == pytest.approx(1.0, abs=0.1)


def test_the_stated_interval_of_a_plane_holds_the_truth_on_a_sidewall_with_relief() -> None:
    """What stands out at one radius does so before every head: lines counted as many that know it each."""
    rng, inside = np.random.default_rng(11), []
    for _ in range(250):
        # Three heads, each sees a patch of a wheel whose axis stands a few millimetres beside theirs.
        beside = rng.uniform(-8.0, 8.0, 2)
        angle = np.radians(np.repeat([90.0, 210.0, 330.0], 500) + rng.uniform(-8.0, 8.0, 1500))
        xy = rng.uniform(225.0, 305.0, 1500)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        radius = np.hypot(*(xy - beside).T)
        knots = np.arange(200.0, 330.0, 4.0)
        relief = np.interp(radius, knots, 0.3 * rng.standard_normal(len(knots)))
        points = np.column_stack([xy, relief + 0.02 * rng.standard_normal(1500)])
        plane = fit_plane(points, radius, UP)
        turn = plane.tilt_axes[:, :2]
        inside.append(np.abs(plane.normal[:2]) <= 1.96 * np.sqrt(np.diag(turn.T @ plane.covariance @ turn)))
    assert 0.92 <= np.mean(inside) <= 0.98


def test_points_on_a_line_are_refused() -> None:
    points = np.outer(np.linspace(0, 1, 100), [1.0, 2.0, 3.0])
    with pytest.raises(DegenerateInputError, match="line"):
        fit_plane(points, np.hypot(*points[:, :2].T), np.array([0.0, 0.0, 1.0]))


def test_too_few_points_are_refused() -> None:
    points, cluster, _ = wheel_points((0.0, 0.0), (0.0, 0.0), np.random.default_rng(0), count=30)
    with pytest.raises(DegenerateInputError, match="at least 50"):
        fit(points, cluster)


def test_a_process_that_does_nothing_but_fit_a_wheel_ends_well() -> None:
    # Kernels that start threads bring them up when they are compiled, but not when they come from the disk.
    code = (
        "import numpy as np\n"
        "from tests.alignment.wheel.test_revolution import fit, wheel_points\n"
        "points, cluster, _ = wheel_points((0.01, -0.02), (2.0, 1.0), np.random.default_rng(1))\n"
        "fit(points, cluster)\n"
    )
    for _ in range(2):
        subprocess.run([sys.executable, "-c", code], cwd=Path(__file__).parents[3], check=True, timeout=200)
