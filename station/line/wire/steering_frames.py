"""Steering and guidance to frames and back: what a sweep and a vehicle brought, and what is to be turned."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import can

from alignment.errors import LineError
from station.cycle import (
    AngleCorrection,
    CornerAnswer,
    Guidance,
    HeightState,
    QuantityAnswer,
    QuantityState,
    SteeringAnswer,
    SteeringWheelAnswer,
    StraightAhead,
    SweepProgress,
    SweepState,
)
from station.guidance import AdjusterKind, GuidanceState, OutOfReach, TurnDirection
from station.line.wire.dbc import LineDatabase, Value
from station.line.wire.numbers import bounded, fitting, milliseconds, read_number, rounded_up

_NONE = "none"


def steering_frames(
    database: LineDatabase, sequence: int, steering: SteeringAnswer
) -> tuple[can.Message, ...]:
    """Angles as measured, ride heights, steering wheel and steering axes, in the order of sending.

    Nothing where the DBC is of an interface before 3.1.

    Raises
    ------
    InputError
        When a value does not fit its signal.
    """
    if not database.has_steering:
        return ()
    raw = (_raw_frame(database, e, sequence, steering.corner(w)) for w, e in database.guided.items())
    heights = (_heights_frame(database, axle, sequence, steering) for axle in database.levelled)
    axes = (
        database.encode(
            message,
            {
                "State": str(steering.of(name).state),
                "Sequence": sequence,
                "Value": fitting(database, message, "Value", steering.of(name).value),
                "U95": rounded_up(database, message, "U95", steering.of(name).u95),
            },
        )
        for name, message in database.steering_axes.items()
    )
    return (*raw, *heights, _wheel_frame(database, sequence, steering.wheel), *axes)


def _raw_frame(database: LineDatabase, ending: str, sequence: int, corner: CornerAnswer) -> can.Message:
    name = f"WheelRaw{ending}"
    return database.encode(
        name,
        {
            "Correction": str(corner.correction),
            "Sequence": sequence,
            "Camber": fitting(database, name, "Camber", corner.raw_camber_deg),
            "Toe": fitting(database, name, "Toe", corner.raw_toe_deg),
        },
    )


def _heights_frame(database: LineDatabase, axle: str, sequence: int, steering: SteeringAnswer) -> can.Message:
    name = f"RideHeightUsed{database.levelled[axle]}"
    values: dict[str, Value] = {"Sequence": sequence}
    for side in ("Left", "Right"):
        corner = steering.corner(f"{axle}_{side.lower()}")
        values[f"{side}State"] = str(corner.height)
        values[side] = fitting(database, name, side, corner.height_mm)
    return database.encode(name, values)


def _wheel_frame(database: LineDatabase, sequence: int, wheel: SteeringWheelAnswer) -> can.Message:
    name = "SteeringWheelResult"
    return database.encode(
        name,
        {
            "State": str(wheel.state),
            "Sequence": sequence,
            "Used": fitting(database, name, "Used", wheel.used_deg),
            "Offset": fitting(database, name, "Offset", wheel.offset_deg),
            "StraightAhead": str(wheel.straight_ahead),
        },
    )


def read_steering(database: LineDatabase, results: Mapping[str, Mapping[str, Value]]) -> SteeringAnswer:
    """What is told of the steering, from its decoded messages; nothing of a station before 3.1.

    Raises
    ------
    LineError
        When a message contradicts itself.
    """
    if not database.has_steering:
        return SteeringAnswer()
    said = results["SteeringWheelResult"]
    try:
        axes = tuple(
            QuantityAnswer(
                name,
                QuantityState(str(results[message]["State"])),
                read_number(results[message]["Value"]),
                read_number(results[message]["U95"]),
            )
            for name, message in database.steering_axes.items()
            if results[message]["State"] != _NONE
        )
        wheel = SteeringWheelAnswer(
            StraightAhead(str(said["StraightAhead"])),
            QuantityState(str(said["State"])),
            read_number(said["Offset"]),
            read_number(said["Used"]),
        )
        corners = (_corner(database, wheel_name, results) for wheel_name in database.wheels)
        return SteeringAnswer(axes, wheel, tuple(c for c in corners if c != CornerAnswer(c.wheel)))
    except ValueError as error:
        raise LineError(f"what is told of the steering contradicts itself: {error}") from error


def _corner(database: LineDatabase, wheel: str, results: Mapping[str, Mapping[str, Value]]) -> CornerAnswer:
    corner = CornerAnswer(wheel)
    if wheel in database.guided:
        raw = results[f"WheelRaw{database.guided[wheel]}"]
        corner = CornerAnswer(
            wheel,
            correction=AngleCorrection(str(raw["Correction"])),
            raw_camber_deg=read_number(raw["Camber"]),
            raw_toe_deg=read_number(raw["Toe"]),
        )
    axle, _, side = wheel.rpartition("_")
    ending = database.levelled.get(axle)
    if ending is None or side not in ("left", "right"):
        return corner
    heights = results[f"RideHeightUsed{ending}"]
    state = HeightState(str(heights[f"{side.capitalize()}State"]))
    return replace(corner, height=state, height_mm=read_number(heights[side.capitalize()]))


def progress_frame(database: LineDatabase, sequence: int, progress: SweepProgress) -> can.Message:
    """How a sweep goes; raises as `steering_frames`."""
    return database.encode(
        "SweepProgress",
        {
            "State": str(progress.state),
            "Sequence": sequence,
            "Position": progress.position,
            "Positions": progress.positions,
            "Wanted": fitting(database, "SweepProgress", "Wanted", progress.wanted_deg),
        },
    )


def read_progress(values: Mapping[str, Value]) -> tuple[int, SweepProgress]:
    """Number of the start and how its sweep goes, from the decoded message.

    Raises
    ------
    LineError
        When it contradicts itself.
    """
    try:
        return int(values["Sequence"]), SweepProgress(
            SweepState(str(values["State"])),
            int(values["Position"]),
            int(values["Positions"]),
            read_number(values["Wanted"]),
        )
    except ValueError as error:
        raise LineError(f"the progress of the sweep contradicts itself: {error}") from error


def guidance_frames(
    database: LineDatabase, guidance: Guidance, age_s: float | None
) -> tuple[can.Message, can.Message]:
    """Target and guidance of one wheel, in the order of sending.

    Turns and drift beyond their signals' ranges are at the ends of those; raises as `steering_frames`.
    """
    ending = database.guided[guidance.wheel]
    name, target = f"Guidance{ending}", f"GuidanceTarget{ending}"
    return database.encode(
        target,
        {
            "Reason": str(guidance.reason),
            "Shot": guidance.shot,
            "Camber": fitting(database, target, "Camber", guidance.target_camber_deg),
            "Toe": fitting(database, target, "Toe", guidance.target_toe_deg),
            "Drift": bounded(database, target, "Drift", guidance.drift_deg),
        },
    ), database.encode(
        name,
        {
            "State": str(guidance.state),
            "Shot": guidance.shot,
            "Adjuster": str(guidance.adjuster),
            "Direction": str(guidance.direction),
            "Turns": bounded(database, name, "Turns", guidance.turns_to_go),
            "Age": milliseconds(database, name, "Age", age_s),
        },
    )


def read_guidance(
    wheel: str, values: Mapping[str, Value], target: Mapping[str, Value]
) -> tuple[Guidance, float | None]:
    """What to do at a wheel and how old that is, seconds, from its two decoded messages.

    Raises
    ------
    LineError
        When they contradict themselves, are of different shots, or tell another way than their turns.
    """
    try:
        guidance = Guidance(
            wheel,
            GuidanceState(str(values["State"])),
            int(values["Shot"]),
            AdjusterKind(str(values["Adjuster"])),
            read_number(values["Turns"]),
            read_number(target["Camber"]),
            read_number(target["Toe"]),
            read_number(target["Drift"]),
            OutOfReach(str(target["Reason"])),
        )
        direction = TurnDirection(str(values["Direction"]))
    except ValueError as error:
        raise LineError(f"the guidance of wheel {wheel} contradicts itself: {error}") from error
    if values["Shot"] != target["Shot"]:
        raise LineError(
            f"the guidance of wheel {wheel} is of shot {values['Shot']}, its target of {target['Shot']}"
        )
    # Turns of next to nothing are 0 on the bus, and still have a way.
    if guidance.direction is not direction and guidance.turns_to_go != 0.0:
        raise LineError(
            f"the guidance of wheel {wheel} says {direction}, but turns are {guidance.turns_to_go}"
        )
    age_ms = read_number(values["Age"])
    return guidance, None if age_ms is None else age_ms / 1000.0


def blank_guidance(database: LineDatabase, wheel: str) -> tuple[can.Message, can.Message]:
    """Frames that say of a wheel that it is not adjusted any more."""
    return guidance_frames(database, Guidance(wheel, GuidanceState.NONE), None)
