import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from alignment.errors import DegenerateInputError
from alignment.geometry.transforms import RigidTransform
from tests.strategies import transforms

POINTS = np.array([[0.0, 0.0, 0.0], [100.0, -20.0, 3.0], [-7.0, 250.0, 400.0]])


@given(transforms(), transforms())
def test_chaining_equals_applying_one_after_the_other(a: RigidTransform, b: RigidTransform) -> None:
    np.testing.assert_allclose((a @ b).apply(POINTS), a.apply(b.apply(POINTS)), atol=1e-9)


@given(transforms())
def test_a_transform_and_its_inverse_cancel(a: RigidTransform) -> None:
    np.testing.assert_allclose(a.inverse().apply(a.apply(POINTS)), POINTS, atol=1e-9)
    np.testing.assert_allclose((a @ a.inverse()).rotation, np.eye(3), atol=1e-12)


@given(transforms())
def test_rotation_vectors_round_trip(a: RigidTransform) -> None:
    again = RigidTransform.from_rotvec(a.rotvec(), a.translation)
    np.testing.assert_allclose(again.rotation, a.rotation, atol=1e-12)


@given(transforms(), st.floats(-1e-3, 1e-3))
def test_a_perturbation_turns_about_the_source_axes_and_shifts_in_the_target(
    a: RigidTransform, angle: float
) -> None:
    turned = a.perturbed(np.array([0.0, 0.0, angle]), np.array([1.0, 2.0, 3.0]))
    np.testing.assert_allclose(turned.apply_vectors([0.0, 0.0, 1.0]), a.apply_vectors([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(turned.translation - a.translation, [1.0, 2.0, 3.0], atol=1e-9)


def test_a_mirrored_matrix_is_not_a_rotation() -> None:
    with pytest.raises(DegenerateInputError, match="determinant"):
        RigidTransform(np.diag([1.0, 1.0, -1.0]), np.zeros(3))


def test_a_stretched_matrix_is_not_a_rotation() -> None:
    with pytest.raises(DegenerateInputError, match="orthonormal"):
        RigidTransform(1.001 * np.eye(3), np.zeros(3))


def test_nothing_infinite_gets_into_a_transform() -> None:
    with pytest.raises(DegenerateInputError, match="finite"):
        RigidTransform(np.eye(3), np.array([0.0, np.inf, 0.0]))


def test_a_transform_cannot_be_changed_behind_its_back() -> None:
    with pytest.raises(ValueError, match="read-only"):
        RigidTransform.identity().rotation[0, 0] = 2.0
