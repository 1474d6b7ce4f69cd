"""Answers to frames and back: the one place that knows which signal carries which angle."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import cast

import can

from alignment.errors import InputError, LineError
from alignment.vehicle import ThrustSign
from station.cycle import (
    NO_GEOMETRY,
    NO_STEERING,
    AxisKind,
    AxleAnswer,
    GeometryAnswer,
    LiveAngles,
    LiveState,
    Outcome,
    Quality,
    QuantityState,
    SteeringAnswer,
    VehicleAnswer,
    WheelAnswer,
    vehicle_outcome,
)
from station.line.wire.dbc import LineDatabase, Value
from station.line.wire.dbc_needs import INVALID
from station.line.wire.messages import LiveAge, VehicleReport
from station.line.wire.numbers import fitting, milliseconds, read_number, rounded_up
from station.line.wire.steering_frames import steering_frames
from station.line.wire.vehicle_frames import geometry_frames

_WORDS = (
    "Kind", "State", "RunOutState", "Reference", "Between", "Correction", "StraightAhead", "LeftState",
    "RightState",
)  # fmt: skip


def wheel_frames(database: LineDatabase, sequence: int, answer: WheelAnswer) -> tuple[can.Message, ...]:
    """Uncertainty, axis and result of one wheel, in the order of sending.

    Raises
    ------
    InputError
        When a value does not fit its signal.
    """
    ending = database.wheels[answer.wheel]
    uncertainty, axis, result = (f"Wheel{what}{ending}" for what in ("Uncertainty", "Axis", "Result"))
    return (
        database.encode(
            uncertainty,
            {
                "Quality": str(answer.quality),
                "Sequence": sequence,
                "CamberU95": rounded_up(database, uncertainty, "CamberU95", answer.camber_u95_deg),
                "ToeU95": rounded_up(database, uncertainty, "ToeU95", answer.toe_u95_deg),
                "Residual": INVALID
                if answer.residual_mm is None
                else min(answer.residual_mm, database.range_of(uncertainty, "Residual")[1]),
            },
        ),
        database.encode(
            axis,
            {
                "Kind": str(answer.kind),
                "Sequence": sequence,
                "RunOutState": str(answer.run_out_state),
                "RunOut": fitting(database, axis, "RunOut", answer.run_out_mm),
                "HighSpot": _circled(database, axis, "HighSpot", answer.high_spot_deg),
                "RunOutU95": rounded_up(database, axis, "RunOutU95", answer.run_out_u95_mm),
            },
        ),
        database.encode(
            result,
            {
                "Outcome": str(answer.outcome),
                "Sequence": sequence,
                "Camber": fitting(database, result, "Camber", answer.camber_deg),
                "Toe": fitting(database, result, "Toe", answer.toe_deg),
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
                "TotalToeU95": rounded_up(database, uncertainty, "TotalToeU95", toe_u95),
                "CamberDifferenceU95": rounded_up(database, uncertainty, "CamberDifferenceU95", camber_u95),
            },
        ),
        database.encode(
            result,
            {
                "Outcome": str(answer.outcome),
                "Sequence": sequence,
                "TotalToe": fitting(database, result, "TotalToe", answer.total_toe_deg),
                "CamberDifference": fitting(
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
            "ThrustAngle": fitting(database, name, "ThrustAngle", answer.thrust_angle_deg),
            "ThrustSign": answer.thrust_sign,
            "ThrustAngleU95": rounded_up(database, name, "ThrustAngleU95", answer.thrust_angle_u95_deg),
        },
    )


def frames_of_live(database: LineDatabase, live: LiveAngles, age: LiveAge) -> tuple[can.Message, can.Message]:
    """Age and angles of one wheel that is adjusted, in the order of sending; raises like `wheel_frames`."""
    ending = database.wheels[live.wheel]
    name, aged = f"LiveAngles{ending}", f"LiveAge{ending}"
    age_ms = milliseconds(database, aged, "Age", age.age_s)
    return database.encode(aged, {"Kind": str(age.kind), "Shot": age.shot, "Age": age_ms}), database.encode(
        name,
        {
            "State": str(live.state),
            "Shot": live.shot,
            "Camber": fitting(database, name, "Camber", live.camber_deg),
            "Toe": fitting(database, name, "Toe", live.toe_deg),
        },
    )


def blank_frames(database: LineDatabase) -> list[can.Message]:
    """All result messages without a result: sequence number 0, everything invalid."""
    nothing: dict[str, Value] = {
        "Outcome": "none",
        "Quality": str(Quality.NONE),
        "Sequence": 0,
        "ThrustSign": "left_positive",
        **dict.fromkeys(_WORDS, "none"),
    }
    frames = []
    for name in database.result_messages:
        signals = database.signals(name)
        frames.append(database.encode(name, {signal: nothing.get(signal, INVALID) for signal in signals}))
    return frames


def read_wheel(
    wheel: str, result: Mapping[str, Value], uncertainty: Mapping[str, Value], axis: Mapping[str, Value]
) -> WheelAnswer:
    """Answer of one wheel from its three decoded messages.

    Raises
    ------
    LineError
        When the messages contradict themselves or each other, such as ok with an invalid angle.
    """
    _same_sequence(wheel, result, uncertainty)
    _same_sequence(wheel, result, axis)
    try:
        return WheelAnswer(
            wheel=wheel,
            outcome=Outcome(str(result["Outcome"])),
            camber_deg=read_number(result["Camber"]),
            toe_deg=read_number(result["Toe"]),
            camber_u95_deg=read_number(uncertainty["CamberU95"]),
            toe_u95_deg=read_number(uncertainty["ToeU95"]),
            quality=Quality(str(uncertainty["Quality"])),
            residual_mm=read_number(uncertainty["Residual"]),
            kind=AxisKind(str(axis["Kind"])),
            run_out_state=QuantityState(str(axis["RunOutState"])),
            run_out_mm=read_number(axis["RunOut"]),
            run_out_u95_mm=read_number(axis["RunOutU95"]),
            high_spot_deg=read_number(axis["HighSpot"]),
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
            total_toe_deg=read_number(result["TotalToe"]),
            camber_difference_deg=read_number(result["CamberDifference"]),
            total_toe_u95_deg=read_number(uncertainty["TotalToeU95"]),
            camber_difference_u95_deg=read_number(uncertainty["CamberDifferenceU95"]),
        )
    except ValueError as error:
        raise LineError(f"the result of the {axle} axle contradicts itself: {error}") from error


def read_vehicle(
    result: Mapping[str, Value],
    geometry: GeometryAnswer = NO_GEOMETRY,
    steering: SteeringAnswer = NO_STEERING,
) -> VehicleReport:
    """Verdict and thrust angle from the decoded message, beside geometry and steering.

    Raises
    ------
    LineError
        When there is no verdict.
    """
    try:
        return VehicleReport(
            outcome=Outcome(str(result["Outcome"])),
            thrust_angle_deg=read_number(result["ThrustAngle"]),
            thrust_angle_u95_deg=read_number(result["ThrustAngleU95"]),
            thrust_sign=cast("ThrustSign", str(result["ThrustSign"])),
            geometry=geometry,
            steering=steering,
        )
    except ValueError as error:
        raise LineError(f"the result of the vehicle contradicts itself: {error}") from error


def read_age(wheel: str, values: Mapping[str, Value]) -> LiveAge:
    """Age of live angles from its decoded message; raises like `read_live`."""
    try:
        age_ms = read_number(values["Age"])
        kind = AxisKind(str(values["Kind"]))
        return LiveAge(wheel, int(values["Shot"]), None if age_ms is None else age_ms / 1000.0, kind)
    except ValueError as error:
        raise LineError(f"the age of the live angles of wheel {wheel} is not understood: {error}") from error


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
            read_number(values["Camber"]),
            read_number(values["Toe"]),
        )
    except ValueError as error:
        raise LineError(f"the live angles of wheel {wheel} are not understood: {error}") from error


def _circled(database: LineDatabase, message: str, signal: str, degrees: float | None) -> Value:
    """A place on a circle: what would be rounded to a full turn is 0."""
    if degrees is None:
        return INVALID
    step = database.step(message, signal)
    return round(degrees / step) * step % 360.0


def _same_sequence(what: str, result: Mapping[str, Value], uncertainty: Mapping[str, Value]) -> None:
    if result["Sequence"] != uncertainty["Sequence"]:
        raise LineError(
            f"the result of {what} has sequence {result['Sequence']}, "
            f"what belongs to it has {uncertainty['Sequence']}"
        )


def result_frames(
    database: LineDatabase,
    sequence: int,
    requested: Sequence[str],
    wheel_answers: Sequence[WheelAnswer],
    axle_answers: Sequence[AxleAnswer],
    vehicle: VehicleAnswer,
) -> tuple[Outcome, list[can.Message]]:
    """All frames of a vehicle's results in the order of sending, and its outcome: see `vehicle_outcome`.

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
    overall = vehicle_outcome(wheels.values(), axles.values(), vehicle)
    frames: list[can.Message] = []
    for name in database.wheels:
        frames += wheel_frames(
            database, sequence, wheels.get(name) or WheelAnswer(name, Outcome.NOT_REQUESTED)
        )
    for name in database.axles:
        frames += axle_frames(database, sequence, axles.get(name) or AxleAnswer(name, Outcome.NOT_REQUESTED))
    frames += geometry_frames(database, sequence, vehicle.geometry)
    frames += steering_frames(database, sequence, vehicle.steering)
    frames.append(vehicle_frame(database, sequence, overall, vehicle))
    return overall, frames


def _require_names(what: str, given: Sequence[str], known: Iterable[str]) -> None:
    if len(set(given)) != len(given) or not set(given) <= set(known):
        raise InputError(
            field=f"{what}_answers",
            expected=f"each {what} of {', '.join(known)} at most once",
            seen=", ".join(given),
        )
