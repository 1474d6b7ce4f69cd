"""What a shot says of movements that it cannot show, against draws of such movements."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from alignment.arrays import Array
from alignment.calibration.judgement import Judgement, judge
from alignment.calibration.knocks import KnockModel, knock_model
from alignment.calibration.prediction import NominalWheel, wheel_points
from alignment.stereo.rows import TERMS, RowFields
from alignment.units import ARCMIN
from alignment.values import RigCalibration
from alignment.wheel.agreement import MOVES, HeadMoves
from sensors.simulation.rigs import RIG_SPECS, build_rig
from station.studies.knocked import plate_covariance

RMS, HEADS = 0.03, 3
POINTS = 3000  # per head
TILTS = np.eye(2)
QUIET_ROWS = np.diag([0.01, 0.02, 0.02, 0.04, 0.04])  # noise of a row field, pixels


@dataclass(frozen=True)
class Signs:
    """Draws of signs of one rig, before a nominal wheel."""

    model: KnockModel
    normal: Array

    def judged(self, signs: Array, rows_seen: bool = True) -> Judgement:
        amounts, fields = signs[: MOVES * HEADS], signs[MOVES * HEADS :].reshape(HEADS, TERMS)
        moves = HeadMoves(np.zeros(0), np.zeros(0), np.zeros(0), self.normal, self.normal @ amounts)
        pairs = np.full(HEADS, 300 if rows_seen else 0)
        information = np.tile(np.linalg.inv(QUIET_ROWS**2), (HEADS, 1, 1))
        rows = RowFields(pairs, np.full(HEADS, 0.1), fields, information)
        return judge(moves, RMS, rows, self.model, np.array([0.0, 0.0, 1.0]), TILTS)

    def drawn(self, rng: np.random.Generator) -> Array:
        """Errors of the calibration, and noise."""
        size = MOVES * HEADS
        out = rng.multivariate_normal(np.zeros(2 * size), self.model.covariance, method="eigh")
        values, vectors = np.linalg.eigh(self.normal)
        out[:size] += vectors @ (rng.normal(size=size) * RMS / np.sqrt(np.maximum(values, 1.0)))
        out[size:] += np.tile(np.diag(QUIET_ROWS), HEADS) * rng.normal(size=size)
        return out

    def angles(self, amounts: Array) -> Array:
        """(2,) change of the angles that the fit takes the amounts of all heads for."""
        common = np.tile(np.eye(MOVES), (HEADS, 1))
        of_common = common.T @ self.normal
        out: Array = np.linalg.lstsq(of_common @ common, of_common @ amounts, rcond=1e-8)[0][1:3]
        return -out


@pytest.fixture(scope="module")
def rig() -> RigCalibration:
    true = build_rig(RIG_SPECS["standard"], "rig", "left", np.random.default_rng(4))
    return replace(true, covariance=plate_covariance(true, np.random.default_rng(6)))


@pytest.fixture(scope="module")
def signs(rig: RigCalibration) -> Signs:
    wheel = NominalWheel()
    moves, rings, head = [], [], []
    for k, each in enumerate(rig.heads):
        points = wheel_points(each, wheel)
        radius = np.hypot(points[:, 0], points[:, 1])
        slope = (wheel.slope(radius) / radius)[:, None] * points[:, :2]
        mine = np.zeros((len(points), MOVES * HEADS))
        mine[:, MOVES * k : MOVES * (k + 1)] = np.column_stack([np.ones(len(points)), points[:, :2], slope])
        moves.append(mine * np.sqrt(POINTS / len(points)))
        rings.append((radius / 10.0).astype(np.int64))
        head.append(np.full(len(points), np.sqrt(POINTS / len(points))))
    design, ring, root = np.vstack(moves), np.concatenate(rings), np.concatenate(head)
    free = (ring[:, None] == np.unique(ring)) * root[:, None]
    rest = design - free @ np.linalg.lstsq(free, design, rcond=None)[0]
    return Signs(knock_model(rig), rest.T @ rest)


def test_a_rise_as_large_as_what_stays_unseen_is_found_in_95_of_100_and_half_of_it_is_not(
    signs: Signs, rig: RigCalibration
) -> None:
    rng = np.random.default_rng(5)
    quiet = signs.judged(np.zeros(2 * MOVES * HEADS))
    assert quiet.unseen is not None
    assert not quiet.suspected
    assert 0.2 * ARCMIN < quiet.unseen.max() < 1.0 * ARCMIN
    rises = [knock.signs[:, 5] for knock in signs.model.knocks if knock.name == rig.heads[knock.head].name]
    # Of all heads' rises the one that reaches what is stated the soonest.
    reach = np.array([np.abs(signs.angles(rise[: MOVES * HEADS])) / quiet.unseen for rise in rises]).max(
        axis=1
    )
    rise = rises[int(reach.argmax())] / reach.max()
    found = {
        size: sum(signs.judged(signs.drawn(rng) + size * rise).suspected for _ in range(200))
        for size in (1.0, 0.5, 0.0)
    }
    assert found[1.0] >= 190
    assert found[0.5] < 190
    assert found[0.0] <= 4


def test_more_stays_unseen_where_no_crosses_show_the_rows(signs: Signs) -> None:
    nothing = np.zeros(2 * MOVES * HEADS)
    with_rows, without = signs.judged(nothing).unseen, signs.judged(nothing, rows_seen=False).unseen
    assert with_rows is not None
    assert without is not None
    assert (without > with_rows).all()
