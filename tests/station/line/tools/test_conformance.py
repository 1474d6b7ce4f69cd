"""The conformance test finds good what is good, and a station that errs; scenarios; the document."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from alignment.errors import ConfigurationError
from station.cycle.words.cycle import ErrorCode
from station.line.handshake import COMMANDS, Handshake, Rule
from station.line.plc.orders import PlcTimeouts
from station.line.plc.simulator import PlcSimulator
from station.line.tools.conformance import POINTS, check_station, point_named, try_point
from station.line.tools.document import interface_document
from station.line.tools.scenarios import play_scenarios, read_scenarios
from station.line.tools.trial import Trial, Vehicles
from station.line.wire.bus import open_bus
from station.line.wire.dbc import LineDatabase
from station.line.wire.error_codes import MEANINGS
from station.line.wire.messages import HandshakeState
from station.line.wire.options import LineOptions
from station.rehearsal.simulated import simulated_station

ROOT = Path(__file__).resolve().parents[4]
PATIENT = PlcTimeouts(
    connect_s=20.0, ready_s=20.0, busy_s=10.0, done_s=20.0, acknowledged_s=10.0, silence_s=4.0
)
# A computer that does other work must not look like a lost controller.
TOLERANT = LineOptions(communication_timeout_s=1.5)


@pytest.fixture
def trial(database: LineDatabase) -> Iterator[Trial]:
    with (
        simulated_station(database, 0.1, TOLERANT) as settings,
        open_bus(settings) as bus,
        PlcSimulator(bus, database, timeouts=PATIENT) as plc,
    ):
        plc.connect()
        yield Trial(plc, database, Vehicles(patience_s=20.0))


@pytest.mark.slow
def test_a_good_station_passes_every_point(trial: Trial) -> None:
    verdicts = list(check_station(trial))
    # How punctual Status is, is a matter of what else the computer does.
    assert [v for v in verdicts if not v.passed and v.point != "status-comes"] == []
    assert len(verdicts) == len(POINTS) == len({point.name for point in POINTS})


@pytest.mark.parametrize(
    ("state", "request_", "rule", "point"),
    [
        ("READY", "START_SAME", Rule(HandshakeState.BUSY, deliver=True), "repeated-start"),
        ("HELD", "ACKNOWLEDGE_OTHER", Rule(HandshakeState.CLOSING, deliver=True), "held-results"),
        ("HELD", "START_NEW", Rule(), "start-while-held"),
        ("READY", "STOP_OTHER", Rule(), "stop-without-adjusting"),
        ("READY", "STEP_OTHER", Rule(), "step-nowhere"),
    ],
)
def test_a_station_that_errs_is_found_out(
    trial: Trial, monkeypatch: pytest.MonkeyPatch, state: str, request_: str, rule: Rule, point: str
) -> None:
    from station.line.handshake import Request

    monkeypatch.setitem(COMMANDS[HandshakeState[state]], Request[request_], rule)
    found = point_named(point)
    assert found is not None
    trial.plc.timeouts = PlcTimeouts(connect_s=5, ready_s=2, busy_s=1, done_s=3, acknowledged_s=1)
    verdict = try_point(found, trial)
    assert not verdict.passed
    assert verdict.failure


def test_a_station_that_takes_stale_starts_is_found_out(
    trial: Trial, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = Handshake.asked

    def forgetful(self: Handshake, command):  # type: ignore[no-untyped-def]
        self._start_is_stale = False
        return asked(self, command)

    monkeypatch.setattr(Handshake, "asked", forgetful)
    point = point_named("start-after-silence")
    assert point is not None
    assert not try_point(point, trial).passed


def test_shipped_scenarios_play(trial: Trial) -> None:
    file = read_scenarios(ROOT / "configs" / "line-scenarios.toml")
    names = {scenario.name for scenario in file.scenarios}
    assert {"normal shift", "slow PLC", "lost heartbeat", "repeated start"} <= names
    quick = tuple(
        scenario.model_copy(update={"times": 1, "pause_s": 0.0})
        for scenario in file.scenarios
        if scenario.name
        in ("normal shift", "wrong CRC and wrong counter", "unknown vehicle type and wrong VIN")
    )
    played = list(play_scenarios(file.model_copy(update={"scenarios": quick}), trial))
    assert [one for one in played if not one.verdict.passed] == []
    assert {one.scenario for one in played} == {scenario.name for scenario in quick}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "scenarios"),
        ('[[scenarios]]\nname = "x"\nplay = ["juggle"]', "good-cycle"),
        ('[[scenarios]]\nname = "x"\nplay = ["good-cycle"]\ntimes = 0', "times"),
        ('[vehicle]\nvin = "SHORT"\n[[scenarios]]\nname = "x"\nplay = ["good-cycle"]', "vin"),
    ],
)
def test_scenario_file_with_a_mistake(tmp_path: Path, text: str, expected: str) -> None:
    file = tmp_path / "scenarios.toml"
    file.write_text(text)
    with pytest.raises(ConfigurationError, match=expected) as caught:
        read_scenarios(file)
    assert str(file) in str(caught.value)


def test_document_is_current(database: LineDatabase) -> None:
    """When this fails: `truewheel line document`, and look at the difference."""
    document = (ROOT / "docs" / "line-interface.md").read_text(encoding="utf-8")
    assert document == interface_document(database)


def test_document_holds_everything(database: LineDatabase) -> None:
    document = interface_document(database)
    for message in database.definition.messages:
        assert f"{message.name} (0x{message.frame_id:03X})" in document
        for signal in message.signals:
            assert signal.name in document
    assert all(f"`{code}`" in document for code in ErrorCode if code is not ErrorCode.NONE)
    assert all(state in document for state in HandshakeState)


def test_every_error_code_has_cause_and_cure() -> None:
    for meaning in MEANINGS.values():
        assert meaning.cause.endswith(".")
        assert meaning.cure.endswith(".")
