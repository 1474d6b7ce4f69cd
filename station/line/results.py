"""Answers to frames and back: the one place that knows which signal carries which angle."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import cast

import can

from alignment.errors import InputError, LineError
from station.line.dbc import INVALID, LineDatabase, Value
from station.line.messages import (
    AxleAnswer,
    LineErrorCode,
    LineStatus,
    Outcome,
    StationState,
    ThrustSign,
    VehicleAnswer,
    VehicleReport,
    WheelAnswer,
)


def wheel_frames(database: LineDatabase, sequence: int, answer: WheelAnswer) -> tuple[can.Message, ...]:
    """Uncertainty and result of one wheel, in the order of sending.

    Raises
    ------
    InputError
        When an angle does not fit its signal.
    """
    ending = database.wheels[answer.wheel]
    uncertainty, result = f"WheelUncertainty{ending}", f"WheelResult{ending}"
    return (
        database.encode(
            uncertainty,
            {
                "Sequence": sequence,
                "CamberU95": _rounded_up(database, uncertainty, "CamberU95", answer.camber_u95_deg),
                "ToeU95": _rounded_up(database, uncertainty, "ToeU95", answer.toe_u95_deg),
            },
        ),
        database.encode(
            result,
            {
                "Outcome": str(answer.outcome),
                "Sequence": sequence,
                "Camber": _angle(database, result, "Camber", answer.camber_deg),
                "Toe": _angle(database, result, "Toe", answer.toe_deg),
            },
        ),
    )


def axle_frames(database: LineDatabase, sequence: int, answer: AxleAnswer) -> tuple[can.Message, ...]:
    """Uncertainty and result of one axle, in the order of sending; raises like `wheel_frames`."""
    ending = database.axles[answer.axle]
    uncertainty, result = f"AxleUncertainty{ending}", f"AxleResult{ending}"
    toe_u95, camber_u95 = answer.total_toe_u95_deg, answer.camber_difference_u95_deg
    return (
        database.encode(
            uncertainty,
            {
                "Sequence": sequence,
                "TotalToeU95": _rounded_up(database, uncertainty, "TotalToeU95", toe_u95),
                "CamberDifferenceU95": _rounded_up(database, uncertainty, "CamberDifferenceU95", camber_u95),
            },
        ),
        database.encode(
            result,
            {
                "Outcome": str(answer.outcome),
                "Sequence": sequence,
                "TotalToe": _angle(database, result, "TotalToe", answer.total_toe_deg),
                "CamberDifference": _angle(
                    database, result, "CamberDifference", answer.camber_difference_deg
                ),
            },
        ),
    )


def vehicle_frame(
    database: LineDatabase, sequence: int, overall: Outcome, answer: VehicleAnswer
) -> can.Message:
    """Verdict of the whole vehicle with its thrust angle; raises like `wheel_frames`."""
    name = "VehicleResult"
    return database.encode(
        name,
        {
            "Outcome": str(overall),
            "Sequence": sequence,
            "ThrustAngle": _angle(database, name, "ThrustAngle", answer.thrust_angle_deg),
            "ThrustSign": answer.thrust_sign,
            "ThrustAngleU95": _rounded_up(database, name, "ThrustAngleU95", answer.thrust_angle_u95_deg),
        },
    )


def status_frame(database: LineDatabase, status: LineStatus) -> can.Message:
    """One Status message."""
    return database.encode(
        "Status",
        {
            "State": str(status.state),
            "Sequence": status.sequence,
            "Ready": int(status.ready),
            "Busy": int(status.busy),
            "Done": int(status.done),
            "Fault": int(status.fault),
            "AliveCounter": status.alive_counter,
            "ErrorCode": str(status.error_code),
            "ErrorSequence": status.error_sequence,
        },
    )


def read_wheel(wheel: str, result: Mapping[str, Value], uncertainty: Mapping[str, Value]) -> WheelAnswer:
    """Answer of one wheel from its two decoded messages.

    Raises
    ------
    LineError
        When the messages contradict themselves or each other, such as ok with an invalid angle.
    """
    _same_sequence(wheel, result, uncertainty)
    try:
        return WheelAnswer(
            wheel=wheel,
            outcome=Outcome(str(result["Outcome"])),
            camber_deg=_number(result["Camber"]),
            toe_deg=_number(result["Toe"]),
            camber_u95_deg=_number(uncertainty["CamberU95"]),
            toe_u95_deg=_number(uncertainty["ToeU95"]),
        )
    except ValueError as error:
        raise LineError(f"the result of wheel {wheel} contradicts itself: {error}") from error


def read_axle(axle: str, result: Mapping[str, Value], uncertainty: Mapping[str, Value]) -> AxleAnswer:
    """Answer of one axle from its two decoded messages; raises like `read_wheel`."""
    _same_sequence(axle, result, uncertainty)
    try:
        return AxleAnswer(
            axle=axle,
            outcome=Outcome(str(result["Outcome"])),
            total_toe_deg=_number(result["TotalToe"]),
            camber_difference_deg=_number(result["CamberDifference"]),
            total_toe_u95_deg=_number(uncertainty["TotalToeU95"]),
            camber_difference_u95_deg=_number(uncertainty["CamberDifferenceU95"]),
        )
    except ValueError as error:
        raise LineError(f"the result of the {axle} axle contradicts itself: {error}") from error


def read_vehicle(result: Mapping[str, Value]) -> VehicleReport:
    """Verdict and thrust angle from the decoded message.

    Raises
    ------
    LineError
        When there is no verdict.
    """
    try:
        return VehicleReport(
            outcome=Outcome(str(result["Outcome"])),
            thrust_angle_deg=_number(result["ThrustAngle"]),
            thrust_angle_u95_deg=_number(result["ThrustAngleU95"]),
            thrust_sign=cast("ThrustSign", str(result["ThrustSign"])),
        )
    except ValueError as error:
        raise LineError(f"the result of the vehicle contradicts itself: {error}") from error


def read_status(values: Mapping[str, Value]) -> LineStatus:
    """Status from its decoded message.

    Raises
    ------
    LineError
        When the state or the error code is none of the value table.
    """
    try:
        return LineStatus(
            state=StationState(str(values["State"])),
            sequence=int(values["Sequence"]),
            ready=bool(values["Ready"]),
            busy=bool(values["Busy"]),
            done=bool(values["Done"]),
            fault=bool(values["Fault"]),
            alive_counter=int(values["AliveCounter"]),
            error_code=LineErrorCode(str(values["ErrorCode"])),
            error_sequence=int(values["ErrorSequence"]),
        )
    except ValueError as error:
        raise LineError(f"the status of the station is not understood: {error}") from error


def _angle(database: LineDatabase, message: str, signal: str, value: float | None) -> Value:
    if value is None:
        return INVALID
    lowest, highest = database.range_of(message, signal)
    # The reserved raw value lies outside the range, so that no angle can be taken for it.
    if not lowest <= value <= highest:
        raise InputError(
            file=database.file,
            field=f"{message}.{signal}",
            expected=f"{lowest:g} to {highest:g} degrees",
            seen=str(value),
        )
    return value


def _rounded_up(database: LineDatabase, message: str, signal: str, value: float | None) -> Value:
    """An uncertainty never looks smaller on the bus than it is, and never 0 unless it is 0."""
    checked = _angle(database, message, signal, value)
    if isinstance(checked, str):
        return checked
    step = database.step(message, signal)
    return math.ceil(checked / step - 1e-9) * step


def _number(value: Value) -> float | None:
    return None if value == INVALID else float(value)


def _same_sequence(what: str, result: Mapping[str, Value], uncertainty: Mapping[str, Value]) -> None:
    if result["Sequence"] != uncertainty["Sequence"]:
        raise LineError(
            f"the result of {what} has sequence {result['Sequence']}, "
            f"its uncertainty has {uncertainty['Sequence']}"
        )
