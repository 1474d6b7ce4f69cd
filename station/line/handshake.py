"""The handshake of controller and station: one table says what every command does in every state.

Nothing here knows a bus, a thread or a clock. `Handshake` is asked with each command that arrives and told
of each event on the station's side; it answers, changes its state by the table, and hands over what the
measuring cycle must learn. The documents draw the table (`station.line.tools.document`).

A command is answered once: the same command with the same number is a repetition and gets the same answer.
Only a refusal that passes by itself (`Rule.again`) is looked at again while the command stands.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, field

from station.cycle import (
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
from station.line.wire import Answer, CommandCode, HandshakeState


class Request(enum.StrEnum):
    """A command as the table sees it: "same" is the number of the start in hand, or else of the last one.

    A step has that number too, and its position is the next one, one that was taken before, or neither.
    """

    PREPARE = "prepare"
    START_NEW = "start, new number"
    START_SAME = "start, same number"
    STOP_SAME = "stop, same number"
    STOP_OTHER = "stop, other number"
    ABORT_SAME = "abort, same number"
    ABORT_OTHER = "abort, other number"
    ACKNOWLEDGE_SAME = "acknowledge, same number"
    ACKNOWLEDGE_OTHER = "acknowledge, other number"
    RESET = "reset"
    STEP_NEXT = "step, next position"
    STEP_TAKEN = "step, position taken before"
    STEP_OTHER = "step, other number or position"


class Event(enum.StrEnum):
    """What happens to the handshake without a command."""

    CYCLE_READY = "cycle is idle"
    CYCLE_FAULT = "cycle is at fault"
    RESULTS_SENT = "results sent"
    START_REFUSED = "cycle refuses"
    RESULTS_RESTORED = "held results found after a restart"
    PREPARE_EXPIRED = "prepare too old"
    LINK_LOST = "communication lost"
    POSITION_WANTED = "a position of the sweep is wanted"
    SWEEP_OVER = "sweep is over"


@dataclass(frozen=True)
class Rule:
    """What a command does in a state.

    Attributes
    ----------
    target
        The state it leads to; None stays.
    refusal
        Why it is refused; NONE when it is accepted.
    deliver
        Whether the measuring cycle is told.
    again
        Whether a refused command is looked at again as long as it stands.
    """

    target: HandshakeState | None = None
    refusal: ErrorCode = ErrorCode.NONE
    deliver: bool = False
    again: bool = False


def _to(state: HandshakeState) -> Rule:
    return Rule(state, deliver=True)


def _no(refusal: ErrorCode, again: bool = False) -> Rule:
    return Rule(refusal=refusal, again=again)


S, E = HandshakeState, ErrorCode
_HARMLESS = Rule()
_WRONG = _no(E.WRONG_SEQUENCE)
_NO_STOP = _no(E.NOTHING_TO_STOP)
_NO_RESULTS = _no(E.NOTHING_TO_ACKNOWLEDGE)
_NO_STEP = _no(E.NOTHING_TO_STEP)
_BUSY = _no(E.BUSY)
_RESET = _to(S.RESETTING)
_STARTING, _RESETTING = _no(E.STARTING), _no(E.RESETTING)
_STEPPED = (_NO_STEP, _HARMLESS, _WRONG)


def _row(
    prepare: Rule,
    start: tuple[Rule, Rule],
    stop: tuple[Rule, Rule],
    abort: tuple[Rule, Rule],
    acknowledge: tuple[Rule, Rule],
    reset: Rule = _RESET,
    step: tuple[Rule, Rule, Rule] = (_NO_STEP, _NO_STEP, _WRONG),
) -> dict[Request, Rule]:
    """Rules of a state: of a start with new and same number; of the others with same and other number.

    Of a step to the next position, to one that was taken before, and to any other.
    """
    rules = (prepare, *start, *stop, *abort, *acknowledge, reset, *step)
    return dict(zip(Request, rules, strict=True))


COMMANDS: dict[HandshakeState, dict[Request, Rule]] = {
    S.STARTING: _row(
        prepare=_STARTING,
        start=(_STARTING, _STARTING),
        stop=(_STARTING, _STARTING),
        abort=(_STARTING, _STARTING),
        acknowledge=(_STARTING, _STARTING),
        reset=_no(E.STARTING, again=True),
        step=(_STARTING, _STARTING, _STARTING),
    ),
    S.READY: _row(
        prepare=_to(S.PREPARED),
        start=(_to(S.BUSY), _no(E.SEQUENCE_USED)),
        stop=(_NO_STOP, _NO_STOP),
        abort=(_HARMLESS, _WRONG),
        acknowledge=(_HARMLESS, _WRONG),
    ),
    S.PREPARED: _row(
        prepare=_to(S.PREPARED),
        start=(_to(S.BUSY), _no(E.SEQUENCE_USED)),
        stop=(_to(S.READY), _to(S.READY)),
        abort=(_to(S.READY), _to(S.READY)),
        acknowledge=(_HARMLESS, _WRONG),
    ),
    S.BUSY: _row(
        prepare=_BUSY,
        start=(_BUSY, _HARMLESS),
        stop=(_NO_STOP, _WRONG),
        abort=(_to(S.ENDING), _WRONG),
        acknowledge=(_NO_RESULTS, _WRONG),
        step=_STEPPED,
    ),
    S.ADJUSTING: _row(
        prepare=_BUSY,
        start=(_BUSY, _HARMLESS),
        stop=(_to(S.BUSY), _WRONG),
        abort=(_to(S.ENDING), _WRONG),
        acknowledge=(_NO_RESULTS, _WRONG),
    ),
    S.SWEEPING: _row(
        prepare=_BUSY,
        start=(_BUSY, _HARMLESS),
        stop=(_to(S.BUSY), _WRONG),
        abort=(_to(S.ENDING), _WRONG),
        acknowledge=(_NO_RESULTS, _WRONG),
        # Images of the position before are still taken.
        step=(_no(E.BUSY, again=True), _HARMLESS, _WRONG),
    ),
    S.TURNING: _row(
        prepare=_BUSY,
        start=(_BUSY, _HARMLESS),
        stop=(_to(S.BUSY), _WRONG),
        abort=(_to(S.ENDING), _WRONG),
        acknowledge=(_NO_RESULTS, _WRONG),
        step=(_to(S.SWEEPING), _HARMLESS, _WRONG),
    ),
    S.ENDING: _row(
        prepare=_BUSY,
        start=(_BUSY, _HARMLESS),
        stop=(_NO_STOP, _WRONG),
        abort=(_HARMLESS, _WRONG),
        acknowledge=(_NO_RESULTS, _WRONG),
        step=_STEPPED,
    ),
    S.HELD: _row(
        prepare=_no(E.NOT_ACKNOWLEDGED),
        start=(_no(E.NOT_ACKNOWLEDGED), _HARMLESS),
        stop=(_NO_STOP, _WRONG),
        abort=(_HARMLESS, _WRONG),
        acknowledge=(_to(S.CLOSING), _WRONG),
        step=_STEPPED,
    ),
    S.CLOSING: _row(
        prepare=_BUSY,
        start=(_BUSY, _no(E.SEQUENCE_USED)),
        stop=(_NO_STOP, _WRONG),
        abort=(_HARMLESS, _WRONG),
        acknowledge=(_HARMLESS, _WRONG),
        step=_STEPPED,
    ),
    S.RESETTING: _row(
        prepare=_RESETTING,
        start=(_RESETTING, _RESETTING),
        stop=(_RESETTING, _RESETTING),
        abort=(_RESETTING, _RESETTING),
        acknowledge=(_RESETTING, _RESETTING),
        step=(_RESETTING, _RESETTING, _RESETTING),
    ),
    S.FAULT: _row(
        prepare=_no(E.RESET_REQUIRED),
        start=(_no(E.RESET_REQUIRED), _no(E.RESET_REQUIRED)),
        stop=(_NO_STOP, _WRONG),
        abort=(_HARMLESS, _WRONG),
        acknowledge=(_HARMLESS, _WRONG),
    ),
}
"""What every command does in every state. A start leads to what `BEGINS` says of its mode, if anything."""

BEGINS = {Mode.ADJUST: S.ADJUSTING, Mode.SWEEP: S.SWEEPING}
"""Where a start of these modes leads instead of BUSY."""

_WATCHED = (S.ADJUSTING, S.SWEEPING, S.TURNING)
_OPEN = (S.BUSY, *_WATCHED, S.ENDING)
EVENTS: dict[Event, dict[HandshakeState, HandshakeState]] = {
    Event.CYCLE_READY: {
        S.STARTING: S.READY,
        S.CLOSING: S.READY,
        S.RESETTING: S.READY,
        S.FAULT: S.READY,
    },
    Event.CYCLE_FAULT: dict.fromkeys(S, S.FAULT),
    Event.RESULTS_SENT: dict.fromkeys(_OPEN, S.HELD),
    Event.START_REFUSED: dict.fromkeys((S.PREPARED, *_OPEN), S.READY),
    Event.RESULTS_RESTORED: {S.STARTING: S.HELD},
    Event.PREPARE_EXPIRED: {S.PREPARED: S.READY},
    # A cycle that runs is finished and its results are held; only what needs the controller's eyes ends.
    Event.LINK_LOST: {S.PREPARED: S.READY, **dict.fromkeys(_WATCHED, S.ENDING)},
    Event.POSITION_WANTED: {S.SWEEPING: S.TURNING},
    Event.SWEEP_OVER: {S.SWEEPING: S.BUSY, S.TURNING: S.BUSY},
}
"""Where every event leads; a state that is not named stays."""

OPEN = frozenset(_OPEN)
"""States in which a start was accepted and its results are not yet sent."""


@dataclass(frozen=True)
class Asked:
    """A command as it arrived; `trouble` is what is wrong with its content, such as a start's VIN.

    Of a step, `position` is the one that was reached, and `angle_deg` the steering wheel's angle there, where
    the controller knows it.
    """

    code: CommandCode
    sequence: int
    wheels: tuple[str, ...] = ()
    vehicle_type: int = 0
    mode: Mode = Mode.AUTOMATIC
    vin: str = ""
    received_s: float = field(default=0.0, compare=False)
    trouble: ErrorCode = ErrorCode.NONE
    position: int = 0
    angle_deg: float | None = None


@dataclass(frozen=True)
class Reply:
    """The answer to a command: accepted, or refused and why."""

    code: CommandCode = CommandCode.NONE
    sequence: int = 0
    refusal: ErrorCode = ErrorCode.NONE

    @property
    def answer(self) -> Answer:
        """The word of the DBC."""
        if self.code is CommandCode.NONE:
            return Answer.NONE
        return Answer.ACCEPTED if self.refusal is ErrorCode.NONE else Answer.REFUSED


class Handshake:
    """The state of the handshake; see `COMMANDS` and `EVENTS`.

    Attributes
    ----------
    state
        Where it stands.
    sequence
        Number of the start or reset that was accepted last.
    reply
        The answer to the last command.
    """

    def __init__(self) -> None:
        self.state = HandshakeState.STARTING
        self.sequence = 0
        self.reply = Reply()
        self._start: int | None = None
        self._final = False
        # Position of the sweep that a step is awaited for next, and the one that the reply is about.
        self._next, self._answered = 1, 0
        # A start that stood on the bus before the station could look is not one that was just given.
        self._start_is_stale = True

    @property
    def ready(self) -> bool:
        """Whether a start would be accepted."""
        return COMMANDS[self.state][Request.START_NEW].refusal is ErrorCode.NONE

    @property
    def busy(self) -> bool:
        """Whether a start was accepted whose results are not yet sent."""
        return self.state in OPEN

    @property
    def held(self) -> bool:
        """Whether results wait for their acknowledgement."""
        return self.state is HandshakeState.HELD

    def asked(self, asked: Asked) -> Command | None:
        """Take a command; returns what the cycle must be told, if anything. The answer is in `reply`."""
        if asked.code is CommandCode.NONE:
            self._start_is_stale = self._final = False
            return None
        if self._final and self._is_repeated(asked):
            return None
        request = self._request(asked)
        rule = COMMANDS[self.state][request]
        if asked.trouble is ErrorCode.WRONG_INTERFACE:
            # Of another interface nothing is taken: what its bits mean is not known.
            rule = _no(ErrorCode.WRONG_INTERFACE)
        elif request in (Request.START_NEW, Request.PREPARE):
            rule = self._checked(rule, asked)
        elif asked.trouble is ErrorCode.STEP_INCOMPLETE and self.state is HandshakeState.TURNING:
            # Its position may still be under way.
            rule = _no(asked.trouble, again=True)
        self._start_is_stale = False
        self._final, self._answered = not rule.again, asked.position
        self.reply = Reply(asked.code, asked.sequence, rule.refusal)
        if rule.target is not None:
            self._enter(rule.target, asked)
        return _command(asked) if rule.deliver else None

    def happened(self, event: Event) -> Command | None:
        """Take an event; returns what the cycle must be told, if anything."""
        before = self.state
        self.state = EVENTS[event].get(before, before)
        if event is Event.RESULTS_SENT and self.state is before:
            raise ValueError(f"results were sent in state '{before}', where none are awaited")
        if event is Event.LINK_LOST:
            self._start_is_stale = True
            if before in _WATCHED:
                return Abort(self.sequence, ErrorCode.COMMUNICATION_LOST)
        return None

    def want(self, position: int) -> None:
        """The sweep waits for the steering to be turned to a position, counted from 1."""
        self._next = position
        self.happened(Event.POSITION_WANTED)

    def refuse(self, sequence: int, code: ErrorCode) -> None:
        """The cycle declines the start or the preparation in hand; its number may be used again."""
        if self._start == sequence:
            self._start = None
        if self.reply.sequence == sequence and self.reply.code in (CommandCode.START, CommandCode.PREPARE):
            self.reply = Reply(self.reply.code, sequence, code)
        self.happened(Event.START_REFUSED)

    def restore(self, sequence: int) -> None:
        """Hold the results of an earlier run of the program."""
        self.sequence = sequence
        self._start = sequence
        self.happened(Event.RESULTS_RESTORED)

    def awaits(self, sequence: int) -> bool:
        """Whether the start of this number waits for results."""
        return self.busy and self._start == sequence

    def _request(self, asked: Asked) -> Request:
        same = asked.sequence == self._start
        match asked.code:
            case CommandCode.START:
                return Request.START_SAME if same else Request.START_NEW
            case CommandCode.STOP:
                return Request.STOP_SAME if same else Request.STOP_OTHER
            case CommandCode.ABORT:
                return Request.ABORT_SAME if same else Request.ABORT_OTHER
            case CommandCode.ACKNOWLEDGE:
                return Request.ACKNOWLEDGE_SAME if same else Request.ACKNOWLEDGE_OTHER
            case CommandCode.RESET:
                return Request.RESET
            case CommandCode.STEP:
                return self._step(asked.position) if same else Request.STEP_OTHER
            case _:
                return Request.PREPARE

    def _step(self, position: int) -> Request:
        if position == self._next:
            return Request.STEP_NEXT
        return Request.STEP_TAKEN if 0 < position < self._next else Request.STEP_OTHER

    def _is_repeated(self, asked: Asked) -> bool:
        # All steps of a sweep have one number, and each has its position.
        known = self.reply.code, self.reply.sequence, self._answered
        return (asked.code, asked.sequence, asked.position) == known

    def _checked(self, rule: Rule, asked: Asked) -> Rule:
        if rule.refusal is not ErrorCode.NONE:
            return rule
        starts = asked.code is CommandCode.START
        if starts and self._start_is_stale:
            return _no(ErrorCode.START_STALE)
        if asked.trouble is not ErrorCode.NONE:
            # The controller's VIN frames may still be under way.
            return _no(asked.trouble, again=asked.trouble is ErrorCode.VIN_INCOMPLETE)
        begins = BEGINS.get(asked.mode) if starts else None
        return rule if begins is None else _to(begins)

    def _enter(self, target: HandshakeState, asked: Asked) -> None:
        self.state = target
        if asked.code is CommandCode.START:
            self._start = self.sequence = asked.sequence
            self._next = 1
        elif asked.code is CommandCode.STEP:
            self._next = asked.position + 1
        elif target is HandshakeState.RESETTING:
            self._start = None
            self.sequence = asked.sequence


def _command(asked: Asked) -> Command:
    match asked.code:
        case CommandCode.START:
            return Trigger(
                asked.sequence, asked.wheels, asked.vehicle_type, asked.vin, asked.received_s, asked.mode
            )
        case CommandCode.PREPARE:
            return Prepare(asked.sequence, asked.wheels, asked.vehicle_type, asked.mode)
        case CommandCode.STOP:
            return Stop(asked.sequence)
        case CommandCode.ABORT:
            return Abort(asked.sequence)
        case CommandCode.ACKNOWLEDGE:
            return Acknowledge(asked.sequence)
        case CommandCode.STEP:
            return Step(asked.sequence, asked.position, asked.angle_deg)
        case _:
            return Reset(asked.sequence)
