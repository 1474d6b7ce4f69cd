"""A wheel that rollers turn while it is shot: unknown spin angles, slow wander, blur by the turn itself.

Lettering and run-out turn with the wheel; the load stays over the rollers. What one exposure sees of the turn
is the mean of a few moments. Left out: the wheel's bounce, and slip.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from alignment.arrays import Array
from alignment.vehicle import camber_toe, normal_from_angles
from sensors.formats.truth import WheelTruth
from sensors.simulation.scene import WheelScene


@dataclass(frozen=True)
class Rollers:
    """How rollers turn a wheel, and how it wanders on them.

    Attributes
    ----------
    speed
        Of the wheel, radians per second, positive as the vehicle drives forward: seen from outboard wheels of
        the left side turn counter-clockwise, those of the right side clockwise.
    interval_s
        Mean time between two exposures.
    jitter
        Share of the interval by which an exposure comes early or late, at most; nobody tells the measurement.
    wander_mm, wander
        Most that the wheel's centre moves in each coordinate, and its camber and toe, radians.
    slowest_s, fastest_s
        Bounds of the wander's periods; slow against a turn, as a vehicle moves on its springs.
    """

    speed: float = 3.0
    interval_s: float = 0.28
    jitter: float = 0.2
    wander_mm: float = 1.0
    wander: float = math.radians(0.05)
    fastest_s: float = 4.0
    slowest_s: float = 10.0


class TurningWheel:
    """The exposures of one wheel on rollers, each a scene of its own.

    Parameters
    ----------
    scene
        The wheel before it turns; its pose is the middle of its wander.
    rollers
        What turns it.
    rng
        Draws wander and jitter.
    exposure_ms
        Of every camera.
    """

    def __init__(
        self, scene: WheelScene, rollers: Rollers, rng: np.random.Generator, exposure_ms: float = 5.0
    ) -> None:
        self._scene, self._rollers, self._exposure_ms = scene, rollers, exposure_ms
        self._speed = rollers.speed if scene.side == "left" else -rollers.speed
        self._periods: Array = rng.uniform(rollers.fastest_s, rollers.slowest_s, 5)
        self._phases: Array = rng.uniform(0.0, 2.0 * math.pi, 5)
        self._jitter = rng.spawn(1)[0]
        self._times: list[float] = []

    def time_s(self, number: int) -> float:
        """Return when exposure `number` is taken, seconds after about the first; always the same."""
        while len(self._times) < number:
            late = self._jitter.uniform(-self._rollers.jitter, self._rollers.jitter)
            self._times.append((len(self._times) + late) * self._rollers.interval_s)
        return self._times[number - 1]

    def exposure(self, number: int) -> WheelScene:
        """Return the wheel as exposure `number`, from 1, sees it; any order, always the same."""
        time_s, rollers, pose = self.time_s(number), self._rollers, self._scene.pose
        swing = np.sin(2.0 * math.pi * time_s / self._periods + self._phases)
        x, y, z = (float(c) for c in pose.offset_mm + rollers.wander_mm * swing[:3])
        moved = replace(
            pose,
            camber=pose.camber + rollers.wander * float(swing[3]),
            toe=pose.toe + rollers.wander * float(swing[4]),
            spin=pose.spin + self._speed * time_s,
            offset_mm=(x, y, z),
        )
        return replace(self._scene, pose=moved, turning=1e-3 * self._exposure_ms * self._speed)


def mean_truth(truths: Sequence[WheelTruth]) -> WheelTruth:
    """Return what a measurement of these exposures of one wheel should find: the mean of its spin axes.

    `camber_deg` and `toe_deg` are those of the mean axis too; the spin angle is how far it turned from the
    first exposure to the last.
    """
    first, last = truths[0], truths[-1]
    axes = [
        normal_from_angles(math.radians(t.spin_camber_deg), math.radians(t.spin_toe_deg), t.side)
        for t in truths
    ]
    camber, toe = (math.degrees(a) for a in camber_toe(np.mean(axes, axis=0), first.side))
    x, y, z = (float(c) for c in np.mean([t.centre_mm for t in truths], axis=0))
    return replace(
        first,
        camber_deg=camber,
        toe_deg=toe,
        spin_camber_deg=camber,
        spin_toe_deg=toe,
        spin_angle_deg=last.spin_angle_deg - first.spin_angle_deg,
        centre_mm=(x, y, z),
    )
