"""Rendered wheels that stand on their tyres, before rigs of two mountings."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from alignment.arrays import Array
from alignment.values import RigCalibration, StereoImages
from sensors.formats import TyreLoad
from sensors.simulation import SHAPES, WheelScene, draw_pose, draw_scene
from station.studies.knocked import plate_covariance
from station.studies.wheels import exposed, lights, study_rig

MOUNTINGS = {"even": "standard", "lifted": "lifted"}
"""Mountings, and the presets of their rigs: heads at 90, 210 and 330°, and at 90, 195 and 345°."""
_EMPTY_EVERY, _SIDE_EVERY = 8, 4


@dataclass(frozen=True, eq=False)
class LoadedShot:
    """A wheel under load, the true cameras, the covariance of a calibration from the plate, and images."""

    mounting: str
    tyre: str
    rig: RigCalibration
    covariance: Array
    scene: WheelScene
    images: list[StereoImages]

    @property
    def load(self) -> TyreLoad:
        """What the road does; nothing for a wheel in the air."""
        return self.scene.load or TyreLoad()


def has_load(number: int) -> bool:
    """Whether a wheel stands on its tyre: the first of every eight hangs in the air."""
    return number % _EMPTY_EVERY != 0


def has_side_force(number: int) -> bool:
    """Whether side and longitudinal force act on a wheel, too: the third of every four."""
    return number % _SIDE_EVERY == _SIDE_EVERY - 2


def draw_load(rng: np.random.Generator, number: int) -> TyreLoad | None:
    """Draw a load of 0 to 8 mm of either shape; nothing for a wheel that hangs in the air."""
    if not has_load(number):
        return None
    side = has_side_force(number)
    return TyreLoad(
        bulge_mm=float(rng.uniform(0.0, 8.0)),
        width_deg=float(rng.uniform(18.0, 32.0)),
        shape="wave" if rng.integers(2) else "gaussian",
        side_mm=float(rng.uniform(-8.0, 8.0)) if side else 0.0,
        side_width_deg=float(rng.uniform(40.0, 60.0)),
        longitudinal_mm=float(rng.uniform(-0.3, 0.3)) if side else 0.0,
        crest=float(rng.uniform(0.45, 0.65)),
        tread=float(rng.uniform(0.1, 0.3)),
    )


def loaded_shot(seed: int, mounting: str, number: int) -> LoadedShot:
    """Render one wheel; the same seed, mounting and number give the same one."""
    rng = np.random.default_rng([seed, 41, list(MOUNTINGS).index(mounting), number])
    rig = study_rig(MOUNTINGS[mounting], seed + number, "left" if number % 2 else "right")
    tyre = sorted(SHAPES)[number % len(SHAPES)]
    camber, toe = np.radians(rng.uniform(-3.0, 3.0, 2))
    scene = draw_scene(rig.spec, rig.side, draw_pose(rng, camber, toe), rng, tyre, seed=seed + number)
    scene = replace(scene, load=draw_load(rng, number), ambient=float(rng.uniform(0.05, 0.6)))
    images = exposed(lights(scene, rig.true), scene, rng, float(rng.uniform(2.5, 6.0)))
    return LoadedShot(mounting, tyre, rig.true, plate_covariance(rig.true, rng), scene, images)
