"""Straight ahead: what the steering wheel's angle says of front toe, and when it says nothing."""

from __future__ import annotations

import math
from dataclasses import FrozenInstanceError
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from alignment.vehicle import AxleAngles, WheelAngles
from station.configuration.steering import SteeringOptions
from station.cycle.judging.straight_ahead import (
    LARGEST_BELIEVED_DEG,
    NOTHING_ASKED,
    StraightAheadState,
    most_toe_out,
    steering_wheel_offset,
    straight_ahead,
)
from station.cycle.words.vehicle import SteeringWheel

CHECKED, NOT_CHECKED, REFUSED, NOT_ASKED = (
    StraightAheadState.CHECKED,
    StraightAheadState.NOT_CHECKED,
    StraightAheadState.REFUSED,
    StraightAheadState.NOT_ASKED,
)
RATIO = 16.0


def options(**fields: Any) -> SteeringOptions:
    exact = {"ratio": RATIO, "ratio_sigma": 0.0, "angle_sigma_deg": 0.2, "oldest_s": 0.5, "largest_deg": 5.0}
    return SteeringOptions.model_validate(exact | fields)


def wheel(angle_deg: float | None, age_s: float = 0.1) -> SteeringWheel:
    return SteeringWheel(angle_deg, age_s)


def test_a_type_that_says_nothing_of_its_steering_is_not_asked() -> None:
    assert straight_ahead(None, [wheel(3.0)]) is NOTHING_ASKED
    assert (NOTHING_ASKED.state, NOTHING_ASKED.refused, NOTHING_ASKED.steer) == (NOT_ASKED, False, 0.0)


def test_a_steering_wheel_turned_to_the_left_takes_toe_from_the_left_wheel_and_gives_it_to_the_right() -> (
    None
):
    """Turned to the left both wheels point to the left: the left one shows less toe-in than it has."""
    found = straight_ahead(options(), [wheel(3.2)])
    assert (found.state, found.reason, found.refused) == (CHECKED, None, False)
    assert found.steer == pytest.approx(math.radians(0.2))
    assert found.wheel == pytest.approx(math.radians(3.2))
    assert found.age_s == 0.1
    raw = WheelAngles(-0.01, 0.001, 1e-5, 2e-5)
    left, right = (found.wheel_at_straight(f"front_{side}", raw) for side in ("left", "right"))
    assert left.toe == pytest.approx(0.001 + math.radians(0.2))
    assert right.toe == pytest.approx(0.001 - math.radians(0.2))
    assert (left.camber, left.camber_u) == (right.camber, right.camber_u) == (raw.camber, raw.camber_u)
    assert found.wheel_at_straight("rear_left", raw) is raw


def test_the_offset_is_what_the_line_tells_of_a_straight_wheel() -> None:
    found = straight_ahead(options(offset_deg=2.0), [wheel(2.0)])
    assert (found.state, found.steer, found.wheel) == (CHECKED, 0.0, 0.0)


def test_angle_ratio_and_second_order_are_in_the_uncertainty_of_each_front_toe() -> None:
    found = straight_ahead(options(ratio_sigma=0.8), [wheel(4.0)])
    steer = math.radians(4.0) / RATIO
    of_angle, of_ratio = math.radians(0.2) / RATIO, steer * 0.8 / RATIO
    assert found.wheel_u == pytest.approx(math.radians(0.2))
    assert found.steer_u == pytest.approx(math.hypot(of_angle, of_ratio))
    raw = WheelAngles(0.0, 0.0, 1e-5, 3e-5)
    second = 0.5 * 0.7 * steer**2 / math.sqrt(3.0)
    assert most_toe_out(steer) == pytest.approx(0.35 * steer**2)
    assert found.wheel_at_straight("front_left", raw).toe_u == pytest.approx(
        math.hypot(3e-5, found.steer_u, second), rel=1e-12
    )
    axle = AxleAngles(0.002, 0.001, 4e-5, 5e-5)
    corrected = found.axle_at_straight("front", axle)
    assert corrected.total_toe == axle.total_toe
    assert corrected.total_toe_u == pytest.approx(math.hypot(4e-5, 2.0 * second), rel=1e-12)
    assert (corrected.camber_difference, corrected.camber_difference_u) == (0.001, 5e-5)
    assert found.axle_at_straight("rear", axle) is axle


@pytest.mark.parametrize(
    ("told", "words"),
    [
        ((), "the line told no angle"),
        ((None,), "the line told no angle"),
        ((wheel(1.0), None), "the line told no angle"),
        ((None, wheel(1.0)), "the line told no angle"),
        ((wheel(None),), "told as not valid"),
        ((wheel(1.0), wheel(None)), "told as not valid"),
        ((wheel(1.0, 0.501),), "0.50 s old, accepted are 0.5 s"),
        ((wheel(1.0, 0.1), wheel(1.0, 7.0)), "7.00 s old, accepted are 0.5 s"),
        # Too old to count at all, so it is not refused for where it stood then.
        ((wheel(90.0, 7.0),), "7.00 s old"),
    ],
)
@pytest.mark.parametrize("required", [True, False])
def test_a_lost_or_stale_angle_is_not_checked_and_the_vehicle_type_decides(
    told: tuple[SteeringWheel | None, ...], words: str, required: bool
) -> None:
    found = straight_ahead(options(require_straight_ahead=required), told)
    assert found.state is (REFUSED if required else NOT_CHECKED)
    assert found.refused is required
    assert found.reason is not None
    assert found.reason.startswith("straight ahead not checked: ")
    assert words in found.reason
    assert (found.steer, found.steer_u) == (0.0, 0.0)
    raw, axle = WheelAngles(0.0, 0.001, 1e-5, 1e-5), AxleAngles(0.002, 0.0, 1e-5, 1e-5)
    assert found.wheel_at_straight("front_left", raw) is raw
    assert found.axle_at_straight("front", axle) is axle


def test_an_angle_that_is_just_young_enough_counts() -> None:
    assert straight_ahead(options(), [wheel(1.0, 0.5)]).state is CHECKED


@pytest.mark.parametrize(
    ("told", "words", "known"),
    [
        ((wheel(5.01),), "stands 5.01° to the left of straight, toe is corrected from at most 5°", True),
        ((wheel(-5.01),), "stands 5.01° to the right of straight", True),
        ((wheel(1081.0),), "no steering wheel stands at 1081°", False),
        ((wheel(-3000.0), wheel(1.0)), "no steering wheel stands at -3000°", False),
        ((wheel(3276.7), None), "no steering wheel stands at 3276.7°", False),
        (
            (wheel(0.0), wheel(0.85)),
            "moved by 0.85° while the wheels were measured, accepted are 0.85°",
            True,
        ),
        ((wheel(2.0), wheel(-2.0)), "moved by 4.00°", True),
    ],
)
@pytest.mark.parametrize("required", [True, False])
def test_an_absurd_turned_or_moving_steering_wheel_is_refused_whatever_the_type_allows(
    told: tuple[SteeringWheel | None, ...], words: str, known: bool, required: bool
) -> None:
    found = straight_ahead(options(require_straight_ahead=required), told)
    assert (found.state, found.steer, found.steer_u) == (REFUSED, 0.0, 0.0)
    assert found.reason is not None
    assert words in found.reason
    assert (found.wheel is not None, found.wheel_u is not None, found.age_s is not None) == (known,) * 3


def test_the_bounds_themselves_are_accepted() -> None:
    assert straight_ahead(options(), [wheel(5.0)]).state is CHECKED
    assert straight_ahead(options(), [wheel(-5.0)]).state is CHECKED
    # √2 · 3 · 0.2° is what two readings of one angle may differ by.
    assert straight_ahead(options(), [wheel(0.0), wheel(0.848)]).state is CHECKED
    assert straight_ahead(options(), [wheel(0.0), wheel(3.0 * math.sqrt(2.0) * 0.2)]).state is CHECKED
    far = straight_ahead(options(), [wheel(LARGEST_BELIEVED_DEG)])
    assert far.wheel == pytest.approx(math.radians(LARGEST_BELIEVED_DEG))
    assert "to the left of straight" in (far.reason or "")


def test_a_steering_wheel_just_left_of_a_narrow_limit_stands_to_the_left() -> None:
    found = straight_ahead(options(largest_deg=0.7), [wheel(0.8)])
    assert "stands 0.80° to the left of straight" in (found.reason or "")


def test_what_was_found_does_not_change_any_more() -> None:
    with pytest.raises(FrozenInstanceError):
        straight_ahead(options(), [wheel(1.0)]).steer = 0.0  # type: ignore[misc]


def test_the_mean_of_all_angles_counts_and_the_oldest_age_is_told() -> None:
    found = straight_ahead(options(), [wheel(1.0, 0.4), wheel(1.6, 0.2)])
    assert found.wheel == pytest.approx(math.radians(1.3))
    assert found.age_s == 0.4


@pytest.mark.parametrize("angle_deg", [-4.0, -0.5, 0.0, 3.0])
def test_the_steering_wheels_offset_is_the_same_wherever_it_is_held(angle_deg: float) -> None:
    """A vehicle whose steering wheel stands 2° to the left when it drives straight ahead."""
    true_deg = 2.0
    steered = math.radians(angle_deg - true_deg) / RATIO
    # Turned to the left the left wheel shows less toe, the right one more.
    half_toe = 0.5 * ((0.001 - steered) - (0.001 + steered))
    found = straight_ahead(options(), [wheel(angle_deg)])
    value, u = steering_wheel_offset(found, options(), half_toe, 2e-5)
    assert math.degrees(value) == pytest.approx(true_deg, abs=1e-12)
    assert u == pytest.approx(math.hypot(math.radians(0.2), RATIO * 2e-5), rel=1e-12)


def test_the_spread_of_the_ratio_is_in_the_steering_wheels_offset() -> None:
    loose = options(ratio_sigma=0.5, angle_sigma_deg=0.001)
    _, u = steering_wheel_offset(straight_ahead(loose, [wheel(1.0)]), loose, 0.01, 0.0)
    assert u == pytest.approx(math.hypot(math.radians(0.001), 0.5 * 0.01), rel=1e-12)


angles = st.floats(-1e4, 1e4, allow_nan=False)
wheels = st.one_of(
    st.none(),
    st.builds(SteeringWheel, st.one_of(st.none(), angles), st.floats(0.0, 1e5, allow_nan=False)),
)


@given(st.lists(wheels, max_size=4), st.floats(-45, 45), st.booleans())
def test_front_toe_is_judged_only_of_a_wheel_that_stands_nearly_straight(
    told: list[SteeringWheel | None], offset_deg: float, required: bool
) -> None:
    chosen = options(offset_deg=offset_deg, require_straight_ahead=required)
    found = straight_ahead(chosen, told)
    good = bool(told) and all(each is not None and each.fresh(0.5) for each in told)
    if found.state is CHECKED:
        assert good
        assert abs(found.steer) <= math.radians(5.0) / RATIO * (1.0 + 1e-12)
        assert found.steer_u > 0.0
    else:
        assert found.reason is not None
        assert (found.steer, found.steer_u) == (0.0, 0.0)
    if required and not good:
        assert found.refused
