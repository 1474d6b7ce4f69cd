"""Rigs whose cameras look at simulated wheels; only composition roots use them."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Literal

import numpy as np

from alignment.arrays import Singles
from alignment.calibration import content_digest
from alignment.geometry import RigidTransform
from alignment.values import Image, RigCalibration, Side
from sensors.camera import CameraSettings
from sensors.drivers.simulated import SimulatedCamera
from sensors.formats.truth import TyreLoad, WheelTruth
from sensors.frames import FrameTolerance
from sensors.rig import Rig, StereoHead
from sensors.shot import WheelShot
from sensors.simulation.deformation import Wobble
from sensors.simulation.optics import develop
from sensors.simulation.render import camera_image, light_on_chip
from sensors.simulation.rigs import RIG_SPECS, build_rig
from sensors.simulation.scene import Sun, WheelPose, WheelScene, draw_pose, draw_scene, truth_of
from sensors.simulation.turning import Rollers, TurningWheel, mean_truth

PoseDrawer = Callable[[np.random.Generator], WheelPose]
WheelSource = Callable[[int], WheelScene]
"""Gives the wheel that stands there after the rig was armed so many times, from 1."""
TRUE_CALIBRATION_UTC = datetime(2026, 1, 1, tzinfo=UTC)
TRUE_CALIBRATION_METHOD = "simulated: the true cameras"


def true_calibration(rig: str, side: Side, preset: str, seed: int) -> RigCalibration:
    """Build the cameras of a simulated rig; its identity follows from its content, so it never lies."""
    built = build_rig(RIG_SPECS[preset], rig, side, np.random.default_rng([seed, 0]))
    return replace(built, id=f"simulated-{rig}-{content_digest(built)[:12]}")


def standing(calibration: RigCalibration, vehicle_from_rig: RigidTransform) -> RigCalibration:
    """Return the true calibration of a rig that stands there, with an identity of its own.

    Its true pose is known, as one that a gauge frame measured: such rigs stand in one frame.
    """
    placed = replace(calibration, vehicle_from_rig=vehicle_from_rig, vehicle_from_rig_measured=True)
    return replace(placed, id=f"simulated-{placed.rig}-{content_digest(placed, in_vehicle=True)[:12]}")


@dataclass(frozen=True)
class Surroundings:
    """Light that is not the projector's.

    Attributes
    ----------
    ambient
        Irradiance from all around, in the unit of `Projector.level`; None for what a scene has.
    sun
        A beam of sun; None where none falls.
    """

    ambient: float | None = None
    sun: Sun | None = None


@dataclass(frozen=True)
class Road:
    """What wheels of a simulated rig stand on, and how round they are.

    Attributes
    ----------
    load
        What the road does to every tyre; None for wheels in the air.
    wobble
        What turns with every wheel beside the run-out of its pose.
    rollers
        What turns the wheels; None for wheels that stand still.
    """

    load: TyreLoad | None = None
    wobble: Wobble | None = None
    rollers: Rollers | None = None


class SimulatedRig(Rig):
    """A rig in front of which every `arm` puts another wheel.

    On rollers every `shoot` after it is the next exposure of that wheel, which turns and wanders meanwhile;
    without them every `shoot` sees the same wheel, with noise of its own.

    Parameters
    ----------
    calibration
        The true cameras.
    preset
        Name of the rig's geometry and light.
    seed
        Of its wheels.
    pose
        Draws the pose of the next wheel; exchange it to say what comes.
    settings
        Of all cameras.
    tolerance
        What the frames of one shot may differ by.
    road
        What the wheels stand on.
    wheels
        Gives the wheels themselves, in place of `pose` and the load and wobble of `road`; None to draw them.
    surroundings
        Light beside the projector's.
    stays
        The first wheel stays there, whatever is armed.

    Attributes
    ----------
    lamp
        Share of the projector's light that falls on the wheel: a simulated projector sets it. None where the
        rig has no such device: all of it.
    truth
        Of the wheel that stands there now, as the exposure last taken saw it.
    """

    def __init__(
        self,
        calibration: RigCalibration,
        preset: str,
        seed: int,
        pose: PoseDrawer,
        settings: CameraSettings,
        tolerance: FrameTolerance | None = None,
        road: Road | None = None,
        wheels: WheelSource | None = None,
        surroundings: Surroundings | None = None,
        stays: bool = False,
    ) -> None:
        # Rendering takes its time, but all cameras expose at one moment.
        self._exposed_s = self._armed_s = 0.0
        heads = [
            StereoHead(head.name, *(self._camera(calibration, index, side) for side in ("left", "right")))
            for index, head in enumerate(calibration.heads)
        ]
        super().__init__(calibration.rig, heads, settings, tolerance=tolerance)
        self.pose = pose
        self._calibration = calibration
        self._preset = preset
        self._seed = seed
        self._road = road or Road()
        self._surroundings = surroundings or Surroundings()
        self._stays = stays
        self.lamp: float | None = None
        self._chips: dict[tuple[int, str, bool], Singles] = {}
        self._source = wheels or self._drawn
        self._wheels = 0
        self._exposures = 0
        self._turning: TurningWheel | None = None
        self._scene: WheelScene | None = None
        self._seen: WheelScene | None = None
        self._noise: dict[tuple[int, str], np.random.Generator] = {}

    @property
    def truth(self) -> WheelTruth:
        """The angles of the wheel that stands there now."""
        return truth_of(self._exposed_wheel())

    @property
    def series_truth(self) -> WheelTruth:
        """The mean spin axis of all exposures of the wheel that stands there now."""
        wheel = self._wheel()
        if self._turning is None:
            return truth_of(wheel)
        count = max(self._exposures, 1)
        return mean_truth([truth_of(self._turning.exposure(k)) for k in range(1, count + 1)])

    def arm(self) -> None:
        """Put the next wheel there, unless the first one stays, then arm the cameras."""
        if not (self._stays and self._wheels):
            self._wheels += 1
            self._scene = self._turning = None
            self._chips.clear()
        self._exposures = 0
        self._armed_s = time.monotonic()
        self._seen = None
        super().arm()

    def shoot(self, timeout_s: float) -> WheelShot:
        """As `Rig.shoot`; on rollers the wheel has turned on."""
        self._exposed_s = time.monotonic()
        self._exposures += 1
        self._seen = None
        self._wheel()
        if self._turning is not None:
            # Rendering takes longer than the rollers' interval: the cameras' clock is that of the wheel.
            self._exposed_s = self._armed_s + self._turning.time_s(self._exposures)
        return super().shoot(timeout_s)

    def _wheel(self) -> WheelScene:
        if self._scene is None:
            self._scene = self._in_this_light(self._source(self._wheels))
            if self._road.rollers is not None:
                wander = np.random.default_rng([self._seed, 2, self._wheels])
                self._turning = TurningWheel(
                    self._scene, self._road.rollers, wander, self.settings.exposure_ms
                )
            cameras = [(index, side) for index in range(len(self.heads)) for side in ("left", "right")]
            noise = self._rng(self._wheels).spawn(len(cameras))
            self._noise = dict(zip(cameras, noise, strict=True))
        return self._scene

    def _in_this_light(self, wheel: WheelScene) -> WheelScene:
        ambient, sun = self._surroundings.ambient, self._surroundings.sun
        return replace(wheel, ambient=wheel.ambient if ambient is None else ambient, sun=sun or wheel.sun)

    def _rng(self, number: int) -> np.random.Generator:
        return np.random.default_rng([self._seed, 1, number])

    def _drawn(self, number: int) -> WheelScene:
        rng = self._rng(number)
        pose = self.pose(rng)
        drawn = draw_scene(RIG_SPECS[self._preset], self._calibration.side, pose, rng, seed=self._seed)
        return replace(drawn, load=self._road.load, wobble=self._road.wobble)

    def _exposed_wheel(self) -> WheelScene:
        wheel = self._wheel()
        if self._turning is None:
            return wheel
        if self._seen is None:
            self._seen = self._turning.exposure(max(self._exposures, 1))
        return self._seen

    def _camera(
        self, calibration: RigCalibration, head: int, side: Literal["left", "right"]
    ) -> SimulatedCamera:
        return SimulatedCamera(
            f"{calibration.rig}/{calibration.heads[head].name}/{side}",
            _View(self, head, side),
            device_clock=lambda: self._exposed_s,
        )

    def image(self, head: int, side: Literal["left", "right"]) -> Image:
        """What one camera sees now."""
        scene = self._exposed_wheel()
        noise, settings = self._noise[head, side], self.settings
        if self.lamp is None:
            return camera_image(scene, self._calibration, head, side, noise, settings)
        light = self._lit_by_lamp(scene, head, side, self.lamp)
        return develop(light, scene.optics, noise, settings.exposure_ms, settings.gain_db)

    def _lit_by_lamp(
        self, scene: WheelScene, head: int, side: Literal["left", "right"], lamp: float
    ) -> Singles:
        """Light is additive: the scene without projectors, and so much of what they add."""
        if lamp == 1.0:
            return self._chip(scene, head, side, lit=True)
        without = self._chip(scene, head, side, lit=False)
        if lamp == 0.0:
            return without
        return without + np.float32(lamp) * (self._chip(scene, head, side, lit=True) - without)

    def _chip(self, scene: WheelScene, head: int, side: Literal["left", "right"], *, lit: bool) -> Singles:
        """What a camera collects, kept while a wheel stands."""
        kept = self._chips.get((head, side, lit))
        if kept is None:
            seen = scene if lit else replace(scene, projectors=())
            kept = light_on_chip(seen, self._calibration, head, side)
            if self._turning is None:
                self._chips[head, side, lit] = kept
        return kept


class _View:
    """What one camera of a rig sees."""

    def __init__(self, rig: SimulatedRig, head: int, side: Literal["left", "right"]) -> None:
        self._rig, self._head, self._side = rig, head, side

    def image(self, trigger_counter: int) -> Image:
        return self._rig.image(self._head, self._side)


def angles_about(
    camber_deg: float, toe_deg: float, spread_deg: float, run_out_deg: float = 0.0
) -> PoseDrawer:
    """Return a function that draws poses with angles about these, degrees, and this run-out."""

    def draw(rng: np.random.Generator) -> WheelPose:
        camber, toe = rng.normal((camber_deg, toe_deg), spread_deg)
        return draw_pose(rng, math.radians(camber), math.radians(toe), run_out=math.radians(run_out_deg))

    return draw
