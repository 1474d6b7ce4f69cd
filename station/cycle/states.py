"""The states of the measuring cycle, and which may follow which."""

from __future__ import annotations

from collections.abc import Callable

from alignment.errors import TruewheelError
from station.cycle.words import StationState

# Every state but FAULT may end in FAULT: by a failure of the station, or by a mistake in the program.
TRANSITIONS: dict[StationState, frozenset[StationState]] = {
    # Before there is a cycle the line says so; results of an earlier run may be held at once.
    StationState.STARTING: frozenset({StationState.IDLE, StationState.REPORTING, StationState.FAULT}),
    # A trigger arrived that can be served.
    StationState.IDLE: frozenset({StationState.ARMED, StationState.FAULT}),
    # Cameras took their settings; an abort or a camera that fails goes on to the record of it.
    StationState.ARMED: frozenset(
        {
            StationState.ADJUSTING,
            StationState.SWEEPING,
            StationState.MEASURING,
            StationState.EVALUATING,
            StationState.FAULT,
        }
    ),
    # Live angles go out until the operator is done; then everything is measured once more.
    StationState.ADJUSTING: frozenset({StationState.MEASURING, StationState.EVALUATING, StationState.FAULT}),
    # The steering is turned from position to position; straight ahead everything is measured once more.
    StationState.SWEEPING: frozenset({StationState.MEASURING, StationState.EVALUATING, StationState.FAULT}),
    StationState.MEASURING: frozenset({StationState.EVALUATING, StationState.FAULT}),
    StationState.EVALUATING: frozenset({StationState.STORING, StationState.FAULT}),
    # The line is told only after the commit, or after the commit has failed.
    StationState.STORING: frozenset({StationState.REPORTING, StationState.FAULT}),
    StationState.REPORTING: frozenset({StationState.IDLE, StationState.FAULT}),
    # Only a reset leads out.
    StationState.FAULT: frozenset({StationState.IDLE}),
}


class IllegalTransitionError(TruewheelError, RuntimeError):
    """The cycle tried a step that the table does not hold: a mistake in the program."""


class StateMachine:
    """The current state; every change is checked against `TRANSITIONS` and told to the observer.

    Parameters
    ----------
    entered
        Called with each new state, after the change.
    state
        The first state; REPORTING where results of an earlier run are still held.
    """

    def __init__(
        self, entered: Callable[[StationState], None], state: StationState = StationState.IDLE
    ) -> None:
        self._state = state
        self._entered = entered

    @property
    def state(self) -> StationState:
        """The current state."""
        return self._state

    def enter(self, state: StationState) -> None:
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
