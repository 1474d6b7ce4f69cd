"""The words of the measuring cycle: what is asked of it, where it stands, what it answers, what failed.

Angles are in degrees where a controller reads them, and say so in their names. Signs are the product's:
camber positive when the top leans outboard, toe positive for toe-in. That an answer is complete is checked
where it is made. Nothing here knows of a line; the line translates.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Iterable
from dataclasses import dataclass, field

from alignment.errors import InputError
from alignment.vehicle import ThrustSign
from station.cycle.words.geometry import NO_GEOMETRY, GeometryAnswer, QuantityState
from station.cycle.words.steering import NO_STEERING, SteeringAnswer, Step


class Outcome(enum.StrEnum):
    """What became of a wheel, an axle or the vehicle; the words of the DBC's value tables."""

    OK = "ok"
    NOK = "nok"
    FAULT = "fault"
    ABORTED = "aborted"
    NOT_REQUESTED = "not_requested"
    RECORDED = "recorded"

    @property
    def judged(self) -> bool:
        """True for ok and nok, which stand for measured values."""
        return self in (Outcome.OK, Outcome.NOK)


class StationState(enum.StrEnum):
    """Where the measuring cycle stands; the words of the DBC's value table.

    STARTING: the program compiles and loads what a measurement needs; there is no cycle yet. SWEEPING: the
    steering is turned from position to position, and images are taken at each.
    """

    IDLE = "idle"
    ARMED = "armed"
    MEASURING = "measuring"
    EVALUATING = "evaluating"
    STORING = "storing"
    REPORTING = "reporting"
    FAULT = "fault"
    ADJUSTING = "adjusting"
    STARTING = "starting"
    SWEEPING = "sweeping"


class Mode(enum.StrEnum):
    """What a start does; the words of the DBC's value table.

    AUTOMATIC: measure, judge, store, report. ADJUST: live angles until a stop, then as automatic.
    MASTER_CHECK: as automatic, of a master wheel, stored as a check of the calibration too. CALIBRATE:
    images are recorded and nothing is judged. SWEEP: the steering is turned through positions, for its axes;
    the last one is straight ahead, where all is measured as automatic. GUIDANCE, STEERING, LOCATE: names
    that are taken; no station serves them yet, and guidance comes with ADJUST.
    """

    AUTOMATIC = "automatic"
    ADJUST = "adjust"
    MASTER_CHECK = "master_check"
    CALIBRATE = "calibrate"
    SWEEP = "sweep"
    GUIDANCE = "guidance"
    STEERING = "steering"
    LOCATE = "locate"


RESERVED_MODES = frozenset({Mode.GUIDANCE, Mode.STEERING, Mode.LOCATE})
SERVED_MODES = frozenset(Mode) - RESERVED_MODES
"""What a start can do."""


class Quality(enum.StrEnum):
    """How much of a rig stands behind a wheel; the words of the DBC's value table."""

    NONE = "none"
    FULL = "full"
    DEGRADED = "degraded"


class AxisKind(enum.StrEnum):
    """What a wheel's angles are those of; the words of the DBC's value table.

    TYRE_PLANE: of one exposure, run-out included. SPIN_AXIS: of a series of exposures of a wheel that turns,
    free of run-out. NONE: there are no angles, or it is not known.
    """

    NONE = "none"
    TYRE_PLANE = "tyre_plane"
    SPIN_AXIS = "spin_axis"

    @classmethod
    def of_method(cls, method: str | None) -> AxisKind:
        """What a method measures: its first word says so."""
        word = (method or "").partition("/")[0]
        return cls(word) if word in set(cls) else cls.NONE


class LiveState(enum.StrEnum):
    """What a live angle is worth; the words of the DBC's value table."""

    NONE = "none"
    INSIDE = "inside"
    OUTSIDE = "outside"
    STALE = "stale"
    NOT_MEASURED = "not_measured"


class ErrorCode(enum.StrEnum):
    """Why a command was refused or the station stands; the numbers are in the DBC's value table.

    The first group is the answer to a command and leaves the station as it was; the second is the station's.
    """

    NONE = "none"
    VIN_INCOMPLETE = "vin_incomplete"
    VIN_INVALID = "vin_invalid"
    NO_WHEELS = "no_wheels"
    UNKNOWN_COMMAND = "unknown_command"
    BUSY = "busy"
    NOT_ACKNOWLEDGED = "not_acknowledged"
    SEQUENCE_USED = "sequence_used"
    WRONG_SEQUENCE = "wrong_sequence"
    NOTHING_TO_ACKNOWLEDGE = "nothing_to_acknowledge"
    RESET_REQUIRED = "reset_required"
    UNKNOWN_VEHICLE_TYPE = "unknown_vehicle_type"
    WHEEL_NOT_AVAILABLE = "wheel_not_available"
    NOTHING_TO_STOP = "nothing_to_stop"
    START_STALE = "start_stale"
    RESETTING = "resetting"
    MODE_NOT_AVAILABLE = "mode_not_available"
    WRONG_INTERFACE = "wrong_interface"
    NOTHING_TO_STEP = "nothing_to_step"
    STEP_INCOMPLETE = "step_incomplete"
    MASTER_CHECK_OVERDUE = "master_check_overdue"
    MASTER_CHECK_FAILED = "master_check_failed"

    CAMERA_FAULT = "camera_fault"
    CALIBRATION_FAULT = "calibration_fault"
    MEASUREMENT_REFUSED = "measurement_refused"
    STORE_FAULT = "store_fault"
    CYCLE_TIMEOUT = "cycle_timeout"
    CONFIGURATION_FAULT = "configuration_fault"
    INTERNAL_FAULT = "internal_fault"
    LINE_FAULT = "line_fault"
    STARTING = "starting"
    COMMUNICATION_LOST = "communication_lost"
    ADJUST_TIMEOUT = "adjust_timeout"
    SWEEP_FAULT = "sweep_fault"
    GUIDANCE_FAULT = "guidance_fault"
    STEERING_FAULT = "steering_fault"
    LOCATE_FAULT = "locate_fault"


RESERVED_CODES = frozenset({ErrorCode.GUIDANCE_FAULT, ErrorCode.LOCATE_FAULT})
"""Codes of the `RESERVED_MODES`, which nothing sends yet."""


@dataclass(frozen=True)
class Trigger:
    """A start command, complete with its VIN.

    Attributes
    ----------
    sequence
        0 to 255, chosen by the controller; every answer carries it.
    wheels
        Names of the wheels to measure, such as ``front_left``, in the order of the DBC.
    vehicle_type
        Number of the vehicle type, 0 to 65535.
    vin
        17 characters.
    received_s
        When the start command arrived, seconds of the line's monotonic clock.
    mode
        What to do with them.
    """

    sequence: int
    wheels: tuple[str, ...]
    vehicle_type: int
    vin: str
    received_s: float = field(default=0.0, compare=False)
    mode: Mode = Mode.AUTOMATIC

    def __str__(self) -> str:
        return (
            f"start {self.sequence}, VIN {self.vin}, vehicle type {self.vehicle_type}, mode {self.mode}, "
            f"{' and '.join(self.wheels) or 'no wheel'}"
        )


@dataclass(frozen=True)
class Prepare:
    """The next vehicle will be of this type, with these wheels, in this mode."""

    sequence: int
    wheels: tuple[str, ...]
    vehicle_type: int
    mode: Mode = Mode.AUTOMATIC

    def __str__(self) -> str:
        return f"prepare {self.sequence}, vehicle type {self.vehicle_type}"


@dataclass(frozen=True)
class Stop:
    """End the adjusting of this sequence: measure and judge."""

    sequence: int

    def __str__(self) -> str:
        return f"stop {self.sequence}"


@dataclass(frozen=True)
class Abort:
    """End the running cycle; its wheels become aborted. Harmless when no cycle of this sequence runs.

    `reason` is what asked for it: the controller, or the line itself when the communication was lost.
    """

    sequence: int
    reason: ErrorCode = ErrorCode.NONE

    def __str__(self) -> str:
        return f"abort {self.sequence}" + ("" if self.reason is ErrorCode.NONE else f" ({self.reason})")


@dataclass(frozen=True)
class Reset:
    """Forget the cycle and the faults; harmless when there are none."""

    sequence: int

    def __str__(self) -> str:
        return f"reset {self.sequence}"


@dataclass(frozen=True)
class Acknowledge:
    """The controller took over the results of this sequence."""

    sequence: int

    def __str__(self) -> str:
        return f"acknowledge {self.sequence}"


Command = Trigger | Prepare | Stop | Abort | Reset | Acknowledge | Step


def _require_complete(what: str, outcome: Outcome, values: dict[str, float | None]) -> None:
    """Raise unless a judged answer has every value, and any other answer has none."""
    for name, value in values.items():
        if outcome.judged and (value is None or not math.isfinite(value)):
            raise InputError(
                field=f"{what}.{name}",
                expected=f"a finite value, because the outcome is '{outcome}'",
                seen=str(value),
                cure="Answer what was not measured with the outcome 'fault'.",
            )
        if outcome.judged and name.endswith("_u95_deg") and value is not None and value < 0.0:
            raise InputError(field=f"{what}.{name}", expected="an uncertainty of 0 or more", seen=str(value))
        if not outcome.judged and value is not None:
            raise InputError(
                field=f"{what}.{name}",
                expected=f"no value, because the outcome is '{outcome}'",
                seen=str(value),
            )


@dataclass(frozen=True)
class WheelAnswer:
    """Outcome of one wheel. ok and nok carry all four finite values, every other outcome none of them.

    Quality, residual (RMS, millimetres), kind and run-out explain a judged wheel; what is not known of them
    stays empty.

    Attributes
    ----------
    kind
        What the angles are those of.
    run_out_state
        Verdict on the run-out, which is its own; only of a spin axis.
    run_out_mm, run_out_u95_mm
        Axial run-out of the tyre, peak to peak; 0 with what may hide where none can be told from noise. None
        unless the state stands for a value.
    high_spot_deg
        Where the tyre stood out farthest at the last exposure, 0 to 360: from the top of the wheel,
        counter-clockwise as seen from outboard. None where no run-out was told.

    Raises
    ------
    InputError
        When outcome and values contradict each other.
    """

    wheel: str
    outcome: Outcome
    camber_deg: float | None = None
    toe_deg: float | None = None
    camber_u95_deg: float | None = None
    toe_u95_deg: float | None = None
    quality: Quality = Quality.NONE
    residual_mm: float | None = None
    kind: AxisKind = AxisKind.NONE
    run_out_state: QuantityState = QuantityState.NONE
    run_out_mm: float | None = None
    run_out_u95_mm: float | None = None
    high_spot_deg: float | None = None

    def __post_init__(self) -> None:
        values = {
            "camber_deg": self.camber_deg,
            "toe_deg": self.toe_deg,
            "camber_u95_deg": self.camber_u95_deg,
            "toe_u95_deg": self.toe_u95_deg,
        }
        _require_complete(self.wheel, self.outcome, values)
        if self.kind is not AxisKind.NONE and not self.outcome.judged:
            raise InputError(
                field=f"{self.wheel}.kind",
                expected=f"none, because the outcome is '{self.outcome}'",
                seen=self.kind,
            )
        self._require_run_out()

    def _require_run_out(self) -> None:
        if self.run_out_state is not QuantityState.NONE and self.kind is not AxisKind.SPIN_AXIS:
            raise InputError(
                field=f"{self.wheel}.run_out_state",
                expected=f"none, because the angles are those of '{self.kind}'",
                seen=self.run_out_state,
            )
        measured = self.run_out_state.measured
        for name, value in (("run_out_mm", self.run_out_mm), ("run_out_u95_mm", self.run_out_u95_mm)):
            good = value is not None and math.isfinite(value) and value >= 0.0
            if good if measured else value is None:
                continue
            wanted = "a finite number of 0 or more" if measured else "no value"
            raise InputError(
                field=f"{self.wheel}.{name}",
                expected=f"{wanted}, because the state of the run-out is '{self.run_out_state}'",
                seen=str(value),
            )
        spot = self.high_spot_deg
        if spot is not None and not (measured and 0.0 <= spot <= 360.0):
            raise InputError(
                field=f"{self.wheel}.high_spot_deg",
                expected="0 to 360 beside a run-out that was measured",
                seen=str(spot),
            )


@dataclass(frozen=True)
class AxleAnswer:
    """Outcome of one axle (``front``, ``rear``); complete or empty like `WheelAnswer`."""

    axle: str
    outcome: Outcome
    total_toe_deg: float | None = None
    camber_difference_deg: float | None = None
    total_toe_u95_deg: float | None = None
    camber_difference_u95_deg: float | None = None

    def __post_init__(self) -> None:
        values = {
            "total_toe_deg": self.total_toe_deg,
            "camber_difference_deg": self.camber_difference_deg,
            "total_toe_u95_deg": self.total_toe_u95_deg,
            "camber_difference_u95_deg": self.camber_difference_u95_deg,
        }
        _require_complete(self.axle, self.outcome, values)


@dataclass(frozen=True)
class VehicleAnswer:
    """Outcome of the thrust angle; complete or empty like `WheelAnswer`. Beside it geometry and steering."""

    outcome: Outcome
    thrust_angle_deg: float | None = None
    thrust_angle_u95_deg: float | None = None
    thrust_sign: ThrustSign = "left_positive"
    geometry: GeometryAnswer = NO_GEOMETRY
    steering: SteeringAnswer = NO_STEERING

    def __post_init__(self) -> None:
        values = {
            "thrust_angle_deg": self.thrust_angle_deg,
            "thrust_angle_u95_deg": self.thrust_angle_u95_deg,
        }
        _require_complete("vehicle", self.outcome, values)


def overall_outcome(outcomes: Iterable[Outcome]) -> Outcome:
    """Outcome of the whole from the outcomes of its parts.

    aborted goes before fault, fault before nok; ok needs at least one ok and nothing worse. Parts that were
    not requested do not count; without any other part the whole was not requested either.
    """
    present = set(outcomes)
    for outcome in (Outcome.ABORTED, Outcome.FAULT, Outcome.NOK, Outcome.OK, Outcome.RECORDED):
        if outcome in present:
            return outcome
    return Outcome.NOT_REQUESTED


_OF_STEERING = {QuantityState.NOK: Outcome.NOK, QuantityState.NOT_MEASURED: Outcome.FAULT}


def vehicle_outcome(
    wheels: Iterable[WheelAnswer], axles: Iterable[AxleAnswer], vehicle: VehicleAnswer | None
) -> Outcome:
    """Verdict of the whole vehicle: of its parts, its steering, and every run-out that has a limit."""
    wheels = tuple(wheels)
    parts = [wheel.outcome for wheel in wheels] + [axle.outcome for axle in axles]
    if vehicle is not None:
        states = [*(axis.state for axis in vehicle.steering.axes), vehicle.steering.wheel.state]
        parts += [vehicle.outcome, *(_OF_STEERING[state] for state in states if state in _OF_STEERING)]
    parts += [Outcome.NOK for wheel in wheels if wheel.run_out_state is QuantityState.NOK]
    return overall_outcome(parts)


@dataclass(frozen=True)
class LiveAngles:
    """Angles of one wheel while it is adjusted; degrees, None unless measured.

    `shot` counts the measurements of this wheel, 0 to 255 and again; `kind` is what the angles are those of.
    """

    wheel: str
    state: LiveState
    shot: int = 0
    camber_deg: float | None = None
    toe_deg: float | None = None
    kind: AxisKind = AxisKind.NONE


@dataclass(frozen=True)
class StationStatus:
    """What the measuring cycle says of itself; the line adds sequence, busy, done and the alive counter.

    `wheel` names the first wheel that the error code is about, where it is about one.

    Raises
    ------
    InputError
        When the state is fault and no error code says why.
    """

    state: StationState
    error_code: ErrorCode = ErrorCode.NONE
    wheel: str | None = None

    def __post_init__(self) -> None:
        if self.state == StationState.FAULT and self.error_code == ErrorCode.NONE:
            raise InputError(
                field="error_code", expected="the reason of the fault", seen=str(self.error_code)
            )
