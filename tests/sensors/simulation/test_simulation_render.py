"""Images: lines fall where geometry says, and every short cut of the renderer is invisible."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from alignment.geometry.cameras import CameraModel, PosedCamera
from alignment.values import RigCalibration
from sensors.camera import CameraSettings
from sensors.simulation import render
from sensors.simulation.optics import Optics, develop, integrate
from sensors.simulation.projector import LinePattern
from sensors.simulation.rigs import RIG_SPECS, build_projectors, build_rig
from sensors.simulation.scene import Sun, WheelPose, WheelScene, cable, draw_scene, lump
from sensors.simulation.shading import MIXED
from sensors.simulation.tyre import MATT, TyreShape, make_tyre

SMALL = CameraModel(320, 256, 750.0, 751.0, 158.0, 129.0, "brown", (-0.08, 0.01, 1e-4, -1e-4, 0.0))
SPEC = replace(RIG_SPECS["standard"], camera=SMALL)
FLAT = TyreShape(
    rim_edge=120.0, crest=200.0, crest_z=2.0, outer=345.0, drop_inside=0, drop_outside=0, rings=0, letters=0
)


@pytest.fixture(scope="module")
def rig() -> RigCalibration:
    return build_rig(SPEC, "front_left", "left", np.random.default_rng(5))


@pytest.fixture(scope="module")
def scene() -> WheelScene:
    pose = WheelPose(math.radians(1.5), math.radians(-2.0), 0.4, math.radians(0.3), 1.0, (4.0, -5.0, 3.0))
    return draw_scene(SPEC, "left", pose, np.random.default_rng(6))


def only_line(family: str) -> LinePattern:
    everything = tuple(range(9))
    if family == "column":
        return LinePattern(columns=3, rows=9, missing_columns=(0, 2), missing_rows=everything, width_mm=1.0)
    return LinePattern(columns=9, rows=3, missing_rows=(0, 2), missing_columns=everything, width_mm=1.0)


@pytest.mark.parametrize("camera_model", [None, "division"])
@pytest.mark.parametrize("family", ["column", "row"])
@pytest.mark.parametrize("head", [0, 1, 2])
def test_a_line_on_a_tilted_plane_is_imaged_where_geometry_says(
    rig: RigCalibration, head: int, family: str, camera_model: str | None
) -> None:
    """No systematic sub-pixel shift: within 0.001 px, with lens distortion, blur and pixels."""
    rng = np.random.default_rng(head)
    spec = replace(SPEC, pattern=only_line(family))
    projectors = tuple(replace(p, falloff=0.0, level=10.0) for p in build_projectors(spec, rng))
    tyre = make_tyre(FLAT, rubber=MATT, rim=MATT)
    pose = WheelPose(math.radians(2.0), math.radians(-1.5), 0.3, offset_mm=(3.0, -6.0, 5.0))
    scene = WheelScene("left", pose, tyre, projectors, optics=Optics(black_level=0.0, bits=16), ambient=0.0)
    camera = rig.heads[head].left
    if camera_model:
        camera = PosedCamera(replace(SMALL, model="division", coefficients=(-0.09,)), camera.rig_from_camera)
    rig_from_tyre = scene.rig_from_tyre(rig)
    samples = render.render_samples(scene, camera, rig_from_tyre)
    light = integrate(samples, render.SAMPLES, scene.optics.blur_px)
    image = develop(light, scene.optics, None).astype(float)

    # The middle line is the plane through the projector's centre that its axes x (or y) and z leave out.
    projector = projectors[head].rig_from_projector
    axis, along = (0, 1) if family == "column" else (1, 0)
    directions = np.zeros((200, 3))
    directions[:, along], directions[:, 2] = np.linspace(-0.12, 0.12, 200), 1.0
    rays = projector.apply_vectors(directions)
    normal = rig_from_tyre.rotation[:, 2]
    on_plane = rig_from_tyre.apply(np.array([0.0, 0.0, FLAT.crest_z]))
    depth = ((on_plane - projector.translation) @ normal) / (rays @ normal)
    expected = camera.project(projector.translation + depth[:, None] * rays)

    profile = image if family == "column" else image.T
    expected = expected if family == "column" else expected[:, ::-1]
    order = np.argsort(expected[:, 1])
    errors = []
    for row in range(20, profile.shape[0] - 20):
        centre = np.interp(row, expected[order, 1], expected[order, 0], left=np.nan, right=np.nan)
        if not 12 < centre < profile.shape[1] - 12:
            continue
        window = np.arange(round(centre) - 10, round(centre) + 11)
        light = profile[row, window]
        errors.append((light * window).sum() / light.sum() - centre)
    assert axis != along
    assert len(errors) > 80
    assert np.abs(errors).max() < 0.001


def test_cells_and_single_rays_give_the_same_picture(
    rig: RigCalibration, scene: WheelScene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Short cuts in smooth and dark cells must not be seen where light falls, and hardly elsewhere."""
    camera, pose = rig.heads[1].right, scene.rig_from_tyre(rig)
    quick = render.render_samples(scene, camera, pose)

    def everything_mixed(kind: np.ndarray, *_: object) -> np.ndarray:
        return np.full((kind.shape[0] - 1, kind.shape[1] - 1), MIXED, dtype=np.uint8)

    monkeypatch.setattr(render, "_classify", everything_mixed)
    slow = render.render_samples(scene, camera, pose)
    lit = slow > 0.05
    assert lit.sum() > 20_000
    difference = np.abs(quick - slow)
    assert difference[lit].max() < 1e-3  # a quarter of a grey level
    assert np.median(difference[lit]) < 2e-5
    assert difference.max() < 0.004  # a grey level: ambient light in dark cells is sampled coarsely
    assert np.percentile(difference, 99) < 5e-4


def test_more_samples_hardly_change_the_picture(rig: RigCalibration, scene: WheelScene) -> None:
    camera, pose = rig.heads[0].left, scene.rig_from_tyre(rig)
    two = integrate(render.render_samples(scene, camera, pose, 2), 2, 0.7)
    four = integrate(render.render_samples(scene, camera, pose, 4), 4, 0.7)
    inner = (slice(6, -6), slice(6, -6))
    assert np.abs(two - four)[inner].mean() < 1e-3


def test_same_seed_same_shot_and_noise_differs_between_cameras(
    rig: RigCalibration, scene: WheelScene
) -> None:
    first, again, other = (
        render.simulate_shot(scene, rig, np.random.default_rng(seed)) for seed in (3, 3, 4)
    )
    assert first.rig == "front_left"
    assert [frame.camera for frame in first.frames][:2] == [
        "front_left/head_1/left",
        "front_left/head_1/right",
    ]
    for a, b, c in zip(first.frames, again.frames, other.frames, strict=True):
        assert a.image.shape == (256, 320)
        assert a.image.dtype == np.uint8
        np.testing.assert_array_equal(a.image, b.image)
        assert (a.image != c.image).any()


def test_images_have_lines_on_a_dark_ground_like_real_ones(rig: RigCalibration, scene: WheelScene) -> None:
    image = render.camera_image(scene, rig, 2, "left", np.random.default_rng(1))
    assert 3 < np.median(image) < 20
    assert np.percentile(image, 98) > 60
    assert (image == 255).mean() < 0.05


def test_settings_and_transmission_change_the_brightness(rig: RigCalibration, scene: WheelScene) -> None:
    plain = render.camera_image(scene, rig, 0, "left", None).astype(float)
    short = render.camera_image(scene, rig, 0, "left", None, CameraSettings(exposure_ms=1.0)).astype(float)
    dark = render.camera_image(replace(scene, transmission={"head_1.left": 0.0}), rig, 0, "left", None)
    assert short.max() < plain.max()
    assert short.mean() < plain.mean()
    assert np.ptp(dark) == 0


def test_obstacles_hide_the_wheel_and_cast_shadows(rig: RigCalibration, scene: WheelScene) -> None:
    camera, pose = rig.heads[0].left, scene.rig_from_tyre(rig)
    free = render.render_samples(scene, camera, pose)
    hand = lump(np.array([30.0, 270.0, 60.0]), (12.0, 18.0, 10.0))
    with_hand = render.render_samples(replace(scene, obstacles=(hand,)), camera, pose)
    changed = np.abs(with_hand - free) > 0.05
    rows, columns = np.nonzero(changed)
    centre = np.array([columns.mean(), rows.mean()]) / 2
    expected = camera.project(np.array([[30.0, 270.0, 60.0]]))[0]
    np.testing.assert_allclose(centre, expected, atol=25.0)
    darker = (with_hand < 0.02) & (free > 0.1)
    assert darker.sum() > 500  # the shadow, and lines that fall on the hand instead
    wire = cable(np.array([-80.0, 265.0, 300.0]), np.array([80.0, 265.0, 300.0]), 4.0)
    with_wire = render.render_samples(replace(scene, obstacles=(wire,)), camera, pose)
    assert 0.02 < (np.abs(with_wire - free) > 0.05).mean() < 0.5


def test_a_patch_of_sun_lights_only_its_place(rig: RigCalibration, scene: WheelScene) -> None:
    camera, pose = rig.heads[0].left, scene.rig_from_tyre(rig)
    sunny = replace(scene, sun=Sun((0.0, 0.0, 1.0), (0.0, 260.0, 0.0), 20.0, 6.0))
    added = render.render_samples(sunny, camera, pose) - render.render_samples(scene, camera, pose)
    rows, columns = np.nonzero(added > 0.1)
    u, v = camera.project(np.array([[0.0, 260.0, 0.0]]))[0]
    assert abs(columns.mean() / 2 - u) < 10.0
    assert abs(rows.mean() / 2 - v) < 10.0
    assert (added > 0.1).mean() < 0.3
    assert added.min() > -0.01
