"""The steering axis of wheels whose axis is known: exact, honest, and refused where it cannot be told."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import kstest

from alignment.arrays import Array
from alignment.errors import DegenerateInputError
from alignment.units import ARCMIN
from alignment.values import Refusal, RefusalCode, Side
from alignment.vehicle.front_wheels import steered_pair, straight_toe
from alignment.vehicle.steering import steering_axis
from alignment.vehicle.steering_values import (
    MOST_POSITIONS,
    RunOut,
    SteeredWheel,
    SteeringAxis,
    SteeringRules,
    SteeringStand,
)
from alignment.vehicle.wheel_axes import WheelAxis
from tests.steered import NOISE, SteeredTruth, even, own_covariance, shaken

CAR = SteeredTruth()


def found(
    series: list[SteeredWheel], truth: SteeredTruth = CAR, rules: SteeringRules | None = None
) -> SteeringAxis:
    out = steering_axis(series, truth.stand, rules, truth.lean if truth.run_out else None)
    assert isinstance(out, SteeringAxis), out
    return out


def refused(series: list[SteeredWheel], rules: SteeringRules | None = None) -> Refusal:
    out = steering_axis(series, CAR.stand, rules)
    assert isinstance(out, Refusal)
    return out


@settings(max_examples=30, deadline=None)
@given(
    side=st.sampled_from(["left", "right"]),
    caster=st.floats(-2.0, 12.0),
    kpi=st.floats(2.0, 18.0),
    camber=st.floats(-3.0, 2.0),
    scrub=st.floats(-40.0, 60.0),
    trail=st.floats(-10.0, 60.0),
    yaw=st.floats(-0.02, 0.02),
    run_out=st.floats(0.0, 0.006),
)
def test_without_noise_every_quantity_is_exact(
    side: Side,
    caster: float,
    kpi: float,
    camber: float,
    scrub: float,
    trail: float,
    yaw: float,
    run_out: float,
) -> None:
    truth = SteeredTruth(
        side, math.radians(caster), math.radians(kpi), scrub, trail, math.radians(camber), yaw, run_out
    )
    axis = found(truth.sweep(even()), truth)
    for name, value in truth.values.items():
        assert axis.value(name) == pytest.approx(value, abs=1e-9 if name not in ("trail", "scrub") else 1e-8)
    np.testing.assert_allclose(axis.angles, even(), atol=1e-9)
    assert axis.warning is None


def test_signs_caster_leans_the_top_rearward_and_kingpin_inclination_inboard_on_both_sides() -> None:
    for side, outboard in (("left", 1.0), ("right", -1.0)):
        truth = replace(CAR, side=side)  # type: ignore[arg-type]
        axis = found(truth.sweep(even()), truth)
        assert axis.direction[0] < 0.0
        assert outboard * axis.direction[1] < 0.0
        assert axis.direction[2] > 0.0
        # Trail: the axis meets the road ahead of the contact; a positive scrub radius: inboard of it.
        assert axis.point[0] == pytest.approx(1350.0 + CAR.trail, abs=1e-6)
        assert outboard * axis.point[1] < 756.0


def test_the_order_of_positions_and_uneven_steps_do_not_matter() -> None:
    rng = np.random.default_rng(3)
    series = CAR.sweep(np.radians([-9.7, -8, -7.4, -3, -1, 0.2, 0.5, 4, 5, 6, 8, 9.1]))
    rng.shuffle(series)  # type: ignore[arg-type]
    assert found(series).value("kpi") == pytest.approx(CAR.kpi, abs=1e-9)


def test_a_rolling_run_out_that_nobody_knows_of_is_taken_for_caster() -> None:
    """2 mm of run-out and a scrub radius of 14 mm: half a minute, which the roll's model takes off."""
    truth = replace(CAR, run_out=1.0 / 300.0)
    series = truth.sweep(even())
    blind = steering_axis(series, truth.stand)
    assert isinstance(blind, SteeringAxis)
    assert abs(blind.value("caster") - truth.caster) > 0.3 * ARCMIN
    assert found(series, truth).value("caster") == pytest.approx(truth.caster, abs=1e-9)
    # With the brakes held nothing rolls, and nothing needs to be known.
    braked = replace(truth, rolls=0.0)
    still = steering_axis(braked.sweep(even()), braked.stand)
    assert isinstance(still, SteeringAxis)
    assert still.value("caster") == pytest.approx(truth.caster, abs=1e-9)


def test_an_uncertain_run_out_makes_caster_less_sure() -> None:
    truth = replace(CAR, run_out=1.0 / 300.0)
    series = truth.sweep(even(), own_covariance())
    lean = truth.lean
    doubtful = RunOut(lean.camber, lean.toe, np.eye(2) * (3.0 * ARCMIN) ** 2)
    sure = found(series, truth)
    less = steering_axis(series, truth.stand, None, doubtful)
    assert isinstance(less, SteeringAxis)
    assert less.u("caster") > 1.5 * sure.u("caster")


def test_a_camber_that_drifts_to_lock_is_what_makes_kingpin_inclination_unsure() -> None:
    """0.02′ from straight ahead to ±10° is 1.3′ of KPI."""
    angles = even()
    errors = np.zeros((len(angles), 5))
    errors[:, 0] = 0.02 * ARCMIN * (angles / angles.max()) ** 2
    plain = CAR.sweep(angles, own_covariance(0.005 * ARCMIN))
    off = found(shaken(plain, errors)).value("kpi") - CAR.kpi
    assert abs(off) == pytest.approx(1.3 * ARCMIN, rel=0.1)
    # Who does not know of a load states less than that; the drift of one is stated.
    load = np.eye(2) * (0.04 * ARCMIN) ** 2
    loaded = [replace(wheel, load_covariance=load) for wheel in plain]
    assert found(plain).u("kpi") < 0.2 * ARCMIN
    assert found(loaded).u("kpi") == pytest.approx(0.25 * 0.04 / 0.0152 * ARCMIN, rel=0.1)
    # What is the same at all positions turns nothing.
    steady = SteeringRules(load_drift=0.0)
    assert found(loaded, rules=steady).u("kpi") == pytest.approx(found(plain).u("kpi"), rel=0.02)


def test_what_all_positions_share_drops_out_of_the_axis_and_stays_in_camber() -> None:
    shared = np.zeros((5, 1))
    shared[0, 0] = 1.0 * ARCMIN
    plain = CAR.sweep(even(), own_covariance())
    axis = found([replace(wheel, common=shared) for wheel in plain])
    assert axis.u("kpi") < found(plain).u("kpi") + 0.05 * ARCMIN
    assert axis.u("camber") == pytest.approx(ARCMIN, rel=0.05)
    assert axis.u("included_angle") == pytest.approx(ARCMIN, rel=0.35)


def test_a_rig_that_is_turned_about_the_wheels_axis_turns_caster_and_says_so() -> None:
    """No single shot sees that turn: camber and toe of a wheel that is steered straight ahead keep."""
    tilt = 0.5 * ARCMIN
    plain = CAR.sweep(even(), own_covariance())
    shared = []
    for wheel in plain:
        n = wheel.axis.normal
        turned = np.cross([0.0, tilt, 0.0], n)
        column = np.zeros((5, 1))
        column[:2, 0] = np.linalg.lstsq(wheel.axis.normal_by_angles, turned, rcond=None)[0]
        shared.append(replace(wheel, common=column))
    off = found(shaken(shared, np.array([wheel.common[:, 0] for wheel in shared])))
    assert abs(off.value("caster") - CAR.caster) == pytest.approx(tilt, rel=0.05)
    assert off.u("caster") == pytest.approx(tilt, rel=0.05)


def test_a_thrust_line_that_is_unsure_makes_kingpin_inclination_and_caster_unsure() -> None:
    series = CAR.sweep(even())
    axis = steering_axis(series, replace(CAR.stand, heading_u=2.0 * ARCMIN))
    assert isinstance(axis, SteeringAxis)
    # About the vertical by ε: caster by ε tan KPI, KPI by ε tan caster.
    assert axis.u("caster") == pytest.approx(2.0 * ARCMIN * math.tan(CAR.kpi), rel=0.05)


def test_intervals_are_true_and_pulls_are_normal() -> None:
    rng = np.random.default_rng(5)
    covariance = own_covariance()
    covariance[0, 1] = covariance[1, 0] = 0.5 * covariance[0, 0]
    root = np.linalg.cholesky(covariance)
    shared = np.zeros((5, 2))
    shared[:2] = [[3.0 * NOISE, 0.0], [0.0, 2.0 * NOISE]]
    plain = [replace(wheel, common=shared) for wheel in CAR.sweep(even(), covariance)]
    pulls, chances = [], []
    for _ in range(60):
        errors = rng.standard_normal((len(plain), 5)) @ root.T + shared @ rng.standard_normal(2)
        axis = found(shaken(plain, errors))
        pulls.append([(axis.value(name) - value) / axis.u(name) for name, value in CAR.values.items()])
        chances.append(axis.pattern_p)
    inside = np.mean(np.abs(pulls) < 2.0, axis=0)
    assert (inside > 0.85).all()
    assert (np.std(pulls, axis=0) < 1.3).all()
    assert (np.std(pulls, axis=0) > 0.7).all()
    # The residual test accuses wheels with one axis as seldom as it says.
    assert kstest(chances, "uniform").pvalue > 0.01


def test_positions_that_scatter_more_than_stated_are_less_sure() -> None:
    rng = np.random.default_rng(2)
    series = CAR.sweep(even(), own_covariance())
    errors = rng.standard_normal((len(series), 5)) * np.sqrt(np.diag(own_covariance()))
    honest, noisy = found(shaken(series, errors)), found(shaken(series, 4.0 * errors))
    assert noisy.u("kpi") == pytest.approx(4.0 * honest.u("kpi"), rel=0.2)
    assert honest.warning is None
    assert noisy.warning is not None
    assert "scatter" in noisy.warning


def test_an_axis_that_moves_while_it_turns_is_told_by_its_pattern() -> None:
    """A bushing that gives way near lock: the top goes inboard by a third of a degree, to one side only."""
    angles = even()
    rng = np.random.default_rng(4)
    truth = replace(CAR, run_out=0.0)
    series = []
    for angle in angles:
        give = np.array([0.0, 20.0 * ARCMIN * max(angle / angles.max(), 0.0) ** 3, 0.0])
        camber, toe, point = truth.at(float(angle), give)
        series.append(SteeredWheel(WheelAxis("left", camber, toe, point, own_covariance())))
    errors = rng.standard_normal((len(series), 5)) * np.sqrt(np.diag(own_covariance()))
    wide = SteeringRules(caster_u95=math.radians(1.0), kpi_u95=math.radians(10.0))
    axis = found(shaken(series, errors), rules=wide)
    assert axis.warning is not None
    assert "moves while the wheel turns" in axis.warning
    assert axis.pattern_p < 1e-3
    assert abs(axis.value("kpi") - CAR.kpi) < axis.u95("kpi")
    assert abs(axis.value("caster") - CAR.caster) < axis.u95("caster")
    # Where it is asked how sure, that is no answer.
    assert (
        refused(shaken(series, errors), SteeringRules(kpi_u95=1.0 * ARCMIN)).code
        is RefusalCode.SWEEP_TOO_SMALL
    )


def test_a_body_that_rises_on_its_springs_is_no_part_of_the_direction() -> None:
    series = CAR.sweep(even(), own_covariance())
    lifted = np.zeros((len(series), 5))
    lifted[:, 4] = 3.0 * (even() / even().max()) ** 2
    axis = found(shaken(series, lifted))
    assert axis.value("kpi") == pytest.approx(CAR.kpi, abs=1e-9)
    assert np.ptp(axis.axial_mm) == pytest.approx(3.0, abs=0.2)


@pytest.mark.parametrize("reach", [0.0, 0.5, 2.0, 4.0, 7.0])
def test_a_small_sweep_is_refused(reach: float) -> None:
    refusal = refused(CAR.sweep(even(reach), own_covariance()))
    assert refusal.code in (RefusalCode.SWEEP_TOO_SMALL, RefusalCode.TOO_FEW_POSITIONS)
    assert refusal.reason.count(";") == 1


def test_a_sweep_of_two_degrees_is_refused_as_too_small_however_little_is_asked() -> None:
    little = SteeringRules(caster_u95=1.0, kpi_u95=1.0)
    assert refused(CAR.sweep(even(2.0), own_covariance()), little).code is RefusalCode.SWEEP_TOO_SMALL


def test_a_sweep_to_one_side_is_refused() -> None:
    refusal = refused(CAR.sweep(np.radians(np.linspace(-1.0, 19.0, 41)), own_covariance()))
    assert refusal.code is RefusalCode.SWEEP_TOO_SMALL
    assert "18.5°" in refusal.reason
    assert "1.0°" in refusal.reason


def test_too_few_or_doubled_positions_are_refused() -> None:
    assert refused([]).code is RefusalCode.TOO_FEW_POSITIONS
    assert refused(CAR.sweep(even(10.0, 8))).code is RefusalCode.TOO_FEW_POSITIONS
    # Forty exposures at four angles are four positions.
    doubled = CAR.sweep(np.repeat(np.radians([-10.0, -4.0, 3.0, 10.0]), 10))
    assert "4 different positions" in refused(doubled).reason


def test_a_gap_in_the_sweep_is_refused() -> None:
    ends = np.radians([*np.linspace(-10.0, -6.0, 10), *np.linspace(6.0, 10.0, 10)])
    assert refused(CAR.sweep(ends)).code is RefusalCode.TOO_FEW_POSITIONS


def test_what_is_not_as_sure_as_asked_is_refused_with_both_figures() -> None:
    series = CAR.sweep(even(8.0, 9), own_covariance(0.2 * ARCMIN))
    refusal = refused(series)
    assert refusal.code is RefusalCode.SWEEP_TOO_SMALL
    assert "inclination" in refusal.reason
    assert "±10′" in refusal.reason


def test_a_wheel_that_is_turned_by_hand_about_nothing_is_no_steered_wheel() -> None:
    rng = np.random.default_rng(1)
    series = CAR.sweep(even(), own_covariance())
    wild = np.zeros((len(series), 5))
    wild[:, 0] = rng.normal(0.0, math.radians(0.5), len(series))
    assert refused(shaken(series, wild)).code is RefusalCode.NO_STEERING_AXIS
    # A wheel that nods is turned about an axis that lies.
    nods = np.zeros((len(series), 5))
    nods[:, 0] = 1.2 * even()
    assert refused(shaken(series, nods)).code is RefusalCode.NO_STEERING_AXIS


@pytest.mark.parametrize("many", [MOST_POSITIONS + 1])
def test_what_no_caller_may_hand_in_is_an_error(many: int) -> None:
    one = CAR.sweep([0.0])
    with pytest.raises(DegenerateInputError, match="series"):
        steering_axis(one * many)
    with pytest.raises(DegenerateInputError, match="one wheel"):
        steering_axis([*one, *replace(CAR, side="right").sweep([0.0])])
    with pytest.raises(DegenerateInputError, match="common"):
        steering_axis([*one, replace(one[0], common=np.zeros((5, 2)))])
    with pytest.raises(DegenerateInputError, match="common"):
        SteeredWheel(one[0].axis, np.full((5, 1), np.nan))
    with pytest.raises(DegenerateInputError, match="run_out"):
        steering_axis(CAR.sweep(even()), SteeringStand(), None, RunOut(0.001, 0.0))


def test_without_a_road_there_is_no_trail_and_no_scrub_radius() -> None:
    axis = steering_axis(CAR.sweep(even()))
    assert isinstance(axis, SteeringAxis)
    assert list(axis.values) == ["caster", "kpi", "included_angle", "camber"]
    assert axis.covariance.shape == (4, 4)
    with pytest.raises(KeyError):
        axis.value("trail")


def test_the_classic_formula_errs_by_more_than_a_minute() -> None:
    """By 1.5′ at a caster of 6°, a kingpin inclination of 12° and no camber."""
    upright = replace(CAR, camber=0.0)
    for side in ("left", "right"):
        truth = replace(upright, side=side)  # type: ignore[arg-type]
        axis = found(truth.sweep(even()), truth)
        assert axis.classic_caster - truth.caster == pytest.approx(1.5 * ARCMIN, abs=0.05 * ARCMIN)


def _steered(angles: Array) -> tuple[SteeringAxis, SteeringAxis]:
    """Left and right by Ackermann: the inner wheel turns farther."""
    left, right = CAR, replace(CAR, side="right", caster=math.radians(5.5))
    inner, outer = 1.0 + 0.15 * np.abs(angles), 1.0 - 0.15 * np.abs(angles)
    of_left = angles * np.where(angles > 0.0, inner, outer)
    of_right = angles * np.where(angles > 0.0, outer, inner)
    cov = own_covariance()
    return found(left.sweep(of_left, cov), left), found(right.sweep(of_right, cov), right)


def test_toe_out_on_turns_and_locks() -> None:
    left, right = _steered(even(11.0))
    pair = steered_pair(left, right, stop_left=True)
    assert pair.inner_angle == pytest.approx(math.radians(10.0))
    assert math.radians(0.3) < pair.toe_out_left < math.radians(0.8)
    assert pair.toe_out_right == pytest.approx(pair.toe_out_left, rel=0.1)
    assert pair.lock_right is None
    assert pair.lock_left is not None
    assert pair.lock_left[0] > pair.lock_left[1] > math.radians(9.0)
    assert pair.differences["caster"] == pytest.approx(math.radians(0.5), abs=1e-9)
    assert pair.differences_u["caster"] > left.u("caster")


def test_a_sweep_that_does_not_reach_the_asked_angle_tells_the_one_it_reached() -> None:
    left, right = _steered(even(9.0))
    assert math.radians(8.5) < steered_pair(left, right, math.radians(20.0)).inner_angle < math.radians(10.0)


def test_wheels_of_two_sweeps_make_no_pair() -> None:
    left, right = _steered(even())
    for pair in ((right, left), (left, replace(right, toes=right.toes[1:]))):
        with pytest.raises(DegenerateInputError, match="one sweep"):
            steered_pair(*pair)


def test_straight_ahead_is_where_both_toes_are_the_same() -> None:
    toe = math.radians(0.12)
    left, right = [], []
    for angle in even():
        for side, series in (("left", left), ("right", right)):
            truth = replace(CAR, side=side, yaw=0.005)  # type: ignore[arg-type]
            (wheel,) = truth.sweep([float(angle) + 0.01])
            series.append(shaken([wheel], np.array([[0.0, toe, 0.0, 0.0, 0.0]]))[0])
    assert straight_toe(left, right, 0.005) == pytest.approx(toe, abs=1e-5)
    with pytest.raises(DegenerateInputError, match="straight ahead"):
        straight_toe(left[30:], right[30:], 0.005)
    with pytest.raises(DegenerateInputError, match="positions"):
        straight_toe(left, right[1:], 0.005)
