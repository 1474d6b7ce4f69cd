"""The handshake's table, cell by cell, and what no sequence of commands and events may lead to."""

from __future__ import annotations

import itertools
from dataclasses import FrozenInstanceError, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from station.cycle.words.cycle import (
    Abort,
    Acknowledge,
    Command,
    ErrorCode,
    Mode,
    Prepare,
    Reset,
    Step,
    Stop,
    Trigger,
)
from station.line.handshake import BEGINS, COMMANDS, EVENTS, OPEN, Asked, Event, Handshake, Request
from station.line.wire.messages import Answer, CommandCode
from station.line.wire.messages import HandshakeState as State

OWN, OTHER = 5, 6
CODES = {
    Request.PREPARE: (CommandCode.PREPARE, OWN),
    Request.START_NEW: (CommandCode.START, OTHER),
    Request.START_SAME: (CommandCode.START, OWN),
    Request.STOP_SAME: (CommandCode.STOP, OWN),
    Request.STOP_OTHER: (CommandCode.STOP, OTHER),
    Request.ABORT_SAME: (CommandCode.ABORT, OWN),
    Request.ABORT_OTHER: (CommandCode.ABORT, OTHER),
    Request.ACKNOWLEDGE_SAME: (CommandCode.ACKNOWLEDGE, OWN),
    Request.ACKNOWLEDGE_OTHER: (CommandCode.ACKNOWLEDGE, OTHER),
    Request.RESET: (CommandCode.RESET, OTHER),
    Request.STEP_NEXT: (CommandCode.STEP, OWN),
    Request.STEP_TAKEN: (CommandCode.STEP, OWN),
    Request.STEP_OTHER: (CommandCode.STEP, OTHER),
}
STEPS = frozenset({Request.STEP_NEXT, Request.STEP_TAKEN, Request.STEP_OTHER})
TAKEN, NEXT = 2, 3
"""Of the sweep of `handshake_in`."""
TOLD = {
    CommandCode.PREPARE: Prepare,
    CommandCode.START: Trigger,
    CommandCode.STOP: Stop,
    CommandCode.ABORT: Abort,
    CommandCode.ACKNOWLEDGE: Acknowledge,
    CommandCode.RESET: Reset,
    CommandCode.STEP: Step,
}
NONE = Asked(CommandCode.NONE, 0)
START = Asked(CommandCode.START, OWN, ("front_left",), 7, Mode.AUTOMATIC, "VIN", 1.5)


def handshake_in(state: State, mode: Mode = Mode.AUTOMATIC) -> Handshake:
    """A handshake in this state, whose start in hand (or last) is OWN, by an ordinary way.

    In the mode sweep positions up to TAKEN were taken, and NEXT is the next one.
    """
    handshake = Handshake()
    if state is State.STARTING:
        return handshake
    handshake.happened(Event.CYCLE_READY)
    handshake.asked(NONE)
    modes = {State.ADJUSTING: Mode.ADJUST, State.SWEEPING: Mode.SWEEP, State.TURNING: Mode.SWEEP}
    mode = modes.get(state, mode)
    handshake.asked(replace(START, mode=mode))
    if mode is Mode.SWEEP:
        for position in range(1, NEXT):
            handshake.want(position)
            assert isinstance(handshake.asked(step_to(position)), Step)
        assert handshake.state is State.SWEEPING
        if state not in (State.SWEEPING, State.TURNING):
            handshake.happened(Event.SWEEP_OVER)
        elif state is State.TURNING:
            handshake.want(NEXT)
    ways: dict[State, list[Asked | Event]] = {
        State.BUSY: [],
        State.ADJUSTING: [],
        State.SWEEPING: [],
        State.TURNING: [],
        State.ENDING: [Asked(CommandCode.ABORT, OWN)],
        State.HELD: [Event.RESULTS_SENT],
        State.CLOSING: [Event.RESULTS_SENT, Asked(CommandCode.ACKNOWLEDGE, OWN)],
        State.FAULT: [Event.CYCLE_FAULT],
        State.RESETTING: [Asked(CommandCode.RESET, 4)],
    }
    ready = [Event.RESULTS_SENT, Asked(CommandCode.ACKNOWLEDGE, OWN), Event.CYCLE_READY]
    ways[State.READY] = [*ready]
    ways[State.PREPARED] = [*ready, Asked(CommandCode.PREPARE, 9)]
    for step in ways[state]:
        if isinstance(step, Event):
            handshake.happened(step)
        else:
            handshake.asked(step)
    handshake.asked(NONE)
    assert handshake.state is state
    return handshake


def step_to(position: int, sequence: int = OWN, angle_deg: float | None = 90.0) -> Asked:
    return Asked(CommandCode.STEP, sequence, position=position, angle_deg=angle_deg)


def test_table_names_every_state_and_every_command() -> None:
    assert set(COMMANDS) == set(State)
    assert all(set(rules) == set(Request) for rules in COMMANDS.values())
    assert set(EVENTS) == set(Event)


# Before the first start and after a reset there is no number that could be the same, and what is adjusted is
# not swept.
NEVER = {*itertools.product((State.STARTING, State.RESETTING), (Request.STEP_NEXT, Request.STEP_TAKEN))}
NEVER.add((State.ADJUSTING, Request.STEP_TAKEN))
CELLS = [
    (state, request)
    for state, request in itertools.product(State, Request)
    if (state not in (State.STARTING, State.RESETTING) or not request.value.endswith("same number"))
    and (state, request) not in NEVER
]


@pytest.mark.parametrize(("state", "request_"), CELLS)
def test_every_cell_of_the_table(state: State, request_: Request) -> None:
    swept = request_ in STEPS and state is not State.ADJUSTING
    handshake = handshake_in(state, Mode.SWEEP if swept else Mode.AUTOMATIC)
    sequence = handshake.sequence
    code, number = CODES[request_]
    asked = Asked(code, number, ("rear_left",), 3, Mode.AUTOMATIC, "VIN", 2.5)
    if request_ in STEPS:
        position = {Request.STEP_NEXT: NEXT if swept else 1, Request.STEP_TAKEN: TAKEN}.get(request_, NEXT)
        asked = replace(asked, position=position, angle_deg=-12.5)
    told = handshake.asked(asked)
    rule = COMMANDS[state][request_]
    assert handshake.state is (rule.target or state)
    assert handshake.reply.refusal is rule.refusal
    assert (handshake.reply.code, handshake.reply.sequence) == (code, number)
    accepted = rule.refusal is ErrorCode.NONE
    assert handshake.reply.answer is (Answer.ACCEPTED if accepted else Answer.REFUSED)
    if rule.deliver:
        assert isinstance(told, TOLD[code])
        assert told.sequence == number
        if code is CommandCode.STEP:
            assert told == Step(OWN, NEXT, -12.5)
    else:
        assert told is None
    moved = rule.target in (State.BUSY, State.RESETTING) and code in (CommandCode.START, CommandCode.RESET)
    assert handshake.sequence == (number if moved else sequence)
    assert handshake.ready == (handshake.state in (State.READY, State.PREPARED))
    assert handshake.busy == (handshake.state in OPEN)
    assert handshake.held == (handshake.state is State.HELD)
    assert handshake.awaits(OWN) == (
        (handshake.state in OPEN and number == OWN) or (state in OPEN and not moved)
    )


@pytest.mark.parametrize(("state", "event"), list(itertools.product(State, Event)))
def test_every_event_in_every_state(state: State, event: Event) -> None:
    handshake = handshake_in(state)
    if event is Event.RESULTS_SENT and state not in OPEN:
        with pytest.raises(ValueError, match="none are awaited"):
            handshake.happened(event)
        return
    told = handshake.happened(event)
    assert handshake.state is EVENTS[event].get(state, state)
    lost = event is Event.LINK_LOST and state in (State.ADJUSTING, State.SWEEPING, State.TURNING)
    assert told == (Abort(OWN, ErrorCode.COMMUNICATION_LOST) if lost else None)


# The table once more, by hand: what the program's own table must say. A word with ">" leads to a state and is
# told to the cycle, "-" is harmless, anything else is the error code; columns are in the order of `Request`.
EXPECTED = {
    State.STARTING: " ".join(["starting"] * 13),
    State.READY: ">prepared >busy sequence_used nothing_to_stop nothing_to_stop"
    " - wrong_sequence - wrong_sequence >resetting nothing_to_step nothing_to_step wrong_sequence",
    State.PREPARED: ">prepared >busy sequence_used >ready >ready >ready >ready - wrong_sequence >resetting"
    " nothing_to_step nothing_to_step wrong_sequence",
    State.BUSY: "busy busy - nothing_to_stop wrong_sequence >ending wrong_sequence"
    " nothing_to_acknowledge wrong_sequence >resetting nothing_to_step - wrong_sequence",
    State.ADJUSTING: "busy busy - >busy wrong_sequence >ending wrong_sequence"
    " nothing_to_acknowledge wrong_sequence >resetting nothing_to_step nothing_to_step wrong_sequence",
    State.SWEEPING: "busy busy - >busy wrong_sequence >ending wrong_sequence"
    " nothing_to_acknowledge wrong_sequence >resetting busy - wrong_sequence",
    State.TURNING: "busy busy - >busy wrong_sequence >ending wrong_sequence"
    " nothing_to_acknowledge wrong_sequence >resetting >sweeping - wrong_sequence",
    State.ENDING: "busy busy - nothing_to_stop wrong_sequence - wrong_sequence"
    " nothing_to_acknowledge wrong_sequence >resetting nothing_to_step - wrong_sequence",
    State.HELD: "not_acknowledged not_acknowledged - nothing_to_stop wrong_sequence"
    " - wrong_sequence >closing wrong_sequence >resetting nothing_to_step - wrong_sequence",
    State.CLOSING: "busy busy sequence_used nothing_to_stop wrong_sequence"
    " - wrong_sequence - wrong_sequence >resetting nothing_to_step - wrong_sequence",
    State.RESETTING: " ".join(["resetting"] * 9) + " >resetting" + " resetting" * 3,
    State.FAULT: "reset_required reset_required reset_required nothing_to_stop wrong_sequence"
    " - wrong_sequence - wrong_sequence >resetting nothing_to_step nothing_to_step wrong_sequence",
}


@pytest.mark.parametrize("state", State)
def test_table_is_what_was_decided(state: State) -> None:
    for word, (request, rule) in zip(EXPECTED[state].split(), COMMANDS[state].items(), strict=True):
        leads = State(word[1:]) if word.startswith(">") else None
        assert rule.target is leads, request
        assert rule.deliver is (leads is not None), request
        refused = word if leads is None and word != "-" else "none"
        assert rule.refusal == refused, request
        passes = {(State.STARTING, Request.RESET), (State.SWEEPING, Request.STEP_NEXT)}
        assert rule.again is ((state, request) in passes), request


def test_events_lead_where_it_was_decided() -> None:
    ready = {State.STARTING, State.CLOSING, State.RESETTING, State.FAULT}
    watched = {State.ADJUSTING, State.SWEEPING, State.TURNING}
    running = {State.BUSY, *watched, State.ENDING}
    assert {
        Event.CYCLE_READY: dict.fromkeys(ready, State.READY),
        Event.CYCLE_FAULT: dict.fromkeys(State, State.FAULT),
        Event.RESULTS_SENT: dict.fromkeys(running, State.HELD),
        Event.START_REFUSED: dict.fromkeys({State.PREPARED, *running}, State.READY),
        Event.RESULTS_RESTORED: {State.STARTING: State.HELD},
        Event.PREPARE_EXPIRED: {State.PREPARED: State.READY},
        Event.LINK_LOST: {State.PREPARED: State.READY, **dict.fromkeys(watched, State.ENDING)},
        Event.POSITION_WANTED: {State.SWEEPING: State.TURNING},
        Event.SWEEP_OVER: dict.fromkeys((State.SWEEPING, State.TURNING), State.BUSY),
    } == EVENTS
    assert running == OPEN
    assert {Mode.ADJUST: State.ADJUSTING, Mode.SWEEP: State.SWEEPING} == BEGINS


def test_refused_commands_and_repetitions_change_nothing() -> None:
    for state, rules in COMMANDS.items():
        for request, rule in rules.items():
            if rule.refusal is not ErrorCode.NONE:
                assert rule.target is None, (state, request)
                assert not rule.deliver
            if rule.target is None:
                assert not rule.deliver
            if rule.again:
                assert rule.refusal is not ErrorCode.NONE


def test_a_reset_leads_out_of_every_state_and_an_abort_out_of_every_cycle() -> None:
    for state in set(State) - {State.STARTING}:
        if state is not State.RESETTING:
            assert COMMANDS[state][Request.RESET].target is State.RESETTING
    for state in OPEN - {State.ENDING}:
        assert COMMANDS[state][Request.ABORT_SAME].target is State.ENDING


def test_results_are_only_held_after_a_start_or_a_restart() -> None:
    into_held = {
        (event, source) for event, ways in EVENTS.items() for source in ways if ways[source] is State.HELD
    }
    assert into_held == {(Event.RESULTS_SENT, state) for state in OPEN} | {
        (Event.RESULTS_RESTORED, State.STARTING)
    }
    assert not any(r.target is State.HELD for rules in COMMANDS.values() for r in rules.values())


def test_trigger_carries_what_was_asked() -> None:
    handshake = handshake_in(State.READY)
    told = handshake.asked(replace(START, sequence=8, mode=Mode.MASTER_CHECK))
    assert told == Trigger(8, ("front_left",), 7, "VIN", mode=Mode.MASTER_CHECK)
    assert isinstance(told, Trigger)
    assert told.received_s == 1.5
    handshake = handshake_in(State.READY)
    assert handshake.asked(Asked(CommandCode.PREPARE, 9, ("rear_left",), 3, Mode.ADJUST)) == Prepare(
        9, ("rear_left",), 3, Mode.ADJUST
    )


def test_adjusting_begins_with_a_start_and_ends_with_stop() -> None:
    handshake = handshake_in(State.READY)
    handshake.asked(Asked(CommandCode.PREPARE, 8, mode=Mode.ADJUST))
    assert handshake.state is State.PREPARED
    handshake.asked(replace(START, sequence=8, mode=Mode.ADJUST))
    assert handshake.state is State.ADJUSTING
    assert handshake.asked(Asked(CommandCode.STOP, 8)) == Stop(8)
    assert handshake.state is State.BUSY


def test_start_that_stood_there_before_is_not_carried_out() -> None:
    handshake = Handshake()
    handshake.happened(Event.CYCLE_READY)
    assert handshake.asked(START) is None
    assert handshake.reply.refusal is ErrorCode.START_STALE
    assert handshake.asked(START) is None
    assert handshake.state is State.READY
    assert isinstance(handshake.asked(replace(START, sequence=6)), Trigger)


def test_start_that_stands_when_the_communication_comes_back_is_not_carried_out() -> None:
    handshake = handshake_in(State.READY)
    handshake.happened(Event.LINK_LOST)
    assert handshake.asked(replace(START, sequence=9)) is None
    assert handshake.reply.refusal is ErrorCode.START_STALE
    handshake.asked(NONE)
    assert isinstance(handshake.asked(replace(START, sequence=9)), Trigger)


def test_stale_is_a_matter_of_starts_alone() -> None:
    handshake = Handshake()
    handshake.happened(Event.CYCLE_READY)
    assert isinstance(handshake.asked(Asked(CommandCode.PREPARE, 3)), Prepare)
    assert isinstance(handshake.asked(START), Trigger)


@pytest.mark.parametrize("code", [CommandCode.START, CommandCode.PREPARE])
def test_command_with_wrong_content_is_refused_with_its_reason(code: CommandCode) -> None:
    handshake = handshake_in(State.READY)
    asked = replace(START, code=code, sequence=8, trouble=ErrorCode.NO_WHEELS)
    assert handshake.asked(asked) is None
    assert handshake.reply.refusal is ErrorCode.NO_WHEELS
    assert handshake.state is State.READY
    assert handshake.asked(replace(asked, trouble=ErrorCode.NONE)) is None, "it stands, and stays refused"


def test_content_matters_only_where_the_command_would_be_accepted() -> None:
    handshake = handshake_in(State.BUSY)
    handshake.asked(replace(START, sequence=OTHER, trouble=ErrorCode.NO_WHEELS))
    assert handshake.reply.refusal is ErrorCode.BUSY


def test_start_waits_for_the_rest_of_its_vin() -> None:
    handshake = handshake_in(State.READY)
    asked = replace(START, sequence=8, trouble=ErrorCode.VIN_INCOMPLETE)
    assert handshake.asked(asked) is None
    assert handshake.reply.refusal is ErrorCode.VIN_INCOMPLETE
    assert isinstance(handshake.asked(replace(asked, trouble=ErrorCode.NONE)), Trigger)
    assert handshake.reply.refusal is ErrorCode.NONE


def test_reset_that_stands_while_the_station_starts_is_carried_out_then() -> None:
    handshake = Handshake()
    reset = Asked(CommandCode.RESET, 1)
    assert handshake.asked(reset) is None
    handshake.happened(Event.CYCLE_READY)
    assert handshake.asked(reset) == Reset(1)
    assert handshake.asked(reset) is None


def test_repetition_has_the_same_answer_whatever_happened_since() -> None:
    handshake = handshake_in(State.READY)
    start = replace(START, sequence=8)
    assert isinstance(handshake.asked(start), Trigger)
    for event in (Event.RESULTS_SENT, Event.CYCLE_FAULT):
        handshake.happened(event)
        assert handshake.asked(start) is None
        assert handshake.reply.answer is Answer.ACCEPTED


def test_cycle_that_declines_a_start_frees_its_number_and_answers_it() -> None:
    handshake = handshake_in(State.READY)
    start = replace(START, sequence=8)
    handshake.asked(start)
    handshake.refuse(8, ErrorCode.UNKNOWN_VEHICLE_TYPE)
    assert handshake.state is State.READY
    assert handshake.reply.refusal is ErrorCode.UNKNOWN_VEHICLE_TYPE
    assert not handshake.awaits(8)
    assert handshake.asked(start) is None
    handshake.asked(NONE)
    assert isinstance(handshake.asked(start), Trigger)


def test_late_refusal_does_not_answer_another_command() -> None:
    handshake = handshake_in(State.BUSY)
    handshake.asked(Asked(CommandCode.ABORT, OWN))
    handshake.refuse(OWN, ErrorCode.UNKNOWN_VEHICLE_TYPE)
    assert handshake.reply.code is CommandCode.ABORT
    assert handshake.reply.answer is Answer.ACCEPTED
    assert handshake.state is State.READY
    handshake = handshake_in(State.PREPARED)
    handshake.refuse(9, ErrorCode.UNKNOWN_VEHICLE_TYPE)
    assert handshake.state is State.READY
    assert handshake.asked(replace(START, sequence=OWN)) is None, (
        "the number of the start before is still used"
    )
    handshake = handshake_in(State.READY)
    handshake.asked(Asked(CommandCode.PREPARE, 9))
    handshake.asked(Asked(CommandCode.PREPARE, 10))
    handshake.refuse(9, ErrorCode.UNKNOWN_VEHICLE_TYPE)
    assert handshake.reply.answer is Answer.ACCEPTED


def test_preparation_that_the_cycle_declines_is_answered() -> None:
    handshake = handshake_in(State.READY)
    handshake.asked(Asked(CommandCode.PREPARE, 9))
    handshake.refuse(9, ErrorCode.WHEEL_NOT_AVAILABLE)
    assert (handshake.reply.code, handshake.reply.sequence) == (CommandCode.PREPARE, 9)
    assert handshake.reply.refusal is ErrorCode.WHEEL_NOT_AVAILABLE


def test_results_of_an_earlier_run_are_held_and_can_be_acknowledged() -> None:
    handshake = Handshake()
    handshake.restore(77)
    assert (handshake.state, handshake.sequence, handshake.held) == (State.HELD, 77, True)
    assert handshake.asked(Asked(CommandCode.ACKNOWLEDGE, 77)) == Acknowledge(77)


def test_number_of_a_start_that_was_reset_may_be_used_again() -> None:
    handshake = handshake_in(State.BUSY)
    handshake.asked(Asked(CommandCode.RESET, 9))
    handshake.happened(Event.CYCLE_READY)
    handshake.asked(NONE)
    assert isinstance(handshake.asked(START), Trigger)


def test_before_the_first_command_there_is_no_answer() -> None:
    reply = Handshake().reply
    assert reply.answer is Answer.NONE
    assert (reply.code, reply.sequence, reply.refusal) == (CommandCode.NONE, 0, ErrorCode.NONE)


COMMANDS_IN = st.builds(
    Asked,
    code=st.sampled_from(CommandCode),
    sequence=st.integers(1, 3),
    wheels=st.just(("front_left",)),
    mode=st.sampled_from(Mode),
    trouble=st.sampled_from(
        [ErrorCode.NONE, ErrorCode.VIN_INCOMPLETE, ErrorCode.NO_WHEELS, ErrorCode.STEP_INCOMPLETE]
    ),
    position=st.integers(0, 4),
)
WANTED = st.integers(1, 4)


@given(st.lists(COMMANDS_IN | st.sampled_from(Event) | WANTED, max_size=40))
def test_no_history_yields_two_triggers_without_an_end_between_or_results_without_a_start(
    history: list[Asked | Event | int],
) -> None:
    handshake = Handshake()
    open_start: int | None = None
    for step in history:
        if isinstance(step, int):
            handshake.want(step)
            told: Command | None = None
        elif isinstance(step, Event):
            if step is Event.RESULTS_SENT and not handshake.busy:
                continue
            handshake.happened(step)
            told = None
        else:
            told = handshake.asked(step)
        if isinstance(told, Trigger):
            assert open_start is None
            assert step.trouble is ErrorCode.NONE  # type: ignore[union-attr]
            open_start = told.sequence
        if not handshake.busy:
            open_start = None
        else:
            assert open_start is not None
            assert handshake.awaits(open_start)


def test_command_without_content_asks_for_nothing() -> None:
    asked = Asked(CommandCode.STOP, 1)
    assert (asked.wheels, asked.vehicle_type, asked.mode, asked.vin) == ((), 0, Mode.AUTOMATIC, "")
    assert (asked.received_s, asked.trouble) == (0.0, ErrorCode.NONE)


def test_start_in_hand_that_still_stands_when_the_communication_comes_back_is_harmless() -> None:
    handshake = handshake_in(State.BUSY)
    handshake.happened(Event.LINK_LOST)
    assert handshake.asked(START) is None
    assert handshake.reply.answer is Answer.ACCEPTED
    assert handshake.state is State.BUSY


def test_content_of_a_command_that_has_none_does_not_matter() -> None:
    handshake = handshake_in(State.BUSY)
    told = handshake.asked(Asked(CommandCode.ABORT, OWN, trouble=ErrorCode.VIN_INCOMPLETE))
    assert told == Abort(OWN)


@pytest.mark.parametrize("value", [COMMANDS[State.READY][Request.RESET], START, Handshake().reply])
def test_rules_commands_and_replies_cannot_be_changed(value: object) -> None:
    with pytest.raises(FrozenInstanceError):
        value.refusal = value.trouble = ErrorCode.BUSY  # type: ignore[attr-defined]


def test_a_station_that_was_just_started_has_the_number_of_no_vehicle() -> None:
    handshake = Handshake()
    assert handshake.state is State.STARTING
    assert handshake.sequence == 0
    assert handshake.reply.answer is Answer.NONE


def test_the_same_command_heard_again_later_is_the_same_command() -> None:
    assert replace(START, received_s=2.5) == START
    assert replace(START, sequence=OTHER) != START


@pytest.mark.parametrize("request_", list(Request))
@pytest.mark.parametrize("state", list(State))
def test_of_a_controller_of_another_interface_nothing_is_taken_in_any_state(
    state: State, request_: Request
) -> None:
    """A start of interface 2 was measured; its acknowledgement would end results that it cannot read."""
    handshake = handshake_in(state)
    sequence = handshake.sequence
    code, number = CODES[request_]
    assert handshake.asked(NONE) is None
    asked = replace(START, code=code, sequence=number, trouble=ErrorCode.WRONG_INTERFACE)
    assert handshake.asked(asked) is None
    assert (handshake.state, handshake.sequence) == (state, sequence)
    assert (handshake.reply.answer, handshake.reply.refusal) == (Answer.REFUSED, ErrorCode.WRONG_INTERFACE)


@given(st.lists(COMMANDS_IN | st.sampled_from(Event) | WANTED, max_size=60))
def test_a_step_is_told_once_for_each_position_that_was_wanted_and_only_of_the_start_in_hand(
    history: list[Asked | Event | int],
) -> None:
    handshake = Handshake()
    owed: int | None = None
    for step in history:
        told: Command | None = None
        if isinstance(step, int):
            before = handshake.state
            handshake.want(step)
            owed = step if before in (State.SWEEPING, State.TURNING) else None
        elif isinstance(step, Event):
            if step is not Event.RESULTS_SENT or handshake.busy:
                handshake.happened(step)
        else:
            told = handshake.asked(step)
        if isinstance(told, Step):
            assert told.position == owed
            assert handshake.awaits(told.sequence)
            assert handshake.state is State.SWEEPING
            owed = None


def test_a_sweep_goes_from_position_to_position_until_it_is_over() -> None:
    handshake = handshake_in(State.READY)
    assert isinstance(handshake.asked(replace(START, sequence=8, mode=Mode.SWEEP)), Trigger)
    assert handshake.state is State.SWEEPING
    for position in (1, 2, 3):
        handshake.want(position)
        assert handshake.state is State.TURNING
        assert handshake.asked(step_to(position, 8)) == Step(8, position, 90.0)
        assert handshake.state is State.SWEEPING
        assert handshake.reply.answer is Answer.ACCEPTED
    handshake.happened(Event.SWEEP_OVER)
    assert handshake.state is State.BUSY
    assert handshake.awaits(8)


def test_the_next_step_counts_though_no_frame_between_was_heard() -> None:
    """All steps of a sweep have one number: the second one would be taken for the first, repeated."""
    handshake = handshake_in(State.TURNING)
    assert handshake.asked(step_to(NEXT)) == Step(OWN, NEXT, 90.0)
    assert handshake.asked(step_to(NEXT)) is None
    handshake.want(NEXT + 1)
    assert handshake.asked(step_to(NEXT)) is None
    assert handshake.state is State.TURNING
    assert handshake.asked(step_to(NEXT + 1)) == Step(OWN, NEXT + 1, 90.0)


def test_a_step_that_comes_while_images_are_taken_stands_until_they_are() -> None:
    handshake = handshake_in(State.SWEEPING)
    assert handshake.asked(step_to(NEXT)) is None
    assert handshake.reply.refusal is ErrorCode.BUSY
    handshake.want(NEXT)
    assert handshake.asked(step_to(NEXT)) == Step(OWN, NEXT, 90.0)


@pytest.mark.parametrize("position", [0, NEXT + 1, 255])
@pytest.mark.parametrize("state", [State.TURNING, State.SWEEPING, State.BUSY])
def test_a_step_to_a_position_that_nobody_wants_is_refused(state: State, position: int) -> None:
    handshake = handshake_in(state, Mode.SWEEP)
    assert handshake.asked(step_to(position)) is None
    assert handshake.reply.refusal is ErrorCode.WRONG_SEQUENCE
    assert handshake.state is state


def test_a_step_waits_for_the_frame_that_says_its_position() -> None:
    handshake = handshake_in(State.TURNING)
    asked = Asked(CommandCode.STEP, OWN, trouble=ErrorCode.STEP_INCOMPLETE)
    assert handshake.asked(asked) is None
    assert handshake.reply.refusal is ErrorCode.STEP_INCOMPLETE
    assert handshake.state is State.TURNING
    assert handshake.asked(step_to(NEXT)) == Step(OWN, NEXT, 90.0)


@pytest.mark.parametrize("state", sorted({*State} - {State.TURNING, State.STARTING, State.RESETTING}))
def test_what_a_step_lacks_does_not_matter_where_none_is_awaited(state: State) -> None:
    handshake = handshake_in(state, Mode.SWEEP)
    assert handshake.asked(Asked(CommandCode.STEP, OWN, trouble=ErrorCode.STEP_INCOMPLETE)) is None
    assert handshake.reply.refusal is ErrorCode.WRONG_SEQUENCE
    assert handshake.state is state


def test_a_position_that_is_wanted_again_is_taken_again() -> None:
    handshake = handshake_in(State.SWEEPING)
    handshake.want(TAKEN)
    handshake.asked(NONE)
    assert handshake.asked(step_to(TAKEN)) == Step(OWN, TAKEN, 90.0)


def test_a_new_sweep_begins_with_its_first_position() -> None:
    handshake = handshake_in(State.READY, Mode.SWEEP)
    handshake.asked(replace(START, sequence=8, mode=Mode.SWEEP))
    handshake.asked(NONE)
    assert handshake.asked(step_to(NEXT, 8)) is None
    assert handshake.reply.refusal is ErrorCode.WRONG_SEQUENCE
    handshake.want(1)
    handshake.asked(NONE)
    assert handshake.asked(step_to(1, 8)) == Step(8, 1, 90.0)


@pytest.mark.parametrize("state", [State.SWEEPING, State.TURNING])
def test_a_position_that_comes_too_late_awaits_nothing(state: State) -> None:
    for code, ended in ((CommandCode.ABORT, State.ENDING), (CommandCode.STOP, State.BUSY)):
        handshake = handshake_in(state)
        handshake.asked(Asked(code, OWN))
        assert handshake.state is ended
        handshake.want(NEXT)
        assert handshake.state is ended
        assert handshake.asked(step_to(NEXT)) is None
        assert handshake.reply.refusal is ErrorCode.NOTHING_TO_STEP


def test_a_step_that_was_refused_stays_refused_while_it_stands() -> None:
    handshake = handshake_in(State.TURNING)
    ahead = step_to(NEXT + 1)
    assert handshake.asked(ahead) is None
    handshake.want(NEXT + 1)
    assert handshake.asked(ahead) is None
    assert handshake.reply.refusal is ErrorCode.WRONG_SEQUENCE
    handshake.asked(NONE)
    assert handshake.asked(ahead) == Step(OWN, NEXT + 1, 90.0)


def test_a_step_without_content_means_no_position_and_no_angle() -> None:
    asked = Asked(CommandCode.STEP, 1)
    assert (asked.position, asked.angle_deg) == (0, None)
