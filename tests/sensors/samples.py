"""A small rig, its calibration, its shots, and a clock that only moves when somebody waits."""

from datetime import UTC, datetime

import numpy as np

from alignment.geometry.cameras import CameraModel, PosedCamera
from alignment.geometry.transforms import RigidTransform
from alignment.values import HeadCalibration, RigCalibration, nominal_vehicle_from_rig
from sensors.camera import Frame
from sensors.shot import HeadFrames, WheelShot

WIDTH, HEIGHT = 40, 30
TIME = datetime(2026, 3, 1, 12, 0, 0, 123456, tzinfo=UTC)


class StillClock:
    """Seconds that pass only while somebody sleeps; `slept` lists how long."""

    def __init__(self):
        self.now = 100.0
        self.slept = []

    def __call__(self):
        return self.now

    def sleep(self, seconds):
        self.slept.append(seconds)
        self.now += seconds


def calibration(heads=("head_1", "head_2", "head_3"), rig="front_left", covariance=True):
    rng = np.random.default_rng(7)

    def camera(model):
        coefficients = (-0.07,) if model == "division" else (-0.07, 0.01, 1 / 3e5, -1e-4, 0.0)
        return PosedCamera(
            CameraModel(WIDTH, HEIGHT, 90 + rng.random(), 90 + rng.random(), 19.6, 14.4, model, coefficients),
            RigidTransform.from_rotvec(rng.normal(size=3), rng.normal(size=3) * 300),
        )

    result = RigCalibration(
        id="2026-03-01/front_left",
        rig=rig,
        side="left",
        heads=tuple(HeadCalibration(name, camera("brown"), camera("division")) for name in heads),
        vehicle_from_rig=nominal_vehicle_from_rig("left"),
    )
    if not covariance:
        return result
    size = len(result.parameter_names)
    factor = rng.normal(size=(size, size)) * rng.lognormal(size=size)[:, None]
    matrix = factor @ factor.T
    return RigCalibration(
        **{name: getattr(result, name) for name in ("id", "rig", "side", "heads", "vehicle_from_rig")},
        covariance=(matrix + matrix.T) / 2,
    )


def shot(
    heads=("head_1", "head_2", "head_3"), rig="front_left", trigger=1, depth=np.uint8, shape=(HEIGHT, WIDTH)
):
    rng = np.random.default_rng(trigger)

    def frame(head, side):
        image = rng.integers(0, np.iinfo(depth).max, shape, dtype=depth, endpoint=True)
        return Frame(f"{rig}/{head}/{side}", image, trigger, trigger / 3, 100 + trigger / 7, 5.0)

    return WheelShot(rig, TIME, tuple(HeadFrames(h, frame(h, "left"), frame(h, "right")) for h in heads))
