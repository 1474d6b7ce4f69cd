from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from alignment.geometry.cameras import PosedCamera
from alignment.geometry.transforms import RigidTransform
from alignment.imaging.lines import extract_many
from alignment.stereo.overlap import shared_views
from alignment.values import HeadCalibration, RigCalibration
from sensors.simulation.rigs import RIG_SPECS, build_rig
from tests.alignment.imaging.grids import slanted_grid

DEPTH = (-60.0, 60.0)


@pytest.fixture(scope="module", params=["standard", "ccir"])
def rig(request: pytest.FixtureRequest) -> RigCalibration:
    return build_rig(RIG_SPECS[request.param], "rig", "left", np.random.default_rng(3))


def inside(pixels: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    return ((pixels >= low) & (pixels < high)).all(axis=1)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_whatever_both_cameras_see_within_the_depth_range_lies_in_both_views(
    rig: RigCalibration, seed: int
) -> None:
    views = shared_views(rig, DEPTH)
    points = np.random.default_rng(seed).uniform([-400, -400, DEPTH[0]], [400, 400, DEPTH[1]], (3000, 3))
    found = 0
    for k, head in enumerate(rig.heads):
        middle = 0.5 * sum(camera.rig_from_camera.translation for camera in head.cameras)
        near = points[np.hypot(*(points[:, :2] - middle[:2]).T) < 150.0]
        pixels = [camera.project(near) for camera in head.cameras]
        size = np.array([head.left.model.width, head.left.model.height])
        both = inside(pixels[0], np.zeros(2), size) & inside(pixels[1], np.zeros(2), size)
        found += int(both.sum())
        for view, seen in zip(views[2 * k : 2 * k + 2], pixels, strict=True):
            assert inside(seen[both], view[:2], view[2:]).all()
    assert found > 50


def test_cameras_side_by_side_share_only_a_part(rig: RigCalibration) -> None:
    views = shared_views(rig, DEPTH)
    width = rig.heads[0].left.model.width
    left, right = views[0], views[1]
    assert left[0] > 0.1 * width
    assert left[2] == width
    assert right[0] == 0
    assert right[2] < 0.9 * width


def test_cameras_that_share_nothing_are_looked_at_whole(rig: RigCalibration) -> None:
    head = rig.heads[0]
    aside = RigidTransform(np.eye(3), np.array([0.0, 5000.0, 0.0]))
    moved = PosedCamera(head.right.model, aside @ head.right.rig_from_camera)
    apart = replace(rig, heads=(HeadCalibration(head.name, head.left, moved),))
    size = [0, 0, head.left.model.width, head.left.model.height]
    assert shared_views(apart, DEPTH)[0].tolist() == size


def test_lines_of_a_part_are_those_of_the_whole_image() -> None:
    image = slanted_grid(0.1, noise=1.0)
    view = np.array([[120, 40, 560, 440]])
    (whole,), (part,) = extract_many([image]), extract_many([image], views=view)
    assert whole is not None
    assert part is not None
    assert inside(part.points, view[0, :2], view[0, 2:]).all()
    well_in = inside(whole.points, view[0, :2] + 60, view[0, 2:] - 60)
    nearest = [np.hypot(*(part.points - each).T).min() for each in whole.points[well_in]]
    assert np.mean(np.array(nearest) < 0.01) > 0.97
    well_in = inside(whole.crosses.points, view[0, :2] + 60, view[0, 2:] - 60)
    for cross in whole.crosses.points[well_in]:
        assert np.hypot(*(part.crosses.points - cross).T).min() < 0.02
