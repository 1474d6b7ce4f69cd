"""The analytic sidewall: exact heights, exact gradients, and hits that lie on it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from alignment.errors import DegenerateInputError
from sensors.simulation import shading
from sensors.simulation.lettering import Inscription
from sensors.simulation.surface import relief_near
from sensors.simulation.tyre import SHAPES, Ring, Tyre, draw_tyre, make_tyre

A_NANOMETRE = 1e-6


@pytest.fixture(scope="module")
def tyre() -> Tyre:
    return draw_tyre(np.random.default_rng(11))


def sidewall_points(tyre: Tyre, count: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    radius = rng.uniform(tyre.rim_edge_mm, tyre.outer_radius_mm - 3.0, count)
    angle = rng.uniform(-math.pi, math.pi, count)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])


def test_gradient_is_the_derivative_of_the_height(tyre: Tyre) -> None:
    points = sidewall_points(tyre, 4000, 1)
    _, gradient = tyre.height(points)
    step = 1e-5
    for axis in range(2):
        offset = np.zeros(2)
        offset[axis] = step
        difference = (tyre.height(points + offset)[0] - tyre.height(points - offset)[0]) / (2 * step)
        np.testing.assert_allclose(gradient[:, axis], difference, atol=2e-7)


def test_refined_hits_lie_on_the_analytic_surface_although_the_mesh_does_not(tyre: Tyre) -> None:
    """Open3D works in single precision on facets: its own hits are a millimetre off where letters stand."""
    origin = np.array([10.0, 266.0, 400.0])
    rng = np.random.default_rng(2)
    rays = np.column_stack(
        [rng.uniform(-0.2, 0.2, 50_000), rng.uniform(-0.13, 0.09, 50_000), -np.ones(50_000)]
    )
    packed = np.concatenate([np.broadcast_to(origin, rays.shape), rays], axis=1).astype(np.float32)
    import open3d as o3d

    mesh_depth = tyre.scene.cast_rays(o3d.core.Tensor(packed))["t_hit"].numpy().astype(float)
    depth, gradient, good = shading.refine(rays, mesh_depth, origin, tyre.surface)
    assert good.mean() > 0.999
    points = origin + depth[good, None] * rays[good]
    height, exact_gradient = tyre.height(points[:, :2])
    assert np.abs(points[:, 2] - height).max() < A_NANOMETRE
    slope_error = np.abs(gradient[good, :2] - exact_gradient).max(axis=1)
    assert np.median(slope_error) < 1e-4
    assert slope_error.max() < 0.01
    raw = origin + mesh_depth[:, None] * rays
    assert np.abs(raw[good, 2] - tyre.height(raw[good, :2])[0]).max() > 0.3


def test_lettering_is_never_overlooked_by_the_shortcut_for_flat_places(tyre: Tyre) -> None:
    points = sidewall_points(tyre, 20_000, 3)
    s = tyre.surface
    from sensors.simulation.surface import heights

    bump = heights(points, s.scales, s.profile, s.relief)[0][:, 3]
    near = np.array([relief_near(x, y, 0.5, s.scales, s.relief, s.occupied) for x, y in points])
    assert (bump != 0).any()
    assert near[bump != 0].all()
    assert not near.all()


def test_a_word_stands_out_as_far_as_it_says_and_reads_clockwise() -> None:
    shape = SHAPES["touring"]
    letter = Inscription("L", radius_mm=260.0, angle=math.pi / 2, size_mm=20.0, relief_mm=0.6)
    plain, raised = make_tyre(shape), make_tyre(shape, inscriptions=[letter])
    x, y = np.meshgrid(np.linspace(-12, 12, 97), np.linspace(245, 275, 121))
    points = np.column_stack([x.ravel(), y.ravel()])
    bump = (raised.height(points)[0] - plain.height(points)[0]).reshape(x.shape)
    assert bump.max() == pytest.approx(0.6, abs=0.03)
    assert bump.min() == 0.0
    # On top of the wheel, seen from outboard, an L has its stem on the left and its foot below.
    columns, rows = bump.sum(axis=0), bump.sum(axis=1)
    assert x[0, columns.argmax()] < -2.0
    assert y[rows.argmax(), 0] < 255.0


def test_rings_keep_their_height_and_place() -> None:
    shape = SHAPES["sport"]
    plain, ringed = make_tyre(shape), make_tyre(shape, [Ring(250.0, 0.8, 2.0), Ring(280.0, -0.5, 3.0)])
    points = np.column_stack([np.array([250.0, 280.0, 265.0]), np.zeros(3)])
    difference = ringed.height(points)[0] - plain.height(points)[0]
    np.testing.assert_allclose(difference, [0.8, -0.5, 0.0], atol=1e-3)


def test_shapes_differ_clearly_and_seeds_repeat() -> None:
    touring, again = (draw_tyre(np.random.default_rng(5), "touring") for _ in range(2))
    sport = draw_tyre(np.random.default_rng(5), "sport")
    points = np.column_stack([np.linspace(220, 305, 50), np.zeros(50)])
    np.testing.assert_array_equal(touring.height(points)[0], again.height(points)[0])
    relative = touring.height(points)[0] - sport.height(points)[0]
    assert np.ptp(relative) > 5.0


def test_points_beside_the_tyre_and_unknown_shapes_are_refused(tyre: Tyre) -> None:
    with pytest.raises(DegenerateInputError, match="radii between 60"):
        tyre.height(np.array([[400.0, 0.0]]))
    with pytest.raises(DegenerateInputError, match="touring or sport"):
        draw_tyre(np.random.default_rng(0), "square")


def test_dirt_changes_the_skin_but_not_the_shape(tyre: Tyre) -> None:
    dirty = tyre.with_dirt(np.random.default_rng(4), 30)
    assert dirty.surface is tyre.surface
    assert 0.05 < (np.abs(dirty.texture / tyre.texture - 1.0) > 0.1).mean() < 0.9
