"""Rendered plates against geometry: marks lie where the cameras project them, with the size they have."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from alignment.errors import DegenerateInputError
from alignment.geometry.cameras import CameraModel, PosedCamera
from alignment.geometry.transforms import RigidTransform
from alignment.imaging.plate import Plate
from sensors.formats import PlateDescription, read_plate, read_plate_session, write_plate_session
from sensors.simulation import plate as plates
from sensors.simulation.optics import Optics
from sensors.simulation.plate import PlateLight, PlateLook, plate_image, plate_light
from sensors.simulation.plate_rays import PIXEL_PARTS, RAY_CELL, covered, ray_nodes
from sensors.simulation.plate_session import (
    PlatePosition,
    PlateSessionSpec,
    plate_positions,
    simulate_plate_session,
)
from sensors.simulation.rigs import RIG_SPECS, RigSpec, build_rig

PLATES = Path(__file__).parents[3] / "configs" / "plates"
LOOK = PlateLook()
EVEN = PlateLight()
FACING = RigidTransform(np.diag([-1.0, 1.0, -1.0]), np.array([0.0, 0.0, 400.0]))
BENT = CameraModel(640, 480, 1500.0, 1510.0, 322.3, 236.8, "brown", (-0.12, 0.03, 4e-4, -3e-4, 0.0))


@pytest.fixture(scope="module")
def head_plate() -> PlateDescription:
    return read_plate(PLATES / "head.toml")


@pytest.fixture(scope="module")
def rig_plate() -> PlateDescription:
    return read_plate(PLATES / "rig.toml")


def imaged_disc(camera: PosedCamera, centre: np.ndarray, radius: float, pose: RigidTransform):
    """Area and centre of the image of a disc, from its projected contour (Green's theorem)."""
    angle = np.linspace(0.0, 2.0 * np.pi, 4000, endpoint=False)
    ring = np.column_stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)]) * radius + centre
    x, y = camera.project(pose.apply(ring)).T
    nx, ny = np.roll(x, -1), np.roll(y, -1)
    cross = x * ny - nx * y
    area = cross.sum() / 2
    return abs(area), np.array([((x + nx) * cross).sum(), ((y + ny) * cross).sum()]) / (6 * area)


def displaced(plate: Plate, rng: np.random.Generator) -> Plate:
    errors = rng.uniform(-1.0, 1.0, plate.points.shape) * [0.05, 0.05, 0.3]
    return replace(plate, points=plate.points + errors, hollow=np.zeros(len(plate.points), dtype=bool))


@pytest.mark.parametrize("blur", [0.0, 0.7, 1.5])
def test_marks_lie_where_geometry_says(head_plate: PlateDescription, blur: float) -> None:
    rng = np.random.default_rng(5)
    plate = displaced(head_plate.plate, rng)
    camera = PosedCamera(BENT, FACING)
    pose = RigidTransform.from_rotvec([0.45, -0.2, 0.3], [1.0, -2.0, 10.0])
    light = plate_light(plate, camera, pose, LOOK, blur, EVEN).astype(float)
    v, u = np.mgrid[0 : light.shape[0], 0 : light.shape[1]]
    errors, areas = [], []
    centres = camera.project(pose.apply(plate.points))
    for point, (x, y) in zip(plate.points, centres, strict=True):
        area, centre = imaged_disc(camera, point, plate.mark_radius_mm, pose)
        half = 22
        column, row = round(x), round(y)
        if not (half < column < 639 - half and half < row < 479 - half):
            continue
        window = slice(row - half, row + half + 1), slice(column - half, column + half + 1)
        dark = (LOOK.ground - light[window]) / (LOOK.ground - LOOK.mark)
        areas.append(dark.sum() / area - 1)
        errors.append([(dark * u[window]).sum(), (dark * v[window]).sum()] / dark.sum() - centre)
    assert len(errors) > 50
    assert np.abs(errors).max() < 0.001
    assert np.abs(np.mean(errors, axis=0)).max() < 0.0002
    assert np.abs(areas).max() < 0.0005


def test_a_covered_share_is_the_area_of_the_square_on_one_side() -> None:
    rng = np.random.default_rng(3)
    steps = (np.arange(400) + 0.5) / 400 - 0.5
    x, y = np.meshgrid(steps, steps)
    for _ in range(40):
        angle, distance = rng.uniform(0, 2 * np.pi), rng.uniform(-0.8, 0.8)
        gx, gy = 3 * np.cos(angle), 3 * np.sin(angle)
        expected = (x * gx / 3 + y * gy / 3 <= distance).mean()
        assert covered(distance, gx, gy) == pytest.approx(expected, abs=2e-3)
    assert covered(0.6, 1.0, 0.0) == 1.0
    assert covered(-0.6, 0.0, -2.0) == 0.0
    assert covered(0.25, 0.0, 2.0) == 0.75
    assert covered(1.0, 0.0, 0.0) == 1.0


def test_rings_have_a_light_centre_and_the_plate_ends(head_plate: PlateDescription) -> None:
    camera = PosedCamera(replace(BENT, fx=900.0, fy=900.0), FACING)
    image = plate_light(head_plate.plate, camera, RigidTransform.identity(), LOOK, 0.0, EVEN)

    def at(x: float, y: float) -> float:
        column, row = camera.project(np.array([[x, y, 0.0]]))[0].round().astype(int)
        return float(image[row, column])

    assert at(15.0, 0.0) == pytest.approx(LOOK.ground)
    assert at(15.0 + 2.75, 0.0) == pytest.approx(LOOK.mark)
    assert at(0.0, 0.0) == pytest.approx(LOOK.mark)
    assert at(7.5, 7.5) == pytest.approx(LOOK.ground)
    assert at(85.0, 0.0) == pytest.approx(LOOK.ground)
    assert at(95.0, 0.0) == pytest.approx(LOOK.beyond)


def test_a_plate_behind_the_camera_is_not_seen(head_plate: PlateDescription) -> None:
    away = PosedCamera(BENT, RigidTransform(np.eye(3), np.array([0.0, 0.0, 400.0])))
    image = plate_light(head_plate.plate, away, RigidTransform.identity(), LOOK, 0.7, EVEN)
    assert image.max() == pytest.approx(LOOK.beyond)


@pytest.mark.parametrize("turn", [(0.2, -0.1, 0.3), (1.2, 0.4, 0.0), (1.48, 0.3, 0.0), (1.65, 0.0, 0.4)])
def test_cells_without_an_edge_are_as_if_their_pixels_were_seen_one_by_one(
    rig_plate: PlateDescription, turn: tuple[float, float, float]
) -> None:
    """From above, flatly, and past the horizon, where parts of a pixel kept whatever was in the memory."""
    pose = FACING @ RigidTransform.from_rotvec(list(turn), [10.0, -20.0, 0.0])
    nodes, levels = ray_nodes(BENT), np.array([0.7, 0.04, 0.02])
    seen = pose.inverse()
    table = (nodes, np.ascontiguousarray(seen.rotation), seen.translation.copy())
    table = (*table, *plates._mark_tables(rig_plate.plate), levels)
    whole = np.full((480 * PIXEL_PARTS, 640 * PIXEL_PARTS), np.nan, dtype=np.float32)
    plates._plate_radiance(*table, whole)
    single = np.full_like(whole, np.nan)
    cells = 0
    for row, column in np.ndindex(480 // RAY_CELL, 640 // RAY_CELL):
        cells += plates._plain_cell(row, column, *table) >= 0.0
    for v, u in np.ndindex(480, 640):
        plates._shade_pixel(v, u, *table, single)
    assert cells > 400
    np.testing.assert_array_equal(whole, single)


def test_light_falls_off_away_from_its_top() -> None:
    over = PlateLight((0.5, -0.5), 0.2).over(BENT)
    assert over.shape == (480, 640)
    assert over.max() == pytest.approx(1.0, abs=1e-4)
    assert over.min() == pytest.approx(0.8, abs=1e-3)
    assert np.unravel_index(over.argmax(), over.shape) == pytest.approx((119, 479), abs=1)


def test_noise_blur_and_grey_levels_are_those_of_the_optics(head_plate: PlateDescription) -> None:
    camera = PosedCamera(BENT, FACING)
    optics = Optics(blur_px=1.0)
    images = [
        plate_image(head_plate.plate, camera, RigidTransform.identity(), rng, optics=optics).astype(float)
        for rng in (None, np.random.default_rng(1), np.random.default_rng(2))
    ]
    ground = images[0] > images[0].max() - 1
    assert images[0].max() - images[0].min() == pytest.approx(0.66 * 255, abs=1.5)
    noise = (images[1] - images[2])[ground].std() / np.sqrt(2)
    assert noise == pytest.approx(np.hypot(np.sqrt(0.7 * 1e4 + 144) * 255 / 1e4, 0.3), rel=0.05)


@pytest.mark.parametrize("preset", ["standard", "ccir"])
def test_every_camera_sees_its_ring_marks_in_every_view(rig_plate: PlateDescription, preset: str) -> None:
    for seed in range(5):
        rig = build_rig(RIG_SPECS[preset], "front_left", "left", np.random.default_rng(seed))
        for position in plate_positions(9):
            pose = RigidTransform.from_rotvec(np.array([*position.tilt, 0.0]), np.array(position.stage_mm))
            for head, group in zip(rig.heads, rig_plate.file.hollow_marks, strict=True):
                marks = np.array([[15.0 * i, 15.0 * j, 0.0] for i, j in group.marks])
                for camera in head.cameras:
                    pixels = camera.project(pose.apply(marks))
                    size = camera.model.width, camera.model.height
                    assert (pixels > 40).all()
                    assert (pixels < np.array(size) - 41).all()


SMALL = RigSpec(camera=CameraModel(320, 256, 750.0, 750.0, 159.5, 127.5, "brown", (-0.08, 0, 0, 0, 0)))
TWO = (PlatePosition("z0"), PlatePosition("tilted", (0.0, 0.0, 5.0), (0.1, 0.0)))


def small_rig():
    return build_rig(SMALL, "front_left", "left", np.random.default_rng(2))


def test_a_session_has_errors_within_tolerance_and_keeps_the_truth_to_itself(
    rig_plate: PlateDescription,
) -> None:
    rig = small_rig()
    session, truth = simulate_plate_session(
        PlateSessionSpec(positions=TWO), rig_plate, rig, np.random.default_rng(8), seed=8
    )
    errors = truth.points - rig_plate.plate.points
    assert 0.0095 < np.abs(errors[:, :2]).max() <= 0.01 + 1e-12
    assert (errors[:, 2] == 0).all()
    stage = truth.rig_from_plate["z0"].translation
    assert 0 < np.abs(stage).max() <= 0.01
    assert session.plate is rig_plate
    assert session.views[0].stage_mm.tolist() == [0.0, 0.0, 0.0]
    assert session.views[1].stage_mm is None
    assert truth.rig_from_plate["tilted"].rotvec()[0] == pytest.approx(0.1)
    assert session.heads == ("head_1", "head_2", "head_3")
    assert all(len(view.images) == 6 for view in session.views)
    assert session.views[0].images["head_3", "right"].shape == (256, 320)


def test_the_same_seed_gives_the_same_images_and_more_views_keep_the_first(
    rig_plate: PlateDescription,
) -> None:
    def views(positions):
        spec = PlateSessionSpec(positions=positions, heads=("head_2",))
        made, _ = simulate_plate_session(spec, rig_plate, small_rig(), np.random.default_rng(4))
        return made.views

    one, two = views(TWO[:1]), views(TWO)
    assert set(two[0].images) == {("head_2", "left"), ("head_2", "right")}
    for key, image in one[0].images.items():
        assert np.array_equal(image, two[0].images[key])
    assert not np.array_equal(two[0].images["head_2", "left"], two[1].images["head_2", "left"])


def test_a_certificate_states_the_true_marks_within_its_uncertainty(
    rig_plate: PlateDescription, tmp_path: Path
) -> None:
    spec = PlateSessionSpec(positions=TWO[:1], heads=("head_1",), certificate_sigma_mm=0.001)
    session, truth = simulate_plate_session(spec, rig_plate, small_rig(), np.random.default_rng(4))
    write_plate_session(tmp_path / "session", session)
    plate = read_plate_session(tmp_path / "session").plate.plate
    assert (plate.sigma_mm == 0.001).all()
    assert (plate.points - truth.points).std() == pytest.approx(0.001, rel=0.05)
    assert (truth.points - rig_plate.plate.points)[:, :2].std() == pytest.approx(0.0058, rel=0.05)


def test_wrong_wishes_are_named(rig_plate: PlateDescription) -> None:
    with pytest.raises(DegenerateInputError, match="heads among head_1, head_2, head_3, found head_4"):
        simulate_plate_session(
            PlateSessionSpec(heads=("head_4",)), rig_plate, small_rig(), np.random.default_rng(1)
        )
    with pytest.raises(DegenerateInputError, match="from 3 to 9"):
        plate_positions(2)
