"""Normals of a turning wheel as points of a plane: angles from their middle, with the noise of each."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array
from alignment.errors import DegenerateInputError
from alignment.values import Side, WheelMeasurement
from alignment.vehicle.angles import camber_toe_jacobian, normal_from_angles


@dataclass(frozen=True, eq=False)
class Scatter:
    """Normals as angles (N, 2) from their middle along `frame[:2]`, with the noise of each (N, 2, 2)."""

    points: Array
    noise: Array
    frame: Array

    @classmethod
    def of(cls, measurements: Sequence[WheelMeasurement], side: Side, common: Array) -> Scatter:
        """Return the normals of tyre planes of one rig.

        Parameters
        ----------
        measurements
            The tyre planes.
        side
            Side of the vehicle.
        common
            (2, 2) part of every covariance that all share, radians²; it is no noise of a single one.

        Raises
        ------
        DegenerateInputError
            When a covariance without that part is none.
        """
        normals = np.array([normal_from_angles(m.camber, m.toe, side) for m in measurements])
        frame = frame_about(np.median(normals, axis=0))
        noise = np.empty((len(normals), 2, 2))
        for i, (normal, m) in enumerate(zip(normals, measurements, strict=True)):
            own = m.angle_covariance - common
            tilt_by_angles = np.linalg.inv(camber_toe_jacobian(normal, side) @ frame[:2].T)
            noise[i] = tilt_by_angles @ own @ tilt_by_angles.T
            if not np.linalg.eigvalsh(noise[i])[0] > 0.0:
                raise DegenerateInputError(
                    field=f"measurements[{i}].angle_covariance",
                    expected="a positive definite matrix, larger than the common covariance",
                    seen=f"{m.angle_covariance.tolist()} and {common.tolist()}",
                )
        return cls(_points(normals, frame), noise, frame)

    @property
    def sigma(self) -> float:
        """Typical standard deviation of one shot along one direction."""
        return math.sqrt(float(np.median(np.trace(self.noise, axis1=1, axis2=2))) / 2.0)

    def about(self, axis: Array) -> Scatter:
        """Return the same as angles from another unit axis (3,), which is then exact however far they are.

        The noise stays along its directions: the axes differ by minutes of arc.
        """
        frame = frame_about(axis)
        return Scatter(_points(normals_of(self.points, self.frame), frame), self.noise, frame)


def _points(normals: Array, frame: Array) -> Array:
    angle, azimuth = tilt_and_azimuth(normals, frame)
    out: Array = angle[:, None] * np.column_stack([np.cos(azimuth), np.sin(azimuth)])
    return out


def frame_about(axis: Array) -> Array:
    """Rows: towards the top, counter-clockwise of it seen from outboard, the unit axis; vehicle frame."""
    n = axis / np.linalg.norm(axis)
    up = np.array([0.0, 0.0, 1.0]) - n[2] * n
    up /= np.linalg.norm(up)
    return np.array([up, np.cross(n, up), n])


def tilt_and_azimuth(normals: Array, frame: Array) -> tuple[Array, Array]:
    """Angle of normals (N, 3) from the axis of a frame, and their azimuth in it, radians."""
    x, y, z = frame @ normals.T
    return np.arctan2(np.hypot(x, y), z), np.arctan2(y, x)


def normals_of(points: Array, frame: Array) -> Array:
    """Unit normals (N, 3) of angles (N, 2) along the rows of a frame: the inverse of `Scatter.points`."""
    angle = np.linalg.norm(points, axis=-1, keepdims=True)
    out: Array = np.cos(angle) * frame[2] + np.sinc(angle / math.pi) * (points @ frame[:2])
    return out
