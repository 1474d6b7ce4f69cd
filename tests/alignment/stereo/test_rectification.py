import numpy as np
from hypothesis import example, given, settings

from alignment.geometry.cameras import CameraModel, PosedCamera
from alignment.geometry.transforms import RigidTransform
from alignment.stereo.rectification import Rectification
from tests.strategies import cameras

FACING = np.diag([-1.0, 1.0, -1.0])
SIZE = (1280, 1024)
# Along three lines, as light lines come: neighbours, then a jump; not a whole number of blocks.
ROWS = np.linspace(5.0, 1015.0, 111)
PIXELS = np.vstack([np.column_stack([np.full(111, x), ROWS]) for x in (20.5, 700.0, 1270.25)])
TILTED = (-0.2, 0.1, 1e-3, -1e-3, 0.02, 0.01, 0.0, 0.0, 1e-3, 0.0, -1e-3, 0.0, 0.03, -0.02)


def posed(model: CameraModel, x: float, turn: float) -> PosedCamera:
    pose = RigidTransform(FACING, np.array([x, 260.0, 400.0]))
    return PosedCamera(model, pose.perturbed(np.array([0.0, turn, 0.01]), np.zeros(3)))


@given(cameras())
@example(CameraModel(*SIZE, 3000, 3000, 640, 512, "brown", TILTED))
@example(CameraModel(*SIZE, 1700, 1750, 600, 500, "division", (-0.1,)))
@settings(max_examples=60)
def test_any_lens_is_rectified_as_its_rays_run(model: CameraModel) -> None:
    left, right = posed(model, 40.0, 0.02), posed(model, -40.0, -0.03)
    frame = Rectification.of(left, right)
    for camera in (left, right):
        found, bad = frame.coordinates(camera, PIXELS)
        rays = camera.rays(PIXELS) @ frame.rectified_from_rig.T
        assert bad == 0
        # A hundred-thousandth of a pixel.
        np.testing.assert_allclose(found, rays[:, :2] / rays[:, 2:], atol=1e-5 / model.fx)


def test_a_pixel_beyond_the_fold_is_counted_and_does_not_spoil_its_neighbours() -> None:
    folds = CameraModel(*SIZE, 1000, 1000, 640, 512, "brown", (-0.5, 0.0, 0.0, 0.0, 0.0))
    camera = posed(folds, 40.0, 0.0)
    frame = Rectification.of(camera, posed(folds, -40.0, 0.0))
    good = np.column_stack([np.linspace(600.0, 700.0, 50), np.full(50, 500.0)])
    beyond = np.array([[0.0, 0.0], [1279.0, 1023.0]])
    alone, none = frame.coordinates(camera, good)
    found, bad = frame.coordinates(camera, np.vstack([good[:20], beyond, good[20:]]))
    assert (none, bad) == (0, 2)
    np.testing.assert_allclose(np.delete(found, [20, 21], axis=0), alone, atol=1e-8)
