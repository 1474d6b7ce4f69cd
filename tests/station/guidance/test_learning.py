"""What is learned of turns and of locked nuts, and what is not; angles in arcminutes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from alignment.errors import DegenerateInputError
from station.configuration.limits import Limits
from station.guidance.aims import Aims, Room
from station.guidance.drift import FIRST_WEIGHT, MOST_WEIGHT, Drift
from station.guidance.plan import AdjusterPlan, GuidanceSettings, WheelPlan
from station.guidance.reaction import Reaction
from station.guidance.stillness import Rest
from station.guidance.words import AdjusterKind, TurnDirection
from tests.station.guidance.walk import ARCMIN, BOLT, ROD, SIX, bolt, rod


def aims(*, across: float = 0.0, with_bolt: AdjusterPlan | None = None, backlash: float = 0.0) -> Aims:
    plan = WheelPlan("front_left", SIX, SIX, rod(across=across, backlash=backlash), with_bolt)
    drift = Drift(0.0, 9.0 * ARCMIN)
    return Aims.of(plan, GuidanceSettings(), {ROD: drift, BOLT: drift})


def at(camber: float, toe: float) -> Rest:
    return Rest(camber * ARCMIN, toe * ARCMIN)


@pytest.mark.parametrize("share", [0.75, 1.25])
def test_a_turn_that_did_other_than_told_is_learned(share: float) -> None:
    """Told -1 turn of 40′; the axle made more of it, or less."""
    known = aims()
    known.moved(ROD, at(0, 40), at(0, 40 - 40 * share), -1.0, 0.0)
    learned = known.known[ROD].reaction.main / (40 * ARCMIN)
    assert (learned - 1.0) * (share - 1.0) > 0.0
    assert abs(learned - share) < 0.6 * abs(1.0 - share)


def test_turns_that_moved_nothing_teach_nothing() -> None:
    """In the backlash a wheel stands still: a turn does not become worth less by it."""
    known = aims()
    before = known.known[ROD].reaction
    known.moved(ROD, at(0, 40), at(0, 40), -0.2, 0.0)
    known.moved(ROD, at(0, 40), at(0, 40.7), -0.2, 0.0)
    assert known.known[ROD].reaction is before
    assert known.known[ROD].shift == 0.0


def test_a_part_of_a_turn_does_not_become_a_weak_turn() -> None:
    """A wrench is set anew after a sixth of a turn, and the wheel rests meanwhile."""
    known = aims()
    for toe in (40, 33, 26, 19):
        known.moved(ROD, at(0, toe), at(0, toe - 7), -toe / 40.0, 0.0)
    assert known.known[ROD].reaction.main == pytest.approx(40 * ARCMIN, rel=0.08)
    assert known.known[ROD].shift == pytest.approx(-28 * ARCMIN)


def test_who_stops_where_the_screen_says_so_teaches_no_size_but_a_ratio() -> None:
    known = aims()
    known.moved(ROD, at(0, 40), at(-8, 0), -1.0, 0.0)
    reaction = known.known[ROD].reaction
    assert reaction.main == pytest.approx(40 * ARCMIN, rel=0.05)
    assert reaction.ratio == pytest.approx(0.2, abs=0.03)


def test_a_reaction_keeps_its_sign_whatever_is_seen() -> None:
    known = aims()
    for _ in range(20):
        known.moved(ROD, at(0, 0), at(0, 20), -1.0, -40.0 * ARCMIN)
    assert known.known[ROD].reaction.main == pytest.approx(40 * ARCMIN, rel=0.3 + 1e-9)
    assert known.known[ROD].reaction.most == pytest.approx(52 * ARCMIN)


def test_who_turned_the_other_adjuster_teaches_nothing() -> None:
    known = aims(with_bolt=bolt(across=9.0))
    before = known.known[ROD].reaction
    known.moved(ROD, at(0, 40), at(30, 49), -1.0, 0.0)
    assert known.known[ROD].reaction is before
    assert not known.known[ROD].odd


def test_the_backlash_is_added_when_the_direction_changes_and_halved_when_it_was_too_much() -> None:
    known = aims(backlash=0.2)
    assert known.turns(ROD, 20 * ARCMIN) == pytest.approx(0.5)
    known.moved(ROD, at(0, 40), at(0, -10), -1.0, 0.0)
    main = known.known[ROD].reaction.main
    assert known.turns(ROD, 10 * ARCMIN) == pytest.approx(10 * ARCMIN / main + 0.2)
    assert known.turns(ROD, -10 * ARCMIN) == pytest.approx(-10 * ARCMIN / main)
    known.moved(ROD, at(0, -10), at(0, 6), 0.45, 0.0)
    main = known.known[ROD].reaction.main
    assert known.turns(ROD, -6 * ARCMIN) == pytest.approx(-6 * ARCMIN / main - 0.1)


def test_camber_leaves_room_for_what_the_tie_rod_will_do_to_it() -> None:
    """Toe comes 40′ back by the rod, which takes a fifth of it from camber."""
    known = aims(across=8.0, with_bolt=bolt())
    assert known.aim(BOLT, at(20, 40), rod_follows=True) == pytest.approx(8 * ARCMIN)
    assert known.aim(BOLT, at(20, 40), rod_follows=False) == pytest.approx(0.0, abs=1e-12)


def test_camber_and_toe_both_arrive_where_both_adjusters_change_both() -> None:
    known = aims(across=8.0, with_bolt=bolt(across=9.0))
    camber = known.aim(BOLT, at(20, 40), rod_follows=True)
    turned = camber - 20 * ARCMIN
    toe = 40 * ARCMIN + 0.3 * turned
    assert camber + 0.2 * (0.0 - toe) == pytest.approx(0.0, abs=1e-12)


def test_without_a_bolt_toe_is_set_where_camber_is_inside_too() -> None:
    known = aims(across=10.0)
    known.look(0.5 * ARCMIN, 0.5 * ARCMIN)
    # A quarter of the way of toe goes to camber, which is to come up from -6′ by at least 0.55′.
    aim = known.aim(ROD, at(-6.0, 0.0), rod_follows=False)
    assert aim == pytest.approx(0.5 * (2.2 + 5.45) * ARCMIN)


def test_a_nut_teaches_the_mean_and_the_first_one_most() -> None:
    drift = Drift(0.0, 9.0)
    first = drift.after(5.0)
    assert first.mean == pytest.approx(5.0 / (1.0 + FIRST_WEIGHT))
    assert first.weight == 1.0 + FIRST_WEIGHT
    many = drift
    for _ in range(500):
        many = many.after(4.0)
    assert many.mean == pytest.approx(4.0, abs=0.01)
    assert many.weight == MOST_WEIGHT
    assert many.after(5.0).mean - many.mean == pytest.approx((5.0 - many.mean) / MOST_WEIGHT)


def test_what_can_be_no_drift_teaches_nothing() -> None:
    drift = Drift(1.0, 3.0)
    assert drift.after(6.01) is drift
    assert drift.after(-6.01) is drift
    assert drift.after(math.nan) is drift
    assert drift.after(6.0).mean > 1.0


def test_the_room_for_drift_is_bounded_and_can_be_switched_off() -> None:
    assert Drift(8.0, 3.0).expected() == 3.0
    assert Drift(-8.0, 3.0).expected() == -3.0
    assert Drift(2.0, 3.0, used=False).expected(2.0) == 0.0
    assert Drift(2.0, 3.0).expected() == 2.0


def test_the_last_locking_of_this_nut_counts_most_where_little_is_known() -> None:
    assert Drift(0.0, 9.0).expected(5.0) == pytest.approx(4.0)
    assert Drift(2.0, 9.0, weight=60.0).expected(5.0) == pytest.approx(2.9)
    assert Drift(2.0, 9.0).expected(19.0) == 2.0


@pytest.mark.parametrize(("mean", "bound"), [(math.nan, 1.0), (0.0, -1.0), (0.0, math.inf), (math.inf, 1.0)])
def test_a_drift_that_is_no_number_is_refused(mean: float, bound: float) -> None:
    with pytest.raises(DegenerateInputError):
        Drift(mean, bound)


def test_room_says_what_is_missing_to_it() -> None:
    room = Room.of(Limits(-6.0, 6.0), 1.0)
    assert (room.low, room.high, room.middle, room.half) == (-5.0, 5.0, 0.0, 5.0)
    assert [room.missing(value) for value in (-7.0, -5.0, 0.0, 5.0, 7.0)] == [2.0, 0.0, 0.0, 0.0, -2.0]
    assert [room.holds(value) for value in (-5.1, -5.0, 5.0, 5.1)] == [False, True, True, False]


def test_a_movement_is_a_kalman_update() -> None:
    reaction = Reaction.stated(rod())
    after = reaction.after(1.0, 1e-9, np.array([50.0, 5.0]) * ARCMIN, 1e-9 * ARCMIN)
    assert after.mean == pytest.approx(np.array([50.0, 5.0]) * ARCMIN, rel=1e-6)
    assert np.all(np.linalg.eigvalsh(after.covariance) >= -1e-12)


@pytest.mark.parametrize(
    ("kind", "turns", "direction"),
    [
        (ROD, 0.1, TurnDirection.LENGTHEN),
        (ROD, -0.1, TurnDirection.SHORTEN),
        (BOLT, 0.1, TurnDirection.OUT),
        (BOLT, -0.1, TurnDirection.IN),
        (ROD, 0.0, TurnDirection.NONE),
        (AdjusterKind.NONE, 0.1, TurnDirection.NONE),
    ],
)
def test_directions_are_as_a_person_says_them(
    kind: AdjusterKind, turns: float, direction: TurnDirection
) -> None:
    assert TurnDirection.of(kind, turns) is direction


def test_a_bent_axle_is_not_taken_for_the_other_adjuster() -> None:
    """Camber went out 1.3 times as far as toe; a bolt whose toe is half its camber came near to that."""
    known = aims(across=14.0, with_bolt=bolt(across=15.0))
    known.moved(ROD, at(0, -140), at(130, -40), 3.0, 0.0)
    assert known.known[ROD].odd
    assert known.known[ROD].shift == pytest.approx(100 * ARCMIN)


@pytest.mark.parametrize(("toe", "odd"), [(8.1, True), (7.9, False)])
def test_a_small_movement_tells_nothing_of_how_the_angles_hang_together(toe: float, odd: bool) -> None:
    known = aims()
    known.moved(ROD, at(0, 40), at(0.4 * toe, 40 - toe), -1.0, 0.0)
    assert known.known[ROD].odd is odd


@pytest.mark.parametrize(("ratio", "odd"), [(0.29, False), (0.31, True), (-0.29, False), (-0.31, True)])
def test_the_angles_hang_together_as_stated_within_the_stated_error(ratio: float, odd: bool) -> None:
    known = aims()
    known.moved(ROD, at(0, 40), at(20 * ratio, 60), 0.5, 100 * ARCMIN)
    assert known.known[ROD].odd is odd
