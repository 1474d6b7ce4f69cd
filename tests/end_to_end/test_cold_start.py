"""A station that starts where nothing is compiled: what the controller, the log and the installer see."""

from __future__ import annotations

import itertools
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import can
import numpy as np
import pytest

from alignment.errors import WarmUpError
from sensors.formats import read_image, write_image
from station.cli import exit_status
from station.configuration.settings import read_configuration
from station.cycle.words.cycle import ErrorCode, Outcome
from station.line.plc.orders import PlcOrder, PlcTimeouts
from station.line.plc.simulator import PlcSimulator
from station.line.wire.bus import LineBus, open_bus
from station.line.wire.channel import BusSettings
from station.line.wire.dbc import LineDatabase, load_line_database
from station.line.wire.messages import Answer, CommandCode, HandshakeState
from station.running import composition
from station.running.app import run_station
from station.warm_up.needs import Work
from station.warm_up.prepare import StoppedError
from tests.end_to_end.conftest import Truewheel

ROOT = Path(__file__).parents[2]
PATIENT = PlcTimeouts(ready_s=60.0, busy_s=30.0, done_s=60.0, acknowledged_s=30.0, silence_s=30.0)
Warm = Callable[[Sequence[Work], threading.Event], None]


class SlowWarmUp:
    """Stands for a compiler that takes its time: until it is let go, or told to end."""

    def __init__(self, failure: Exception | None = None) -> None:
        self.begun = threading.Event()
        self.finish = threading.Event()
        self.failure = failure

    def __call__(self, works: Sequence[Work], stopping: threading.Event) -> None:
        assert works
        self.begun.set()
        while not self.finish.wait(0.01):
            if stopping.is_set():
                raise StoppedError("told to end")
        if self.failure is not None:
            raise self.failure


class Heard:
    """Every Status of the station, with the time at which it came."""

    def __init__(self, database: LineDatabase) -> None:
        self._database = database
        self._changed = threading.Condition()
        self.statuses: list[tuple[float, dict[str, object]]] = []

    def __call__(self, frame: can.Message) -> None:
        if self._database.name_of(frame) == "Status":
            with self._changed:
                self.statuses.append((time.monotonic(), dict(self._database.decode(frame))))
                self._changed.notify_all()

    def wait_for(self, number: int) -> list[tuple[float, dict[str, object]]]:
        with self._changed:
            assert self._changed.wait_for(lambda: len(self.statuses) >= number, 60.0)
            return list(self.statuses)


@contextmanager
def starting(
    config: Path, warm: Warm, monkeypatch: pytest.MonkeyPatch
) -> Iterator[tuple[LineBus, LineDatabase, threading.Event, Callable[[], None]]]:
    monkeypatch.setattr(composition, "warm_up", warm)
    line = read_configuration(config).settings.line
    database = load_line_database(config.parent / line.dbc)
    stopping = threading.Event()
    with ThreadPoolExecutor(1) as pool, open_bus(BusSettings(channel=line.channel)) as bus:
        served = pool.submit(run_station, config, stopping)
        try:
            yield bus, database, stopping, lambda: served.result(60.0)
        finally:
            stopping.set()


def test_a_station_that_compiles_says_starting_in_time_and_takes_no_start_before_it_is_ready(
    replay: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It used to say ready at once, and compiled in the first cycle, whose time was over before the end."""
    warm = SlowWarmUp()
    with starting(replay, warm, monkeypatch) as (bus, database, stopping, ended):
        heard = Heard(database)
        bus.listen(heard)
        assert warm.begun.wait(60.0)
        with PlcSimulator(bus, database, time.monotonic, PATIENT) as plc:
            plc.view.wait("a status", 60.0, lambda status: status.handshake is HandshakeState.STARTING)
            plc.view.wait_until(60.0, lambda: plc.view.answer is not None and plc.view.answer.link_up)
            plc.command(CommandCode.RESET, 7)
            assert plc.view.wait_until(60.0, lambda: plc.view.answer_to(CommandCode.RESET, 7) is not None)
            answer = plc.view.answer_to(CommandCode.RESET, 7)
            assert answer is not None
            assert (answer.answer, answer.error_code) == (Answer.REFUSED, ErrorCode.STARTING)
            plc.withdraw(CommandCode.RESET, 7)
            plc.command(CommandCode.START, 8)
            assert plc.view.wait_until(60.0, lambda: plc.view.answer_to(CommandCode.START, 8) is not None)
            answer = plc.view.answer_to(CommandCode.START, 8)
            assert answer is not None
            assert answer.answer is Answer.REFUSED
            plc.withdraw(CommandCode.START, 8)
            statuses = heard.wait_for(len(heard.statuses) + 10)
            assert {
                (s["State"], s["Handshake"], s["Fault"], s["Ready"], s["ErrorCode"]) for _, s in statuses
            } == {("starting", "starting", 0, 0, "starting")}
            counters = [int(str(status["AliveCounter"])) for _, status in statuses]
            assert all((b - a) % 256 == 1 for a, b in itertools.pairwise(counters))
            gaps = [b - a for (a, _), (b, _) in itertools.pairwise(statuses)]
            assert max(gaps) < (database.timeout_s("Status") or 0.0)
            warm.finish.set()
            result = plc.run(PlcOrder("TWDEMX00000000001", 1, ("front_left",)))
            assert result.vehicle.outcome in (Outcome.OK, Outcome.NOK)
        stopping.set()
        ended()


def test_a_controller_that_starts_up_waits_until_the_station_has_compiled(
    replay: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It waited ten seconds for a station that was there and said so, and gave up."""
    warm = SlowWarmUp()
    hasty = PlcTimeouts(connect_s=60.0, starting_s=60.0, ready_s=60.0, silence_s=30.0)
    with (
        starting(replay, warm, monkeypatch) as (bus, database, stopping, ended),
        ThreadPoolExecutor(1) as pool,
    ):
        with PlcSimulator(bus, database, time.monotonic, hasty) as plc:
            started = pool.submit(plc.start_up)
            heard = Heard(database)
            bus.listen(heard)
            assert warm.begun.wait(60.0)
            heard.wait_for(5)
            assert not started.done()
            warm.finish.set()
            assert started.result(60.0) is None
            assert plc.status is not None
            assert plc.status.ready
        stopping.set()
        ended()


def test_what_does_not_compile_is_a_fault_of_the_station_and_never_ready(
    replay: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    warm = SlowWarmUp(WarmUpError("the function x was not compiled: LLVM says no; install again"))
    with starting(replay, warm, monkeypatch) as (bus, database, _, ended):
        heard = Heard(database)
        bus.listen(heard)
        heard.wait_for(3)
        warm.finish.set()
        with pytest.raises(WarmUpError) as told:
            ended()
        assert exit_status(told.value) == 3
        last = heard.statuses[-1][1]
        assert (last["State"], last["Fault"], last["ErrorCode"]) == ("fault", 1, "internal_fault")
        assert not any(status["Ready"] for _, status in heard.statuses)


def test_told_to_end_while_it_compiles_a_station_ends_in_order(
    replay: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    warm = SlowWarmUp()
    with starting(replay, warm, monkeypatch) as (_, _, stopping, ended):
        assert warm.begun.wait(60.0)
        stopping.set()
        ended()


@pytest.mark.slow
def test_a_signal_while_everything_is_compiled_ends_the_station_and_its_processes(
    replay: Path, tmp_path: Path
) -> None:
    """With an empty folder of compiled code, as on a new computer."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "empty")}
    command = [sys.executable, "-m", "station.cli", "run", "--config", str(replay)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, cwd=ROOT, env=environment) as station:
        assert station.stderr is not None
        for line in station.stderr:
            assert "is ready" not in line
            if "compiling" in line:
                break
        children = Path(f"/proc/{station.pid}/task/{station.pid}/children").read_text().split()
        station.send_signal(signal.SIGTERM)
        rest = station.communicate(timeout=60)[1]
    assert station.returncode == 0
    assert "stopped" in rest
    assert "Traceback" not in rest
    assert not any(Path(f"/proc/{child}").exists() for child in children)


# Measures with everything of the table loaded; whatever numba compiles then is told.
STRICT = """
import json, sys
from numba.core import event
from alignment.follow import FollowRules, follow_wheel
from alignment.measure import measure_wheel
from alignment.prepared import PreparedRig
from alignment.values import MeasureSettings
from sensors.formats import read_calibration, read_shot
from station.warm_up.needs import SIGNATURES, Work
from station.warm_up.notation import called
from station.warm_up.prepare import warm_up

class Compiled(event.Listener):
    def __init__(self): self.seen = []
    def on_start(self, told): self.seen.append(str(told.data["dispatcher"].py_func))
    def on_end(self, told): pass

warm_up([Work.MEASURE_8, Work.MEASURE_16])
listener = Compiled()
event.register("numba:compile", listener)
outcomes, followed = [], []
for shot in sys.argv[2:]:
    known = read_calibration(sys.argv[1])
    for method in ("revolution", "plane", "ridges"):
        found = measure_wheel(
            read_shot(shot).images, known, MeasureSettings(method=method, allow_lost_head=True)
        )
        outcomes.append(bool(found))
    two = known.without_head(1)
    images = read_shot(shot).images
    outcomes.append(bool(measure_wheel([images[0], images[2]], two, MeasureSettings())))
    rig, one = PreparedRig.of(known, MeasureSettings()), None
    for _ in range(2):
        again = follow_wheel(images, rig, MeasureSettings(), one, FollowRules())
        one = again.wheel
    followed.append(again.whole is None)
table = [SIGNATURES[work] for work in ("measure_8", "measure_16")]
unknown = [
    f"{name}: {signature}"
    for name, signatures in called().items()
    for signature in signatures
    if not any(signature in known.get(name, ()) for known in table)
]
print(json.dumps({"compiled": listener.seen, "unknown": unknown, "outcomes": outcomes, "followed": followed}))
"""


@pytest.mark.slow
def test_after_the_warm_up_a_measurement_compiles_nothing(wheel: Path, tmp_path: Path) -> None:
    """A function that the table does not know fails here: write it with tools/kernel_table.py."""
    deep, dark = tmp_path / "deep", tmp_path / "dark"
    for folder in (deep, dark):
        shutil.copytree(wheel, folder)
    for file in deep.glob("*.png"):
        write_image(file, read_image(file).astype(np.uint16) * 257)
    for file in dark.glob("head_2*.png"):
        write_image(file, read_image(file) * 0)
    command = [
        sys.executable,
        "-c",
        STRICT,
        str(wheel / "calibration.json"),
        str(wheel),
        str(deep),
        str(dark),
    ]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["compiled"] == []
    assert told["unknown"] == []
    assert any(told["outcomes"][:4])
    assert any(told["outcomes"][4:8])
    assert told["followed"][:2] == [True, True]


def test_warm_up_prints_what_it_compiled(truewheel: Truewheel) -> None:
    truewheel("warm-up", "--json")
    ended = truewheel("warm-up", "--json")
    assert ended.status == 0
    assert ended.json["compiled"] == []
    assert ended.json["kept"] is True
    assert ended.json["functions"] > 40
    assert "compiled already" in truewheel("warm-up").out
