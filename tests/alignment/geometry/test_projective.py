"""Joins and meets, conics and their poles, homographies, the absolute conic."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from alignment.errors import DegenerateInputError
from alignment.geometry.cameras import Array
from alignment.geometry.projective import (
    CIRCULAR_POINTS,
    LINE_AT_INFINITY,
    PLANE_AT_INFINITY,
    absolute_conic_image,
    camera_of_absolute_conic,
    circle,
    conic_through,
    fit_homography,
    homogeneous,
    inhomogeneous,
    join,
    mapped_conic,
    meet,
    polar,
    pole,
)

COORDINATE = st.floats(-100.0, 100.0)
POINT = st.tuples(COORDINATE, COORDINATE).map(np.array)
HOMOGRAPHY = np.array([[1.1, 0.2, 30.0], [-0.1, 0.9, 20.0], [1e-3, -5e-4, 1.0]])


def same_up_to_scale(a: Array, b: Array) -> bool:
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    return bool(min(np.abs(a - b).max(), np.abs(a + b).max()) < 1e-8)


@given(POINT, POINT)
def test_join_goes_through_both_points(a: Array, b: Array) -> None:
    p, q = homogeneous(np.array([a, b]))
    if np.linalg.norm(a - b) < 0.1:
        return
    line = join(p, q)
    assert abs(line @ p) < 1e-9 * np.linalg.norm(p)
    assert abs(line @ q) < 1e-9 * np.linalg.norm(q)
    assert same_up_to_scale(line, np.cross(p, q))


def test_lines_meet_and_parallel_lines_meet_at_infinity() -> None:
    point = meet(np.array([1.0, 0.0, -3.0]), np.array([0.0, 1.0, -4.0]))
    np.testing.assert_allclose(inhomogeneous(point[None]), [[3.0, 4.0]])
    far = meet(np.array([1.0, 1.0, -3.0]), np.array([1.0, 1.0, 5.0]))
    assert abs(far @ LINE_AT_INFINITY) < 1e-12
    with pytest.raises(DegenerateInputError, match="infinity"):
        inhomogeneous(far[None])


def test_three_points_of_space_join_in_a_plane_and_three_planes_meet_in_a_point() -> None:
    points = homogeneous(np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]]))
    assert same_up_to_scale(join(*points), np.array([1.0, 1.0, 1.0, -1.0]))
    planes = np.array([[1.0, 0, 0, -2.0], [0, 1.0, 0, -3.0], [0, 0, 1.0, -4.0]])
    np.testing.assert_allclose(inhomogeneous(meet(*planes)[None]), [[2.0, 3.0, 4.0]])
    direction = meet(planes[0], planes[1], PLANE_AT_INFINITY)
    assert same_up_to_scale(direction, np.array([0.0, 0.0, 1.0, 0.0]))


def test_dependent_or_ill_sized_elements_are_refused() -> None:
    point = np.array([1.0, 2.0, 1.0])
    with pytest.raises(DegenerateInputError, match="independent"):
        join(point, 3.0 * point)
    with pytest.raises(DegenerateInputError, match="length 3"):
        join(point, point, point)


@given(POINT, st.floats(0.1, 50.0))
def test_every_circle_goes_through_the_circular_points(centre: Array, radius: float) -> None:
    conic = circle(centre, radius)
    for point in CIRCULAR_POINTS:
        assert abs(point @ conic @ point) < 1e-12
    np.testing.assert_allclose(
        inhomogeneous(pole(conic, LINE_AT_INFINITY)[None])[0], centre, rtol=1e-6, atol=1e-6
    )


def test_conic_through_points_and_its_tangent() -> None:
    angle = np.linspace(0.0, 5.0, 9)
    points = np.column_stack([40.0 + 8.0 * np.cos(angle), 7.0 + 3.0 * np.sin(angle)])
    conic = conic_through(points)
    for point in homogeneous(points):
        assert abs(point @ conic @ point) < 1e-12 * np.square(point).sum()
    tangent = polar(conic, np.array([48.0, 7.0, 1.0]))
    assert same_up_to_scale(tangent, np.array([1.0, 0.0, -48.0]))
    with pytest.raises(DegenerateInputError, match="five"):
        conic_through(points[:4])
    with pytest.raises(DegenerateInputError, match="line"):
        conic_through(np.column_stack([angle, 2 * angle]))
    with pytest.raises(DegenerateInputError, match="pair of lines"):
        pole(np.outer([1.0, 0, 0], [1.0, 0, 0]), LINE_AT_INFINITY)


def test_image_of_a_circle_and_of_its_centre() -> None:
    """The centre's image is the pole of the vanishing line, not the centre of the ellipse."""
    centre = np.array([10.0, -5.0])
    image = mapped_conic(HOMOGRAPHY, circle(centre, 20.0))
    vanishing = np.linalg.inv(HOMOGRAPHY).T @ LINE_AT_INFINITY
    true = HOMOGRAPHY @ [*centre, 1.0]
    assert same_up_to_scale(pole(image, vanishing), true)
    of_ellipse = inhomogeneous(pole(image, LINE_AT_INFINITY)[None])[0]
    assert np.linalg.norm(of_ellipse - inhomogeneous(true[None])[0]) > 0.1


def test_homography_comes_back() -> None:
    rng = np.random.default_rng(3)
    points = rng.uniform(-100, 100, (10, 2))
    pixels = inhomogeneous(homogeneous(points) @ HOMOGRAPHY.T)
    assert same_up_to_scale(fit_homography(points, pixels), HOMOGRAPHY)


def test_camera_follows_from_the_absolute_conic_and_the_pose_does_not_matter() -> None:
    k = np.array([[800.0, 2.0, 310.0], [0.0, 820.0, 250.0], [0.0, 0.0, 1.0]])
    omega = absolute_conic_image(k)
    np.testing.assert_allclose(camera_of_absolute_conic(-3.0 * omega), k, rtol=1e-9)
    # The circular points of any plane are imaged onto it.
    rotation = Rotation.from_euler("xyz", [0.5, -0.3, 1.0]).as_matrix()
    homography = k @ np.column_stack([rotation[:, 0], rotation[:, 1], [3.0, 4.0, 500.0]])
    for point in CIRCULAR_POINTS:
        image = homography @ point
        assert abs(image @ omega @ image) < 1e-9
    with pytest.raises(DegenerateInputError, match="definite"):
        camera_of_absolute_conic(np.diag([1.0, 1.0, -1.0]))
