"""What the line says of itself: in Status, and in the log, where a controller could provoke too much."""

from __future__ import annotations

import logging
from collections.abc import Callable

from station.cycle import Coalesced, ErrorCode, StationState, StationStatus
from station.line.handshake import Handshake
from station.line.wire import LineStatus

_LOG = logging.getLogger("truewheel.line")


class Said:
    """The last refusal, and what was logged, coalesced.

    Attributes
    ----------
    refusal, refused_sequence
        Why the last command was refused, and its number; NONE and 0 where it was not.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self.refusal, self.refused_sequence = ErrorCode.NONE, 0
        self._said = Coalesced[tuple[int, str]](lambda kind, text: _LOG.log(kind[0], "%s", text), clock)

    def refused(self, sequence: int, code: ErrorCode, text: str) -> None:
        """Remember why a command was refused, or with NONE that it was not."""
        refused = code is not ErrorCode.NONE
        # An unknown command stands in every frame, until the controller thinks better of it.
        if refused and (code, sequence) != (self.refusal, self.refused_sequence):
            self.say(logging.WARNING, str(code), text)
        self.refusal, self.refused_sequence = code, sequence if refused else 0

    def say(self, level: int, kind: str, text: str) -> None:
        """Log something; the same kind again soon is counted instead."""
        self._said.say((level, kind), text)

    def flush_due(self) -> None:
        """Log what was counted long enough."""
        self._said.flush_due()

    def flush(self) -> None:
        """Log all that was counted."""
        self._said.flush()


def shown_status(
    handshake: Handshake, status: StationStatus, said: Said, master: ErrorCode, *, link_up: bool, alive: int
) -> LineStatus:
    """Return what the next Status message says.

    Parameters
    ----------
    handshake, status
        Where handshake and cycle stand.
    said
        Its last refusal is shown where nothing worse is.
    master
        Why its master checks keep a station from being ready, shown where nothing else is.
    link_up, alive
        Whether the controller is heard, and the alive counter.
    """
    code, code_sequence = status.error_code, handshake.sequence
    if code is ErrorCode.NONE and not link_up:
        code = ErrorCode.COMMUNICATION_LOST
    if code is ErrorCode.NONE:
        code, code_sequence = said.refusal, said.refused_sequence
    if code is ErrorCode.NONE and handshake.ready:
        code, code_sequence = master, 0
    return LineStatus(
        state=status.state,
        sequence=handshake.sequence,
        ready=handshake.ready and link_up and master is ErrorCode.NONE,
        busy=handshake.busy,
        done=handshake.held,
        fault=status.state is StationState.FAULT,
        alive_counter=alive,
        error_code=code,
        error_sequence=code_sequence,
        handshake=handshake.state,
    )
