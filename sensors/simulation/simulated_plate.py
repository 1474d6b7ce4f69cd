"""A rig whose cameras look at a calibration plate: every arming finds it in its next position."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from alignment.calibration import CameraKey
from alignment.geometry import RigidTransform
from alignment.values import SIDES, Image, RigCalibration, Side
from sensors.camera import CameraSettings
from sensors.drivers.simulated import SimulatedCamera
from sensors.formats.plate import PlateDescription
from sensors.frames import FrameTolerance
from sensors.rig import Rig, StereoHead
from sensors.shot import WheelShot
from sensors.simulation.plate_session import PlateBeforeRig, PlatePosition, PlateSessionSpec


class SimulatedPlateRig(Rig):
    """A rig before which somebody moves a plate; after its last position it begins again with the first.

    Every `shoot` after an `arm` sees the same position, with noise of its own. The plate is lit by the room:
    the projector does not matter.

    Parameters
    ----------
    calibration
        The true cameras.
    plate
        As its maker describes it; the simulated one deviates within what that allows.
    positions
        At least one.
    rng
        Draws errors, light and noise.
    settings
        Of all cameras.
    tolerance
        What the frames of one shot may differ by.
    """

    def __init__(
        self,
        calibration: RigCalibration,
        plate: PlateDescription,
        positions: Sequence[PlatePosition],
        rng: np.random.Generator,
        settings: CameraSettings,
        tolerance: FrameTolerance | None = None,
    ) -> None:
        self._exposed_s = 0.0
        self._before = PlateBeforeRig.of(PlateSessionSpec(), plate, calibration, rng)
        self._positions = tuple(positions)
        self._armed = 0
        self._pose: RigidTransform | None = None
        noise = self._before.of_image.spawn(len(self._before.cameras))
        self._noise = dict(zip(self._before.cameras, noise, strict=True))
        heads = [
            StereoHead(head.name, *(self._camera(calibration.rig, head.name, side) for side in SIDES))
            for head in calibration.heads
        ]
        super().__init__(calibration.rig, heads, settings, tolerance=tolerance)

    def arm(self) -> None:
        """Put the plate in its next position, then arm the cameras."""
        _, self._pose = self._before.put(self._positions[self._armed % len(self._positions)])
        self._armed += 1
        super().arm()

    def shoot(self, timeout_s: float) -> WheelShot:
        """As `Rig.shoot`."""
        self._exposed_s = time.monotonic()
        return super().shoot(timeout_s)

    def image(self, key: CameraKey) -> Image:
        """What one camera sees now."""
        assert self._pose is not None
        return self._before.image(key, self._pose, self._noise[key], self.settings)

    def _camera(self, rig: str, head: str, side: Side) -> SimulatedCamera:
        return SimulatedCamera(
            f"{rig}/{head}/{side}", _View(self, (head, side)), device_clock=lambda: self._exposed_s
        )


class _View:
    """What one camera of a rig sees."""

    def __init__(self, rig: SimulatedPlateRig, key: CameraKey) -> None:
        self._rig, self._key = rig, key

    def image(self, trigger_counter: int) -> Image:
        return self._rig.image(self._key)
