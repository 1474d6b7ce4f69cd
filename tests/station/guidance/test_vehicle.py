"""Rear before front, and which wheel of an axle is turned for it; angles in arcminutes."""

from __future__ import annotations

import pytest

from station.configuration.limits import Limits
from station.guidance.drift import Drift
from station.guidance.plan import WheelPlan, WheelReading
from station.guidance.vehicle import VehicleGuide
from station.guidance.wheel import Advice
from station.guidance.words import AdjusterKind, GuidanceState, OutOfReach
from tests.station.guidance.walk import ARCMIN, BOLT, ROD, SIX, bolt, rod

S = GuidanceState
WHEELS = ("front_left", "front_right", "rear_left", "rear_right")


class Stand:
    def __init__(self, *wheels: str) -> None:
        plans = [WheelPlan(wheel, SIX, SIX, rod(), bolt()) for wheel in wheels]
        drift = Drift(0.0, 9.0 * ARCMIN)
        self.guide = VehicleGuide(
            plans, {(axle, kind): drift for axle in ("front", "rear") for kind in (ROD, BOLT)}
        )
        self.toes = dict.fromkeys(wheels, 0.0)
        self.verdicts: dict[str, dict[str, bool]] = {wheel: {} for wheel in wheels}
        self.time_s = 0.0

    def run(self, times: int = 5) -> dict[str, Advice]:
        told: dict[str, Advice] = {}
        for _ in range(times):
            self.time_s += 0.25
            for wheel, toe in self.toes.items():
                own = {f"{wheel}.camber": True, f"{wheel}.toe": abs(toe) <= 6.0}
                reading = WheelReading(
                    wheel, self.time_s, 0.0, toe * ARCMIN, verdicts=own | self.verdicts[wheel]
                )
                told[wheel] = self.guide.take(reading)
        return told


def test_the_front_axle_waits_for_the_rear_one() -> None:
    stand = Stand(*WHEELS)
    stand.toes |= {"front_left": 20.0, "rear_right": 20.0}
    told = stand.run()
    assert told["rear_right"].state is S.TURN
    assert told["rear_left"].state is S.DONE
    assert told["front_left"].state is S.WAITING
    assert told["front_right"].state is S.DONE


def test_a_rear_wheel_waits_for_no_front_wheel() -> None:
    stand = Stand(*WHEELS)
    stand.toes |= dict.fromkeys(WHEELS, 20.0)
    told = stand.run()
    assert {wheel: told[wheel].state for wheel in WHEELS} == {
        "front_left": S.WAITING,
        "front_right": S.WAITING,
        "rear_left": S.TURN,
        "rear_right": S.TURN,
    }


def test_a_bent_rear_axle_does_not_keep_the_front_waiting() -> None:
    stand = Stand(*WHEELS)
    stand.toes |= {"front_left": 20.0, "rear_right": 900.0}
    told = stand.run(6)
    assert told["rear_right"].state is S.UNREACHABLE
    assert told["front_left"].state is S.TURN


def test_the_front_axle_alone_waits_for_nobody() -> None:
    stand = Stand("front_left", "front_right")
    stand.toes["front_left"] = 20.0
    assert stand.run()["front_left"].state is S.TURN


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_wheel_farther_from_its_target_is_turned_for_the_axle(sign: float) -> None:
    stand = Stand("front_left", "front_right")
    stand.toes |= {"front_left": sign * 3.0, "front_right": sign * 5.0}
    for wheel in stand.toes:
        stand.verdicts[wheel] = {"front.total_toe": False}
    told = stand.run()
    assert told["front_right"].state is S.TURN
    assert told["front_right"].turns == pytest.approx(-sign * 5.0 / 40.0)
    assert told["front_left"].state is S.WAITING


def test_the_thrust_angle_is_a_matter_of_toe_and_the_difference_one_of_camber() -> None:
    stand = Stand("rear_left", "rear_right")
    stand.toes["rear_left"] = 4.0
    for wheel in stand.toes:
        stand.verdicts[wheel] = {"thrust_angle": False}
    assert stand.run()["rear_left"].adjuster is ROD
    both = Stand("rear_left", "rear_right")
    for wheel in both.toes:
        both.verdicts[wheel] = {"rear.camber_difference": False}
    # Camber is where it should be already: nothing is to be turned for it, and nothing is done either.
    assert {advice.state for advice in both.run().values()} == {S.WAITING}


def test_a_wheel_without_a_plan_is_not_guided() -> None:
    stand = Stand("front_left")
    told = stand.guide.take(WheelReading("rear_left", 1.0, 0.0, 0.0))
    assert (told.state, told.adjuster, told.reason) == (S.NONE, AdjusterKind.NONE, OutOfReach.NONE)
    assert (told.turns, told.camber, told.toe, told.drift) == (None, None, None, None)


def test_a_wheel_that_is_lost_stays_where_it_was_last_seen() -> None:
    stand = Stand("front_left", "front_right")
    stand.toes |= {"front_left": 3.0, "front_right": 5.0}
    for wheel in stand.toes:
        stand.verdicts[wheel] = {"front.total_toe": False}
    stand.run(3)
    assert stand.guide.take(WheelReading("front_right", stand.time_s)).state is S.LOST
    del stand.toes["front_right"]
    assert stand.run()["front_left"].state is S.WAITING


def test_half_a_result_is_none() -> None:
    stand = Stand("front_left")
    stand.run(3)
    assert stand.guide.take(WheelReading("front_left", stand.time_s, None, 0.0)).state is S.LOST
    assert stand.guide.take(WheelReading("front_left", stand.time_s, 0.0, None)).state is S.LOST


@pytest.mark.parametrize(
    ("left", "right", "farther"),
    [(0.0, 3.5, "front_left"), (1.0, 4.5, "front_right"), (1.0, 0.5, "front_right")],
)
@pytest.mark.parametrize(("angle", "kind"), [("camber_difference", BOLT), ("total_toe", ROD)])
def test_an_axle_asks_the_wheel_that_is_farther_from_its_own_target(
    left: float, right: float, farther: str, angle: str, kind: AdjusterKind
) -> None:
    """The target of camber is not that of toe: of one it is 0′, of the other 2′."""
    skewed = Limits(-4.0 * ARCMIN, 8.0 * ARCMIN)
    camber, toe = (skewed, SIX) if kind is BOLT else (SIX, skewed)
    drift = Drift(0.0, 9.0 * ARCMIN)
    plans = [WheelPlan(wheel, camber, toe, rod(), bolt()) for wheel in ("front_left", "front_right")]
    guide = VehicleGuide(plans, {("front", ROD): drift, ("front", BOLT): drift})
    values = {"front_left": left, "front_right": right}
    for step in range(6):
        told = {}
        for wheel, value in values.items():
            verdicts = {f"{wheel}.camber": True, f"{wheel}.toe": True, f"front.{angle}": False}
            angles = (value * ARCMIN, 0.0) if kind is BOLT else (0.0, value * ARCMIN)
            told[wheel] = guide.take(WheelReading(wheel, 0.25 * step, *angles, verdicts=verdicts))
    other = "front_right" if farther == "front_left" else "front_left"
    assert (told[farther].state, told[farther].adjuster) == (S.TURN, kind)
    turns = told[farther].turns
    assert turns is not None
    assert turns * (2.0 - values[farther]) > 0.0
    assert told[other].state is S.WAITING


def test_wheels_of_another_axle_are_not_asked_nor_compared() -> None:
    stand = Stand(*WHEELS)
    stand.toes |= {"front_left": 3.0, "front_right": 5.0, "rear_left": 5.9, "rear_right": 5.9}
    for wheel in ("front_left", "front_right"):
        stand.verdicts[wheel] = {"front.total_toe": False}
    told = stand.run(6)
    assert told["front_right"].state is S.TURN
    assert told["rear_left"].state is S.DONE


def test_two_wheels_that_are_equally_far_are_both_turned() -> None:
    stand = Stand("front_left", "front_right")
    stand.toes |= {"front_left": 5.0, "front_right": 5.0}
    for wheel in stand.toes:
        stand.verdicts[wheel] = {"front.total_toe": False}
    assert {advice.state for advice in stand.run().values()} == {S.TURN}


def test_a_wheel_that_was_never_seen_is_nowhere() -> None:
    stand = Stand("front_left", "front_right")
    del stand.toes["front_right"]
    stand.toes["front_left"] = 5.0
    stand.verdicts["front_left"] = {"front.total_toe": False}
    assert stand.run()["front_left"].state is S.TURN
