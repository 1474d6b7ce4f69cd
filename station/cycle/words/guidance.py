"""What is told of the guidance of one wheel while it is adjusted, as a controller or a nutrunner reads it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

from alignment.errors import InputError
from station.guidance import AdjusterKind, GuidanceState, OutOfReach, TurnDirection


@dataclass(frozen=True)
class Guidance:
    """What to do at one wheel now; angles in degrees, signs of the product.

    Attributes
    ----------
    wheel
        Its name, such as ``front_left``.
    state
        Where its adjusting stands.
    shot
        That of the live angles that it follows from, 0 to 255 and again.
    adjuster
        What is turned, held or locked; NONE where nothing is.
    turns_to_go
        Positive lengthens a tie rod, or moves the top of the wheel out by a camber bolt; None unless the
        state is TURN or HOLD.
    target_camber_deg, target_toe_deg
        Where the angles should be before the nut is locked: the middle of the limits less what locking
        usually adds. None where there is none.
    drift_deg
        What locking usually adds to the angle that this adjuster sets, and the target leaves room for; None
        where nothing is turned.
    reason
        Why it cannot be reached; only in the state UNREACHABLE.

    Raises
    ------
    InputError
        When the values contradict the state.
    """

    wheel: str
    state: GuidanceState
    shot: int = 0
    adjuster: AdjusterKind = AdjusterKind.NONE
    turns_to_go: float | None = None
    target_camber_deg: float | None = None
    target_toe_deg: float | None = None
    drift_deg: float | None = None
    reason: OutOfReach = OutOfReach.NONE

    def __post_init__(self) -> None:
        turning = self.state in (GuidanceState.TURN, GuidanceState.HOLD)
        if turning != (self.turns_to_go is not None):
            raise self._wrong("turns_to_go", "a number" if turning else "no number", self.turns_to_go)
        numbers = {
            "turns_to_go": self.turns_to_go,
            "target_camber_deg": self.target_camber_deg,
            "target_toe_deg": self.target_toe_deg,
            "drift_deg": self.drift_deg,
        }
        for name, value in numbers.items():
            if value is not None and not math.isfinite(value):
                raise self._wrong(name, "a finite number", value)
        if turning and self.adjuster is AdjusterKind.NONE:
            raise self._wrong("adjuster", "what is turned", self.adjuster)
        if (self.state is GuidanceState.UNREACHABLE) != (self.reason is not OutOfReach.NONE):
            raise self._wrong("reason", "one where it cannot be reached, else none", self.reason)

    def _wrong(self, name: str, expected: str, seen: object) -> InputError:
        return InputError(
            field=f"{self.wheel}.{name}",
            expected=f"{expected}, because the state is '{self.state}'",
            seen=str(seen),
        )

    @property
    def direction(self) -> TurnDirection:
        """Which way to turn; NONE where nothing is to be turned."""
        if self.state is not GuidanceState.TURN or self.turns_to_go is None:
            return TurnDirection.NONE
        return TurnDirection.of(self.adjuster, self.turns_to_go)

    @property
    def done(self) -> bool:
        """Whether this wheel needs nothing more: measured inside its limits, with the nut locked."""
        return self.state is GuidanceState.DONE


class GuidanceLine(Protocol):
    """What guidance needs of the line."""

    def publish_guidance(self, guidance: Guidance, measured_s: float) -> None:
        """Show what to do at a wheel, of images taken at this time of the clock; beside its live angles."""
        ...
