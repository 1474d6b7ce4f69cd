"""What a sweep of the steering gives, wheel by wheel, and what is asked of it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from alignment.arrays import Array
from alignment.errors import DegenerateInputError
from alignment.units import ARCMIN
from alignment.values import Side
from alignment.vehicle.angles import SIGN
from alignment.vehicle.wheel_axes import AXIS_SIZE, WheelAxis

MOST_POSITIONS = 400
STEERING_QUANTITIES = ("caster", "kpi", "included_angle", "camber", "trail", "scrub")
"""Of a steering axis, in the order of its covariance; the last two are millimetres."""


@dataclass(frozen=True, eq=False)
class SteeredWheel:
    """One front wheel at one position of the steering.

    Attributes
    ----------
    axis
        As a rig has measured it, in the stand's frame. Its covariance is what is this position's own: noise,
        and what each exposure makes of the load anew.
    common
        (5, M) what all positions share of the errors of camber, toe and reference point, such as the
        calibration's: column by column what one independent error of unit size does here.
    load_covariance
        (2, 2) of camber and toe: what is not known of the load, radians². It is the same load at all
        positions. None for a wheel without load.
    """

    axis: WheelAxis
    common: Array = field(default_factory=lambda: np.zeros((AXIS_SIZE, 0)))
    load_covariance: Array | None = None

    def __post_init__(self) -> None:
        if self.common.ndim != 2 or self.common.shape[0] != AXIS_SIZE or not np.isfinite(self.common).all():
            raise DegenerateInputError(
                field="common",
                expected=f"finite numbers of shape ({AXIS_SIZE}, M)",
                seen=f"shape {self.common.shape}",
            )


@dataclass(frozen=True, eq=False)
class RunOut:
    """By how much the tyre plane that is measured leans from the spin axis, straight ahead.

    Where the wheel rolls while it is steered it takes this lean with it, which looks like a little caster:
    run-out of 2 mm and a scrub radius of 10 mm make 0.4′ of it.

    Attributes
    ----------
    camber, toe
        Of the tyre plane less those of the spin axis, radians.
    covariance
        (2, 2) of both, radians².
    """

    camber: float
    toe: float
    covariance: Array = field(default_factory=lambda: np.zeros((2, 2)))


@dataclass(frozen=True)
class SteeringStand:
    """What is known of stand, vehicle and tyre beside the sweep.

    Attributes
    ----------
    heading
        Direction of the thrust line, radians, counter-clockwise from the stand's X seen from above; caster
        and KPI refer to it.
    heading_u
        Its standard uncertainty.
    road_z_mm
        Height of the wheel supports in the stand's frame; None where it is not known: there is no trail and
        no scrub radius then.
    tyre_width_mm, tyre_width_sigma_mm
        Section width and its spread; None where it is not stated, as for the road.
    straight_toe
        Toe of this wheel to the thrust line where the steering stands straight ahead, radians.
    rolls
        Share of free rolling in place of slipping on the turn plates: 1 for a wheel that rolls about the
        steering axis, 0 with the brakes held.
    """

    heading: float = 0.0
    heading_u: float = 0.0
    road_z_mm: float | None = None
    tyre_width_mm: float | None = None
    tyre_width_sigma_mm: float = 0.0
    straight_toe: float = 0.0
    rolls: float = 1.0


@dataclass(frozen=True)
class SteeringRules:
    """What a sweep must be, and how sure its result.

    Attributes
    ----------
    least_angle
        To which the wheel must be steered to both sides of straight ahead, radians.
    fewest
        Positions at least, at different angles.
    widest_gap
        Between neighbouring angles, radians.
    caster_u95, kpi_u95
        Largest expanded uncertainties that still answer what is asked, radians.
    load_drift
        By how much what is not known of the load may change from straight ahead to the end of the sweep, as a
        share of itself, one standard deviation.
    coverage_factor
        k of the expanded uncertainties.
    """

    least_angle: float = math.radians(7.5)
    fewest: int = 9
    widest_gap: float = math.radians(6.0)
    caster_u95: float = 3.0 * ARCMIN
    kpi_u95: float = 10.0 * ARCMIN
    load_drift: float = 0.5
    coverage_factor: float = 2.0


def steered(toe: Array, side: Side, straight_toe: float) -> Array:
    """(N,) by which a wheel with toes (N,) to the thrust line is steered to the left, radians."""
    out: Array = -SIGN[side] * (toe - straight_toe)
    return out


@dataclass(frozen=True, eq=False)
class SteeringAxis:
    """The axis about which a front wheel is steered, straight ahead.

    Angles are in radians.

    Attributes
    ----------
    side
        Of the vehicle.
    direction
        (3,) unit vector along the axis, upward, in the stand's frame.
    point
        (3,) where it meets the road, or the plane Z = 0 where the road is not known; stand's frame,
        millimetres.
    values
        By the names of `STEERING_QUANTITIES`, those that are known: caster and KPI to the thrust line,
        included angle (KPI + camber), camber of the spin axis, trail and scrub radius at the road.
    covariance
        Of these, in their order.
    angles
        (N,) by which the wheel was steered about the axis at each position, radians, positive to the left,
        0 straight ahead.
    toes
        (N,) toe to the thrust line at each position, as measured.
    straight_toe
        The same straight ahead, as it was stated.
    residuals
        (N,) by which the angle between wheel and axis leaves its mean, radians.
    scatter
        Root mean square of the residuals in what is stated of them; the larger of it and 1 is in the
        covariance.
    axial_mm
        (N,) by how much the wheel's centre leaves its mean along the axis: what the body does on its springs
        meanwhile, and no part of the direction.
    pattern
        Largest systematic part of the residuals that no fixed axis explains, radians.
    pattern_p
        How probable a pattern of that size is by chance.
    warning
        What speaks against one fixed axis, in words; None where nothing does. The uncertainty then covers it.
    classic_caster
        By (γ₁ − γ₂) / (2 sin δ), for comparison only.
    coverage_factor
        k of the expanded uncertainties.
    """

    side: Side
    direction: Array
    point: Array
    values: Mapping[str, float]
    covariance: Array
    angles: Array
    toes: Array
    straight_toe: float
    residuals: Array
    scatter: float
    axial_mm: Array
    pattern: float
    pattern_p: float
    warning: str | None
    classic_caster: float
    coverage_factor: float = 2.0

    def __contains__(self, name: str) -> bool:
        return name in self.values

    def value(self, name: str) -> float:
        """One quantity, radians or millimetres; KeyError for one that is not known."""
        return self.values[name]

    def u(self, name: str) -> float:
        """Its standard uncertainty."""
        k = list(self.values).index(name)
        return math.sqrt(max(float(self.covariance[k, k]), 0.0))

    def u95(self, name: str) -> float:
        """Its expanded uncertainty."""
        return self.coverage_factor * self.u(name)

    @property
    def turns(self) -> Array:
        """(N,) angles about the vertical at each position, radians, to the left, 0 straight ahead."""
        return steered(self.toes, self.side, self.straight_toe)

    @property
    def reach(self) -> tuple[float, float]:
        """How far the wheel was steered to the right and to the left, radians, both positive as a rule."""
        return float(-self.angles.min()), float(self.angles.max())
