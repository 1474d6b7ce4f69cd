"""What the line tells of the vehicle: no number that cannot be one, no age that is not known."""

from __future__ import annotations

import math

import pytest

from alignment.errors import InputError
from station.cycle.words.vehicle import RideHeights, SteeringWheel


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
def test_a_number_that_is_none_is_told_of_no_steering_wheel_and_no_height(number: float) -> None:
    with pytest.raises(InputError, match="angle_deg"):
        SteeringWheel(number)
    with pytest.raises(InputError, match="age_s"):
        SteeringWheel(1.0, number)
    with pytest.raises(InputError, match="front_left"):
        RideHeights({"front_left": number})
    with pytest.raises(InputError, match="age_s"):
        RideHeights({"front_left": 380.0}, {"front_left": number})


def test_an_age_is_never_negative() -> None:
    with pytest.raises(InputError, match="0 or more"):
        SteeringWheel(0.0, -0.001)
    with pytest.raises(InputError, match="0 or more"):
        RideHeights({"rear_left": 380.0}, {"rear_left": -1.0})


def test_an_angle_of_zero_is_one_and_no_angle_is_never_fresh() -> None:
    assert SteeringWheel(0.0).valid
    assert SteeringWheel(0.0, 0.5).fresh(0.5)
    assert not SteeringWheel(0.0, 0.501).fresh(0.5)
    assert not SteeringWheel(None).valid
    assert not SteeringWheel(None).fresh(10.0)


def test_heights_have_their_ages_each() -> None:
    heights = RideHeights({"front_left": 380.0, "rear_left": 370.0}, {"front_left": 0.1, "rear_left": 3.0})
    assert heights.of("front_left", 1.0) == 380.0
    assert heights.of("rear_left", 1.0) is None
    assert heights.of("rear_left") == 370.0
    assert heights.of("front_right") is None
    with pytest.raises(InputError, match="one age for each height"):
        RideHeights({"front_left": 380.0}, {"rear_left": 0.0})


def test_heights_do_not_change_with_what_they_were_made_of() -> None:
    told = {"front_left": 380.0}
    heights = RideHeights(told)
    told["front_left"] = 1.0
    assert heights.of("front_left") == 380.0
    assert heights.ages_s == {"front_left": 0.0}
