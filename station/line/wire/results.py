"""Answers to frames and back: the one place that knows which signal carries which angle."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import cast

import can

from alignment.errors import InputError, LineError
from alignment.vehicle import ThrustSign
from station.cycle import (
    AxleAnswer,
    LiveAngles,
    LiveState,
    Outcome,
    Quality,
    VehicleAnswer,
    WheelAnswer,
    overall_outcome,
)
from station.line.wire.dbc import LineDatabase, Value
from station.line.wire.dbc_needs import INVALID
from station.line.wire.messages import VehicleReport


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
                "Quality": str(answer.quality),
                "Sequence": sequence,
                "CamberU95": _rounded_up(database, uncertainty, "CamberU95", answer.camber_u95_deg),
                "ToeU95": _rounded_up(database, uncertainty, "ToeU95", answer.toe_u95_deg),
                "Residual": INVALID
                if answer.residual_mm is None
                else min(answer.residual_mm, database.range_of(uncertainty, "Residual")[1]),
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


def live_frame(database: LineDatabase, live: LiveAngles) -> can.Message:
    """Angles of one wheel that is adjusted; raises like `wheel_frames`."""
    name = f"LiveAngles{database.wheels[live.wheel]}"
    return database.encode(
        name,
        {
            "State": str(live.state),
            "Shot": live.shot,
            "Camber": _angle(database, name, "Camber", live.camber_deg),
            "Toe": _angle(database, name, "Toe", live.toe_deg),
        },
    )


def blank_frames(database: LineDatabase) -> list[can.Message]:
    """All result messages without a result: sequence number 0, everything invalid."""
    nothing: dict[str, Value] = {
        "Outcome": "none",
        "Quality": str(Quality.NONE),
        "Sequence": 0,
        "ThrustSign": "left_positive",
    }
    frames = []
    for name in database.result_messages:
        signals = database.signals(name)
        frames.append(database.encode(name, {signal: nothing.get(signal, INVALID) for signal in signals}))
    return frames


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
            quality=Quality(str(uncertainty["Quality"])),
            residual_mm=_number(uncertainty["Residual"]),
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


def read_live(wheel: str, values: Mapping[str, Value]) -> LiveAngles:
    """Live angles from their decoded message.

    Raises
    ------
    LineError
        When the state is none of the value table.
    """
    try:
        return LiveAngles(
            wheel,
            LiveState(str(values["State"])),
            int(values["Shot"]),
            _number(values["Camber"]),
            _number(values["Toe"]),
        )
    except ValueError as error:
        raise LineError(f"the live angles of wheel {wheel} are not understood: {error}") from error


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


def result_frames(
    database: LineDatabase,
    sequence: int,
    requested: Sequence[str],
    wheel_answers: Sequence[WheelAnswer],
    axle_answers: Sequence[AxleAnswer],
    vehicle: VehicleAnswer,
) -> tuple[Outcome, list[can.Message]]:
    """All frames of a vehicle's results in the order of sending, and its outcome: see `overall_outcome`.

    Wheels and axles without an answer become not requested.

    Raises
    ------
    InputError
        When a requested wheel has no answer, another wheel has one, a name is unknown or given twice, or an
        angle does not fit its signal.
    """
    wheels = {answer.wheel: answer for answer in wheel_answers}
    axles = {answer.axle: answer for answer in axle_answers}
    answered = {name for name, answer in wheels.items() if answer.outcome is not Outcome.NOT_REQUESTED}
    _require_names("wheel", [answer.wheel for answer in wheel_answers], database.wheels)
    _require_names("axle", [answer.axle for answer in axle_answers], database.axles)
    if answered != set(requested):
        raise InputError(
            field="wheel_answers",
            expected=f"an outcome for {', '.join(requested)} and no other wheel",
            seen=", ".join(sorted(answered)) or "none",
        )
    answers: list[WheelAnswer | AxleAnswer | VehicleAnswer] = [*wheels.values(), *axles.values(), vehicle]
    overall = overall_outcome(answer.outcome for answer in answers)
    frames: list[can.Message] = []
    for name in database.wheels:
        frames += wheel_frames(
            database, sequence, wheels.get(name) or WheelAnswer(name, Outcome.NOT_REQUESTED)
        )
    for name in database.axles:
        frames += axle_frames(database, sequence, axles.get(name) or AxleAnswer(name, Outcome.NOT_REQUESTED))
    frames.append(vehicle_frame(database, sequence, overall, vehicle))
    return overall, frames


def _require_names(what: str, given: Sequence[str], known: Iterable[str]) -> None:
    if len(set(given)) != len(given) or not set(given) <= set(known):
        raise InputError(
            field=f"{what}_answers",
            expected=f"each {what} of {', '.join(known)} at most once",
            seen=", ".join(given),
        )
