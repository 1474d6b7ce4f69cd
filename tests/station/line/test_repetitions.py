"""What a cable or a controller can provoke at will does not fill the program's log."""

from __future__ import annotations

import itertools
import logging
import re
import threading

import can
import pytest

from station.line.wire.bus import LineBus
from tests.station.line.line_bench import WAIT_S, Bench, FakeCanBus


def test_cable_that_makes_and_breaks_contact_is_two_lines(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, "truewheel.line")
    count, enough = itertools.count(), threading.Event()

    def fail() -> can.Message:
        if next(count) > 8:
            enough.set()
        raise can.CanOperationError("no contact")

    def opened() -> FakeCanBus:
        fake = FakeCanBus()
        fake.receive = fail
        return fake

    with LineBus(opened) as bus:
        assert enough.wait(WAIT_S)
        assert bus.health.losses >= 8
        lines = [record.message for record in caplog.records]
        assert len(lines) == 2
    lines = [record.message for record in caplog.records]
    assert len(lines) == 4
    assert any(
        re.search(r"\d more.* is lost: receive: CanOperationError: no contact", line) for line in lines
    )


def test_controller_that_comes_and_goes_is_two_lines(bench: Bench, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, "truewheel.line")
    for _ in range(20):
        bench.clock.now += 0.6
        bench.line.tick()
        bench.link_up()
    said = [record.message for record in caplog.records]
    assert len(said) <= 2 + 2 * 2, said
    bench.line.close()
    counted = [int(m[1]) for r in caplog.records if (m := re.match(r"(\d+) more", r.message))]
    firsts = sum(not re.match(r"\d+ more", record.message) for record in caplog.records)
    assert sum(counted) + firsts == 40


def test_frames_with_bad_content_are_counted_and_not_written_down(
    bench: Bench, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG)
    bench.idle()
    for number in range(500):
        frame = can.Message(
            arbitration_id=0x110, is_extended_id=False, data=bytes([number % 256] * (number % 9))
        )
        bench.line.receive(frame)
    assert caplog.records == []
    health = bench.line.health.link
    assert health.wrong_crc + health.malformed >= 499
