"""`truewheel line …` as an integrator calls it."""

from __future__ import annotations

from pathlib import Path

import pytest

from station.line.tools.cable import Cable
from tests.end_to_end.conftest import CONFIGS, Truewheel, change
from tests.station.line.line_bench import dbc_of_interface_2

CONFIG = ("--config", CONFIGS / "station.toml")


def test_plc_against_a_simulated_station(truewheel: Truewheel, tmp_path: Path) -> None:
    ended = truewheel("line", "plc", "--simulated", "--vin", "WVWZZZ1KZAW123456", *CONFIG, "--json")
    assert ended.status == 0, ended.err
    (vehicle,) = ended.json["vehicles"]
    assert (vehicle["vin"], vehicle["outcome"]) == ("WVWZZZ1KZAW123456", "ok")
    assert {wheel["kind"] for wheel in vehicle["wheels"]} == {"tyre_plane"}
    assert vehicle["geometry"]["reference"] == "stand"
    scenario = tmp_path / "short.toml"
    scenario.write_text('[[scenarios]]\nname = "one"\nplay = ["good-cycle", "wrong-crc"]\n')
    ended = truewheel("line", "plc", "--simulated", "--scenario", scenario, *CONFIG, "--json")
    assert ended.status == 0, ended.err
    assert ended.json["figures"] == {"passed": 2, "failed": 0}
    ended = truewheel("line", "plc", "--simulated", "--scenario", scenario, *CONFIG)
    assert "passed  one: good-cycle" in ended.out


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("plc", "--vin", "SHORT"), "17 characters"),
        (("plc",), "either VINs or a scenario file"),
        (("check", "--vin", "SHORT"), "17 characters"),
        (("check", "--wheel", "front"), "wheels of front_left, front_right, rear_left, rear_right"),
        (("plc", "--vin", "WVWZZZ1KZAW123456", "--interface", "smoke"), "socketcan"),
        (("monitor", "--interface", "slcan", "--channel", "/dev/no_such_device"), "no_such_device"),
        (("plc", "--scenario", "absent.toml"), "absent.toml"),
    ],
)
def test_bad_input_is_one_clear_sentence(
    truewheel: Truewheel, arguments: tuple[str, ...], expected: str
) -> None:
    ended = truewheel("line", *arguments, *CONFIG)
    assert ended.status == 2
    assert expected in ended.err
    assert ended.err.startswith("truewheel: ")
    assert len(ended.err.strip().splitlines()) == 1


def test_busy_channel_is_one_clear_sentence(truewheel: Truewheel) -> None:
    from station.line.wire.bus import open_bus

    with Cable() as cable, open_bus(cable.settings(0)):
        arguments = ("--interface", "slcan", "--channel", cable.ends[0])
        ended = truewheel("line", "monitor", *arguments, *CONFIG)
    assert ended.status == 2
    assert "another program has it open" in ended.err


def test_dbc_that_lacks_a_message_stops_every_line_command(truewheel: Truewheel, tmp_path: Path) -> None:
    for name in ("station.toml", "line.dbc"):
        (tmp_path / name).write_text((CONFIGS / name).read_text())
    (tmp_path / "vehicles").symlink_to(CONFIGS / "vehicles")
    dbc = tmp_path / "line.dbc"
    dbc.write_text(dbc.read_text().replace("BO_ 289 CommandAnswer:", "BO_ 289 CommandReply:"))
    for arguments in (("check", "--simulated"), ("monitor",), ("plc", "--vin", "WVWZZZ1KZAW123456")):
        ended = truewheel("line", *arguments, "--config", tmp_path / "station.toml")
        assert ended.status == 2
        assert "CommandAnswer" in ended.err
        assert str(dbc) in ended.err


def test_log_of_interface_2_is_read_by_its_own_dbc_and_by_today_s(
    truewheel: Truewheel, tmp_path: Path
) -> None:
    """A station would not start by that DBC; what was recorded is read all the same."""
    (tmp_path / "station.toml").write_text((CONFIGS / "station.toml").read_text())
    (tmp_path / "line.dbc").write_text(dbc_of_interface_2(), encoding="cp1252")
    (tmp_path / "vehicles").symlink_to(CONFIGS / "vehicles")
    older = ("--config", tmp_path / "station.toml")
    log = tmp_path / "traffic.log"
    frames = ("110#5900000000000000", "110#B021050F02010100", "131#302705C7CF4F9C00")
    log.write_text("".join(f"({k}.000000) can0 {frame}\n" for k, frame in enumerate(frames)))
    for configuration in (CONFIG, older):
        ended = truewheel("line", "monitor", log, "--json", *configuration)
        assert (ended.status, ended.json["errors"]) == (0, 0), ended.err
        start, result = (frame["values"] for frame in ended.json["frames"][1:])
        assert (start["Code"], start["VehicleType"], result["Outcome"]) == ("start", 258, "nok")
        assert result["Camber"] == pytest.approx(-1.2345)
    ended = truewheel("line", "check", "--simulated", *older)
    assert ended.status == 2
    assert "InterfaceMajor" in ended.err


def test_monitor_converts_logs_and_marks_errors(truewheel: Truewheel, tmp_path: Path) -> None:
    log = tmp_path / "traffic.log"
    good = "(1.000000) can0 110#CC00000000000000\n"
    log.write_text(good)
    for ending in (".asc", ".blf"):
        copy = tmp_path / f"copy{ending}"
        ended = truewheel("line", "monitor", log, "--out", copy, *CONFIG)
        assert ended.status == 1
        assert "end-to-end protection: wrong_crc" in ended.out
        assert truewheel("line", "monitor", copy, *CONFIG, "--json").json["errors"] == 1


def test_monitor_shows_changes_of_the_messages_that_are_asked_for(
    truewheel: Truewheel, tmp_path: Path
) -> None:
    log = tmp_path / "traffic.log"
    frames = (f"({k}.000000) can0 110#{k:02X}0000000000000" + "0" for k in range(3))
    log.write_text("\n".join([*frames, "(4.000000) can0 120#0000000000000000"]) + "\n")
    ended = truewheel("line", "monitor", log, "--message", "command", *CONFIG)
    assert len(ended.out.splitlines()) == 1, "three times the same"
    assert " Status " not in ended.out
    assert "4 frames" in ended.err
    ended = truewheel("line", "monitor", log, "--message", "command", "--all", "--counters", *CONFIG)
    assert [line.split("E2eCrc=")[1][0] for line in ended.out.splitlines()] == ["0", "1", "2"]
    assert len(truewheel("line", "monitor", log, *CONFIG, "--json").json["frames"]) == 4
    assert (
        len(truewheel("line", "monitor", log, "--message", "status", *CONFIG, "--json").json["frames"]) == 1
    )
    ended = truewheel("line", "monitor", log, "--message", "Statsu", *CONFIG)
    assert (ended.status, ended.out) == (2, "")
    assert "field '--message'" in ended.err


@pytest.mark.parametrize("verb", [("monitor",), ("check",), ("plc", "--vin", "WVWZZZ1KZAW123456")])
@pytest.mark.parametrize("more", [(), ("--interface", "virtual"), ("--channel", "another")])
def test_a_channel_of_this_process_alone_is_refused_with_what_to_do(
    truewheel: Truewheel, verb: tuple[str, ...], more: tuple[str, ...]
) -> None:
    """It waited for a station that could never hear it, and then said that there was none."""
    ended = truewheel("line", *verb, *more, *CONFIG)
    assert ended.status == 2
    assert "in one process only" in ended.err
    assert "`truewheel run --cable out/plc`" in ended.err
    assert ("--simulated" in ended.err) == (verb[0] != "monitor")


def test_config_check_says_that_no_plc_reaches_a_virtual_channel(truewheel: Truewheel, configs: Path) -> None:
    config = configs / "station.toml"
    assert "no PLC reaches it" in truewheel("config", "check", config).out
    change(config, 'interface = "virtual"', 'interface = "socketcan"')
    assert "no PLC reaches it" not in truewheel("config", "check", config).out


def test_document_command_writes_what_is_delivered(truewheel: Truewheel, tmp_path: Path) -> None:
    out = tmp_path / "line.md"
    assert truewheel("line", "document", "--out", out, *CONFIG).status == 0
    assert out.read_text() == (CONFIGS.parent / "docs" / "line-interface.md").read_text()
