"""The states of the measuring cycle, and which may follow which."""

from __future__ import annotations

import enum
from collections.abc import Callable

from alignment.errors import TruewheelError


class State(enum.StrEnum):
    """Where the station is in its cycle; the same names stand in the status message on the line."""

    IDLE = "idle"
    ARMED = "armed"
    MEASURING = "measuring"
    EVALUATING = "evaluating"
    STORING = "storing"
    REPORTING = "reporting"
    FAULT = "fault"


TRANSITIONS: dict[State, frozenset[State]] = {
    # A trigger arrived; a trigger that cannot be served is reported at once.
    State.IDLE: frozenset({State.ARMED, State.FAULT}),
    # Cameras took their settings; an abort or a camera that fails goes on to the record of it.
    State.ARMED: frozenset({State.MEASURING, State.EVALUATING, State.FAULT}),
    State.MEASURING: frozenset({State.EVALUATING, State.FAULT}),
    State.EVALUATING: frozenset({State.STORING, State.FAULT}),
    # The line is told only after the commit, or after the commit has failed.
    State.STORING: frozenset({State.REPORTING, State.FAULT}),
    State.REPORTING: frozenset({State.IDLE, State.FAULT}),
    # Only a reset leads out.
    State.FAULT: frozenset({State.IDLE}),
}


class IllegalTransitionError(TruewheelError, RuntimeError):
    """The cycle tried a step that the table does not hold: a mistake in the program."""


class StateMachine:
    """The current state; every change is checked against `TRANSITIONS` and told to the observer.

    Parameters
    ----------
    entered
        Called with each new state, after the change.
    """

    def __init__(self, entered: Callable[[State], None]) -> None:
        self._state = State.IDLE
        self._entered = entered

    @property
    def state(self) -> State:
        """The current state; IDLE at the start."""
        return self._state

    def enter(self, state: State) -> None:
        """Change to `state`.

        Raises
        ------
        IllegalTransitionError
            When `state` may not follow the current one; the current one stays.
        """
        if state not in TRANSITIONS[self._state]:
            allowed = ", ".join(sorted(TRANSITIONS[self._state]))
            raise IllegalTransitionError(
                f"the cycle is in state '{self._state}' and may enter {allowed}, not '{state}'"
            )
        self._state = state
        self._entered(state)
