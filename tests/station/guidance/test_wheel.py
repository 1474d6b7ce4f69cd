"""The guidance of one wheel, walked through state by state; angles in arcminutes."""

from __future__ import annotations

from dataclasses import replace

import pytest

from station.guidance.aims import Aims
from station.guidance.drift import Drift
from station.guidance.plan import AdjusterPlan, GuidanceSettings, WheelPlan, WheelReading
from station.guidance.states import GUIDANCE_STATES
from station.guidance.stillness import Rest
from station.guidance.wheel import Advice
from station.guidance.words import AdjusterKind, GuidanceState, OutOfReach, TurnDirection
from tests.station.guidance.walk import ARCMIN, BOLT, ROD, SIX, Walk, bolt, rod

S = GuidanceState


def approx(value: float, within: float = 1e-9) -> object:
    return pytest.approx(value, abs=within)


def turned_to(walk: Walk, toe: float, camber: float = 0.0) -> None:
    """Turn, hold, and be told to lock."""
    held = walk.at(camber, toe)
    assert held.state is S.HOLD
    assert held.turns is not None
    told = walk.at(camber, toe, 4)
    assert told.state is S.LOCK_NUT
    assert told.turns is None
    assert told.adjuster is not AdjusterKind.NONE


def test_a_wheel_that_is_found_inside_is_done_and_never_touched() -> None:
    walk = Walk(with_rod=rod())
    assert walk.at(0.0, 5.0, 3).state is S.CHECK
    assert walk.at(0.0, 5.0).state is S.DONE
    assert walk.guide.count == 0
    assert walk.guide.corrections == ()
    assert walk.guide.finished


def test_nothing_is_said_before_the_wheel_was_seen() -> None:
    walk = Walk(with_rod=rod())
    assert walk.lost().state is S.NONE
    assert not walk.guide.finished


@pytest.mark.parametrize(
    ("toe", "main", "turns", "direction"),
    [
        (20.0, 40.0, -0.5, TurnDirection.SHORTEN),
        (-20.0, 40.0, 0.5, TurnDirection.LENGTHEN),
        (20.0, -40.0, 0.5, TurnDirection.LENGTHEN),
        (-20.0, -40.0, -0.5, TurnDirection.SHORTEN),
    ],
)
def test_toe_is_turned_to_the_middle_by_the_tie_rod(
    toe: float, main: float, turns: float, direction: TurnDirection
) -> None:
    """`main`: whether lengthening toes in or out depends on where the rack lies."""
    advice = Walk(with_rod=rod(main), with_bolt=bolt()).at(0.0, toe, 4)
    assert (advice.state, advice.adjuster) == (S.TURN, ROD)
    assert advice.turns == approx(turns)
    assert TurnDirection.of(advice.adjuster, advice.turns or 0.0) is direction
    assert advice.toe == approx(0.0)
    assert advice.camber is None


@pytest.mark.parametrize(
    ("camber", "turns", "direction"), [(-15.0, 0.5, TurnDirection.OUT), (15.0, -0.5, TurnDirection.IN)]
)
def test_camber_comes_before_toe(camber: float, turns: float, direction: TurnDirection) -> None:
    advice = Walk(with_rod=rod(), with_bolt=bolt()).at(camber, 20.0, 4)
    assert (advice.state, advice.adjuster) == (S.TURN, BOLT)
    assert advice.turns == approx(turns)
    assert TurnDirection.of(advice.adjuster, advice.turns or 0.0) is direction
    assert advice.camber == approx(0.0)
    assert advice.toe is None


def test_one_correction_from_found_to_done() -> None:
    walk = Walk(with_rod=rod())
    walk.at(0.0, 20.0, 4)
    assert walk.at(0.0, 10.0).turns == approx(-0.25)
    turned_to(walk, 0.2)
    assert walk.at(0.0, 0.2, 3).state is S.LOCK_NUT
    walk.at(0.0, 2.0)
    assert walk.at(0.0, 3.0, 5).state is S.CHECK
    assert walk.at(0.0, 3.0, 4).state is S.DONE
    (done,) = walk.guide.corrections
    assert done.adjuster is ROD
    assert done.turns == approx(-19.8 / 40.0)
    assert done.taken == approx(0.2 * ARCMIN)
    assert done.locked == approx(3.0 * ARCMIN)
    assert walk.guide.count == 1
    assert walk.guide.found is not None
    assert walk.guide.found.toe == approx(20.0 * ARCMIN)


def test_what_locking_carries_out_of_the_limits_is_turned_again_and_remembered() -> None:
    walk = Walk(with_rod=rod())
    walk.at(0.0, 20.0, 4)
    turned_to(walk, 0.0)
    walk.at(0.0, 8.0, 5)
    advice = walk.at(0.0, 8.0, 4)
    assert advice.state is S.TURN
    # The one nut says four fifths of what is believed of it: the vehicle type's figure counts a quarter.
    assert advice.toe == approx(-6.4 * ARCMIN)
    assert advice.drift == approx(6.4 * ARCMIN)
    assert walk.guide.count == 2
    assert advice.turns == approx(-14.4 / 40.0)


@pytest.mark.parametrize(("used", "aim"), [(True, -4.0), (False, 0.0)])
def test_the_target_leaves_room_for_the_usual_drift(used: bool, aim: float) -> None:
    walk = Walk(with_rod=rod(), drift=Drift(4.0 * ARCMIN, 9.0 * ARCMIN, used))
    advice = walk.at(0.0, 20.0, 4)
    assert advice.toe == approx(aim * ARCMIN)
    assert advice.turns == approx((aim - 20.0) / 40.0)
    assert advice.drift == approx(-aim * ARCMIN)


def test_who_turns_on_out_of_the_window_is_told_so() -> None:
    walk = Walk(with_rod=rod())
    walk.at(0.0, 20.0, 4)
    assert walk.at(0.0, 0.39).state is S.TURN
    assert walk.at(0.0, 0.38).state is S.HOLD
    assert walk.at(0.0, 0.57).state is S.HOLD
    assert walk.at(0.0, 0.58).state is S.TURN
    assert walk.at(0.0, 0.38).state is S.HOLD
    advice = walk.at(0.0, -2.0)
    assert advice.state is S.TURN
    assert advice.turns == approx(0.05)


def test_what_was_at_rest_before_the_turn_is_no_reason_to_lock() -> None:
    """A wheel just outside of its margin was told to be locked at once, before anybody could turn."""
    walk = Walk(with_rod=rod(), drift=Drift(6.0 * ARCMIN, 9.0 * ARCMIN))
    walk.at(0.0, -6.0, 4)
    assert walk.seen[-1] is S.TURN
    assert walk.at(0.0, -6.0).state is S.HOLD
    assert walk.at(0.0, -6.0, 3).state is S.HOLD
    assert walk.at(0.0, -6.0).state is S.LOCK_NUT


def test_a_nut_that_moves_nothing_counts_as_locked_after_a_while() -> None:
    walk = Walk(with_rod=rod())
    walk.at(0.0, 20.0, 4)
    turned_to(walk, 0.0)
    assert walk.at(0.0, 0.0, 31).state is S.LOCK_NUT
    assert walk.at(0.0, 0.0).state is S.CHECK
    assert walk.at(0.0, 0.0, 4).state is S.DONE


def test_what_moves_far_while_it_is_to_be_locked_was_turned() -> None:
    walk = Walk(with_rod=rod())
    walk.at(0.0, 20.0, 4)
    turned_to(walk, 0.0)
    walk.at(0.0, 25.0, 4)
    advice = walk.at(0.0, 25.0)
    assert advice.state is S.TURN
    assert advice.turns == approx(-25.0 / 40.0, 0.2)
    assert walk.guide.count == 1


def test_done_ends_with_the_first_result_that_is_outside() -> None:
    walk = Walk(with_rod=rod())
    walk.at(0.0, 5.0, 4)
    assert walk.at(0.0, 5.6).state is S.CHECK
    assert walk.at(0.0, 5.0, 3).state is S.CHECK
    assert walk.at(0.0, 5.0).state is S.DONE
    walk.at(0.0, 7.0)
    assert walk.at(0.0, 7.0, 4).state is S.TURN


def test_a_wheel_is_not_done_before_all_that_it_is_part_of_is_known() -> None:
    walk = Walk(with_rod=rod())
    walk.whole = False
    assert walk.at(0.0, 0.0, 8).state is not S.DONE
    walk.whole = True
    assert walk.at(0.0, 0.0, 4).state is S.DONE


def test_a_wheel_is_not_done_while_its_axle_is_outside() -> None:
    walk = Walk(with_rod=rod())
    walk.verdicts = {"front.total_toe": False}
    assert walk.at(0.0, 2.0, 8).state is S.WAITING
    # Nothing that is turned here can help: others do not wait for it.
    assert walk.guide.finished


def test_the_wheel_that_is_asked_is_turned_for_its_axle() -> None:
    walk = Walk(with_rod=rod())
    walk.verdicts, walk.asked = {"front.total_toe": False}, frozenset({"toe"})
    advice = walk.at(0.0, 4.0, 4)
    assert (advice.state, advice.adjuster) == (S.TURN, ROD)
    assert advice.turns == approx(-0.1)


def test_a_turned_wheel_is_done_only_well_inside() -> None:
    """The next measurement would have said otherwise of one in thirty that ended at the very edge."""
    walk = Walk(with_rod=rod(), u95=1.0)
    walk.at(0.0, 20.0, 4)
    turned_to(walk, 0.0)
    walk.at(0.0, 4.95, 5)
    assert walk.at(0.0, 4.95, 4).state is S.TURN
    found = Walk(with_rod=rod(), u95=1.0)
    assert found.at(0.0, 4.95, 4).state is S.DONE


def test_a_front_wheel_waits_for_the_rear_axle() -> None:
    walk = Walk(with_rod=rod())
    walk.allowed = False
    assert walk.at(0.0, 20.0, 4).state is S.WAITING
    assert not walk.guide.finished
    walk.allowed = True
    assert walk.at(0.0, 20.0).state is S.TURN
    walk.allowed = False
    assert walk.at(0.0, 15.0).state is S.TURN, "a nut that is loose is not left so"


@pytest.mark.parametrize(
    ("before", "after"), [("turn", S.TURN), ("hold", S.TURN), ("lock", S.LOCK_NUT), ("done", S.CHECK)]
)
def test_a_wheel_that_is_not_seen_is_lost_and_goes_on_where_it_was(before: str, after: GuidanceState) -> None:
    walk = Walk(with_rod=rod())
    toe = 1.0 if before == "done" else 20.0
    walk.at(0.0, toe, 4)
    if before in {"hold", "lock"}:
        toe = 0.0
        walk.at(0.0, toe, 1 if before == "hold" else 5)
    lost = walk.lost()
    assert lost.state is S.LOST
    assert (lost.turns, lost.adjuster, lost.toe) == (None, AdjusterKind.NONE, None)
    assert walk.lost().state is S.LOST
    assert not walk.guide.finished
    assert walk.at(0.0, toe + (2.0 if before == "hold" else 0.0)).state is after


def test_done_after_a_loss_needs_results_in_a_row_again() -> None:
    walk = Walk(with_rod=rod())
    walk.at(0.0, 0.0, 4)
    walk.lost()
    assert walk.at(0.0, 0.0, 3).state is S.CHECK
    assert walk.at(0.0, 0.0).state is S.DONE


@pytest.mark.parametrize(
    ("camber", "toe", "with_rod", "with_bolt"),
    [
        (0.0, 20.0, False, False),
        (20.0, 0.0, True, False),
        (20.0, 0.0, False, False),
        (20.0, 20.0, True, False),
    ],
)
def test_what_no_adjuster_changes_is_bent(camber: float, toe: float, with_rod: bool, with_bolt: bool) -> None:
    walk = Walk(with_rod=rod() if with_rod else None, with_bolt=bolt() if with_bolt else None)
    advice = walk.at(camber, toe, 4)
    assert (advice.state, advice.reason) == (S.UNREACHABLE, OutOfReach.NO_ADJUSTER)
    assert walk.guide.finished
    assert walk.guide.count == 0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_what_lies_beyond_the_range_at_the_largest_reaction_is_bent(sign: float) -> None:
    # 4 turns of 40′, or 52′ at most: 208′ beyond the edge of the room at 5.35′.
    assert Walk(with_rod=rod()).at(0.0, sign * 213.0, 4).state is S.TURN
    advice = Walk(with_rod=rod()).at(0.0, sign * 214.0, 4)
    assert (advice.state, advice.reason) == (S.UNREACHABLE, OutOfReach.RANGE)


def test_an_adjuster_at_its_end_is_named_after_a_while_and_freed_when_it_moves() -> None:
    walk = Walk(with_rod=rod())
    walk.at(0.0, 200.0, 4)
    walk.at(0.0, 60.0, 4)
    assert walk.at(0.0, 60.0, 40).state is S.TURN
    advice = walk.at(0.0, 60.0, 16)
    assert (advice.state, advice.reason) == (S.UNREACHABLE, OutOfReach.RANGE)
    assert walk.at(0.0, 60.0, 20).state is S.UNREACHABLE
    walk.at(0.0, 40.0, 3)
    assert walk.at(0.0, 40.0).state is S.TURN
    assert walk.guide.count == 1


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_bolt_at_its_end_short_of_its_aim_is_locked_there_and_the_rod_decides(sign: float) -> None:
    """The bolt makes room for what the rod will do; 4′ short of that it was to be turned for ever."""
    walk = Walk(with_rod=rod(across=8.0), with_bolt=bolt(turns=4.0))
    # The rod takes away 200′ of toe and 40′ of camber: the bolt's aim is 40′.
    advice = walk.at(sign * -60.0, sign * 200.0, 4)
    assert (advice.state, advice.adjuster) == (S.TURN, BOLT)
    walk.at(sign * 36.0, sign * 200.0, 4)
    assert walk.at(sign * 36.0, sign * 200.0, 40).state is S.TURN
    assert walk.at(sign * 36.0, sign * 200.0, 16).state is S.LOCK_NUT
    assert S.HOLD in walk.seen
    advice = walk.at(sign * 36.0, sign * 200.0, 60)
    assert (advice.state, advice.adjuster) == (S.TURN, ROD)
    # It stops far from where toe comes inside: bent, and said so.
    walk.at(sign * 8.0, sign * 60.0, 4)
    advice = walk.at(sign * 8.0, sign * 60.0, 60)
    assert (advice.state, advice.reason) == (S.UNREACHABLE, OutOfReach.RANGE)


def test_an_adjuster_is_locked_at_its_end_once_and_then_named() -> None:
    """The axle asks for more than the rod has: it is not loosened and locked there for ever."""
    walk = Walk(with_rod=rod())
    walk.asked = frozenset({"toe"})
    walk.at(0.0, 150.0, 4)
    walk.at(0.0, 3.0, 4)
    walk.at(0.0, 3.0, 60)
    assert walk.seen[-2:] == [S.HOLD, S.LOCK_NUT]
    assert walk.at(0.0, 3.0, 150).state is S.UNREACHABLE
    assert walk.guide.reason is OutOfReach.RANGE
    assert walk.guide.count == 2
    assert walk.seen.count(S.LOCK_NUT) == 1


def test_a_pause_amid_the_range_is_no_end_of_it() -> None:
    walk = Walk(with_rod=rod())
    walk.at(0.0, 60.0, 4)
    walk.at(0.0, 40.0, 4)
    assert walk.at(0.0, 40.0, 200).state is S.TURN


def test_an_axle_that_reacts_as_no_sound_one_is_bent() -> None:
    walk = Walk(with_rod=rod(across=4.0))
    walk.at(0.0, 40.0, 4)
    # Camber goes along with half of the toe, and with a tenth on a sound axle.
    advice = walk.at(-5.0, 30.0, 4)
    assert (advice.state, advice.reason) == (S.UNREACHABLE, OutOfReach.REACTION)


def test_a_wheel_left_alone_inside_its_limits_is_checked() -> None:
    walk = Walk(with_rod=rod())
    walk.at(0.0, 20.0, 4)
    walk.at(0.0, 3.0, 4)
    assert walk.at(0.0, 3.0, 31).state is S.TURN
    assert walk.at(0.0, 3.0, 8).state is S.DONE


def test_every_step_is_one_of_the_table() -> None:
    walk = Walk(with_rod=rod(across=8.0), with_bolt=bolt(across=10.0))
    for camber, toe, times in [
        (20, 30, 4), (0, 25, 8), (0.5, 25, 4), (3, 25, 40), (3, 0, 6), (3, 5, 9), (2, 8, 20),
        (0, 0, 60), (0, 9, 9),
    ]:  # fmt: skip
        walk.at(float(camber), float(toe), times)
        walk.lost()
        walk.seen.append(S.LOST)
    for before, after in zip(walk.seen, walk.seen[1:], strict=False):
        assert after is before or after is S.LOST or after in GUIDANCE_STATES[before].follows, (before, after)


def test_the_table_holds_every_state_and_says_something_of_each() -> None:
    assert set(GUIDANCE_STATES) == set(GuidanceState)
    for rule in GUIDANCE_STATES.values():
        assert rule.says
        assert rule.means


def test_a_wheel_that_never_rests_is_never_done() -> None:
    walk = Walk(with_rod=rod())
    for toe in (0.0, 2.0) * 20:
        assert walk.at(0.0, toe).state is S.CHECK


def test_settings_are_the_callers() -> None:
    walk = Walk(with_rod=rod(), settings=replace(GuidanceSettings(), readings=2, rest_s=0.2))
    assert walk.at(0.0, 1.0, 2).state is S.DONE


def test_no_more_corrections_are_kept_than_anybody_reads() -> None:
    walk = Walk(with_rod=rod(), drift=Drift(0.0, 9.0 * ARCMIN, used=False))
    walk.at(0.0, 20.0, 4)
    for number in range(40):
        turned_to(walk, 0.0)
        walk.at(0.0, 8.0 if number % 2 else -8.0, 9)
    assert walk.guide.count == 41
    # The last one is told beside those that are kept.
    assert len(walk.guide.corrections) == 33


def test_who_locks_a_little_beside_the_aim_is_not_asked_again() -> None:
    walk = Walk(with_rod=rod())
    walk.at(0.0, 20.0, 4)
    assert walk.at(0.0, 0.3).state is S.HOLD
    assert walk.at(0.0, 0.5, 4).state is S.LOCK_NUT


def test_a_verdict_that_is_not_known_is_none() -> None:
    """Own angles without a verdict count for nothing, however often they are seen."""
    walk = Walk(with_rod=rod())
    for _ in range(10):
        walk.time_s += 0.25
        advice = walk.guide.take(WheelReading("front_left", walk.time_s, 0.0, 0.0, verdicts={}))
        assert advice.state is S.CHECK


def test_turns_add_up_however_often_locking_undoes_them() -> None:
    """Each locking takes 8′ back, and the rod is lengthened on and on: it ends."""
    walk = Walk(with_rod=rod(), drift=Drift(0.0, 9.0 * ARCMIN, used=False))
    walk.at(0.0, 20.0, 4)
    for _ in range(24):
        turned_to(walk, 0.0)
        walk.at(0.0, 8.0, 9)
    turned_to(walk, 0.0)
    advice = walk.at(0.0, 8.0, 9)
    assert (advice.state, advice.reason) == (S.UNREACHABLE, OutOfReach.RANGE)


@pytest.mark.parametrize(("camber", "adjuster"), [(0.0, BOLT), (8.0, ROD)])
def test_camber_is_judged_by_where_the_tie_rod_will_leave_it(camber: float, adjuster: AdjusterKind) -> None:
    """On its 40′ way back toe takes 8′ of camber along: what is inside now is not then."""
    walk = Walk(with_rod=rod(across=8.0), with_bolt=bolt())
    advice = walk.at(camber, 40.0, 4)
    assert (advice.state, advice.adjuster) == (S.TURN, adjuster)


def rod_at_its_aim_with_camber_at(camber: float, walk: Walk) -> Advice:
    """A rod that moved camber by more than was stated; the operator stopped at the aim."""
    assert walk.at(0.0, 20.0, 4).adjuster is ROD
    assert walk.at(camber, 0.0).state is S.HOLD
    return walk.at(camber, 0.0, 4)


@pytest.mark.parametrize(("camber", "turns"), [(8.0, -8.0 / 30.0), (-8.0, 8.0 / 30.0)])
def test_camber_that_the_rod_carried_away_is_turned_before_the_nut_of_the_rod_is_locked(
    camber: float, turns: float
) -> None:
    """It was locked, camber found outside and turned, and the rod loosened for what that did to toe."""
    walk = Walk(with_rod=rod(), with_bolt=bolt())
    told = rod_at_its_aim_with_camber_at(camber, walk)
    assert (told.state, told.adjuster) == (S.TURN, BOLT)
    assert told.turns == approx(turns, within=0.05)
    assert [(each.adjuster, each.taken) for each in walk.guide.corrections] == [(ROD, None), (BOLT, None)]
    turned_to(walk, 0.0)
    # The bolt is locked and all is inside: the rod's nut is loose all the same.
    told = walk.at(1.0, 0.0, 20)
    assert told.adjuster is ROD
    assert told.state is S.LOCK_NUT
    assert walk.at(1.0, 1.5, 20).state is S.DONE
    by_rod, by_bolt = sorted(walk.guide.corrections, key=lambda each: each.adjuster is BOLT)
    assert (by_rod.adjuster, by_bolt.adjuster) == (ROD, BOLT)
    assert by_rod.locked == approx(1.5 * ARCMIN)
    assert by_bolt.locked == approx(1.0 * ARCMIN)
    # Loosened, turned and locked once each.
    assert walk.guide.count == 2


def test_a_rod_left_loose_is_told_of_when_the_adjusting_ends_there() -> None:
    walk = Walk(with_rod=rod(), with_bolt=bolt())
    rod_at_its_aim_with_camber_at(8.0, walk)
    left, begun = walk.guide.corrections
    assert (left.adjuster, left.locked) == (ROD, None)
    assert left.turns == approx(-0.5, within=0.05)
    assert begun.adjuster is BOLT


def aims(drift: float = 0.0, u95: float = 0.5, **adjusters: AdjusterPlan) -> Aims:
    known = Drift(drift * ARCMIN, 9.0 * ARCMIN)
    plan = WheelPlan("front_left", SIX, SIX, adjusters.get("with_rod"), adjusters.get("with_bolt"))
    found = Aims.of(plan, GuidanceSettings(), {ROD: known, BOLT: known})
    found.look(u95 * ARCMIN, u95 * ARCMIN)
    return found


@pytest.mark.parametrize(
    ("camber", "known"),
    [
        # Inside, by more than what counts as a movement.
        (4.6, aims(with_rod=rod(), with_bolt=bolt())),
        # Nothing could be done about it.
        (8.0, aims(with_rod=rod())),
        (8.0, aims(with_bolt=bolt())),
        # The limits leave nothing to aim at.
        (8.0, aims(with_rod=rod(), with_bolt=bolt(), u95=5.0)),
        # Out of the bolt's reach: the check says so.
        (8.0, aims(with_rod=rod(), with_bolt=bolt(main=0.1, turns=0.5))),
    ],
    ids=["inside", "no bolt", "no rod", "no room", "out of reach"],
)
def test_a_rod_is_locked_where_the_bolt_has_nothing_to_do(camber: float, known: Aims) -> None:
    assert not known.bolt_before_lock(Rest(camber * ARCMIN, 0.0))


def test_a_bolt_at_its_end_does_not_keep_the_rod_loose() -> None:
    known = aims(with_rod=rod(), with_bolt=bolt(turns=1.0))
    assert known.bolt_before_lock(Rest(8.0 * ARCMIN, 0.0))
    known.known[BOLT].shift = -30.0 * ARCMIN
    assert not known.bolt_before_lock(Rest(8.0 * ARCMIN, 0.0))


def test_what_locking_the_rod_adds_to_camber_counts_before_it_is_locked() -> None:
    """4′ of camber are inside; the nut adds 6′ of toe, of which the axle makes 3′ of camber."""
    known = aims(6.0, with_rod=rod(across=20.0), with_bolt=bolt())
    assert known.bolt_before_lock(Rest(4.0 * ARCMIN, -6.0 * ARCMIN))
    assert not known.bolt_before_lock(Rest(-4.0 * ARCMIN, -6.0 * ARCMIN))


def test_camber_without_an_adjuster_is_turned_by_a_tie_rod_that_moves_both() -> None:
    walk = Walk(with_rod=rod(40.0, 20.0))
    advice = walk.at(7.0, 0.0, 4)
    assert (advice.state, advice.adjuster) == (S.TURN, ROD)
    assert walk.guide.reason is OutOfReach.NONE


def test_a_wheel_beyond_the_range_that_somebody_brings_inside_is_good() -> None:
    walk = Walk(with_rod=rod(turns=0.2))
    assert walk.at(0.0, 60.0, 4).state is S.UNREACHABLE
    assert walk.guide.reason is OutOfReach.RANGE
    walk.at(0.0, 0.0, 12)
    assert walk.seen[-1] is S.DONE
    assert walk.guide.reason is OutOfReach.NONE


def test_no_more_corrections_are_kept_than_anybody_makes() -> None:
    walk = Walk(with_rod=rod())
    walk.at(0.0, 20.0, 4)
    turned_to(walk, 0.2)
    (first,) = walk.guide.corrections
    walk.guide._closed.extend([first] * 32)  # noqa: SLF001
    assert walk.at(0.0, 9.0, 12).state is S.TURN
    assert walk.guide.count == 2
    assert len(walk.guide._closed) == 32  # noqa: SLF001


def test_what_a_turn_taught_may_put_the_aim_elsewhere_and_nothing_is_locked(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    walk = Walk(with_rod=rod())
    walk.at(0.0, 20.0, 4)
    assert walk.at(0.0, 0.2).state is S.HOLD
    aims = walk.guide._aims  # noqa: SLF001

    def taught(*_: object) -> None:
        monkeypatch.setattr(aims, "aim", lambda *_args, **_more: 5.0 * ARCMIN)

    monkeypatch.setattr(aims, "moved", taught)
    walk.at(0.0, 0.2, 4)
    assert walk.at(0.0, 0.2).state is S.TURN
    assert S.LOCK_NUT not in walk.seen


def test_an_adjuster_named_at_its_end_begins_anew_when_the_wheel_was_brought_inside() -> None:
    """By somebody who turned elsewhere: what was begun ends without a nut that was locked."""
    walk = Walk(with_rod=rod())
    walk.at(0.0, 200.0, 4)
    walk.at(0.0, 60.0, 60)
    assert walk.seen[-1] is S.UNREACHABLE
    walk.at(0.0, 0.0, 12)
    assert walk.seen[-2:] == [S.CHECK, S.DONE]
    walk.at(0.0, 20.0, 8)
    assert walk.guide.count == 2
    assert walk.guide.corrections[0].taken is None
