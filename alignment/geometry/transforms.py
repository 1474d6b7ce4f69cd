"""Rigid transforms, named and chained by reading: `rig_from_camera = rig_from_head @ head_from_camera`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.arrays import Array
from alignment.errors import DegenerateInputError


def _frozen(values: object, shape: tuple[int, ...], name: str) -> Array:
    array = np.array(values, dtype=np.float64)
    if array.shape != shape or not np.isfinite(array).all():
        raise DegenerateInputError(
            field=name, expected=f"finite numbers of shape {shape}", seen=f"shape {array.shape}"
        )
    array.flags.writeable = False
    return array


@dataclass(frozen=True, eq=False)
class RigidTransform:
    """Maps points of a source frame to a target frame: p_target = R p_source + t.

    Attributes
    ----------
    rotation
        (3, 3) proper rotation matrix R.
    translation
        (3,) position of the source origin in the target frame, millimetres.
    """

    rotation: Array
    translation: Array

    def __post_init__(self) -> None:
        rotation = _frozen(self.rotation, (3, 3), "rotation")
        deviation = np.abs(rotation @ rotation.T - np.eye(3)).max()
        if deviation > 1e-6 or np.linalg.det(rotation) < 0:
            raise DegenerateInputError(
                field="rotation",
                expected="an orthonormal matrix with determinant +1",
                seen=f"largest deviation of R Rᵀ from identity {deviation:.2e}",
            )
        object.__setattr__(self, "rotation", rotation)
        object.__setattr__(self, "translation", _frozen(self.translation, (3,), "translation"))

    @classmethod
    def identity(cls) -> Self:
        """Return the transform that changes nothing."""
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def from_rotvec(cls, rotvec: Array, translation: Array) -> Self:
        """Build from a rotation vector (3,), radians, and a translation (3,), millimetres."""
        return cls(Rotation.from_rotvec(np.asarray(rotvec, float)).as_matrix(), translation)

    def rotvec(self) -> Array:
        """Return the rotation vector (3,), radians, length at most π."""
        return np.asarray(Rotation.from_matrix(self.rotation).as_rotvec(), dtype=np.float64)

    def __matmul__(self, other: RigidTransform) -> RigidTransform:
        """Chain: `(a_from_b @ b_from_c).apply(p_c) == a_from_b.apply(b_from_c.apply(p_c))`."""
        return RigidTransform(
            self.rotation @ other.rotation, self.rotation @ other.translation + self.translation
        )

    def inverse(self) -> RigidTransform:
        """Return the transform from target to source."""
        return RigidTransform(self.rotation.T, -self.rotation.T @ self.translation)

    def apply(self, points: Array) -> Array:
        """Map points (..., 3), millimetres."""
        return np.asarray(points, dtype=np.float64) @ self.rotation.T + self.translation

    def apply_vectors(self, vectors: Array) -> Array:
        """Map directions (..., 3): rotation only."""
        return np.asarray(vectors, dtype=np.float64) @ self.rotation.T

    def perturbed(self, rotvec: Array, translation: Array) -> RigidTransform:
        """Return the transform with R → R·exp([rotvec]×) and t → t + translation.

        Parameters
        ----------
        rotvec
            (3,) small rotation about the axes of the *source* frame, radians.
        translation
            (3,) shift of the source origin in the *target* frame, millimetres.
        """
        step = Rotation.from_rotvec(np.asarray(rotvec, float)).as_matrix()
        return RigidTransform(self.rotation @ step, self.translation + np.asarray(translation, float))


def cross_matrices(vectors: Array) -> Array:
    """Return the matrices (…, 3, 3) of the cross products v × of vectors (…, 3)."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    rows = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]])
    return np.moveaxis(rows, (0, 1), (-2, -1))
