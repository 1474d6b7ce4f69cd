"""Front wheels that are steered about a known axis, as numbers: what the tests of steering axes measure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.arrays import Array
from alignment.values import Side
from alignment.vehicle.angles import SIGN, camber_toe, normal_from_angles
from alignment.vehicle.steering_values import RunOut, SteeredWheel, SteeringStand
from alignment.vehicle.wheel_axes import WheelAxis

ROAD, WIDTH = -310.0, 195.0
NOISE = 0.02 * math.pi / 10800.0


@dataclass(frozen=True)
class SteeredTruth:
    """A wheel, its axis and what is done to it, radians and millimetres; the vehicle is turned by `yaw`."""

    side: Side = "left"
    caster: float = math.radians(6.0)
    kpi: float = math.radians(12.0)
    scrub: float = 14.0
    trail: float = 25.0
    camber: float = math.radians(-0.7)
    yaw: float = 0.0
    run_out: float = 0.0
    phase: float = 1.0
    rolls: float = 1.0

    @property
    def stand(self) -> SteeringStand:
        return SteeringStand(self.yaw, 0.0, ROAD, WIDTH, rolls=self.rolls)

    @property
    def lean(self) -> RunOut:
        camber, toe = camber_toe(self._plane, self.side)
        return RunOut(camber - self.camber, toe)

    @property
    def values(self) -> dict[str, float]:
        return {
            "caster": self.caster,
            "kpi": self.kpi,
            "included_angle": self.kpi + self.camber,
            "camber": self.camber,
            "trail": self.trail,
            "scrub": self.scrub,
        }

    @property
    def _spin_axis(self) -> Array:
        return normal_from_angles(self.camber, 0.0, self.side)

    @property
    def _plane(self) -> Array:
        n = self._spin_axis
        across = np.cross(n, [0.0, 0.0, 1.0])
        lean = Rotation.from_rotvec(n * self.phase).apply(across / np.linalg.norm(across))
        return np.asarray(Rotation.from_rotvec(self.run_out * lean).apply(n))

    def at(self, angle: float, moved: Array | None = None) -> tuple[float, float, Array]:
        """Camber, toe and reference point of a wheel steered by an angle about an axis that has moved."""
        s, n = SIGN[self.side], self._spin_axis
        k = np.array([-math.tan(self.caster), -s * math.tan(self.kpi), 1.0])
        k = k / np.linalg.norm(k) if moved is None else k / np.linalg.norm(k) + moved
        k = k / np.linalg.norm(k)
        middle = np.array([1350.0, s * 756.0, 3.0])
        contact = middle + (middle[2] - ROAD) * n[2] / (n[0] ** 2 + n[1] ** 2) * np.array([n[0], n[1], 0.0])
        point = np.array([contact[0] + self.trail, contact[1] - s * self.scrub, ROAD])
        turn = Rotation.from_rotvec(k * angle)
        rolled = -self.rolls * self.scrub / (middle[2] - ROAD) * angle
        plane = turn.apply(Rotation.from_rotvec(n * rolled).apply(self._plane))
        place = point + turn.apply(middle - point) + 0.5 * WIDTH * plane
        vehicle = Rotation.from_rotvec([0.0, 0.0, self.yaw])
        return *camber_toe(vehicle.apply(plane), self.side), np.asarray(vehicle.apply(place))

    def sweep(self, angles: Sequence[float] | Array, covariance: Array | None = None) -> list[SteeredWheel]:
        """Exact positions at angles, radians, that state a covariance (5, 5)."""
        known = np.zeros((5, 5)) if covariance is None else covariance
        return [
            SteeredWheel(WheelAxis(self.side, camber, toe, point, known))
            for camber, toe, point in (self.at(float(angle)) for angle in angles)
        ]


def even(reach_deg: float = 10.0, positions: int = 41) -> Array:
    """Angles, radians."""
    return np.radians(np.linspace(-reach_deg, reach_deg, positions))


def own_covariance(angle: float = NOISE, place_mm: float = 0.002) -> Array:
    """(5, 5) of one position."""
    return np.diag([angle, angle, place_mm, place_mm, place_mm]) ** 2


def shaken(series: Sequence[SteeredWheel], errors: Array) -> list[SteeredWheel]:
    """Positions that are off by errors (N, 5)."""
    out = []
    for wheel, error in zip(series, errors, strict=True):
        a = wheel.axis
        axis = WheelAxis(a.side, a.camber + error[0], a.toe + error[1], a.point + error[2:], a.covariance)
        out.append(SteeredWheel(axis, wheel.common, wheel.load_covariance))
    return out
