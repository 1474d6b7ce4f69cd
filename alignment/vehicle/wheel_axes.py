"""What is known of wheels in the stand's frame, and of the stand and the tyres, before there is a vehicle."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, Protocol, get_args

import numpy as np

from alignment.arrays import Array
from alignment.errors import DegenerateInputError
from alignment.values import RigCalibration, Side, WheelReference
from alignment.vehicle.angles import SIGN, normal_from_angles

FRONT, REAR = "front", "rear"
VehicleWheel = Literal["front_left", "front_right", "rear_left", "rear_right"]
"""Position of a wheel on a vehicle with two axles."""
FOUR_WHEELS: tuple[VehicleWheel, ...] = get_args(VehicleWheel)
"""Wheels of a vehicle with two axles, in the order of every joint covariance."""
AXIS_SIZE = 5
"""Numbers of one wheel: camber, toe, then X, Y and Z of its reference point."""
STEEL_PER_K = 12e-6
"""Expansion of structural steel per kelvin (EN 1993-1-1, 3.2.6)."""


class MeasuredAngles(Protocol):
    """Angles of a wheel against the stand's axes; a tyre plane has them, and a spin axis."""

    @property
    def camber(self) -> float:
        """Radians."""
        ...

    @property
    def toe(self) -> float:
        """Radians."""
        ...

    @property
    def angle_covariance(self) -> Array:
        """(2, 2) of camber and toe, radians²."""
        ...


@dataclass(frozen=True, eq=False)
class WheelAxis:
    """One wheel in the stand's frame (ISO 8855 axes; Z is the normal of the wheel supports).

    Attributes
    ----------
    side
        Of the vehicle.
    camber, toe
        Of its axis against the stand's axes, radians, signs as the conventions say.
    point
        (3,) its reference point: where the axis meets the plane of the outermost ring of the sidewall,
        millimetres.
    covariance
        (5, 5) of camber, toe and the three coordinates: images, cameras, and the rig's pose on the stand.
    """

    side: Side
    camber: float
    toe: float
    point: Array
    covariance: Array

    def __post_init__(self) -> None:
        for name, shape in (("point", (3,)), ("covariance", (AXIS_SIZE, AXIS_SIZE))):
            array = np.asarray(getattr(self, name), dtype=np.float64)
            if array.shape != shape or not np.isfinite(array).all():
                raise DegenerateInputError(
                    field=name, expected=f"finite numbers of shape {shape}", seen=f"shape {array.shape}"
                )
            object.__setattr__(self, name, array)
        if not np.isfinite([self.camber, self.toe]).all():
            raise DegenerateInputError(
                field="camber, toe", expected="finite angles", seen=f"{self.camber}, {self.toe}"
            )

    @classmethod
    def of(cls, found: MeasuredAngles, reference: WheelReference, calibration: RigCalibration) -> WheelAxis:
        """Return the wheel that a rig has measured.

        Parameters
        ----------
        found
            A tyre plane or a spin axis, with its angles as they were corrected.
        reference
            The wheel's place by the same images.
        calibration
            Of the rig.
        """
        covariance = np.array(reference.covariance)
        covariance[:2, :2] = found.angle_covariance
        return cls(
            calibration.side,
            found.camber,
            found.toe,
            calibration.vehicle_from_rig.apply(reference.point),
            covariance,
        )

    @property
    def normal(self) -> Array:
        """(3,) outboard unit normal."""
        return normal_from_angles(self.camber, self.toe, self.side)

    @cached_property
    def normal_by_angles(self) -> Array:
        """(3, 2) change of the normal per change of camber and toe."""
        s = SIGN[self.side]
        sin_c, cos_c = np.sin(self.camber), np.cos(self.camber)
        sin_t, cos_t = np.sin(self.toe), np.cos(self.toe)
        return np.array(
            [[-sin_c * sin_t, cos_c * cos_t], [-s * sin_c * cos_t, -s * cos_c * sin_t], [-cos_c, 0.0]]
        )


@dataclass(frozen=True)
class Stand:
    """What is known of the stand beside the poses of its rigs.

    Attributes
    ----------
    road_z_mm
        Height of the wheel supports in the stand's frame, millimetres; None where it is not known.
    temperature_sigma_k
        How far its temperature may be from that at which the rigs were placed, one standard deviation,
        kelvin.
    gradient_sigma_k_per_m
        The same of the temperature's slope along X and along Y each, kelvin per metre.
    expansion_per_k
        Relative expansion of its frame per kelvin.
    """

    road_z_mm: float | None = None
    temperature_sigma_k: float = 0.0
    gradient_sigma_k_per_m: float = 0.0
    expansion_per_k: float = STEEL_PER_K

    def covariance(self, points: Array, sides: tuple[Side, ...]) -> Array:
        """(5 N, 5 N) what its temperature makes of camber, toe and place of wheels at `points` (N, 3).

        A temperature that is linear in X and Y leaves a plane frame without stress (Boley and Weiner 1960):
        it grows by α·T everywhere, and for a slope g along Y bends by α·g·(xy, (y² − x²)/2) and turns by
        −α·g·x, for one along X likewise.
        """
        columns = np.zeros((len(points), AXIS_SIZE, 3))
        for column, (x, y, z), side in zip(columns, points, sides, strict=True):
            half = 0.5 * (x * x - y * y)
            column[2:, 0] = x, y, z
            column[2:4, 1] = half, x * y
            column[2:4, 2] = x * y, -half
            # What is turned to the left with the frame has less toe on the left, and more on the right.
            column[1, 1:] = -SIGN[side] * y, SIGN[side] * x
        per_mm = self.gradient_sigma_k_per_m / 1e3
        sigmas = self.expansion_per_k * np.array([self.temperature_sigma_k, per_mm, per_mm])
        flat = columns.reshape(-1, 3) * sigmas
        out: Array = flat @ flat.T
        return out


@dataclass(frozen=True)
class TyreWidths:
    """Section widths of a vehicle's tyres: from outermost ring to outermost ring, without letters.

    Attributes
    ----------
    front_mm, rear_mm
        Nominal, by axle; None where it is not stated.
    sigma_mm
        Spread of single tyres about it, one standard deviation.
    """

    front_mm: float | None = None
    rear_mm: float | None = None
    sigma_mm: float = 0.0
