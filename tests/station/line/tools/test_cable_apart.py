"""A cable of its own process, and the name of its other end."""

from __future__ import annotations

import queue
import subprocess
import sys
from pathlib import Path

import can
import pytest

from alignment.errors import ConfigurationError, LineConnectionError
from station.line.tools.cable import SLCAN_OPTIONS
from station.line.tools.cable_apart import link, named_cable
from station.line.wire.bus import open_bus
from station.line.wire.channel import BusSettings
from tests.station.line.line_bench import WAIT_S


def test_another_program_opens_the_other_end_by_its_name(tmp_path: Path) -> None:
    plug = tmp_path / "new" / "plc"
    heard: queue.SimpleQueue[can.Message] = queue.SimpleQueue()
    with named_cable(plug) as end:
        named = BusSettings("slcan", str(plug), options=SLCAN_OPTIONS)
        with open_bus(end) as first, open_bus(named) as second:
            second.listen(heard.put)
            first.send(can.Message(arbitration_id=0x123, is_extended_id=False, data=[7]))
            assert heard.get(timeout=WAIT_S).data[0] == 7
            with pytest.raises(ConfigurationError, match="another program has it open"):
                open_bus(named)
    assert not plug.is_symlink()


def test_the_cable_ends_with_whoever_laid_it(tmp_path: Path) -> None:
    """Killed, a station must leave no process behind, and no name that leads to another terminal."""
    command = [sys.executable, "-m", "station.line.tools.cable_apart"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert "/dev/" in process.stdout.readline()
        process.stdin.close()
        assert process.wait(60.0) == 0


def test_a_name_that_is_taken_is_left_alone_and_one_left_behind_is_not(tmp_path: Path) -> None:
    taken = tmp_path / "plc"
    taken.write_text("mine")
    with pytest.raises(ConfigurationError, match="found something of this name"):
        link(taken, "/dev/null")
    assert taken.read_text() == "mine"
    with pytest.raises(ConfigurationError, match="Choose a place that can be written"):
        link(taken / "below", "/dev/null")
    left = tmp_path / "left"
    left.symlink_to("/dev/pts/no-such-device")
    link(left, "/dev/null")
    assert str(left.readlink()) == "/dev/null"
    with pytest.raises(ConfigurationError, match="remove it if no other program has it"):
        link(left, "/dev/null")


def test_a_cable_that_does_not_start_is_one_clear_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "executable", "/bin/true")
    with pytest.raises(LineConnectionError, match="did not start"), named_cable(tmp_path / "plc"):
        pytest.fail("there is no cable")
