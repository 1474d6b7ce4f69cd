"""What `truewheel line plc` shows of a vehicle."""

from __future__ import annotations

import pytest

from station.commands.line import _show
from station.cycle.words.cycle import Outcome, WheelAnswer
from station.cycle.words.steering import (
    CornerAnswer,
    HeightState,
    SteeringAnswer,
    SteeringWheelAnswer,
    StraightAhead,
)
from station.line.plc.orders import PlcOrder, PlcResult
from station.line.wire.messages import VehicleReport

VIN = "WVWZZZ1KZAW000001"


def shown(steering: SteeringAnswer, outcome: Outcome, capsys: pytest.CaptureFixture[str]) -> str:
    vehicle = VehicleReport(outcome, None, None, "left_positive", steering=steering)
    wheels = (WheelAnswer("front_left", outcome),)
    _show(PlcResult(PlcOrder(VIN), 1, vehicle, wheels, (), 0.0, 0.0, 0.0, 0.0, ()))
    return capsys.readouterr().out


def test_a_wheel_that_is_not_judged_says_what_of_the_vehicle_was_missing(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """It said `fault` alone, and whoever read it looked at cameras; the steering wheel was told as 740°."""
    steering = SteeringAnswer(
        wheel=SteeringWheelAnswer(StraightAhead.NOT_CHECKED),
        corners=(CornerAnswer("front_left", HeightState.ABSURD), CornerAnswer("front_right")),
    )
    lines = shown(steering, Outcome.FAULT, capsys).splitlines()
    assert lines[2:] == [
        "  straight ahead not checked",
        "  ride height of front_left absurd",
        "  fault: the station's log says why, and `truewheel report vin`",
    ]


def test_an_angle_that_toe_was_corrected_by_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    steering = SteeringAnswer(wheel=SteeringWheelAnswer(StraightAhead.CHECKED, used_deg=3.25))
    assert "  straight ahead checked by +3.2° of the steering wheel\n" in shown(
        steering, Outcome.ABORTED, capsys
    )


def test_nothing_is_said_of_what_nobody_asked_for(capsys: pytest.CaptureFixture[str]) -> None:
    assert len(shown(SteeringAnswer(), Outcome.ABORTED, capsys).splitlines()) == 2
