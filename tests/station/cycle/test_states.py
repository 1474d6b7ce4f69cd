import itertools

import pytest

from station.cycle.states import TRANSITIONS, IllegalTransitionError, StateMachine
from station.cycle.words.cycle import StationState as State

PATHS: dict[State, list[State]] = {
    State.STARTING: [],
    State.IDLE: [],
    State.ARMED: [State.ARMED],
    State.ADJUSTING: [State.ARMED, State.ADJUSTING],
    State.SWEEPING: [State.ARMED, State.SWEEPING],
    State.MEASURING: [State.ARMED, State.MEASURING],
    State.EVALUATING: [State.ARMED, State.EVALUATING],
    State.STORING: [State.ARMED, State.EVALUATING, State.STORING],
    State.REPORTING: [State.ARMED, State.EVALUATING, State.STORING, State.REPORTING],
    State.FAULT: [State.FAULT],
}


def machine_in(state: State) -> tuple[StateMachine, list[State]]:
    seen: list[State] = []
    machine = StateMachine(seen.append, State.STARTING if state is State.STARTING else State.IDLE)
    for step in PATHS[state]:
        machine.enter(step)
    return machine, seen


def test_every_state_has_its_row() -> None:
    assert set(TRANSITIONS) == set(State)


@pytest.mark.parametrize(("source", "target"), list(itertools.product(State, State)))
def test_only_the_steps_of_the_table_are_possible(source: State, target: State) -> None:
    machine, seen = machine_in(source)
    told = list(seen)
    if target in TRANSITIONS[source]:
        machine.enter(target)
        assert machine.state is target
        assert seen == [*told, target]
    else:
        with pytest.raises(IllegalTransitionError, match=f"in state '{source}'"):
            machine.enter(target)
        assert machine.state is source
        assert seen == told


def test_results_are_never_reported_without_passing_the_store() -> None:
    assert {state for state, targets in TRANSITIONS.items() if State.REPORTING in targets} == {
        State.STORING,
        # Those of an earlier run, which are in the database.
        State.STARTING,
    }


def test_every_state_is_entered_from_where_it_should_be() -> None:
    """The table itself, said once more from the other side: ready never comes before the answer."""
    sources = {
        target: {str(source) for source, targets in TRANSITIONS.items() if target in targets} - {"starting"}
        for target in (
            State.IDLE,
            State.ARMED,
            State.ADJUSTING,
            State.SWEEPING,
            State.MEASURING,
            State.EVALUATING,
            State.STORING,
            State.REPORTING,
        )
    }
    assert sources == {
        State.IDLE: {"reporting", "fault"},
        State.ARMED: {"idle"},
        State.ADJUSTING: {"armed"},
        State.SWEEPING: {"armed"},
        State.MEASURING: {"armed", "adjusting", "sweeping"},
        State.EVALUATING: {"armed", "adjusting", "sweeping", "measuring"},
        State.STORING: {"evaluating"},
        State.REPORTING: {"storing"},
    }
