"""A wheel that turns about an axis: from spin axes and places at many positions the axis, step by step.

While a wheel is steered about a fixed direction k, k · n of its axis n stays what it is: the normals lie on a
plane, and k is across it. The place follows from the circle on which the wheel's centre goes. What rolls
takes its run-out with it, which is taken off by the scrub radius.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.arrays import Array
from alignment.values import Side
from alignment.vehicle.angles import SIGN, normal_from_angles
from alignment.vehicle.steering_values import STEERING_QUANTITIES, RunOut, SteeringStand

_ROUNDS, _SETTLED = 30, 1e-15
_NOWHERE = np.zeros(5)


@dataclass(frozen=True, eq=False)
class SweepSeen:
    """What was measured at N positions.

    Attributes
    ----------
    side
        Of the wheel.
    state
        (N, 5) camber and toe to the stand, and the reference point, millimetres.
    """

    side: Side
    state: Array

    @property
    def normals(self) -> Array:
        """(N, 3) of the tyre planes."""
        return normals_of_angles(self.state[:, 0], self.state[:, 1], self.side)


@dataclass(frozen=True)
class KnownBeside:
    """What is known beside: as `SteeringStand` and `RunOut` have it, as numbers that may be varied."""

    heading: float
    width_mm: float | None
    road_z_mm: float | None
    straight_toe: float
    rolls: float
    run_out: tuple[float, float]

    @classmethod
    def of(cls, stand: SteeringStand, run_out: RunOut | None) -> KnownBeside:
        """Take the numbers of a stand and a run-out."""
        lean = (0.0, 0.0) if run_out is None else (run_out.camber, run_out.toe)
        return cls(stand.heading, stand.tyre_width_mm, stand.road_z_mm, stand.straight_toe, stand.rolls, lean)

    def changed(self, error: Mapping[str, float], sign: float) -> KnownBeside:
        """Return the numbers with an error, by name; of the run-out ``run_out.0`` and ``run_out.1``."""
        lean = [value + sign * error.get(f"run_out.{k}", 0.0) for k, value in enumerate(self.run_out)]
        width = None if self.width_mm is None else self.width_mm + sign * error.get("width_mm", 0.0)
        heading = self.heading + sign * error.get("heading", 0.0)
        return replace(self, heading=heading, width_mm=width, run_out=(lean[0], lean[1]))

    @property
    def has_road(self) -> bool:
        """Whether there is a contact centre."""
        return self.width_mm is not None and self.road_z_mm is not None

    @property
    def turns_a_lean(self) -> bool:
        """Whether rolling changes what is measured."""
        return self.rolls != 0.0 and any(self.run_out)


@dataclass(frozen=True, eq=False)
class TurnedWheel:
    """A wheel about an axis: everything that follows from the measured positions and one direction.

    Attributes
    ----------
    direction
        (3,) k.
    roll, normals
        (N, 3) what rolling adds to the normals that were measured, and these without it.
    angles
        (N,) steered, 0 straight ahead.
    radius
        (2,) way from the axis to the middle, along `tangents`.
    middle
        (3,) of the wheel straight ahead, or its reference point where the width is not known.
    point
        (3,) where the axis meets the road, or Z = 0.
    straight
        (3,) measured tyre plane straight ahead, without what rolling makes of it.
    camber
        Of the spin axis, straight ahead.
    trail, scrub
        Millimetres; None where the road is not known.
    axial
        (N,) k · centre, less its mean.
    """

    direction: Array
    roll: Array
    normals: Array
    angles: Array
    radius: Array
    middle: Array
    point: Array
    straight: Array
    camber: float
    trail: float | None
    scrub: float | None
    axial: Array

    @property
    def residuals(self) -> Array:
        """(N,) k · n less its mean; zero about a true axis."""
        return residuals_of(self.normals, self.direction)


def residuals_of(normals: Array, direction: Array) -> Array:
    """(N,) k · n of normals (N, 3) less its mean."""
    along = normals @ direction
    out: Array = along - along.mean()
    return out


def normals_of_angles(camber: Array, toe: Array, side: Side) -> Array:
    """(N, 3) outboard unit normals of cambers and toes (N,), radians, as `normal_from_angles`."""
    level = np.cos(camber)
    return np.column_stack([level * np.sin(toe), SIGN[side] * level * np.cos(toe), -np.sin(camber)])


def normals_by_angles(camber: Array, toe: Array, side: Side) -> Array:
    """(N, 3, 2) change of these normals by camber and toe."""
    sine_c, cosine_c, sine_t, cosine_t = np.sin(camber), np.cos(camber), np.sin(toe), np.cos(toe)
    s = SIGN[side]
    by_camber = np.column_stack([-sine_c * sine_t, -s * sine_c * cosine_t, -cosine_c])
    by_toe = np.column_stack([cosine_c * cosine_t, -s * cosine_c * sine_t, np.zeros(len(camber))])
    return np.stack([by_camber, by_toe], axis=2)


def first_direction(normals: Array) -> Array:
    """Direction (3,), upward, along which normals (N, 3) spread least: the smallest singular vector."""
    _, _, rows = np.linalg.svd(normals - normals.mean(axis=0), full_matrices=False)
    return upward(rows[2])


def upward(direction: Array) -> Array:
    """Unit vector along a direction, upward."""
    unit = direction / np.linalg.norm(direction)
    out: Array = unit if unit[2] >= 0.0 else -unit
    return out


def tangents(direction: Array) -> Array:
    """(2, 3) unit vectors across a direction, the first about forward; they are right-handed with it."""
    forward = np.array([1.0, 0.0, 0.0]) - direction[0] * direction
    forward /= np.linalg.norm(forward)
    return np.array([forward, np.cross(direction, forward)])


def turned(seen: SweepSeen, known: KnownBeside, direction: Array) -> TurnedWheel:
    """Return what the positions say of a wheel that turns about a direction (3,)."""
    here = turned_with(seen, known, direction, np.zeros((len(seen.state), 3)))
    if not known.turns_a_lean:
        return here
    # Rolling turns the lean of the tyre plane about the spin axis; how much follows from the scrub radius.
    for _ in range(_ROUNDS):
        roll = roll_of(here, known, seen.side)
        settled = float(np.abs(roll - here.roll).max())
        here = turned_with(seen, known, direction, roll)
        if settled < _SETTLED:
            break
    return here


def roll_of(here: TurnedWheel, known: KnownBeside, side: Side, farther_mm: float = 0.0) -> Array:
    """(N, 3) what rolling adds to the normals; of a scrub radius that is so much larger.

    Steered to the left about an axis that meets the road inboard of it, a left wheel goes back.
    """
    if here.scrub is None or known.road_z_mm is None:
        return np.zeros((len(here.angles), 3))
    radius = float(here.middle[2]) - known.road_z_mm
    spins = -known.rolls * (here.scrub + farther_mm) / radius * here.angles
    spin_axis = _spin_axis(here.straight, known, side)
    lean = Rotation.from_rotvec(spins[:, None] * spin_axis).apply(here.straight) - here.straight
    out: Array = Rotation.from_rotvec(here.angles[:, None] * here.direction).apply(lean)
    return out


def _spin_axis(straight: Array, known: KnownBeside, side: Side) -> Array:
    camber, toe = angles_of(straight, side)
    return normal_from_angles(camber - known.run_out[0], toe - known.run_out[1], side)


def angles_of(normal: Array, side: Side) -> tuple[float, float]:
    """Camber and toe, radians, of a unit normal (3,), as `camber_toe`; none is refused."""
    return float(-np.arcsin(np.clip(normal[2], -1.0, 1.0))), float(
        np.arctan2(normal[0], SIGN[side] * normal[1])
    )


def turned_with(
    seen: SweepSeen,
    known: KnownBeside,
    direction: Array,
    roll: Array,
    cosine_off: float = 0.0,
    place_off: Array = _NOWHERE,
) -> TurnedWheel:
    """As `turned`, with what rolling adds to the normals (N, 3) given.

    For derivatives the mean of k · n may be changed, and (5,) the circle's middle, its radius and the mean
    place along the axis.
    """
    normals = seen.normals - roll
    across = tangents(direction)
    flat = normals @ across.T
    cosine = float((normals @ direction).mean()) + cosine_off
    bearing = _straight_bearing(direction, across, cosine, known, seen.side)
    # Angles about the direction from straight ahead, positive counter-clockwise seen from above: to the left.
    angles = np.arctan2(flat[:, 1], flat[:, 0]) - bearing
    angles = np.arctan2(np.sin(angles), np.cos(angles))
    sine = np.sqrt(max(1.0 - cosine**2, 0.0))
    straight = cosine * direction + sine * (np.cos(bearing) * across[0] + np.sin(bearing) * across[1])
    half = 0.0 if known.width_mm is None else 0.5 * known.width_mm
    centres = seen.state[:, 2:] - half * seen.normals
    rows = circle_rows(angles)
    circle = np.linalg.lstsq(rows, (centres @ across.T).T.ravel(), rcond=None)[0] + place_off[:4]
    place, radius = circle[:2], circle[2:]
    along = centres @ direction + place_off[4]
    axis = place @ across
    height = known.road_z_mm if known.road_z_mm is not None else 0.0
    point = axis + (height - axis[2]) / direction[2] * direction
    camber = angles_of(straight, seen.side)[0] - known.run_out[0]
    middle = axis + radius @ across + along.mean() * direction
    here = TurnedWheel(
        direction, roll, normals, angles, radius, middle, point, straight, camber, None, None,
        along - along.mean(),
    )  # fmt: skip
    if not known.has_road:
        return here
    trail, scrub = _at_road(here, known, seen.side)
    return replace(here, trail=trail, scrub=scrub)


def _straight_bearing(
    direction: Array, across: Array, cosine: float, known: KnownBeside, side: Side
) -> float:
    """Angle of the tyre plane's normal about the direction, from `across[0]`, where the spin axis has its toe
    of straight ahead."""
    s = SIGN[side]
    # Toe to the stand: what the thrust line turns to the left takes from the toe of a left wheel.
    wanted = known.straight_toe + known.run_out[1] - s * known.heading
    sine = np.sqrt(max(1.0 - cosine**2, 0.0))
    # n · (cos toe, −s sin toe, 0) = 0, of which one of two places is outboard.
    level = np.array([np.cos(wanted), -s * np.sin(wanted), 0.0])
    a, b = (sine * across @ level).tolist()
    c = cosine * float(direction @ level)
    size = float(np.hypot(a, b))
    middle = float(np.arctan2(b, a))
    spread = float(np.arccos(np.clip(-c / size, -1.0, 1.0)))
    outboard = np.array([0.0, s, 0.0])
    return max(
        (middle + spread, middle - spread),
        key=lambda bearing: float(outboard @ (np.cos(bearing) * across[0] + np.sin(bearing) * across[1])),
    )


def circle_rows(angles: Array) -> Array:
    """(2 N, 4) of points on a circle at angles (N,): its middle (2), and the way from there at 0 (2)."""
    cosine, sine, one, none = np.cos(angles), np.sin(angles), np.ones(len(angles)), np.zeros(len(angles))
    return np.concatenate(
        [np.column_stack([one, none, cosine, -sine]), np.column_stack([none, one, sine, cosine])]
    )


def _at_road(here: TurnedWheel, known: KnownBeside, side: Side) -> tuple[float, float]:
    """Trail and scrub radius."""
    middle = here.middle
    assert known.road_z_mm is not None
    n = _spin_axis(here.straight, known, side)
    flat = np.array([n[0], n[1], 0.0])
    contact = middle + (middle[2] - known.road_z_mm) * (n[2] / (n[0] ** 2 + n[1] ** 2) * flat)
    ahead = np.array([np.cos(known.heading), np.sin(known.heading)])
    left = np.array([-ahead[1], ahead[0]])
    offset = (contact - here.point)[:2]
    return float(-ahead @ offset), float(SIGN[side] * left @ offset)


def quantities(here: TurnedWheel, side: Side, heading: float) -> dict[str, float]:
    """Values of `STEERING_QUANTITIES` that are known of a wheel about its axis."""
    x, y, z = here.direction.tolist()
    ahead = x * math.cos(heading) + y * math.sin(heading)
    left = y * math.cos(heading) - x * math.sin(heading)
    kpi = math.atan2(-SIGN[side] * left, z)
    values = (math.atan2(-ahead, z), kpi, kpi + here.camber, here.camber, here.trail, here.scrub)
    return {name: value for name, value in zip(STEERING_QUANTITIES, values, strict=True) if value is not None}
