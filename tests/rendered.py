"""One rendered wheel that all tests share: rendering takes seconds, measuring a hundredth of one."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np

from alignment.geometry.cameras import PosedCamera
from alignment.geometry.transforms import RigidTransform
from alignment.values import HeadCalibration, RigCalibration, StereoImages
from sensors.formats.truth import TyreLoad
from sensors.simulation.render import simulate_shot
from sensors.simulation.rigs import RIG_SPECS, build_rig
from sensors.simulation.scene import WheelScene, draw_pose, draw_scene
from tests.once import once

SPEC = RIG_SPECS["standard"]
CAMBER, TOE = math.radians(0.7), math.radians(-0.4)


@cache
def rig() -> RigCalibration:
    """The true cameras, without a covariance."""
    return build_rig(SPEC, "rig", "left", np.random.default_rng(5))


@cache
def known_rig(sigma: float = 1e-7) -> RigCalibration:
    """The true cameras, and how well they are known: every parameter alike, in its own unit."""
    size = len(rig().parameter_names)
    return replace(rig(), covariance=sigma**2 * np.eye(size))


@cache
def scene() -> WheelScene:
    """A touring tyre at 0.7° of camber and −0.4° of toe."""
    rng = np.random.default_rng(6)
    return draw_scene(SPEC, "left", draw_pose(rng, CAMBER, TOE), rng, seed=6)


@once
def _pairs() -> tuple[StereoImages, ...]:
    return tuple(simulate_shot(scene(), rig(), np.random.default_rng(1)).images)


def images() -> list[StereoImages]:
    """Its images, one pair per head, copied so that a test may spoil them."""
    return [StereoImages(pair.left.copy(), pair.right.copy()) for pair in _pairs()]


def moved(calibration: RigCalibration, movement: RigidTransform, *heads: int) -> RigCalibration:
    """The calibration with these heads moved in the rig frame; all heads where none is named."""
    chosen = heads or range(len(calibration.heads))
    changed = [
        HeadCalibration(
            head.name,
            *(PosedCamera(camera.model, movement @ camera.rig_from_camera) for camera in head.cameras),
        )
        if k in chosen
        else head
        for k, head in enumerate(calibration.heads)
    ]
    return replace(calibration, heads=tuple(changed))


def turned_head(calibration: RigCalibration, head: int, turn_deg: float) -> RigCalibration:
    """The calibration with one head turned about its middle and the rig's x axis, as a knock turns it."""
    centres = [camera.rig_from_camera.translation for camera in calibration.heads[head].cameras]
    middle = np.mean(centres, axis=0)
    turn = RigidTransform.from_rotvec(np.array([math.radians(turn_deg), 0.0, 0.0]), middle)
    return moved(calibration, turn @ RigidTransform(np.eye(3), -middle), head)


@cache
def loaded_scene() -> WheelScene:
    """The same wheel on the road: a bulge of 6 mm."""
    return replace(scene(), load=TyreLoad(6.0, 24.0, "wave"))


@once
def _loaded_pairs() -> tuple[StereoImages, ...]:
    return tuple(simulate_shot(loaded_scene(), rig(), np.random.default_rng(1)).images)


def loaded_images() -> list[StereoImages]:
    """Images of it, as `images`."""
    return [StereoImages(pair.left.copy(), pair.right.copy()) for pair in _loaded_pairs()]
