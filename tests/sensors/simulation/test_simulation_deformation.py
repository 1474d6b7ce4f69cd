"""A tyre on the road: its bulge is where the road is, lines fall on it where geometry says, letters turn."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from alignment.arrays import Array
from alignment.geometry.cameras import CameraModel
from alignment.geometry.transforms import RigidTransform
from alignment.values import RigCalibration, Side, nominal_vehicle_from_rig
from sensors.formats.truth import TyreLoad
from sensors.simulation import render, shading
from sensors.simulation.deformation import Contact, Wobble, angular_shapes, radial_shapes
from sensors.simulation.optics import Optics, develop, integrate
from sensors.simulation.projector import LinePattern
from sensors.simulation.rigs import RIG_SPECS, build_projectors, build_rig
from sensors.simulation.scene import WheelPose, WheelScene, truth_of
from sensors.simulation.tyre import MADE_SHAPES, MATT, Tyre, TyreShape, draw_tyre, make_tyre

SIDES: tuple[Side, Side] = ("left", "right")
SHAPES = ("gaussian", "wave")
SMALL = CameraModel(320, 256, 750.0, 751.0, 158.0, 129.0, "brown", (-0.08, 0.01, 1e-4, -1e-4, 0.0))
SPEC = replace(RIG_SPECS["standard"], camera=SMALL)
FLAT = TyreShape(
    rim_edge=120.0, crest=200.0, crest_z=2.0, outer=345.0, drop_inside=0, drop_outside=0, rings=0, letters=0
)
BULGE = TyreLoad(7.0, 24.0)


def wheel(
    pose: WheelPose, load: TyreLoad | None, side: Side = "left", tyre: Tyre | None = None
) -> WheelScene:
    return WheelScene(side, pose, tyre or make_tyre(MADE_SHAPES["touring"]), (), load=load)


def at(scene: WheelScene, degrees: Array, radius: float = 270.0) -> Array:
    """What load and wobble do at angles of the rig frame, millimetres."""
    rig_from_tyre = scene.pose.rig_from_tyre(scene.side, nominal_vehicle_from_rig(scene.side)).rotation
    angle = np.radians(degrees)
    directions = np.column_stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)]) @ rig_from_tyre
    points = radius * directions[:, :2] / np.linalg.norm(directions[:, :2], axis=1)[:, None]
    return scene.deformed_tyre.height(points)[0] - scene.tyre.height(points)[0]


@pytest.mark.parametrize("shape", SHAPES)
def test_shapes_over_the_angle_have_their_width_and_only_the_wave_swings_back(shape: str) -> None:
    load = replace(BULGE, shape=shape, side_width_deg=60.0)
    angle = np.radians(np.linspace(-180.0, 180.0, 3601))
    even, side, odd = angular_shapes(load, angle)
    half = math.degrees(float(angle[even > 0.5].max()))
    assert half == pytest.approx(24.0 * math.sqrt(2.0 * math.log(2.0)), abs=0.2)
    assert (even.max(), side.max()) == pytest.approx((1.0, 1.0), abs=1e-6)
    assert odd.max() == pytest.approx(1.0, abs=2e-3)
    np.testing.assert_allclose(odd, -odd[::-1], atol=1e-12)
    assert (even.min() < -0.03) == (shape == "wave")
    assert math.degrees(float(angle[side > 0.5].max())) > 1.8 * half
    for values in (even, side, odd):
        assert values[0] == pytest.approx(values[-1], abs=1e-9)  # closed at the top of the wheel


@pytest.mark.parametrize("crest", [0.3, 0.55, 0.75])
def test_no_profile_moves_the_bead_and_the_tread_feels_the_side_force_most(crest: float) -> None:
    share = np.linspace(-0.2, 1.0, 1201)
    bulge, shift = radial_shapes(replace(BULGE, crest=crest), share)
    assert np.abs([bulge[share <= 0], shift[share <= 0]]).max() == 0.0
    assert bulge.max() == pytest.approx(1.0, abs=1e-5)
    assert share[bulge.argmax()] == pytest.approx(crest, abs=0.08)
    assert 0.1 < bulge[-1] < 0.4
    assert shift.argmax() == len(share) - 1


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("shape", SHAPES)
def test_the_bulge_stays_over_the_road_while_the_wheel_turns(side: Side, shape: str) -> None:
    degrees = np.linspace(0.0, 359.0, 360)
    found = [
        at(wheel(WheelPose(0.03, -0.02, spin), replace(BULGE, shape=shape), side), degrees)
        for spin in (0.0, 1.1, 3.0)
    ]
    assert found[0].max() == pytest.approx(7.0, abs=0.03)
    assert degrees[found[0].argmax()] == pytest.approx(270.0, abs=0.6)
    np.testing.assert_allclose(found[1], found[0], atol=0.002)
    np.testing.assert_allclose(found[2], found[0], atol=0.002)


@pytest.mark.parametrize("side", SIDES)
def test_a_longitudinal_force_bulges_ahead_of_the_contact_patch_on_both_sides(side: Side) -> None:
    """x of the left rig points backward, of the right one forward."""
    ahead, behind = (250.0, 290.0) if side == "left" else (290.0, 250.0)
    front, rear = at(
        wheel(WheelPose(spin=2.0), TyreLoad(longitudinal_mm=1.5), side), np.array([ahead, behind])
    )
    assert front > 1.0
    assert rear == pytest.approx(-front, abs=1e-6)


def test_letters_turn_and_the_bulge_does_not() -> None:
    tyre = draw_tyre(np.random.default_rng(11))
    points = np.column_stack([np.linspace(215.0, 305.0, 200), np.full(200, 20.0)])
    load = (BULGE, Contact(2.0, 1))
    moved = tyre.deformed(load)
    plain = make_tyre(MADE_SHAPES["touring"]).deformed(None)
    only = plain.deformed(load).height(points)[0] - plain.height(points)[0]
    both = moved.height(points)[0] - tyre.height(points)[0]
    assert np.abs(tyre.surface.relief).max() > 0.3
    # Bead and tread of a drawn tyre are those of its shape: the same deformation, and letters ride on it.
    np.testing.assert_allclose(both, only, atol=1e-9)


@pytest.fixture(scope="module")
def deformed() -> Tyre:
    load = TyreLoad(6.0, 20.0, "wave", side_mm=-3.0, longitudinal_mm=1.0)
    wobble = Wobble(second_mm=0.8, second_phase=0.4, rim_mm=1.0, rim_phase=2.0)
    return draw_tyre(np.random.default_rng(11)).deformed((load, Contact(-1.2, -1)), wobble, (0.003, 1.0))


def test_gradient_is_the_derivative_of_the_deformed_height(deformed: Tyre) -> None:
    rng = np.random.default_rng(1)
    radius, angle = (
        rng.uniform(180.0, deformed.outer_radius_mm - 3.0, 4000),
        rng.uniform(-math.pi, math.pi, 4000),
    )
    points = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
    _, gradient = deformed.height(points)
    step = 1e-5
    for axis in range(2):
        offset = np.zeros(2)
        offset[axis] = step
        difference = (deformed.height(points + offset)[0] - deformed.height(points - offset)[0]) / (2 * step)
        np.testing.assert_allclose(gradient[:, axis], difference, atol=5e-7)


def test_the_mesh_follows_the_deformation_and_hits_lie_on_the_surface(deformed: Tyre) -> None:
    """Without the mesh's deformation hits start 7 mm off, and shadows fall elsewhere."""
    origin = 266.0 * np.array([math.cos(-1.2), math.sin(-1.2), 0.0]) + [0.0, 0.0, 400.0]
    rng = np.random.default_rng(2)
    rays = np.column_stack([rng.uniform(-0.08, 0.08, (20_000, 2)), -np.ones(20_000)])
    packed = np.concatenate([np.broadcast_to(origin, rays.shape), rays], axis=1).astype(np.float32)
    import open3d as o3d

    mesh_depth = deformed.scene.cast_rays(o3d.core.Tensor(packed))["t_hit"].numpy().astype(float)
    depth, _, good = shading.refine(rays, mesh_depth, origin, deformed.surface)
    assert good.mean() > 0.999
    points = origin + depth[good, None] * rays[good]
    assert np.abs(points[:, 2] - deformed.height(points[:, :2])[0]).max() < 1e-6
    assert np.median(np.abs(depth - mesh_depth)) < 0.05


def test_the_rim_wobbles_by_what_is_stated_against_the_spin_axis(deformed: Tyre) -> None:
    """The tyre's own tilt is the pose's; the rim takes no part in it."""
    tyre = make_tyre(MADE_SHAPES["touring"])
    angle = np.linspace(-math.pi, math.pi, 73)
    circle = 190.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    lean, phase = 0.003, 1.0
    moved = tyre.deformed(None, Wobble(rim_mm=1.0, rim_phase=2.0), (lean, phase))
    against_tyre = moved.height(circle)[0] - tyre.height(circle)[0]
    tyre_against_axis = -lean * 190.0 * np.cos(angle - phase)
    expected = -0.5 * 190.0 / moved.rim_edge_mm * np.cos(angle - 2.0)
    np.testing.assert_allclose(against_tyre + tyre_against_axis, expected, atol=1e-3)
    sidewall = circle * 260.0 / 190.0
    np.testing.assert_allclose(moved.height(sidewall)[0], tyre.height(sidewall)[0], atol=1e-6)


def test_a_wheel_in_the_air_is_the_tyre_itself_and_says_so() -> None:
    scene = wheel(WheelPose(), None)
    assert scene.deformed_tyre is scene.tyre
    assert scene.tyre.surface.deformation is None
    assert truth_of(scene).load is None
    assert truth_of(replace(scene, load=BULGE)).load == BULGE


@pytest.fixture(scope="module")
def rig() -> RigCalibration:
    return build_rig(SPEC, "front_left", "left", np.random.default_rng(5))


def on_surface(tyre: Tyre, origin: Array, rays: Array) -> Array:
    """Where rays (N, 3) from one point meet the tyre, by Newton's method on its exact heights."""
    depth = -origin[2] / rays[:, 2]
    for _ in range(50):
        points = origin + depth[:, None] * rays
        height, gradient = tyre.height(points[:, :2])
        depth += (height - points[:, 2]) / (rays[:, 2] - (gradient * rays[:, :2]).sum(axis=1))
    return origin + depth[:, None] * rays


@pytest.mark.parametrize("shape", SHAPES)
def test_a_line_on_a_loaded_tyre_is_imaged_where_geometry_says(rig: RigCalibration, shape: str) -> None:
    """Within 0.003 px, while the load moves it a hundred times as far: lines are on the deformed surface."""
    everything = tuple(range(9))
    pattern = LinePattern(columns=3, rows=9, missing_columns=(0, 2), missing_rows=everything, width_mm=1.0)
    projectors = build_projectors(replace(SPEC, pattern=pattern), np.random.default_rng(1))
    projectors = tuple(replace(p, falloff=0.0, level=10.0) for p in projectors)
    pose = WheelPose(math.radians(2.0), math.radians(-1.5), 0.3, offset_mm=(3.0, -6.0, 5.0))
    load = TyreLoad(7.0, 24.0, shape, side_mm=4.0, longitudinal_mm=1.0)
    scene = WheelScene(
        "left", pose, make_tyre(FLAT, rubber=MATT, rim=MATT), projectors,
        optics=Optics(black_level=0.0, bits=16), ambient=0.0, load=load,
    )  # fmt: skip
    head = 1  # at 210°
    camera, rig_from_tyre = rig.heads[head].left, scene.rig_from_tyre(rig)
    samples = render.render_samples(scene, camera, rig_from_tyre)
    light = integrate(samples, render.SAMPLES, scene.optics.blur_px)
    image = develop(light, scene.optics, None).astype(float)
    from_projector: RigidTransform = rig_from_tyre.inverse() @ projectors[head].rig_from_projector
    slopes = np.column_stack([np.zeros(400), np.linspace(-0.12, 0.12, 400), np.ones(400)])
    rays = from_projector.apply_vectors(slopes)
    expected, unloaded = (
        camera.project(rig_from_tyre.apply(on_surface(tyre, from_projector.translation, rays)))
        for tyre in (scene.deformed_tyre, scene.tyre)
    )
    assert np.abs(expected - unloaded).max() > 0.3
    order = np.argsort(expected[:, 1])
    errors = []
    for row in range(20, image.shape[0] - 20):
        centre = np.interp(row, expected[order, 1], expected[order, 0], left=np.nan, right=np.nan)
        if not 12 < centre < image.shape[1] - 12:
            continue
        window = np.arange(round(centre) - 10, round(centre) + 11)
        light = image[row, window]
        errors.append((light * window).sum() / light.sum() - centre)
    assert len(errors) > 80
    assert np.abs(errors).max() < 0.003
