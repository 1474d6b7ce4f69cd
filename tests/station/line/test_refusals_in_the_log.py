"""The log says which start was refused and why: the PLC's programmer asks the station's people first."""

from __future__ import annotations

import logging

import pytest

from station.cycle.words.cycle import ErrorCode
from station.line.asking import refusal_in_words
from tests.station.line.line_bench import VIN, Bench, command_frame


@pytest.fixture
def said(bench: Bench, caplog: pytest.LogCaptureFixture) -> pytest.LogCaptureFixture:
    bench.idle()
    bench.link_up()
    caplog.set_level(logging.INFO, "truewheel.line")
    caplog.clear()
    return caplog


def test_start_that_the_handshake_refuses_is_named(bench: Bench, said: pytest.LogCaptureFixture) -> None:
    """Nothing was written: a line that stood for a wrong number left no trace at the station."""
    bench.start(4, wheels=0)
    bench.start(4, wheels=0)
    assert [record.message for record in said.records] == [
        "start 4, VIN not whole, vehicle type 7, was refused: no_wheels. The start marks no wheel."
    ]
    assert said.records[0].levelno == logging.WARNING


def test_start_that_the_cycle_refuses_is_named_with_its_vehicle(
    bench: Bench, said: pytest.LogCaptureFixture
) -> None:
    bench.start(1)
    bench.commands()
    bench.line.refuse(1, ErrorCode.UNKNOWN_VEHICLE_TYPE)
    [record] = said.records
    assert record.message == (
        f"start 1, VIN {VIN}, vehicle type 7, was refused: unknown_vehicle_type. "
        "No vehicle type has this number."
    )


def test_other_commands_are_named_too_each_once(bench: Bench, said: pytest.LogCaptureFixture) -> None:
    bench.command("acknowledge", 9)
    frame = command_frame(bench.database, "none", 8)
    frame.data[1] |= 0xF0
    for _ in range(50):
        bench.receive(frame)
    bench.command("none", 8)
    bench.command("stop", 3)
    texts = [record.message for record in said.records]
    assert [text.split(".")[0] for text in texts] == [
        "acknowledge 9 was refused: wrong_sequence",
        "command 15, 8 was refused: unknown_command",
        "stop 3 was refused: nothing_to_stop",
    ]


def test_a_controller_that_asks_again_and_again_does_not_fill_the_log(
    bench: Bench, said: pytest.LogCaptureFixture
) -> None:
    for number in range(1, 200):
        bench.start(number, wheels=0)
        bench.command("none", number)
    assert len(said.records) == 1
    bench.line.close()
    assert said.records[-1].message.startswith("198 more within")
    assert "start 199" in said.records[-1].message


@pytest.mark.parametrize("why", [code for code in ErrorCode if code is not ErrorCode.NONE])
def test_every_reason_has_words(why: ErrorCode) -> None:
    text = refusal_in_words("prepare", 3, why)
    assert text.startswith(f"prepare 3 was refused: {why}. ")
    assert text.endswith(".")
    assert ".." not in text
