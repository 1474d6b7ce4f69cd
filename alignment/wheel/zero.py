"""Angles relative to a master wheel: a wheel whose angles are certified is measured once and turned to them.

What a rig's calibration and its pose in the vehicle get wrong in common for all wheels, the master shows. The
correction is a rotation of normals in the vehicle frame, the smallest that takes the measured normal of the
master to the certified one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from alignment.arrays import Array
from alignment.errors import DegenerateInputError
from alignment.geometry.transforms import RigidTransform
from alignment.values import Side, WheelMeasurement
from alignment.vehicle.angles import camber_toe, normal_from_angles


@dataclass(frozen=True, eq=False)
class ZeroCorrection:
    """What a zero measurement does to the angles of a wheel.

    Attributes
    ----------
    rotation
        (3, 3) takes measured normals to corrected ones, vehicle frame.
    covariance
        (2, 2) of the (camber, toe) that it adds, radians²: of the measured master without what it shares with
        every wheel, and of its certificate. Not covered: a rotation of the rig about the wheel's axis, which
        a wheel at zero does not show.
    side
        Side of the vehicle.
    """

    rotation: Array
    covariance: Array
    side: Side

    def corrected(self, measurement: WheelMeasurement) -> WheelMeasurement:
        """Return the measurement with corrected angles and their combined covariance.

        The normal and the plane stay as measured, in the rig frame. The calibration's share of the covariance
        stays too, though most of it is common to master and wheel and cancels.
        """
        return self._turned(measurement, self.rotation, measurement.angle_covariance + self.covariance)

    def removed(self, measurement: WheelMeasurement) -> WheelMeasurement:
        """Return what was measured before `corrected`."""
        return self._turned(measurement, self.rotation.T, measurement.angle_covariance - self.covariance)

    def _turned(self, measurement: WheelMeasurement, rotation: Array, covariance: Array) -> WheelMeasurement:
        normal = rotation @ normal_from_angles(measurement.camber, measurement.toe, self.side)
        camber, toe = camber_toe(normal, self.side)
        return replace(measurement, camber=camber, toe=toe, angle_covariance=covariance)


def zero_correction(
    measured: tuple[float, float], certified: tuple[float, float], covariance: Array, side: Side
) -> ZeroCorrection:
    """Return the correction that a master wheel shows.

    Parameters
    ----------
    measured, certified
        Camber and toe of the master wheel, radians.
    covariance
        (2, 2) of measured less certified (camber, toe), radians².
    side
        Side of the vehicle.

    Raises
    ------
    DegenerateInputError
        When measured and certified angles are more than a quarter turn apart, or the covariance is none.
    """
    covariance = np.asarray(covariance, dtype=np.float64)
    if covariance.shape != (2, 2) or not np.linalg.eigvalsh(covariance)[0] >= 0.0:
        raise DegenerateInputError(
            field="covariance", expected="a 2 × 2 covariance", seen=f"{covariance.tolist()}"
        )
    before, after = (normal_from_angles(*angles, side) for angles in (measured, certified))
    if not before @ after > 0.0:
        raise DegenerateInputError(
            field="certified",
            expected="angles near the measured ones, camber {:.4g} and toe {:.4g} rad".format(*measured),
            seen="camber {:.4g} and toe {:.4g} rad".format(*certified),
        )
    across = np.cross(before, after)
    sine = float(np.linalg.norm(across))
    turn = np.arctan2(sine, before @ after) / sine if sine > 0.0 else 1.0
    rotation = RigidTransform.from_rotvec(turn * across, np.zeros(3)).rotation
    return ZeroCorrection(rotation, covariance, side)
