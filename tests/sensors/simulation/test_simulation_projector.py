"""The projected grid: where its lines fall, how bright, and no light where none is expected."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from alignment.errors import DegenerateInputError
from alignment.geometry.transforms import RigidTransform
from sensors.simulation.projector import LinePattern, Projector, irradiance, may_light

IDENTITY = RigidTransform.identity()


def light_at(projector: Projector, points: np.ndarray) -> np.ndarray:
    vector, lines = projector.packed(IDENTITY)
    return np.array([irradiance(*point, 0, vector[None], lines[None]) for point in points])


def across(x: np.ndarray, y: float, z: float) -> np.ndarray:
    return np.column_stack([x, np.full_like(x, y), np.full_like(x, z)])


def test_lines_fall_on_the_pitch_and_their_middle_has_the_stated_level() -> None:
    pattern = LinePattern(columns=3, rows=2, width_mm=1.0, edge_mm=0.1)
    projector = Projector(IDENTITY, pattern, level=5.0, falloff=0.0, focus_mm=400.0)
    light = light_at(projector, across(np.array([-15.0, 0.0, 15.0, 7.0]), 0.0, 400.0))
    assert light[1] == pytest.approx(5.0, rel=1e-5)
    assert light[0] == light[2] == pytest.approx(5.0, rel=2e-3)  # farther from the projector
    assert light[3] == 0.0
    half = light_at(projector, across(np.array([0.5]), 0.0, 400.0))
    assert half[0] == pytest.approx(2.5, rel=1e-3)


@pytest.mark.parametrize("edge_mm", [0.02, 0.3, 0.7])
def test_the_flanks_of_a_line_are_the_error_function(edge_mm: float) -> None:
    """Looked up in a table, as closely as eight bits, or sixteen, can ever tell."""
    pattern = LinePattern(columns=1, rows=1, missing_rows=(0,), width_mm=0.9, edge_mm=edge_mm)
    projector = Projector(IDENTITY, pattern, level=1.0, falloff=0.0, focus_mm=400.0)
    x = np.linspace(-5.0, 5.0, 4001)
    light = light_at(projector, across(x, 3.0, 400.0)) * (1.0 + (x**2 + 9.0) / 400.0**2)

    def open_to(edge: float) -> np.ndarray:
        return np.array([math.erf(s) for s in (x + edge) / (edge_mm * math.sqrt(2.0))])

    expected = 0.5 * (open_to(0.45) - open_to(-0.45))
    near = (np.abs(x) < 0.45 + 3.6 * edge_mm) & (light > 0.0)
    assert near.sum() > 300
    assert light[near] == pytest.approx(expected[near], abs=1e-8)


def test_light_spreads_with_the_distance_and_lines_widen_out_of_focus() -> None:
    pattern = LinePattern(width_mm=1.0, edge_mm=0.1)
    projector = Projector(IDENTITY, pattern, falloff=0.0, focus_mm=400.0, aperture_mm=8.0)
    near, far = light_at(projector, np.array([[0.0, 3.0, 400.0], [0.0, 3.0, 480.0]]))
    assert far < near / 1.44
    x = np.linspace(-4, 4, 801)
    spread = []
    for z in (400.0, 480.0):
        light = light_at(projector, across(x * z / 400.0, 4.0 * z / 400.0, z))
        spread.append(np.sqrt((light * x**2).sum() / light.sum()))
    assert spread[1] > 1.2 * spread[0]


def test_crosses_are_not_brighter_than_lines() -> None:
    projector = Projector(IDENTITY, LinePattern(width_mm=1.5, edge_mm=0.1), falloff=0.0)
    cross, column = light_at(projector, np.array([[0.0, 0.0, 400.0], [0.0, 6.0, 400.0]]))
    assert cross == pytest.approx(column, rel=1e-3)


def test_missing_lines_are_dark_and_nothing_falls_beyond_the_border() -> None:
    projector = Projector(IDENTITY, LinePattern(missing_columns=(6,), missing_rows=(4,)))
    assert light_at(projector, np.array([[0.0, 0.0, 400.0]]))[0] == 0.0
    whole = replace(projector, pattern=LinePattern())
    assert light_at(whole, np.array([[0.0, 0.0, 400.0]]))[0] > 0.0
    beyond = np.array([[110.0, 0.0, 400.0], [0.0, -90.0, 400.0], [0.0, 0.0, -400.0]])
    assert (light_at(whole, beyond) == 0.0).all()


def test_places_called_dark_are_dark() -> None:
    rng = np.random.default_rng(3)
    vector, lines = Projector(IDENTITY, LinePattern()).packed(IDENTITY)
    called_dark = 0
    for _ in range(2000):
        corner = rng.uniform([-110, -90, 370], [110, 90, 430])
        cell = corner + np.array([[0, 0, 0], [0.5, 0, 0.1], [0, 0.5, 0.2], [0.5, 0.5, 0.3]])
        if not may_light(cell, 0.0, 0, vector[None]):
            called_dark += 1
            share = rng.uniform(0, 1, (20, 2))
            inside = corner + np.column_stack([share * 0.5, share @ [0.1, 0.2]])
            assert max(irradiance(*point, 0, vector[None], lines[None]) for point in inside) == 0.0
    assert 500 < called_dark < 1800


def test_lines_that_run_together_are_refused() -> None:
    with pytest.raises(DegenerateInputError, match="run together"):
        LinePattern(column_pitch_mm=2.0, width_mm=2.0)
