"""Simulated rods, bolts and nuts do what theirs do; truth is arithmetic."""

from __future__ import annotations

import numpy as np
import pytest

from alignment.errors import DegenerateInputError
from sensors.simulation.adjusters import BY_HAND, NUTRUNNER, AdjustedWheel, FitterAtWork, SimulatedAdjuster
from sensors.simulation.vehicle import Adjuster, draw_vehicle


def rod(backlash: float = 0.2, drift: float = 0.0, spread: float = 0.0) -> SimulatedAdjuster:
    return SimulatedAdjuster(Adjuster(toe=0.01, camber=0.002), backlash, 3.0, drift, spread, sets_toe=True)


def test_turns_in_the_backlash_move_nothing() -> None:
    turned = rod().turned(1.0)
    assert turned.moved == pytest.approx(0.9)
    assert turned.turned(-0.2).moved == pytest.approx(0.9)
    assert turned.turned(-0.5).moved == pytest.approx(0.6)


def test_an_adjuster_ends_where_its_range_does() -> None:
    turned = rod().turned(50.0)
    assert turned.moved == pytest.approx(3.0)
    assert turned.turned(-0.3).moved == pytest.approx(2.9)
    assert rod().turned(-50.0).moved == pytest.approx(-3.0)


def test_both_angles_move_and_locking_adds_to_its_own() -> None:
    turned = rod(0.0, 0.001).turned(1.0)
    assert turned.effect == pytest.approx((0.002, 0.01))
    assert turned.locked(np.random.default_rng(1)).effect == pytest.approx((0.002, 0.011))


def test_a_wheel_adds_what_its_adjusters_do_and_stands_so_on_a_vehicle() -> None:
    wheel = AdjustedWheel(-0.01, 0.002, {"tie_rod": rod(0.0)}).turned("tie_rod", 1.0)
    assert wheel.angles == pytest.approx((-0.008, 0.012))
    vehicle = wheel.on_vehicle(draw_vehicle(3), "rear_left")
    assert vehicle.corners["rear_left"].angles == pytest.approx((-0.008, 0.012))
    assert vehicle.corners["front_left"] is not None


def test_a_fitter_who_watches_stops_at_once_and_a_nutrunner_ends_its_turn() -> None:
    left = {}
    for fitter in (BY_HAND, NUTRUNNER):
        wheel = AdjustedWheel(0.0, 0.0, {"tie_rod": rod(0.0)})
        work = FitterAtWork(wheel, fitter, np.random.default_rng(2))
        work.turn("tie_rod", 2.0, 0.2)
        for _ in range(60):
            work.hold(0.2)
        left[fitter] = work.wheel.adjusters["tie_rod"].hand
    assert left[BY_HAND] == pytest.approx(0.08)
    assert left[NUTRUNNER] == pytest.approx(2.0, rel=0.1)


def test_a_nut_is_locked_once_and_only_when_it_is_loose() -> None:
    wheel = AdjustedWheel(0.0, 0.0, {"tie_rod": rod(0.0, 0.001)})
    work = FitterAtWork(wheel, BY_HAND, np.random.default_rng(2))
    for _ in range(20):
        work.lock("tie_rod", 0.2)
    assert work.locked == {"tie_rod": 0}
    work.turn("tie_rod", 0.01, 0.2)
    for _ in range(20):
        work.lock("tie_rod", 0.2)
    assert work.locked == {"tie_rod": 1}
    assert work.wheel.adjusters["tie_rod"].drifted == pytest.approx(0.001)


@pytest.mark.parametrize(("backlash", "turns"), [(-0.1, 3.0), (0.1, 0.0)])
def test_what_can_be_no_adjuster_is_refused(backlash: float, turns: float) -> None:
    with pytest.raises(DegenerateInputError):
        SimulatedAdjuster(Adjuster(0.01, 0.0), backlash, turns, 0.0, 0.0, sets_toe=True)
