"""The spin axis from tyre planes at unknown turns: exact, with a true uncertainty, and when it is refused."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from alignment.measure_spin import measure_spin
from alignment.units import ARCMIN
from alignment.values import (
    MeasureSettings,
    Refusal,
    RefusalCode,
    Side,
    StereoImages,
    WheelMeasurement,
)
from alignment.vehicle.angles import camber_toe
from alignment.wheel.spin import SpinMeasurement, fit_spin_axis
from sensors.simulation.render import simulate_shot
from sensors.simulation.rigs import RIG_SPECS, build_rig
from sensors.simulation.scene import RUN_OUT_RADIUS_MM, WheelPose, draw_scene, truth_of
from tests.assertions import assert_angle_within
from tests.strategies import sides, small_angles

NOISE = 0.02 * ARCMIN
RUN_OUT = math.radians(0.5)
FULL_TURN = math.radians(360.0) * np.arange(8) / 8


def plane(camber: float, toe: float, u: float = NOISE) -> WheelMeasurement:
    return WheelMeasurement(
        camber=camber,
        toe=toe,
        angle_covariance=np.diag([u**2, u**2]),
        normal=np.array([0.0, 0.0, 1.0]),
        centre=np.zeros(3),
        offset_mm=0.0,
        points_used=9000,
        residual_rms_mm=0.03,
        heads=(),
        method="tyre_plane/revolution",
    )


def series(
    spins: np.ndarray,
    *,
    run_out: float = RUN_OUT,
    camber: float = 0.0,
    toe: float = 0.0,
    side: Side = "left",
    noise: float = 0.0,
    rng: np.random.Generator | None = None,
) -> list[WheelMeasurement]:
    """Tyre planes of one wheel at these turns; stated noise is `NOISE`, the real one as asked."""
    pose = WheelPose(camber=camber, toe=toe, run_out=run_out)
    found = []
    for spin in spins:
        angles = camber_toe(replace(pose, spin=float(spin)).vehicle_from_tyre(side)[:, 2], side)
        off = np.zeros(2) if rng is None else noise * rng.normal(size=2)
        found.append(plane(angles[0] + off[0], angles[1] + off[1]))
    return found


def accepted(found: SpinMeasurement | Refusal) -> SpinMeasurement:
    assert isinstance(found, SpinMeasurement), found
    return found


def refused(found: SpinMeasurement | Refusal) -> Refusal:
    assert isinstance(found, Refusal), found
    assert not found
    return found


@given(
    side=sides,
    camber=small_angles,
    toe=small_angles,
    run_out=st.floats(math.radians(0.01), math.radians(4.0)),
    start=st.floats(0.0, 2.0 * math.pi),
    arc=st.floats(math.radians(125.0), math.radians(330.0)),
    shots=st.integers(8, 30),
)
@settings(max_examples=60)
def test_axis_run_out_and_turns_are_recovered_exactly(
    side: Side, camber: float, toe: float, run_out: float, start: float, arc: float, shots: int
) -> None:
    turns = np.linspace(0.0, arc, shots)
    found = accepted(
        fit_spin_axis(series(start + turns, run_out=run_out, camber=camber, toe=toe, side=side), side)
    )
    assert_angle_within(found.camber, camber, 1e-5, "camber")
    assert_angle_within(found.toe, toe, 1e-5, "toe")
    assert found.run_out == pytest.approx(run_out, abs=1e-9)
    assert found.phases is not None
    assert np.unwrap(found.phases) - found.phases[0] == pytest.approx(turns, abs=1e-4)
    # Seen from outboard x, from which the simulator counts, lies a quarter turn clockwise of the top,
    # but for the product of camber and toe.
    assert math.remainder(found.phases[0] - (start - math.pi / 2), 2 * math.pi) == pytest.approx(0, abs=0.015)
    assert found.shots_used == shots
    # A full turn less the largest gap, which is one between two shots where they nearly make the turn.
    gap = max(2 * math.pi - arc, arc / (shots - 1))
    assert found.covered_turn == pytest.approx(2 * math.pi - gap, abs=1e-3)
    assert found.method == "spin_axis"


def test_run_out_in_millimetres_is_peak_to_peak_at_a_radius() -> None:
    found = accepted(fit_spin_axis(series(FULL_TURN), "left"))
    assert found.run_out_mm(300.0) == pytest.approx(2 * 300 * math.sin(RUN_OUT))


@pytest.mark.parametrize("arc_deg", [125.0, 180.0, 330.0])
def test_the_stated_covariance_is_that_of_many_series(arc_deg: float) -> None:
    rng = np.random.default_rng(3)
    errors, stated = [], []
    for _ in range(150):
        spins = rng.uniform(0, 2 * math.pi) + np.linspace(0.0, math.radians(arc_deg), 16)
        found = fit_spin_axis(series(spins, noise=NOISE, rng=rng), "left")
        if found:
            errors.append([found.camber, found.toe])
            stated.append(found.angle_covariance)
    assert len(errors) >= 120
    predicted = np.sqrt(np.trace(np.mean(stated, axis=0)))
    assert math.sqrt(np.square(errors).sum(axis=1).mean()) / predicted == pytest.approx(1.0, abs=0.1)
    inside = np.abs(errors) <= 2 * np.sqrt(np.array([np.diag(c) for c in stated]))
    assert 0.9 <= inside.mean() <= 1.0


def test_the_stated_run_out_is_that_of_many_series() -> None:
    rng = np.random.default_rng(4)
    errors, stated = [], []
    for _ in range(300):
        found = accepted(fit_spin_axis(series(rng.uniform(0, 6) + FULL_TURN, noise=NOISE, rng=rng), "left"))
        assert found.run_out is not None
        errors.append(found.run_out - RUN_OUT)
        stated.append(found.run_out_u)
    # Noise is never taken for less than was stated: of so few shots a little too much is stated.
    assert np.std(errors) / math.sqrt(np.square(stated).mean()) == pytest.approx(0.95, abs=0.1)


def waved(wave: float, shots: int = 12) -> tuple[list[WheelMeasurement], float]:
    """Shots of a full turn with three waves on their circle, and the scatter that this is, radians.

    No axis and no run-out follows three waves, so that all of it is residual.
    """
    turns = 2.0 * math.pi * np.arange(shots) / shots
    off = wave * np.cos(3.0 * turns)
    planes = [series(np.array([t]), run_out=RUN_OUT + o)[0] for t, o in zip(turns, off, strict=True)]
    return planes, math.sqrt(float(np.square(off).sum()) / (shots - 3))


def test_shots_noisier_than_stated_are_counted_with_the_three_unknowns_of_a_cone() -> None:
    """Divided by the number of shots, the noise of a few looks smaller than it is: of eight by a fifth."""
    planes, scatter = waved(3.0 * NOISE)
    found = accepted(fit_spin_axis(planes, "left"))
    assert found.run_out == pytest.approx(RUN_OUT, abs=1e-3 * NOISE)
    # Each shot sees one of both tilts: together they are known as from half of them.
    expected = scatter**2 * 2.0 / len(planes) * np.eye(2)
    assert found.angle_covariance == pytest.approx(expected, rel=0.01, abs=1e-13)


def test_shots_may_scatter_by_an_arcminute() -> None:
    (_, of_one), limit = waved(ARCMIN), ARCMIN
    planes, _ = waved(0.98 * limit * ARCMIN / of_one)
    accepted(fit_spin_axis(planes, "left"))
    planes, _ = waved(1.02 * limit * ARCMIN / of_one)
    found = refused(fit_spin_axis(planes, "left"))
    assert found.code is RefusalCode.INCONSISTENT_SHOTS
    assert "the others scatter by 1.02′" in found.reason


@pytest.mark.parametrize(("degrees", "is_one"), [(4.95, True), (5.05, False)])
def test_a_tyre_may_sit_aslant_by_five_degrees(degrees: float, is_one: bool) -> None:
    found = fit_spin_axis(series(FULL_TURN, run_out=math.radians(degrees)), "left")
    if is_one:
        assert accepted(found).run_out == pytest.approx(math.radians(degrees))
    else:
        assert refused(found).code is RefusalCode.INCONSISTENT_SHOTS


@pytest.mark.parametrize("run_out", [RUN_OUT, 0.0])
@pytest.mark.parametrize("factor", [1.0, 3.0])
def test_the_expanded_uncertainty_has_the_factor_of_the_shots(run_out: float, factor: float) -> None:
    """With two in place of it, a station that asks for three would be told too little."""
    rng = np.random.default_rng(6)
    shots = series(FULL_TURN, run_out=run_out, noise=NOISE, rng=rng)
    found = accepted(fit_spin_axis([replace(m, coverage_factor=factor) for m in shots], "left"))
    assert (found.run_out is None) == (run_out == 0.0)
    assert found.camber_u95 == pytest.approx(factor * math.sqrt(found.angle_covariance[0, 0]))
    assert found.toe_u95 == pytest.approx(factor * math.sqrt(found.angle_covariance[1, 1]))


@pytest.mark.parametrize("arc_deg", [5.0, 30.0])
def test_hidden_run_out_of_a_wheel_that_hardly_turned_is_in_the_uncertainty(arc_deg: float) -> None:
    """As large as one shot's noise, it is not seen, and does not average out over shots of one turn."""
    rng = np.random.default_rng(21)
    errors, stated = [], []
    for _ in range(100):
        spins = rng.uniform(0.0, 2.0 * math.pi) + np.linspace(0.0, math.radians(arc_deg), 16)
        found = fit_spin_axis(series(spins, run_out=NOISE, noise=NOISE, rng=rng), "left")
        if found:
            errors.append([found.camber, found.toe])
            stated.append(np.diag(found.angle_covariance))
            assert found.run_out is None
    assert len(errors) >= 98
    assert math.sqrt(np.square(errors).mean() / np.mean(stated)) == pytest.approx(1.0, abs=0.15)
    assert (np.abs(errors) <= 2.0 * np.sqrt(stated)).mean() >= 0.95


def test_a_shorter_arc_has_a_larger_uncertainty() -> None:
    def total_u(arc_deg: float) -> float:
        found = accepted(fit_spin_axis(series(np.linspace(0.0, math.radians(arc_deg), 12)), "left"))
        return math.hypot(found.camber_u, found.toe_u)

    uncertainties = [total_u(arc_deg) for arc_deg in (330.0, 180.0, 125.0)]
    assert uncertainties == sorted(uncertainties)
    assert uncertainties[2] > 2 * uncertainties[0]


def test_more_noise_than_stated_shows_in_the_uncertainty() -> None:
    rng = np.random.default_rng(1)
    quiet = accepted(fit_spin_axis(series(FULL_TURN, noise=NOISE, rng=rng), "left"))
    loud = accepted(fit_spin_axis(series(FULL_TURN, noise=10 * NOISE, rng=rng), "left"))
    assert loud.camber_u > 3 * quiet.camber_u


def test_what_all_shots_share_does_not_average_out() -> None:
    common = np.diag([(0.05 * ARCMIN) ** 2, (0.03 * ARCMIN) ** 2])
    alone = series(FULL_TURN)
    shots = [replace(m, angle_covariance=m.angle_covariance + common) for m in alone]
    expected = accepted(fit_spin_axis(alone, "left")).angle_covariance + common
    found = accepted(fit_spin_axis(shots, "left", common))
    assert found.angle_covariance == pytest.approx(expected, rel=1e-9)


def test_two_wrong_shots_of_eight_are_left_out() -> None:
    shots = series(FULL_TURN, camber=0.01, toe=-0.02)
    shots[2] = plane(0.01 + 0.02, -0.02)
    shots[5] = plane(0.01, -0.02)
    found = accepted(fit_spin_axis(shots, "left"))
    assert [k for k, used in enumerate(found.used) if not used] == [2, 5]
    assert_angle_within(found.camber, 0.01, 1e-4, "camber")
    assert_angle_within(found.toe, -0.02, 1e-4, "toe")


@pytest.mark.parametrize("shots", [8, 11, 12])
def test_more_wrong_shots_than_a_quarter_are_not_left_out(shots: int) -> None:
    turns = 2.0 * math.pi * np.arange(shots) / shots
    rng = np.random.default_rng(shots)
    for wrong, is_one in ((shots // 4, True), (shots // 4 + 1, False)):
        planes = series(turns, noise=NOISE, rng=rng)
        for k in range(wrong):
            planes[2 * k] = plane(0.02 + 0.003 * k, -0.03 * (-1) ** k)
        found = fit_spin_axis(planes, "left")
        if is_one:
            assert accepted(found).shots_used == shots - wrong
        else:
            assert refused(found).code is RefusalCode.INCONSISTENT_SHOTS


def test_run_out_below_the_noise_leaves_the_turn_unknown() -> None:
    rng = np.random.default_rng(5)
    found = accepted(fit_spin_axis(series(FULL_TURN, run_out=0.0, noise=NOISE, rng=rng), "left"))
    assert found.run_out is None
    assert found.phases is None
    assert found.covered_turn is None
    assert found.run_out_mm(300.0) is None
    assert found.run_out_u == pytest.approx(NOISE, rel=0.5)
    assert_angle_within(found.camber, 0.0, 0.02, "camber")
    assert found.camber_u < NOISE


def test_a_degraded_shot_marks_the_result() -> None:
    shots = series(FULL_TURN)
    shots[3] = replace(shots[3], degraded=True)
    assert accepted(fit_spin_axis(shots, "left")).degraded


def test_seven_shots_are_too_few() -> None:
    found = refused(fit_spin_axis(series(FULL_TURN[:7]), "left"))
    assert found.code is RefusalCode.TOO_FEW_SHOTS
    assert "at least 8" in found.reason


@pytest.mark.parametrize("arc_deg", [5.0, 40.0, 110.0])
def test_run_out_on_a_short_arc_is_refused(arc_deg: float) -> None:
    rng = np.random.default_rng(7)
    spins = np.linspace(0.0, math.radians(arc_deg), 10)
    found = refused(fit_spin_axis(series(spins, noise=NOISE, rng=rng), "left"))
    assert found.code is RefusalCode.TURN_TOO_SHORT
    assert "at least 120°" in found.reason


def test_an_axis_that_moved_between_the_shots_is_refused() -> None:
    shots = series(FULL_TURN[:4]) + series(FULL_TURN[4:], camber=math.radians(0.2), toe=math.radians(0.3))
    assert refused(fit_spin_axis(shots, "left")).code is RefusalCode.INCONSISTENT_SHOTS


def test_shots_of_different_wheels_are_refused() -> None:
    rng = np.random.default_rng(2)
    shots = [plane(*rng.normal(0.0, math.radians(1.0), 2)) for _ in range(12)]
    assert refused(fit_spin_axis(shots, "left")).code is RefusalCode.INCONSISTENT_SHOTS


@pytest.mark.slow
def test_eight_rendered_shots_give_the_axis_of_a_wheel_with_half_a_degree_of_run_out() -> None:
    rng = np.random.default_rng(11)
    calibration = build_rig(RIG_SPECS["ccir"], "rig", "right", rng)
    pose = WheelPose(
        camber=math.radians(-1.3),
        toe=math.radians(0.4),
        run_out=RUN_OUT,
        run_out_phase=1.0,
        offset_mm=(3.0, -4.0, 2.0),
    )
    scene = draw_scene(RIG_SPECS["ccir"], "right", pose, rng)
    turns = FULL_TURN + rng.uniform(-0.2, 0.2, len(FULL_TURN))
    scenes = [replace(scene, pose=replace(pose, spin=float(spin))) for spin in turns]
    shots = [simulate_shot(turned, calibration, rng).images for turned in scenes]
    found = accepted(measure_spin(shots, calibration, MeasureSettings()))
    again = refused(measure_spin([shots[0], shots[0]], calibration, MeasureSettings()))
    assert "shots 1 and 2 are the same images" in again.reason
    assert_angle_within(found.camber, pose.camber, 0.1, "camber")
    assert_angle_within(found.toe, pose.toe, 0.1, "toe")
    assert found.run_out_mm(RUN_OUT_RADIUS_MM) == pytest.approx(truth_of(scene).runout_mm, abs=0.02)
    assert found.phases is not None
    assert np.unwrap(found.phases) - found.phases[0] == pytest.approx(turns - turns[0], abs=0.01)


def test_a_refused_shot_is_named() -> None:
    calibration = build_rig(RIG_SPECS["standard"], "rig", "left", np.random.default_rng(0))
    camera = calibration.heads[0].left.model
    black = np.zeros((camera.height, camera.width), dtype=np.uint8)
    dark = [StereoImages(black, black) for _ in calibration.heads]
    found = refused(measure_spin([dark], calibration, MeasureSettings()))
    assert found.code is RefusalCode.HEAD_DARK
    assert found.reason.startswith("shot 1: ")
