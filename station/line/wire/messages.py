"""What the controller asks and what the station answers, as values; nothing here knows bits or buses.

Angles are in degrees, as on the bus, and say so in their names. Signs are the product's: camber positive when
the top leans outboard, toe positive for toe-in. Ranges of angles are those of the line's DBC and are checked
where a value is encoded; that an answer is complete is checked where it is made.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass

from alignment.vehicle import ThrustSign
from station.cycle import (
    NO_GEOMETRY,
    NO_STEERING,
    AxisKind,
    ErrorCode,
    GeometryAnswer,
    Outcome,
    StationState,
    SteeringAnswer,
)
from station.duty import MasterState


class HandshakeState(enum.StrEnum):
    """Where station and controller stand with each other; the words of the DBC's value table.

    STARTING: the station is not up yet. READY: a start would be accepted. PREPARED: the next vehicle is
    announced. BUSY: a start was accepted. ADJUSTING: so was one in the mode adjust, and live angles go out.
    ENDING: the running cycle was aborted and ends. HELD: results went out and wait for their
    acknowledgement. CLOSING: they were acknowledged, which is being stored. RESETTING: a reset waits for the
    cycle. FAULT: only a reset leads out. SWEEPING: a start in the mode sweep was accepted, and images of a
    position are taken. TURNING: the steering is to be turned to the next one, and a step is awaited.
    """

    STARTING = "starting"
    READY = "ready"
    PREPARED = "prepared"
    BUSY = "busy"
    ADJUSTING = "adjusting"
    ENDING = "ending"
    HELD = "held"
    CLOSING = "closing"
    RESETTING = "resetting"
    FAULT = "fault"
    SWEEPING = "sweeping"
    TURNING = "turning"


class CommandCode(enum.StrEnum):
    """What the controller asks; the words of the DBC's value table.

    STEP: the steering was turned to the position that the sweep wanted.
    """

    NONE = "none"
    PREPARE = "prepare"
    START = "start"
    STOP = "stop"
    ABORT = "abort"
    RESET = "reset"
    ACKNOWLEDGE = "acknowledge"
    STEP = "step"


class Answer(enum.StrEnum):
    """Answer to a command; the words of the DBC's value table."""

    NONE = "none"
    ACCEPTED = "accepted"
    REFUSED = "refused"


class Part(enum.StrEnum):
    """Part of the station that an error code is about; the words of the DBC's value table."""

    NONE = "none"
    LINE = "line"
    CYCLE = "cycle"
    CAMERAS = "cameras"
    CALIBRATION = "calibration"
    MEASUREMENT = "measurement"
    STORE = "store"
    CONFIGURATION = "configuration"


@dataclass(frozen=True)
class VehicleReport:
    """The vehicle as the controller reads it: verdict, thrust angle (None: invalid), geometry, steering."""

    outcome: Outcome
    thrust_angle_deg: float | None
    thrust_angle_u95_deg: float | None
    thrust_sign: ThrustSign
    geometry: GeometryAnswer = NO_GEOMETRY
    steering: SteeringAnswer = NO_STEERING


@dataclass(frozen=True)
class LiveAge:
    """One LiveAge message: age of the live angles of the same shot, seconds, and what they are those of."""

    wheel: str
    shot: int
    age_s: float | None
    kind: AxisKind


@dataclass(frozen=True)
class LineStatus:
    """One Status message as it is on the bus; the attributes are the signals of the DBC.

    `done` is ResultValid: the results of `sequence` went out and wait for their acknowledgement.
    """

    state: StationState
    sequence: int
    ready: bool
    busy: bool
    done: bool
    fault: bool
    alive_counter: int
    error_code: ErrorCode
    error_sequence: int
    handshake: HandshakeState = HandshakeState.STARTING

    @property
    def takes_start(self) -> bool:
        """Whether a start would be accepted, be it of a master check alone, which a station may owe."""
        return self.ready or self.handshake in (HandshakeState.READY, HandshakeState.PREPARED)

    def __str__(self) -> str:
        flags = {"ready": self.ready, "busy": self.busy, "results valid": self.done, "fault": self.fault}
        said = [name for name, true in flags.items() if true]
        if self.error_code is not ErrorCode.NONE:
            said.append(f"{self.error_code} of {self.error_sequence}")
        return f"{', '.join([str(self.handshake), *said])}; cycle {self.state}, number {self.sequence}"


@dataclass(frozen=True)
class LineMaster:
    """One MasterCheck message; None where vehicles or time are not counted."""

    state: MasterState
    vehicles_left: int | None
    minutes_left: int | None
    doubted: int


@dataclass(frozen=True)
class CommandAnswer:
    """One CommandAnswer message: what became of the last command, and whether the controller is heard."""

    code: CommandCode
    sequence: int
    answer: Answer
    error_code: ErrorCode
    link_up: bool
    heartbeat: int

    def __str__(self) -> str:
        why = "" if self.error_code is ErrorCode.NONE else f" with {self.error_code}"
        heard = "" if self.link_up else ", controller not heard"
        return f"{self.code} {self.sequence} {self.answer}{why}{heard}"


@dataclass(frozen=True)
class StationInfo:
    """One StationInfo message: versions, and a number that changes when the program starts again."""

    interface: tuple[int, int]
    software: tuple[int, int, int]
    boot: int

    def __str__(self) -> str:
        interface, software = (".".join(map(str, numbers)) for numbers in (self.interface, self.software))
        return f"interface {interface}, software {software}"
