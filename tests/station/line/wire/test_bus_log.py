"""The bus's log over restarts, power losses and full files: nothing is erased, and it stays bounded."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import can
import pytest

from alignment.errors import ConfigurationError
from station.configuration.settings import read_configuration
from station.line.tools.logs.reading import read_log
from station.line.wire.bus import LineBus, open_bus
from station.line.wire.bus_log import open_log
from station.line.wire.channel import BusSettings
from station.running.composition import bus_settings
from tests.station.line.line_bench import DBC

FRAME_BYTES = 60


def frame(number: int) -> can.Message:
    data = number.to_bytes(8, "big")
    return can.Message(timestamp=1.0 + number, arbitration_id=0x123, is_extended_id=False, data=data)


def write(file: Path, numbers: range, most_bytes: int = 10**6, files: int = 4) -> None:
    log = open_log(file, most_bytes, files)
    for number in numbers:
        log.on_message_received(frame(number))
    log.stop()


def kept(folder: Path) -> list[int]:
    """Numbers of all frames that are kept, the oldest file first."""
    files = sorted(folder.iterdir(), key=lambda f: int(f.suffixes[0][1:]) if len(f.suffixes) > 1 else 0)
    return [int.from_bytes(m.data, "big") for file in reversed(files) for m in read_log(file)]


@pytest.mark.parametrize("ending", [".log", ".asc", ".blf"])
def test_restart_keeps_what_was_logged(tmp_path: Path, channel: str, ending: str) -> None:
    """Each start erased the log of the day before."""
    file = tmp_path / f"traffic{ending}"
    for number in (1, 2, 3):
        with open_bus(BusSettings(channel=channel, log=file, log_files=4)) as bus:
            bus.send(frame(number))
    assert kept(tmp_path) == [1, 2, 3]
    assert len(list(tmp_path.iterdir())) == (1 if ending == ".log" else 3)


@pytest.mark.parametrize("ending", [".log", ".asc", ".blf"])
@pytest.mark.parametrize("files", [1, 2, 4])
def test_log_stays_within_its_size_and_number_of_files(tmp_path: Path, ending: str, files: int) -> None:
    """It grew until the disk was full."""
    for start in range(0, 900, 300):
        write(tmp_path / f"traffic{ending}", range(start, start + 300), most_bytes=3000, files=files)
        sizes = [file.stat().st_size for file in tmp_path.iterdir()]
        assert len(sizes) <= files
        assert all(size <= 3000 + 2 * FRAME_BYTES + 500 for size in sizes)
    numbers = kept(tmp_path)
    assert numbers == list(range(900 - len(numbers), 900))
    assert len(sizes) == files


def test_fewer_files_than_before_gives_the_oldest_up_and_touches_no_other(tmp_path: Path) -> None:
    others = [tmp_path / name for name in ("traffic.old.log", "traffic.txt", "other.1.log", "traffic.01.log")]
    for other in others:
        other.write_text("mine")
    write(tmp_path / "traffic.log", range(300), most_bytes=1000, files=9)
    write(tmp_path / "traffic.log", range(300, 301), most_bytes=1000, files=3)
    assert all(other.read_text() == "mine" for other in others)
    names = {file.name for file in tmp_path.iterdir()} - {other.name for other in others}
    assert names == {"traffic.log", "traffic.1.log", "traffic.2.log"}


@pytest.mark.parametrize("torn", [b"(17.0) vcan0 12", b"x" * 200, b""])
def test_line_that_a_power_loss_cut_off_costs_no_other_frame(tmp_path: Path, torn: bytes) -> None:
    file = tmp_path / "traffic.log"
    write(file, range(3))
    with file.open("ab") as binary:
        binary.write(torn)
    write(file, range(3, 5))
    assert kept(tmp_path) == [0, 1, 2, 3, 4]


def test_every_frame_is_in_the_file_when_the_program_is_killed(tmp_path: Path) -> None:
    log = open_log(tmp_path / "traffic.log", 10**6, 3)
    for number in range(5):
        log.on_message_received(frame(number))
    assert len(kept(tmp_path)) >= 4
    log.stop()


def test_file_that_cannot_be_put_aside_stops_the_log_not_the_line(tmp_path: Path, channel: str) -> None:
    (tmp_path / "traffic.1.log").mkdir()
    (tmp_path / "traffic.1.log" / "in the way").touch()
    settings = BusSettings(channel=channel, log=tmp_path / "traffic.log", log_bytes=200, log_files=2)
    with open_bus(settings) as bus:
        for number in range(20):
            bus.send(frame(number))
        assert bus.health.sent == 20
        assert bus.health.log_failures >= 1
        assert "log:" in str(bus.health.last_error)


def test_pipe_folder_and_device_are_refused_before_they_are_opened(tmp_path: Path) -> None:
    pipe, folder, device = (tmp_path / name for name in ("pipe.log", "folder.log", "device.log"))
    os.mkfifo(pipe)
    folder.mkdir()
    device.symlink_to("/dev/full")
    for path in (pipe, folder, device):
        with pytest.raises(ConfigurationError, match="an ordinary file") as caught:
            open_log(path, 1000, 3)
        assert str(path) in str(caught.value)


def test_bus_that_does_not_open_puts_no_log_aside(tmp_path: Path) -> None:
    file = tmp_path / "traffic.asc"
    write(file, range(2))
    for _ in range(3):
        with pytest.raises(ConfigurationError):
            open_bus(BusSettings(interface="nosuchbus", log=file, log_files=2))
    assert [path.name for path in tmp_path.iterdir()] == ["traffic.asc"]
    assert kept(tmp_path) == [0, 1]


def test_log_that_does_not_open_leaves_no_bus(tmp_path: Path, channel: str) -> None:
    with pytest.raises(ConfigurationError, match="log"):
        open_bus(BusSettings(channel=channel, log=tmp_path / "absent" / "traffic.log"))
    with LineBus(lambda: can.Bus(interface="virtual", channel=channel)) as bus:
        assert bus.health.connected


def test_bounds_come_from_the_configuration_and_change_no_hash(tmp_path: Path) -> None:
    configs = shutil.copytree(DBC.parent, tmp_path / "configs")
    file = configs / "station.toml"
    text = file.read_text(encoding="utf-8")
    plain = read_configuration(file)
    assert bus_settings(plain).log is None
    for line in ('log = "../traffic.log"', "log_mb = 100.0", "log_files = 10"):
        assert f"# {line}\n" in text, "the delivered configuration shows the defaults"
        text = text.replace(f"# {line}\n", line.replace("100.0", "0.5").replace("10", "3") + "\n")
    file.write_text(text, encoding="utf-8")
    chosen = read_configuration(file)
    settings = bus_settings(chosen)
    assert (settings.log_bytes, settings.log_files) == (500_000, 3)
    assert settings.log is not None
    assert settings.log.resolve() == tmp_path / "traffic.log"
    assert chosen.hash == plain.hash
    assert (bus_settings(plain).log_bytes, bus_settings(plain).log_files) == (100_000_000, 10)


@pytest.mark.parametrize("line", ["log_mb = 0", "log_mb = 10001", "log_files = 0", "log_files = 1001"])
def test_log_without_bounds_is_refused(tmp_path: Path, line: str) -> None:
    configs = shutil.copytree(DBC.parent, tmp_path / "configs")
    file = configs / "station.toml"
    text = file.read_text(encoding="utf-8").replace("[line]\n", f"[line]\n{line}\n", 1)
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigurationError, match=rf"line\.{line.partition(' ')[0]}"):
        read_configuration(file)
