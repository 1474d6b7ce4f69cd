"""A station that is told to stop by a signal ends in order, whatever it is doing."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from db.records import CycleOutcome
from station.cycle.words.cycle import Mode, Outcome, StationState
from station.running.app import stop_on_signals
from tests.station.bench import Restarted, open_bench

ROOT = Path(__file__).resolve().parents[3]
ENDING = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT]


@pytest.mark.parametrize("number", ENDING)
def test_every_ending_signal_ends_in_order_and_a_second_one_adds_nothing(number: signal.Signals) -> None:
    """SIGHUP, which a closing terminal sends, killed the station amid a cycle."""
    # Whoever starts the tests may have it ignored, as shells do for what runs in the background.
    found = signal.signal(number, signal.default_int_handler)
    try:
        stopping = threading.Event()
        with stop_on_signals(stopping):
            os.kill(os.getpid(), number)
            assert stopping.is_set()
            os.kill(os.getpid(), number)
        assert signal.getsignal(number) is signal.default_int_handler
    finally:
        signal.signal(number, found)


def test_a_station_under_nohup_survives_its_terminal() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        stopping = threading.Event()
        with stop_on_signals(stopping):
            os.kill(os.getpid(), signal.SIGHUP)
            assert not stopping.is_set()
            os.kill(os.getpid(), signal.SIGTERM)
            assert stopping.is_set()
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize("state", [StationState.MEASURING, StationState.STORING, StationState.REPORTING])
def test_signal_amid_a_cycle_lets_it_finish(state: StationState) -> None:
    with open_bench() as bench:
        stopping = threading.Event()
        bench.line.on_poll = lambda: stopping.set() if bench.cycle.state is state else None
        bench.queue_trigger()
        bench.cycle.serve(stopping)
        assert [record.outcome for record in bench.store.cycles] == [CycleOutcome.OK]
        assert set(bench.line.outcomes.values()) == {Outcome.OK}


def test_signal_while_nobody_acknowledges_does_not_wait_and_the_results_are_offered_again() -> None:
    with open_bench() as bench:
        stopping = threading.Event()
        bench.line.acknowledges = False
        bench.line.on_poll = lambda: stopping.set() if bench.cycle.state is StationState.REPORTING else None
        before = bench.clock.now
        bench.queue_trigger()
        bench.cycle.serve(stopping)
        assert bench.clock.now - before < 0.5
        with Restarted(bench) as after:
            assert after.line.sent == bench.line.sent


def test_signal_amid_adjusting_breaks_it_off() -> None:
    """The station went on for as long as the operator adjusted: ten minutes."""
    with open_bench() as bench:
        stopping = threading.Event()
        bench.line.on_live = stopping.set
        bench.queue_trigger(mode=Mode.ADJUST)
        bench.cycle.serve(stopping)
        assert [record.outcome for record in bench.store.cycles] == [CycleOutcome.ABORTED]
        assert set(bench.line.outcomes.values()) == {Outcome.ABORTED}
        assert "stopping" in bench.store.event_codes


_STATION = """
import os, signal, sys, threading

# Whoever starts the tests may have it ignored.
signal.signal(int(sys.argv[1]), signal.SIG_DFL)
from pathlib import Path
from station.running import app
from station.running import composition

class Station:
    def __enter__(self):
        os.kill(os.getpid(), int(sys.argv[1]))
        print("opened", flush=True)
        return self
    def __exit__(self, *error):
        print("closed", flush=True)
    positions = ()
    class cycle:
        threads = ()
        @staticmethod
        def serve(stopping):
            print("told", stopping.is_set(), flush=True)
    class line:
        health = "good"

app.open_station = lambda configuration, observer, stopping, bus: Station()
app.run_station(Path("configs/station.toml"))
print("ended")
"""


@pytest.mark.parametrize("number", [signal.SIGHUP, signal.SIGQUIT])
def test_signal_while_starting_ends_in_order_too(number: signal.Signals) -> None:
    ended = subprocess.run(
        [sys.executable, "-c", _STATION, str(int(number))],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.split() == ["opened", "told", "True", "closed", "ended"]
