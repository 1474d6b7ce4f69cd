"""What the line knows, as a log and a message say it."""

from __future__ import annotations

import pytest

from station.cycle.words.cycle import (
    Abort,
    Acknowledge,
    ErrorCode,
    Mode,
    Prepare,
    Reset,
    StationState,
    Stop,
    Trigger,
)
from station.line.wire.bus import BusHealth
from station.line.wire.link import LinkHealth
from station.line.wire.messages import (
    Answer,
    CommandAnswer,
    CommandCode,
    HandshakeState,
    LineStatus,
    StationInfo,
)
from station.line.wire.options import LineHealth
from station.threads.health import ThreadHealth

VIN = "WVWZZZ1KZAW000001"
BUS = BusHealth(True, True, 120, 1, 0, 0, 0, 0, 0, None)
STATUS = LineStatus(
    StationState.IDLE, 4, True, False, False, False, 9, ErrorCode.BUSY, 5, HandshakeState.READY
)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (
            Trigger(5, ("front_left", "front_right"), 7, VIN, mode=Mode.ADJUST),
            f"start 5, VIN {VIN}, vehicle type 7, mode adjust, front_left and front_right",
        ),
        (Prepare(5, ("front_left",), 7), "prepare 5, vehicle type 7"),
        (Stop(5), "stop 5"),
        (Abort(5), "abort 5"),
        (Abort(5, ErrorCode.COMMUNICATION_LOST), "abort 5 (communication_lost)"),
        (Reset(5), "reset 5"),
        (Acknowledge(5), "acknowledge 5"),
        (STATUS, "ready, ready, busy of 5; cycle idle, number 4"),
        (
            CommandAnswer(CommandCode.START, 5, Answer.REFUSED, ErrorCode.BUSY, True, 3),
            "start 5 refused with busy",
        ),
        (
            CommandAnswer(CommandCode.NONE, 0, Answer.NONE, ErrorCode.NONE, False, 3),
            "none 0 none, controller not heard",
        ),
        (StationInfo((2, 1), (0, 1, 0), 77), "interface 2.1, software 0.1.0"),
        (
            LineHealth(BUS, LinkHealth(good=99, wrong_crc=1), True, True, 0, 0),
            "controller heard; 120 frames received, 1 sent; 99 good frames of the controller, "
            "1 with a wrong CRC",
        ),
        (
            LineHealth(
                BusHealth(False, True, 120, 1, 2, 1, 0, 1, 1, "receive: gone"),
                LinkHealth(good=1),
                False,
                True,
                0,
                0,
            ),
            "controller not heard; 120 frames received, 1 sent, 3 failures, 1 error frame, 1 loss, the last: "
            "receive: gone; 1 good frame of the controller",
        ),
        (ThreadHealth("line", False, 0, None), "the thread 'line' has ended; 0 failures"),
        (
            ThreadHealth("line", True, 1, "KeyError: 'x'"),
            "the thread 'line' runs on; 1 failure, the last: KeyError: 'x'",
        ),
    ],
)
def test_words(value: object, words: str) -> None:
    """They were written as ``LineHealth(bus=BusHealth(connected=True, …), …)``."""
    assert str(value) == words
