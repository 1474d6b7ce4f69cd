"""Straight ahead and ride height in the verdict: what is judged, stored and told."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from alignment.geometry.transforms import RigidTransform
from alignment.values import WheelMeasurement, nominal_vehicle_from_rig
from alignment.vehicle.wheel_axes import Stand, WheelAxis
from db.records import CycleOutcome, CycleRecord, Verdict
from station.configuration.vehicle_types import VehicleType
from station.cycle.answering.answers import Standing, answers_of
from station.cycle.judging.corrections import NO_CORRECTIONS
from station.cycle.judging.evaluation import Evaluation, evaluate
from station.cycle.judging.ride_height import HeightOutcome
from station.cycle.judging.straight_ahead import StraightAheadState
from station.cycle.judging.verdict import Status
from station.cycle.wheels.frame import CommonFrame
from station.cycle.wheels.positions import WheelResult
from station.cycle.words.cycle import Outcome, vehicle_outcome
from station.cycle.words.vehicle import RideHeights, SteeringWheel, ToldOfVehicle
from tests.station.bench import AXLE, KIND, TODAY, TOLERANCE, WHEELS, measurement
from tests.station.cycle.judging.test_evaluation import recorded
from tests.station.cycle.test_vehicle_frame import PLACES, seen, side_of

RATIO, U = 16.0, 1e-5
STEERING = {"ratio": RATIO, "ratio_sigma": 0.0, "angle_sigma_deg": 0.05, "largest_deg": 5.0}
OFFSET = {"lower_deg": -1.5, "upper_deg": 1.5}
CURVE = {
    "design_mm": 380.0,
    "points": [
        {"height_mm": 340.0, "camber_deg": 0.4, "toe_deg": 0.08},
        {"height_mm": 420.0, "camber_deg": -0.4, "toe_deg": -0.08},
    ],
}
RIDE_HEIGHT = {"sigma_mm": 0.5, "largest_mm": 30.0, "at": {"front": CURVE, "rear": CURVE}}
LEVEL = RideHeights(dict.fromkeys(WHEELS, 380.0))


def kind_of(
    steering: dict[str, Any] | None = None, ride_height: dict[str, Any] | None = None, **fields: Any
) -> VehicleType:
    given: dict[str, Any] = {
        "number": 1, "name": "Car", "axles": {"front": AXLE, "rear": AXLE}, "thrust_angle": TOLERANCE,
        "steering": steering, "ride_height": ride_height,
    }  # fmt: skip
    return VehicleType.model_validate(given | fields)


def told(angle_deg: float | None, heights: RideHeights | None = LEVEL) -> ToldOfVehicle:
    return ToldOfVehicle(SteeringWheel(angle_deg, 0.1), heights)


def judged(
    kind: VehicleType,
    said: tuple[ToldOfVehicle, ...],
    found: dict[str, WheelMeasurement | None] | None = None,
    frame: CommonFrame | None = None,
) -> Evaluation:
    measured = dict.fromkeys(WHEELS, measurement(0.0, 0.0, U)) if found is None else found
    results = [
        WheelResult(wheel, f"cal-{wheel}", True, one, None, measured_utc=TODAY)
        for wheel, one in measured.items()
    ]
    return evaluate(kind, results, 2.0, frame, said)


def outcome_told(record: CycleRecord) -> Outcome:
    answers = answers_of(record, Standing.COMMITTED)
    return vehicle_outcome(answers.wheels, answers.axles, answers.vehicle)


def test_nothing_is_corrected_of_a_type_that_says_nothing() -> None:
    evaluation = judged(KIND, (told(3.0),))
    assert evaluation.corrections.straight.state is StraightAheadState.NOT_ASKED
    assert {height.outcome for height in evaluation.corrections.heights.values()} == {HeightOutcome.NOT_ASKED}
    assert all(wheel.values == wheel.raw for wheel in evaluation.wheels)
    record = recorded(KIND, evaluation)
    assert record.outcome is CycleOutcome.OK
    assert record.steering is None
    assert all(wheel.toe_raw is None and wheel.ride_height is None for wheel in record.wheels)
    assert NO_CORRECTIONS.refusals == ()


def test_front_toe_is_judged_at_straight_ahead_and_total_toe_keeps_its_value() -> None:
    """A good vehicle whose steering wheel was held at 4.8° to the left: 18′ on each front wheel."""
    kind = kind_of(STEERING | {"offset": {"lower_deg": -5.0, "upper_deg": 5.0}})
    steered = math.radians(4.8) / RATIO
    found: dict[str, WheelMeasurement | None] = dict.fromkeys(WHEELS, measurement(0.0, 0.0, U))
    found |= {
        "front_left": measurement(0.0, 0.001 - steered, U),
        "front_right": measurement(0.0, 0.001 + steered, U),
    }
    evaluation = judged(kind, (told(4.8), told(4.8)), found)
    by_name = {wheel.result.wheel: wheel for wheel in evaluation.wheels}
    for side in ("left", "right"):
        values = by_name[f"front_{side}"].values
        assert values is not None
        assert values.toe == pytest.approx(0.001, abs=1e-15)
        assert values.toe_u > U
    front, rear = evaluation.axles
    assert front.values is not None
    assert front.values.total_toe == pytest.approx(0.002, abs=1e-15)
    assert rear.values is not None
    assert rear.values.total_toe_u == pytest.approx(math.sqrt(2.0) * U)
    assert evaluation.vehicle is not None
    assert evaluation.vehicle.values is not None
    assert evaluation.vehicle.values.front_toe_left_to_thrust == pytest.approx(0.001, abs=1e-15)
    assert evaluation.vehicle.values.front_toe_right_to_thrust == pytest.approx(0.001, abs=1e-15)
    record = recorded(kind, evaluation)
    assert record.outcome is CycleOutcome.OK
    left = record.wheels[0]
    assert (left.toe_raw, left.toe_raw_u) == (0.001 - steered, U)
    assert left.toe == pytest.approx(0.001)
    assert record.wheels[2].toe_raw is None
    steering = record.steering
    assert steering is not None
    assert (steering.straight_ahead, steering.reason_text, steering.verdict) == ("checked", None, Verdict.OK)
    assert steering.steering_wheel == pytest.approx(math.radians(4.8))
    assert steering.steer == pytest.approx(steered)
    # Its front wheels have the same toe straight ahead, so its steering wheel stands straight then.
    assert steering.steering_wheel_offset == pytest.approx(0.0, abs=1e-12)
    assert outcome_told(record) is Outcome.OK


@pytest.mark.parametrize(("offset_deg", "outcome"), [(1.2, CycleOutcome.OK), (2.4, CycleOutcome.NOK)])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_steering_wheel_that_stands_askew_when_the_vehicle_drives_straight_is_nok(
    offset_deg: float, outcome: CycleOutcome, sign: float
) -> None:
    kind = kind_of(STEERING | {"offset": OFFSET})
    half = sign * math.radians(offset_deg) / RATIO
    found: dict[str, WheelMeasurement | None] = dict.fromkeys(WHEELS, measurement(0.0, 0.0, U))
    found |= {"front_left": measurement(0.0, half, U), "front_right": measurement(0.0, -half, U)}
    record = recorded(kind, judged(kind, (told(0.0),), found))
    assert record.steering is not None
    assert record.steering.steering_wheel_offset == pytest.approx(sign * math.radians(offset_deg))
    assert (record.steering.steering_wheel_offset_low, record.steering.steering_wheel_offset_high) == (
        pytest.approx(math.radians(-1.5)), pytest.approx(math.radians(1.5)),
    )  # fmt: skip
    assert record.outcome is outcome
    assert all(wheel.verdict is Verdict.OK for wheel in record.wheels)
    assert outcome_told(record) is Outcome(outcome.value)


def test_the_guard_band_of_the_steering_wheels_offset_is_that_of_its_own_uncertainty() -> None:
    kind = kind_of(STEERING | {"offset": OFFSET})
    u = math.hypot(math.radians(0.05), RATIO * math.hypot(U / math.sqrt(2.0), U / math.sqrt(2.0)))
    for short, status in ((2.05, Status.OK), (1.95, Status.NOK)):
        half = (math.radians(1.5) - short * u) / RATIO
        found: dict[str, WheelMeasurement | None] = dict.fromkeys(WHEELS, measurement(0.0, 0.0, U))
        found |= {"front_left": measurement(0.0, half, U), "front_right": measurement(0.0, -half, U)}
        vehicle = judged(kind, (told(0.0),), found).vehicle
        assert vehicle is not None
        assert vehicle.steering_wheel_offset is not None
        assert vehicle.steering_wheel_offset.status is status
        assert vehicle.steering_wheel_offset_u == pytest.approx(u, rel=1e-9)


@pytest.mark.parametrize("yaw_deg", [0.0, 0.1])
def test_in_the_vehicles_own_frame_it_is_the_same_however_the_vehicle_stands(yaw_deg: float) -> None:
    kind = kind_of(STEERING | {"offset": OFFSET}, RIDE_HEIGHT, tyre_width_sigma_mm=0.0)
    results = [
        WheelResult(name, f"cal-{name}", True, one, None, measured_utc=TODAY, axis=axis_of(name, one))
        for name, one in seen(yaw_deg).items()
    ]
    evaluation = evaluate(kind, results, 2.0, CommonFrame(Stand(), "vehicle"), (told(0.8),))
    vehicle = evaluation.vehicle
    assert vehicle is not None
    assert vehicle.steering_wheel_offset is not None
    # The wheels point straight ahead with the steering wheel at 0.8°.
    assert vehicle.steering_wheel_offset.value == pytest.approx(math.radians(0.8), abs=1e-9)
    assert vehicle.steering_wheel_offset_u is not None
    assert vehicle.steering_wheel_offset_u > math.radians(0.05)
    toes = [wheel.toe.value for wheel in evaluation.wheels]
    steer = math.radians(0.8) / RATIO
    assert toes == pytest.approx([steer, -steer, 0.0, 0.0], abs=1e-9)
    assert recorded(kind, evaluation).outcome is CycleOutcome.OK


def axis_of(name: str, found: WheelMeasurement) -> WheelAxis:
    side, reference = side_of(name), found.reference
    assert reference is not None
    rig = RigidTransform(nominal_vehicle_from_rig(side).rotation, np.array(PLACES[name]))
    return WheelAxis(side, found.camber, found.toe, rig.apply(reference.point), reference.covariance)


@pytest.mark.parametrize("said", [(), (ToldOfVehicle(),), (told(None),), (told(0.0), ToldOfVehicle())])
@pytest.mark.parametrize("offset", [None, OFFSET])
def test_without_an_angle_a_type_that_requires_one_is_never_good(
    said: tuple[ToldOfVehicle, ...], offset: dict[str, float] | None
) -> None:
    kind = kind_of(STEERING | {"offset": offset})
    evaluation = judged(kind, said)
    record = recorded(kind, evaluation)
    assert (record.outcome, record.reason_code) == (CycleOutcome.FAULT, "steering_fault")
    assert "straight ahead not checked" in (record.reason_text or "")
    assert outcome_told(record) is Outcome.FAULT
    by_name = {wheel.wheel: wheel for wheel in record.wheels}
    for name in ("front_left", "front_right"):
        found = by_name[name]
        assert (found.verdict, found.reason_code) == (Verdict.NONE, "straight_ahead")
        # What was measured is stored all the same.
        assert (found.toe, found.toe_raw) == (0.0, None)
    assert by_name["rear_left"].verdict is Verdict.OK
    assert record.steering is not None
    assert record.steering.straight_ahead == "refused"
    assert record.steering.verdict is Verdict.NONE
    # Total toe needs no straight ahead.
    assert {axle.verdict for axle in record.axles} == {Verdict.OK}


def test_where_the_type_allows_it_the_result_says_that_straight_ahead_was_not_checked() -> None:
    kind = kind_of(STEERING | {"offset": OFFSET, "require_straight_ahead": False})
    record = recorded(kind, judged(kind, ()))
    assert record.outcome is CycleOutcome.OK
    assert record.steering is not None
    assert record.steering.straight_ahead == "not_checked"
    assert record.steering.steering_wheel_offset is None
    for wheel in record.wheels:
        said = "straight ahead not checked" in (wheel.warning or "")
        assert said is wheel.wheel.startswith("front")
    assert outcome_told(record) is Outcome.OK


@pytest.mark.parametrize("required", [True, False])
@pytest.mark.parametrize("angle_deg", [5.2, -80.0, 2000.0])
def test_an_absurd_or_turned_steering_wheel_is_never_good(required: bool, angle_deg: float) -> None:
    kind = kind_of(STEERING | {"require_straight_ahead": required})
    record = recorded(kind, judged(kind, (told(angle_deg),)))
    assert (record.outcome, record.reason_code) == (CycleOutcome.FAULT, "steering_fault")
    assert record.steering is not None
    assert record.steering.straight_ahead == "refused"


def test_rear_wheels_alone_need_no_straight_ahead() -> None:
    kind = kind_of(STEERING | {"offset": OFFSET})
    evaluation = judged(kind, (), dict.fromkeys(WHEELS[2:], measurement(0.0, 0.0, U)))
    record = recorded(kind, evaluation)
    assert record.outcome is CycleOutcome.OK
    assert record.steering is None


def test_front_wheels_alone_are_brought_to_straight_ahead_and_tell_no_offset() -> None:
    kind = kind_of(STEERING | {"offset": OFFSET})
    record = recorded(kind, judged(kind, (told(1.6),), dict.fromkeys(WHEELS[:2], measurement(0.0, 0.0, U))))
    assert [wheel.toe for wheel in record.wheels] == pytest.approx([math.radians(0.1), -math.radians(0.1)])
    assert record.steering is not None
    assert (record.steering.straight_ahead, record.steering.steering_wheel_offset) == ("checked", None)
    assert record.outcome is CycleOutcome.OK


def test_a_wheel_that_was_not_measured_leaves_the_steering_wheels_offset_open() -> None:
    kind = kind_of(STEERING | {"offset": OFFSET})
    found: dict[str, WheelMeasurement | None] = dict.fromkeys(WHEELS, measurement(0.0, 0.0, U))
    evaluation = judged(kind, (told(0.0),), found | {"rear_left": None})
    assert evaluation.vehicle is not None
    assert evaluation.vehicle.steering_wheel_offset is not None
    assert evaluation.vehicle.steering_wheel_offset.status is Status.UNSET
    assert evaluation.vehicle.steering_wheel_offset_u is None


def test_all_wheels_are_judged_at_the_design_height() -> None:
    """By curves of 0.01° of camber and 0.002° of toe per millimetre."""
    kind = kind_of(None, RIDE_HEIGHT)
    heights = RideHeights(
        {"front_left": 400.0, "front_right": 370.0, "rear_left": 390.0, "rear_right": 380.0}
    )
    evaluation = judged(kind, (ToldOfVehicle(None, RideHeights({})), ToldOfVehicle(None, heights)))
    record = recorded(kind, evaluation)
    camber = [0.2, -0.1, 0.1, 0.0]
    assert [math.degrees(wheel.camber or 0.0) for wheel in record.wheels] == pytest.approx(camber, abs=1e-9)
    toe = [0.04, -0.02, 0.02, 0.0]
    assert [math.degrees(wheel.toe or 0.0) for wheel in record.wheels] == pytest.approx(toe, abs=1e-9)
    assert [wheel.ride_height_mm for wheel in record.wheels] == [400.0, 370.0, 390.0, 380.0]
    assert {wheel.ride_height for wheel in record.wheels} == {"corrected"}
    assert {(wheel.camber_raw, wheel.toe_raw, wheel.design_height_mm) for wheel in record.wheels} == {
        (0.0, 0.0, 380.0)
    }
    own_u = math.hypot(U, math.radians(0.002 * 0.5))
    assert [wheel.toe_u for wheel in record.wheels] == pytest.approx([own_u] * 4, rel=1e-9)
    front, rear = record.axles
    assert math.degrees(front.total_toe) == pytest.approx(0.02)
    assert math.degrees(front.camber_difference) == pytest.approx(0.3)
    assert front.total_toe_u == pytest.approx(math.sqrt(2.0) * own_u, rel=1e-9)
    assert front.camber_difference_u == pytest.approx(
        math.sqrt(2.0) * math.hypot(U, math.radians(0.01 * 0.5)), rel=1e-9
    )
    assert math.degrees(rear.total_toe) == pytest.approx(0.02)
    angles = record.vehicle_angles
    assert angles is not None
    assert math.degrees(angles.thrust_angle) == pytest.approx(-0.01)
    assert angles.thrust_angle_u == pytest.approx(own_u / math.sqrt(2.0), rel=1e-9)
    assert math.degrees(angles.front_toe_left_to_thrust) == pytest.approx(0.04 - 0.01)
    assert math.degrees(angles.front_toe_right_to_thrust) == pytest.approx(-0.02 + 0.01)
    assert record.outcome is CycleOutcome.OK


def test_the_sign_of_the_thrust_angle_is_that_of_the_vehicle_type() -> None:
    heights = RideHeights(dict.fromkeys(WHEELS, 380.0) | {"rear_right": 390.0})
    for sign, factor in (("left_positive", 1.0), ("right_positive", -1.0)):
        kind = kind_of(None, RIDE_HEIGHT, thrust_sign=sign)
        vehicle = judged(kind, (ToldOfVehicle(None, heights),)).vehicle
        assert vehicle is not None
        assert vehicle.values is not None
        assert math.degrees(vehicle.values.thrust_angle) == pytest.approx(factor * 0.01)


def test_ride_height_and_steering_wheel_go_together_in_the_steering_wheels_offset() -> None:
    kind = kind_of(STEERING | {"offset": OFFSET}, RIDE_HEIGHT)
    heights = RideHeights(
        {"front_left": 390.0, "front_right": 380.0, "rear_left": 380.0, "rear_right": 384.0}
    )
    vehicle = judged(kind, (told(0.5, heights),)).vehicle
    assert vehicle is not None
    assert vehicle.steering_wheel_offset is not None
    # Left 0.02° and right 0° of toe, thrust 0.004° to the left.
    half = 0.5 * ((0.02 + 0.004) - (0.0 - 0.004))
    assert math.degrees(vehicle.steering_wheel_offset.value or 0.0) == pytest.approx(0.5 + RATIO * half)
    of_height = math.hypot(*[0.5 * math.radians(0.002 * 0.5)] * 4)
    expected = math.hypot(math.radians(0.05), RATIO * U, RATIO * of_height)
    assert vehicle.steering_wheel_offset_u == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("wheel", WHEELS)
@pytest.mark.parametrize("height_mm", [None, 5.0, 2000.0, 411.0, 430.0])
def test_a_height_that_is_missing_absurd_or_beyond_the_limit_is_never_good(
    wheel: str, height_mm: float | None
) -> None:
    kind = kind_of(STEERING | {"offset": OFFSET}, RIDE_HEIGHT)
    known = dict.fromkeys(WHEELS, 380.0)
    heights = RideHeights({name: h for name, h in (known | {wheel: height_mm}).items() if h is not None})
    evaluation = judged(kind, (told(0.0, heights),))
    record = recorded(kind, evaluation)
    assert (record.outcome, record.reason_code) == (CycleOutcome.FAULT, "measurement_refused")
    assert f"{wheel} not brought to the design height" in (record.reason_text or "")
    bad = next(one for one in record.wheels if one.wheel == wheel)
    assert (bad.verdict, bad.reason_code, bad.ride_height) == (
        Verdict.NONE, "ride_height", "missing" if height_mm is None else "refused",
    )  # fmt: skip
    others = [one for one in record.wheels if one.wheel != wheel]
    assert {one.verdict for one in others} == {Verdict.OK}
    assert record.steering is not None
    assert record.steering.verdict is Verdict.NONE
    vehicle = evaluation.vehicle
    assert vehicle is not None
    assert vehicle.thrust_angle.status is (Status.UNSET if wheel.startswith("rear") else Status.OK)
    statuses = {axle.name: {angle.status for angle in axle.angles} for axle in evaluation.axles}
    axle = wheel.partition("_")[0]
    assert statuses[axle] == {Status.UNSET}
    assert outcome_told(record) is Outcome.FAULT


def test_where_the_type_allows_it_the_result_says_that_the_height_is_not_known() -> None:
    kind = kind_of(None, RIDE_HEIGHT | {"require": False})
    record = recorded(kind, judged(kind, ()))
    assert record.outcome is CycleOutcome.OK
    assert {wheel.ride_height for wheel in record.wheels} == {"not_known"}
    assert all("not brought to the design height" in (wheel.warning or "") for wheel in record.wheels)
    assert all(wheel.toe_raw is None for wheel in record.wheels)


def test_straight_ahead_and_a_height_are_both_told_where_both_forbid_a_verdict() -> None:
    kind = kind_of(STEERING, RIDE_HEIGHT)
    evaluation = judged(kind, ())
    assert len(evaluation.corrections.refusals) == 5
    record = recorded(kind, evaluation)
    assert record.reason_code == "steering_fault"
    assert "straight ahead not checked" in (record.reason_text or "")
    assert "rear_right not brought to the design height" in (record.reason_text or "")
    assert next(one for one in record.wheels if one.wheel == "front_left").reason_code == "ride_height"


numbers = st.one_of(st.none(), st.floats(-12.0, 12.0), st.sampled_from([1e4, -1e4]))
heights_of = st.dictionaries(
    st.sampled_from(WHEELS), st.one_of(st.floats(330.0, 430.0), st.floats(-10.0, 1e4))
)


@settings(max_examples=200, deadline=None)
@given(
    st.lists(st.tuples(numbers, st.floats(0.0, 1.0)), max_size=2), heights_of, st.booleans(), st.booleans(),
    st.floats(-0.009, 0.009), st.floats(-0.009, 0.009),
)  # fmt: skip
def test_never_good_where_straight_ahead_or_a_height_is_required_and_not_known(
    said: list[tuple[float | None, float]],
    heights: dict[str, float],
    require_ahead: bool,
    require_height: bool,
    left: float,
    right: float,
) -> None:
    kind = kind_of(
        STEERING
        | {"offset": {"lower_deg": -10.0, "upper_deg": 10.0}, "require_straight_ahead": require_ahead},
        RIDE_HEIGHT | {"require": require_height},
    )
    found: dict[str, WheelMeasurement | None] = dict.fromkeys(WHEELS, measurement(0.0, 0.0, U))
    found |= {"front_left": measurement(0.0, left, U), "front_right": measurement(0.0, right, U)}
    told_of = tuple(ToldOfVehicle(SteeringWheel(angle, age), RideHeights(heights)) for angle, age in said)
    evaluation = judged(kind, told_of, found)
    record = recorded(kind, evaluation)
    straight = evaluation.corrections.straight
    fresh = bool(said) and all(angle is not None and age <= 0.5 for angle, age in said)
    known = bool(said) and set(heights) == set(WHEELS)
    if require_ahead and not fresh:
        assert record.outcome is CycleOutcome.FAULT
    if require_height and not known:
        assert record.outcome is CycleOutcome.FAULT
    if any(angle is not None and age <= 0.5 and abs(angle) > 6.0 for angle, age in said):
        assert record.outcome is CycleOutcome.FAULT
    if said and any(not 350.0 <= height <= 410.0 for height in heights.values()):
        assert record.outcome is CycleOutcome.FAULT
    if record.outcome is CycleOutcome.OK:
        assert outcome_told(record) is Outcome.OK
        if straight.state is not StraightAheadState.CHECKED:
            assert record.steering is not None
            assert record.steering.straight_ahead == "not_checked"
    # Raw and correction make what is judged; steering changes no total toe.
    for wheel, one in zip(record.wheels, evaluation.wheels, strict=True):
        assert one.raw is not None
        assert one.values is not None
        sign = {"front_left": 1.0, "front_right": -1.0}.get(wheel.wheel, 0.0)
        height = evaluation.corrections.height(wheel.wheel)
        assert wheel.toe == pytest.approx(one.raw.toe + height.toe + sign * straight.steer, abs=1e-15)
        assert wheel.camber == pytest.approx(one.raw.camber + height.camber, abs=1e-15)
    front = record.axles[0]
    of_heights = sum(evaluation.corrections.height(f"front_{side}").toe for side in ("left", "right"))
    assert front.total_toe == pytest.approx(left + right + of_heights, abs=1e-12)
