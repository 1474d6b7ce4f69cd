"""What is said of a vehicle's steering: how a sweep goes, and what was found of axes, wheel and heights.

Angles are in degrees and lengths in millimetres, as a controller reads them. Signs are the product's: caster
positive when the top leans rearward, kingpin inclination positive when the top leans inboard, a steering
wheel's angle positive when it is turned to the left.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

from alignment.errors import InputError
from station.cycle.words.geometry import QuantityAnswer, QuantityState

AXIS_LENGTHS = ("trail", "scrub")
AXIS_QUANTITIES = ("caster", "kpi", "included_angle", "toe_out", *AXIS_LENGTHS)
"""What a sweep tells of each steered wheel; named ``front_left.caster``."""
AXIS_DIFFERENCES = ("caster_difference", "kpi_difference")
"""Left less right."""


class SweepState(enum.StrEnum):
    """Where a sweep stands; the words of the DBC's value table.

    TURN: the steering wheel is to be turned to the wanted angle, and a step is awaited. HOLD: images are
    taken, and nothing is to be moved. DONE: all positions were taken. FAILED: it ended without results.
    """

    NONE = "none"
    TURN = "turn"
    HOLD = "hold"
    DONE = "done"
    FAILED = "failed"


@dataclass(frozen=True)
class SweepProgress:
    """How a sweep goes.

    Attributes
    ----------
    state
        What is to be done.
    position
        The position that is wanted or being taken, from 1; 0 before the first.
    positions
        How many there are.
    wanted_deg
        The steering wheel's angle at this position; None where none is wanted any more.

    Raises
    ------
    InputError
        When an angle is wanted of a finished sweep, or none of one that goes on; for a position beyond.
    """

    state: SweepState = SweepState.NONE
    position: int = 0
    positions: int = 0
    wanted_deg: float | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.position <= self.positions <= 255:
            seen = f"{self.position} of {self.positions}"
            raise InputError(field="position", expected="one of at most 255 positions", seen=seen)
        goes_on = self.state in (SweepState.TURN, SweepState.HOLD)
        known = self.wanted_deg is not None and math.isfinite(self.wanted_deg)
        if goes_on != known or (goes_on and self.position == 0):
            raise InputError(
                field="wanted_deg",
                expected="an angle and a position" if goes_on else f"none, because the sweep is {self.state}",
                seen=f"{self.wanted_deg} at position {self.position}",
            )


NO_SWEEP = SweepProgress()


@dataclass(frozen=True)
class Step:
    """The steering was turned to a position of the sweep.

    Attributes
    ----------
    sequence
        Number of the start.
    position
        Which one, from 1.
    angle_deg
        The steering wheel's angle that was reached, as the controller or the operator says; None where nobody
        knows.
    """

    sequence: int
    position: int
    angle_deg: float | None = None

    def __str__(self) -> str:
        angle = "" if self.angle_deg is None else f" at {self.angle_deg:g}°"
        return f"step {self.sequence} to position {self.position}{angle}"


class StraightAhead(enum.StrEnum):
    """Whether front toe was judged at straight ahead; the words of the DBC's value table.

    CHECKED: by a fresh angle of the steering wheel. NOT_CHECKED: there was none. NONE: nothing was measured.
    """

    NONE = "none"
    CHECKED = "checked"
    NOT_CHECKED = "not_checked"


@dataclass(frozen=True)
class SteeringWheelAnswer:
    """The steering wheel of a measured vehicle.

    Attributes
    ----------
    straight_ahead
        Whether straight ahead was checked.
    state, offset_deg
        Verdict on the offset of the steering wheel at straight ahead, and the offset.
    used_deg
        The angle that front toe was corrected by; None where there was none.

    Raises
    ------
    InputError
        When they contradict each other: an offset or an angle belongs to a straight ahead that was checked.
    """

    straight_ahead: StraightAhead = StraightAhead.NONE
    state: QuantityState = QuantityState.NONE
    offset_deg: float | None = None
    used_deg: float | None = None

    def __post_init__(self) -> None:
        checked = self.straight_ahead is StraightAhead.CHECKED
        if checked != (self.used_deg is not None and math.isfinite(self.used_deg)):
            raise InputError(
                field="used_deg",
                expected="an angle" if checked else f"none, because straight ahead is {self.straight_ahead}",
                seen=str(self.used_deg),
            )
        known = self.offset_deg is not None and math.isfinite(self.offset_deg)
        if self.state.measured != known or (known and not checked):
            raise InputError(
                field="offset_deg",
                expected=f"what belongs to '{self.state}' at a straight ahead that is {self.straight_ahead}",
                seen=str(self.offset_deg),
            )


class HeightState(enum.StrEnum):
    """What became of a ride height; the words of the DBC's value table.

    USED: angles were brought to the design height by it. MISSING: it was not told, or too long ago. ABSURD:
    it cannot be, or lies farther from the design height than the vehicle type lets one correct. NONE: not
    asked for.
    """

    NONE = "none"
    USED = "used"
    MISSING = "missing"
    ABSURD = "absurd"


class AngleCorrection(enum.StrEnum):
    """For what a wheel's angles were corrected; the words of the DBC's value table."""

    NONE = "none"
    STEERING = "steering"
    RIDE_HEIGHT = "ride_height"
    BOTH = "both"


@dataclass(frozen=True)
class CornerAnswer:
    """One corner as it stood: its ride height, and its angles before they were corrected.

    Attributes
    ----------
    wheel
        Such as ``front_left``.
    height, height_mm
        What became of its ride height, and the height that was used; None of one that was not.
    correction
        For what its angles were corrected.
    raw_camber_deg, raw_toe_deg
        As measured; None where nothing was corrected.

    Raises
    ------
    InputError
        When state and value contradict each other.
    """

    wheel: str
    height: HeightState = HeightState.NONE
    height_mm: float | None = None
    correction: AngleCorrection = AngleCorrection.NONE
    raw_camber_deg: float | None = None
    raw_toe_deg: float | None = None

    def __post_init__(self) -> None:
        self._require("height_mm", self.height_mm, self.height is HeightState.USED)
        corrected = self.correction is not AngleCorrection.NONE
        self._require("raw_camber_deg", self.raw_camber_deg, corrected)
        self._require("raw_toe_deg", self.raw_toe_deg, corrected)

    def _require(self, name: str, value: float | None, wanted: bool) -> None:
        if wanted != (value is not None and math.isfinite(value)):
            raise InputError(
                field=f"{self.wheel}.{name}",
                expected="a finite number" if wanted else "no number",
                seen=str(value),
            )


@dataclass(frozen=True)
class SteeringAnswer:
    """All that is answered of the steering; what is not named was not asked for.

    Attributes
    ----------
    axes
        Quantities of the steering axes, such as ``front_left.caster`` and ``caster_difference``; each at most
        once.
    wheel
        The steering wheel.
    corners
        Of the wheels that ride heights or corrections are told of; each at most once.

    Raises
    ------
    InputError
        For an unknown quantity, or one twice.
    """

    axes: tuple[QuantityAnswer, ...] = ()
    wheel: SteeringWheelAnswer = SteeringWheelAnswer()
    corners: tuple[CornerAnswer, ...] = ()

    def __post_init__(self) -> None:
        _require_once("corners", [corner.wheel for corner in self.corners])
        names = [quantity.name for quantity in self.axes]
        _require_once("axes", names)
        known = {*AXIS_QUANTITIES, *AXIS_DIFFERENCES}
        if unknown := [name for name in names if name.rpartition(".")[2] not in known]:
            raise InputError(
                field="axes", expected=f"quantities of {', '.join(sorted(known))}", seen=", ".join(unknown)
            )

    def of(self, name: str) -> QuantityAnswer:
        """One quantity of the axes."""
        found = (quantity for quantity in self.axes if quantity.name == name)
        return next(found, QuantityAnswer(name, QuantityState.NONE))

    def corner(self, wheel: str) -> CornerAnswer:
        """One corner."""
        return next((corner for corner in self.corners if corner.wheel == wheel), CornerAnswer(wheel))

    @property
    def missed(self) -> tuple[str, ...]:
        """What is out of its limits, or was asked for and not measured."""
        bad = (QuantityState.NOK, QuantityState.NOT_MEASURED)
        names = [quantity.name for quantity in self.axes if quantity.state in bad]
        return (*names, *(["steering_wheel"] if self.wheel.state in bad else []))

    def withdrawn(self) -> SteeringAnswer:
        """Return what is told of a vehicle whose record does not count: nothing was measured."""
        asked = (quantity for quantity in self.axes if quantity.state is not QuantityState.NONE)
        lost = tuple(QuantityAnswer(quantity.name, QuantityState.NOT_MEASURED) for quantity in asked)
        state = QuantityState.NONE
        if self.wheel.state is not QuantityState.NONE:
            state = QuantityState.NOT_MEASURED
        wheel = SteeringWheelAnswer(StraightAhead.NONE, state)
        corners = tuple(replace(CornerAnswer(corner.wheel), height=_lost(corner)) for corner in self.corners)
        return SteeringAnswer(lost, wheel, corners)


def _lost(corner: CornerAnswer) -> HeightState:
    return HeightState.MISSING if corner.height is HeightState.USED else corner.height


def _require_once(field: str, names: Iterable[str]) -> None:
    names = list(names)
    if len(set(names)) != len(names):
        raise InputError(field=field, expected="each at most once", seen=", ".join(names))


NO_STEERING = SteeringAnswer()
