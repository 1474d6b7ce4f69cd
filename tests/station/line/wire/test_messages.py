"""Answers, statuses, and their way over the bus and back."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from alignment.errors import InputError, LineError
from station.cycle.words.cycle import (
    AxisKind,
    AxleAnswer,
    ErrorCode,
    Outcome,
    StationState,
    StationStatus,
    VehicleAnswer,
    WheelAnswer,
    overall_outcome,
    vehicle_outcome,
)
from station.cycle.words.geometry import QuantityState
from station.line.wire.dbc import LineDatabase, Value, load_line_database
from station.line.wire.messages import LineStatus
from station.line.wire.results import (
    axle_frames,
    read_axle,
    read_vehicle,
    read_wheel,
    result_frames,
    vehicle_frame,
    wheel_frames,
)
from station.line.wire.status import read_status, status_frame
from tests.station.line.line_bench import DBC

DATABASE = load_line_database(DBC)
ANGLES = st.floats(-15, 15)
UNCERTAINTIES = st.floats(0, 1.3)
JUDGED = st.sampled_from([Outcome.OK, Outcome.NOK])


@pytest.mark.parametrize("bad", [None, math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("field", ["camber_deg", "toe_deg", "camber_u95_deg", "toe_u95_deg"])
@pytest.mark.parametrize("outcome", [Outcome.OK, Outcome.NOK])
def test_judged_wheel_without_a_value_cannot_be_made(outcome: Outcome, field: str, bad: float | None) -> None:
    values = {"camber_deg": 0.0, "toe_deg": 0.0, "camber_u95_deg": 0.1, "toe_u95_deg": 0.1, field: bad}
    with pytest.raises(InputError, match=f"front_left.{field}"):
        WheelAnswer("front_left", outcome, **values)


@pytest.mark.parametrize("outcome", [Outcome.FAULT, Outcome.ABORTED, Outcome.NOT_REQUESTED])
def test_what_was_not_judged_carries_no_value(outcome: Outcome) -> None:
    with pytest.raises(InputError, match="no value"):
        WheelAnswer("front_left", outcome, camber_deg=0.0)
    with pytest.raises(InputError, match="no value"):
        AxleAnswer("front", outcome, total_toe_deg=0.0)
    with pytest.raises(InputError, match="no value"):
        VehicleAnswer(outcome, 0.0)


def test_negative_uncertainty_and_incomplete_axle_and_vehicle() -> None:
    with pytest.raises(InputError, match="0 or more"):
        WheelAnswer("front_left", Outcome.OK, 0.0, 0.0, -0.001, 0.0)
    with pytest.raises(InputError, match=r"front\.total_toe_deg"):
        AxleAnswer("front", Outcome.OK)
    with pytest.raises(InputError, match=r"vehicle\.thrust_angle_deg"):
        VehicleAnswer(Outcome.NOK)


def test_fault_needs_its_reason() -> None:
    with pytest.raises(InputError, match="reason of the fault"):
        StationStatus(StationState.FAULT)


@pytest.mark.parametrize(
    ("outcomes", "whole"),
    [
        ("ok ok ok", "ok"),
        ("ok nok ok", "nok"),
        ("ok nok fault", "fault"),
        ("nok fault aborted", "aborted"),
        ("ok not_requested", "ok"),
        ("not_requested", "not_requested"),
        ("", "not_requested"),
    ],
)
def test_whole_from_its_parts(outcomes: str, whole: str) -> None:
    assert overall_outcome(Outcome(word) for word in outcomes.split()) is Outcome(whole)


@pytest.mark.parametrize(
    ("state", "whole"),
    [(QuantityState.OK, Outcome.OK), (QuantityState.UNJUDGED, Outcome.OK), (QuantityState.NOK, Outcome.NOK)],
)
def test_vehicle_with_a_run_out_beyond_its_limit_is_not_ok(state: QuantityState, whole: Outcome) -> None:
    wheel = WheelAnswer(
        "front_left", Outcome.OK, 0.0, 0.0, 0.1, 0.1,
        kind=AxisKind.SPIN_AXIS, run_out_state=state, run_out_mm=2.0, run_out_u95_mm=0.1,
    )  # fmt: skip
    assert vehicle_outcome([wheel], [], None) is whole
    _, frames = result_frames(DATABASE, 1, ["front_left"], [wheel], [], VehicleAnswer(Outcome.NOT_REQUESTED))
    by_id = {DATABASE.name_of(frame): DATABASE.decode(frame) for frame in frames}
    assert by_id["VehicleResult"]["Outcome"] == str(whole)


@given(JUDGED, ANGLES, ANGLES, UNCERTAINTIES, UNCERTAINTIES, st.integers(0, 255))
def test_wheel_over_the_bus_and_back(
    outcome: Outcome, camber: float, toe: float, camber_u95: float, toe_u95: float, sequence: int
) -> None:
    answer = WheelAnswer("rear_left", outcome, camber, toe, camber_u95, toe_u95)
    uncertainty, axis, result = wheel_frames(DATABASE, sequence, answer)
    back = read_wheel(
        "rear_left", DATABASE.decode(result), DATABASE.decode(uncertainty), DATABASE.decode(axis)
    )
    assert back.outcome is outcome
    assert back.camber_deg == pytest.approx(camber, abs=0.50001e-4)
    assert back.toe_deg == pytest.approx(toe, abs=0.50001e-4)
    assert back.camber_u95_deg is not None
    assert back.toe_u95_deg is not None
    assert -1e-10 <= back.camber_u95_deg - camber_u95 <= 2e-5 + 1e-10
    assert -1e-10 <= back.toe_u95_deg - toe_u95 <= 2e-5 + 1e-10
    assert DATABASE.decode(result)["Sequence"] == sequence


@given(JUDGED, st.floats(-30, 30), st.floats(-30, 30), st.floats(0, 2.6), st.floats(0, 2.6))
def test_axle_over_the_bus_and_back(
    outcome: Outcome, toe: float, camber: float, u1: float, u2: float
) -> None:
    uncertainty, result = axle_frames(DATABASE, 1, AxleAnswer("rear", outcome, toe, camber, u1, u2))
    back = read_axle("rear", DATABASE.decode(result), DATABASE.decode(uncertainty))
    assert back.outcome is outcome
    assert back.total_toe_deg == pytest.approx(toe, abs=0.50001e-4)
    assert back.camber_difference_deg == pytest.approx(camber, abs=0.50001e-4)


@pytest.mark.parametrize("outcome", [Outcome.FAULT, Outcome.ABORTED, Outcome.NOT_REQUESTED])
def test_unmeasured_angles_are_the_reserved_raw_value(outcome: Outcome) -> None:
    uncertainty, axis, result = wheel_frames(DATABASE, 1, WheelAnswer("front_left", outcome))
    raw = int.from_bytes(result.data, "little")
    assert raw >> 24 & 0xFFFFF == 0x80000
    assert raw >> 44 & 0xFFFFF == 0x80000
    assert int.from_bytes(uncertainty.data[3:8], "little") == 0xFFFFFFFFFF
    assert read_wheel(
        "front_left", DATABASE.decode(result), DATABASE.decode(uncertainty), DATABASE.decode(axis)
    ) == WheelAnswer("front_left", outcome)


def test_vehicle_over_the_bus_and_back() -> None:
    answer = VehicleAnswer(Outcome.OK, -0.123456, 0.00101, "right_positive")
    report = read_vehicle(DATABASE.decode(vehicle_frame(DATABASE, 3, Outcome.NOK, answer)))
    assert report.outcome is Outcome.NOK
    assert report.thrust_angle_deg == pytest.approx(-0.1235)
    assert report.thrust_angle_u95_deg == pytest.approx(0.00102)
    assert report.thrust_sign == "right_positive"


@pytest.mark.parametrize("value", [1.31, 100.0])
def test_uncertainty_beyond_its_signal_is_refused_not_cut(value: float) -> None:
    with pytest.raises(InputError, match=r"WheelUncertaintyFrontLeft\.CamberU95"):
        wheel_frames(DATABASE, 1, WheelAnswer("front_left", Outcome.NOK, 0.0, 0.0, value, 0.1))


def test_frames_that_contradict_themselves_are_not_believed() -> None:
    uncertainty, axis, result = (
        DATABASE.decode(frame)
        for frame in wheel_frames(DATABASE, 1, WheelAnswer("front_left", Outcome.OK, 0.0, 0.0, 0.1, 0.1))
    )
    for change in ({"Camber": "invalid"}, {"Outcome": "none"}, {"Outcome": 9}, {"Outcome": "fault"}):
        with pytest.raises(LineError, match="contradicts itself"):
            read_wheel("front_left", {**result, **change}, uncertainty, axis)
    with pytest.raises(LineError, match="sequence 2"):
        read_wheel("front_left", {**result, "Sequence": 2}, uncertainty, axis)


def test_axle_vehicle_and_status_that_contradict_themselves() -> None:
    angles: dict[str, Value] = {"TotalToe": 0.1, "CamberDifference": 0.1, "Outcome": "fault", "Sequence": 1}
    uncertainties: dict[str, Value] = {"TotalToeU95": 0.1, "CamberDifferenceU95": 0.1, "Sequence": 1}
    with pytest.raises(LineError, match="front axle"):
        read_axle("front", angles, uncertainties)
    thrust: dict[str, Value] = {"ThrustAngle": 0.1, "ThrustAngleU95": 0.1, "ThrustSign": "left_positive"}
    with pytest.raises(LineError, match="vehicle"):
        read_vehicle({**thrust, "Outcome": "none"})
    frame = status_frame(
        DATABASE,
        LineStatus(StationState.IDLE, 1, True, False, False, False, 3, ErrorCode.NONE, 0),
    )
    frame.data[1] = 0xF0
    with pytest.raises(LineError, match="not understood"):
        read_status(DATABASE.decode(frame))


def test_a_value_that_is_no_number_cannot_be_encoded(database: LineDatabase) -> None:
    values: dict[str, Value] = {"Outcome": "ok", "Sequence": 1, "Camber": math.nan, "Toe": 0.0}
    for changed in (values, {**values, "Camber": "thirteen"}, {**values, "Sequence": 256}, {"Outcome": "ok"}):
        with pytest.raises(InputError, match="WheelResultFrontLeft"):
            database.encode("WheelResultFrontLeft", changed)
