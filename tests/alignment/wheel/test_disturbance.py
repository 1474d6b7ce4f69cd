import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from alignment.wheel.disturbance import undisturbed
from alignment.wheel.revolution import fit_revolution
from tests.alignment.wheel.test_revolution import DOWN, fit, tilt_error, wheel_points

LINES, LENGTH = 20, 400


def noise(seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.standard_normal(LINES * LENGTH), np.arange(LINES * LENGTH) // LENGTH


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_noise_alone_costs_few_points(seed: int) -> None:
    ratio, line = noise(seed)
    assert undisturbed(ratio, np.ones(ratio.size, bool), line, 1.0).mean() > 0.97


def test_a_stretch_shifted_by_less_than_any_point_would_show_is_left_out() -> None:
    ratio, line = noise(1)
    ratio[4100:4140] += 2.0
    keep = undisturbed(ratio, np.ones(ratio.size, bool), line, 1.0)
    assert not keep[4105:4135].any()
    assert keep[:4080].mean() > 0.97


def test_the_flanks_of_a_letter_go_with_it() -> None:
    ratio, line = noise(2)
    ratio[5000:5020] += 40.0
    keep = undisturbed(ratio, np.ones(ratio.size, bool), line, 1.0)
    assert not keep[4996:5024].any()


def test_what_disturbs_the_end_of_a_line_leaves_the_next_line_alone() -> None:
    ratio, line = noise(3)
    ratio[LENGTH - 10 : LENGTH] += 40.0
    keep = undisturbed(ratio, np.ones(ratio.size, bool), line, 1.0)
    assert not keep[LENGTH - 10 : LENGTH].any()
    assert keep[LENGTH : LENGTH + 20].all()


def test_points_beyond_the_profile_are_left_out_with_their_neighbours_only() -> None:
    ratio, line = noise(4)
    inside = np.ones(ratio.size, bool)
    inside[2100] = False
    ratio[2100] = np.nan
    keep = undisturbed(ratio, inside, line, 1.0)
    assert not keep[2098:2103].any()
    assert keep.mean() > 0.97


def test_a_slightly_raised_patch_on_one_side_pulls_the_axis_less_when_lines_are_known() -> None:
    known_error = without_error = 0.0
    for seed in range(5):
        points, cluster, true = wheel_points((0.01, -0.02), (2.0, 1.0), np.random.default_rng(seed))
        # One head's stretches between two radii stand 0.1 mm, two and a half deviations, above the sidewall.
        radius = np.hypot(points[:, 0], points[:, 1])
        patch = (points[:, 1] > 0) & (abs(points[:, 0]) < 60) & (radius > 250) & (radius < 265)
        points[patch, 2] += 0.1
        without_error += tilt_error(fit(points, cluster).normal, true)
        sigma, rays = np.full(len(points), 0.04), np.tile(DOWN, (len(points), 1))
        known = fit_revolution(
            points, sigma, rays, cluster, np.array([0.0, 0.0, 1.0]), np.zeros(3), line=cluster
        )
        known_error += tilt_error(known.normal, true)
    assert known_error < 0.7 * without_error
