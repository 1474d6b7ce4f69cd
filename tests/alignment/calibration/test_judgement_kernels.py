"""The judgement of a shot against plain arrays: drawn signs, and rendered wheels before knocked heads."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from alignment import measure, measure_heads
from alignment.calibration.judgement import Judgement, judge
from alignment.calibration.knocks import Knock, KnockModel
from alignment.stereo.rows import TERMS, RowFields
from alignment.values import MeasureSettings
from alignment.wheel.agreement import MOVES, HeadMoves
from tests import rendered
from tests.alignment.calibration import plain_judgement
from tests.alignment.stereo import plain_rows

Array = NDArray[np.float64]


def assert_same(found: Judgement, expected: Judgement) -> None:
    assert (found.suspected, found.knocked) == (expected.suspected, expected.knocked)
    assert (found.suspect, found.head) == (expected.suspect, expected.head)
    np.testing.assert_allclose(found.row_px, expected.row_px, rtol=1e-9)
    np.testing.assert_allclose(found.row_sigma_px, expected.row_sigma_px, rtol=1e-9)
    if expected.evidence is None:
        assert found.evidence is None
        assert found.unseen is None
        return
    assert expected.unseen is not None
    assert found.evidence == pytest.approx(expected.evidence, rel=1e-6, abs=1e-6)
    np.testing.assert_allclose(found.unseen, expected.unseen, rtol=1e-6)
    # Angles in radians: a billionth is far below what any wheel shows.
    np.testing.assert_allclose(found.angles, expected.angles, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(found.covariance, expected.covariance, rtol=1e-5, atol=1e-18)


def drawn_moves(rng: np.random.Generator, heads: int, points: int = 800, rings: int = 30) -> HeadMoves:
    """Sums of the moves of drawn points on patches of a tyre, and of their residuals."""
    square, of_rings = np.zeros((heads, MOVES, MOVES)), np.zeros((rings, heads, MOVES))
    ring_right, right = np.zeros((rings, heads)), np.zeros((heads, MOVES))
    for h in range(heads):
        angle = 2.0 * np.pi * h / heads + rng.uniform(-0.4, 0.4, points)
        radius, weight = rng.uniform(200.0, 300.0, points), rng.uniform(0.0, 1.0, points)
        x, y, slope = radius * np.cos(angle), radius * np.sin(angle), 0.004 * (radius - 260.0)
        move = np.column_stack([np.ones(points), x, y, slope * x / radius, slope * y / radius])
        rest = 0.03 * rng.normal(size=points) + move @ (
            rng.normal(size=MOVES) * [0.01, 3e-5, 3e-5, 0.02, 0.02]
        )
        square[h], right[h] = (move.T * weight) @ move, (move.T * weight) @ rest
        ring = ((radius - 200.0) / 100.0 * rings).astype(int)
        np.add.at(of_rings[:, h], ring, weight[:, None] * move)
        np.add.at(ring_right[:, h], ring, weight * rest)
    total = of_rings[:, :, 0].sum(axis=1)
    flat = of_rings.reshape(rings, heads * MOVES)
    normal = -(flat.T / total) @ flat
    for h in range(heads):
        mine = slice(MOVES * h, MOVES * (h + 1))
        normal[mine, mine] += square[h]
    target = right.reshape(-1) - flat.T @ (ring_right.sum(axis=1) / total)
    return HeadMoves(square, of_rings, ring_right, normal, target)


def drawn_model(rng: np.random.Generator, heads: int) -> KnockModel:
    size = (MOVES + TERMS) * heads
    scale = np.r_[np.tile([0.01, 1e-4, 1e-4, 0.02, 0.02], heads), np.full(TERMS * heads, 0.2)]
    root = scale[:, None] * rng.normal(size=(size, size)) / np.sqrt(size)
    knocks = tuple(
        Knock(f"{h} {k}", h, 10.0 ** rng.uniform(-1.0, 1.5) * scale[:, None] * rng.normal(size=(size, 6)))
        for h in range(heads)
        for k in range(3)
    )
    weights = np.tile(np.diag([1.0, 0.3, 0.3, 0.1, 0.2]), (heads, 1, 1))
    return KnockModel(root @ root.T, knocks, weights)


def drawn_rows(rng: np.random.Generator, heads: int) -> RowFields:
    pairs = rng.choice([0, 14, 15, 60], heads)
    field, information = np.zeros((heads, TERMS)), np.zeros((heads, TERMS, TERMS))
    for h in np.flatnonzero(pairs >= 15):
        root = rng.normal(size=(TERMS, 20)) / 0.05
        field[h], information[h] = rng.normal(0.0, 0.3, TERMS), root @ root.T
    return RowFields(pairs, np.where(pairs >= 15, 0.1, np.nan), field, information)


@given(st.integers(0, 2**31), st.sampled_from([1, 2, 3, 3, 3, 4]))
@settings(max_examples=80)
def test_drawn_signs_are_judged_as_by_plain_arrays(seed: int, heads: int) -> None:
    rng = np.random.default_rng(seed)
    moves, rows, model = drawn_moves(rng, heads), drawn_rows(rng, heads), drawn_model(rng, heads)
    normal = np.array([*rng.uniform(-0.05, 0.05, 2), 1.0])
    given_signs = (moves, 0.03, rows, model, normal / np.linalg.norm(normal), rng.normal(size=(2, 2)))
    assert_same(judge(*given_signs), plain_judgement.judge(*given_signs))
    np.testing.assert_allclose(moves.misfits(), plain_judgement.misfits(moves), rtol=1e-7)


def test_a_rig_that_shows_no_sign_is_not_judged() -> None:
    rng = np.random.default_rng(3)
    nothing = RowFields(
        np.zeros(2, np.int64), np.full(2, np.nan), np.zeros((2, TERMS)), np.zeros((2, TERMS, TERMS))
    )
    answer = judge(
        drawn_moves(rng, 2), 0.03, nothing, drawn_model(rng, 2), np.array([0.0, 0.0, 1.0]), np.eye(2)
    )
    assert answer.evidence is None
    assert not answer.suspected
    assert np.isnan(answer.row_px).all()


def test_crosses_that_stand_in_one_place_say_nothing_of_rows() -> None:
    """The field's information has no inverse then, which ended in an error of numpy's."""
    rng = np.random.default_rng(4)
    terms = np.array([1.0, 0.5, 0.5, 0.25, 0.25])
    rows = drawn_rows(np.random.default_rng(0), 3)
    rows.pairs[:] = [0, 60, 0]
    rows.information[:], rows.field[:] = 0.0, 0.0
    rows.information[1] = 400.0 * np.outer(terms, terms)
    shared = (drawn_model(rng, 3), np.array([0.0, 0.0, 1.0]), np.eye(2))
    moves = drawn_moves(rng, 3)
    answer = judge(moves, 0.03, rows, *shared)
    without = judge(moves, 0.03, replace(rows, pairs=np.zeros(3, np.int64)), *shared)
    assert np.isnan(answer.row_px[1])
    assert answer.evidence == without.evidence


@pytest.mark.parametrize("turn_deg", [0.0, 0.02, 0.05])
def test_a_rendered_wheel_is_judged_as_by_plain_arrays(
    turn_deg: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = rendered.turned_head(rendered.known_rig(), 1, turn_deg)
    images, told = rendered.images(), {}
    monkeypatch.setattr(
        measure_heads, "row_fields", lambda *a: told.setdefault("rows", plain_rows.row_fields(*a))
    )
    monkeypatch.setattr(
        measure_heads, "judge", lambda *a: told.setdefault("judged", plain_judgement.judge(*a))
    )
    monkeypatch.setattr(HeadMoves, "misfits", plain_judgement.misfits)
    plain = measure.measure_wheel(images, rig, MeasureSettings())
    monkeypatch.undo()
    assert told.keys() == {"rows", "judged"}
    assert (told["rows"].pairs > 20).all()
    seen: list[Judgement] = []
    monkeypatch.setattr(measure_heads, "judge", lambda *a: seen.append(judge(*a)) or seen[-1])
    found = measure.measure_wheel(images, rig, MeasureSettings())
    assert_same(seen[0], told["judged"])
    assert type(found) is type(plain)
    if turn_deg == 0.0:
        assert found.warning is None
        assert (found.camber, found.toe) == (plain.camber, plain.toe)
        np.testing.assert_allclose(found.angle_covariance, plain.angle_covariance, rtol=1e-6)
    else:
        assert found.reason == plain.reason
