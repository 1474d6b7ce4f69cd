"""What rigs placed by one view of a gauge frame share, and what it does to a vehicle."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from alignment.geometry.transforms import RigidTransform
from alignment.units import ARCMIN
from alignment.values import Placing, RigCalibration, nominal_vehicle_from_rig
from alignment.vehicle.angles import camber_toe
from alignment.vehicle.geometry import vehicle_geometry
from alignment.vehicle.placed import axis_by_pose, placing_covariance, pose_by_frame
from alignment.vehicle.wheel_axes import FOUR_WHEELS, WheelAxis
from tests.alignment.vehicle.test_geometry import wheels
from tests.sensors.samples import calibration as sample_calibration

TILT, LENGTH = 0.2 * ARCMIN, 20e-6
SHARED = np.diag([TILT**2, TILT**2, (5.0 * ARCMIN) ** 2, 4.0, 4.0, 4.0, LENGTH**2])


def placed_rigs(view: str = "gauge, seen 1", shared: np.ndarray = SHARED) -> dict[str, RigCalibration]:
    """Rigs 20 mm outboard of their wheels' reference points, exact but for what they share."""
    out = {}
    for name, axis in wheels().items():
        side = axis.side
        pose = RigidTransform(
            nominal_vehicle_from_rig(side).rotation,
            axis.point + np.array([3.0, 20.0 if side == "left" else -20.0, -2.0]),
        )
        by = pose_by_frame(pose)
        placing = Placing(view, by @ shared @ by.T, shared)
        out[name] = replace(
            sample_calibration(rig=name, covariance=False),
            side=side,
            vehicle_from_rig=pose,
            vehicle_from_rig_measured=True,
            placing=placing,
        )
    return out


def moved(name: str, by: np.ndarray, rigs: dict[str, RigCalibration]) -> WheelAxis:
    """The wheel as it is seen when the whole frame is off by seven numbers."""
    axis, pose = wheels()[name], rigs[name].vehicle_from_rig
    change = pose_by_frame(pose) @ by
    new = pose.perturbed(change[:3], change[3:])
    inside = pose.inverse()
    camber, toe = camber_toe(new.rotation @ (inside.rotation @ axis.normal), axis.side)
    return replace(axis, camber=camber, toe=toe, point=new.apply(inside.apply(axis.point)))


@pytest.mark.parametrize("number", range(7))
@pytest.mark.parametrize("name", FOUR_WHEELS)
def test_derivatives_of_a_wheel_by_the_frame_are_those_of_moving_it(name: str, number: int) -> None:
    rigs, step = placed_rigs(), 1e-6
    by = np.zeros(7)
    by[number] = step
    there, back = moved(name, by, rigs), moved(name, -by, rigs)
    seen = np.array([there.camber - back.camber, there.toe - back.toe, *(there.point - back.point)]) / (
        2 * step
    )
    pose = rigs[name].vehicle_from_rig
    found = axis_by_pose(wheels()[name], pose) @ pose_by_frame(pose)[:, number]
    np.testing.assert_allclose(found, seen, rtol=1e-6, atol=1e-4)


def test_a_frame_that_rests_askew_costs_camber_and_no_toe_of_the_vehicles_own() -> None:
    """Taken for errors of each rig alone, its yaw made 5′ of every toe and of the thrust angle."""
    rigs, axes = placed_rigs(), wheels()
    together = vehicle_geometry(axes, common=placing_covariance(axes, rigs))
    alone = {name: replace(rig, placing=replace(rig.placing, view=name)) for name, rig in rigs.items()}  # type: ignore[type-var]
    apart = vehicle_geometry(axes, common=placing_covariance(axes, alone))
    nothing = vehicle_geometry(axes)
    assert together.u("front_left.toe") == pytest.approx(nothing.u("front_left.toe"), abs=0.01 * ARCMIN)
    assert together.u("thrust_angle") == pytest.approx(nothing.u("thrust_angle"), abs=0.01 * ARCMIN)
    assert apart.u("front_left.toe") > 2.0 * ARCMIN
    assert together.u("yaw") == pytest.approx(math.hypot(nothing.u("yaw"), 5.0 * ARCMIN), rel=0.01)
    assert together.u("front_left.camber") == pytest.approx(
        math.hypot(nothing.u("front_left.camber"), TILT), rel=0.02
    )
    base = together.value("wheelbase_left")
    assert together.u("wheelbase_left") == pytest.approx(
        math.hypot(nothing.u("wheelbase_left"), LENGTH * base), rel=0.02
    )
    # What leans both wheels of an axle alike goes twice into their difference, and cancels in no toe.
    assert together.u("front.camber_difference") == pytest.approx(
        math.hypot(nothing.u("front.camber_difference"), 2.0 * TILT), rel=0.02
    )


def test_the_joint_covariance_covers_frames_that_are_drawn_from_what_is_stated() -> None:
    rigs, rng = placed_rigs(), np.random.default_rng(3)
    exact = {name: replace(axis, covariance=np.zeros((5, 5))) for name, axis in wheels().items()}
    stated = vehicle_geometry(exact, common=placing_covariance(exact, rigs))
    true = stated.values
    off = []
    for _ in range(400):
        by = rng.multivariate_normal(np.zeros(7), SHARED)
        seen = {name: replace(moved(name, by, rigs), covariance=np.zeros((5, 5))) for name in FOUR_WHEELS}
        off.append(vehicle_geometry(seen).values - true)
    spread, u = np.std(off, axis=0), np.sqrt(np.diag(stated.covariance))
    told = u > 1e-9
    np.testing.assert_allclose(spread[told] / u[told], 1.0, atol=0.15)


def test_rigs_that_do_not_say_how_they_were_placed_share_nothing() -> None:
    """Calibrations of earlier programs are read as before: each rig's pose is independent of others."""
    axes = wheels()
    old = {name: replace(rig, placing=None) for name, rig in placed_rigs().items()}
    assert not placing_covariance(axes, old).any()
    other = placed_rigs()
    other["front_left"] = old["front_left"]
    found = placing_covariance(axes, other)
    assert not found[:5].any()
    assert found[5:10, 10:15].any()


def test_a_rig_whose_covariance_holds_its_pose_does_not_have_it_twice() -> None:
    axes, rigs = wheels(), placed_rigs()
    known = {
        name: replace(rig, covariance=np.eye(len(rig.parameter_names)) * 1e-12) for name, rig in rigs.items()
    }
    with_pose, without = placing_covariance(axes, known), placing_covariance(axes, rigs)
    for k in range(4):
        own = slice(5 * k, 5 * k + 5)
        assert not with_pose[own, own].any()
        assert without[own, own].any()
        without[own, own] = 0.0
    np.testing.assert_array_equal(with_pose, without)
