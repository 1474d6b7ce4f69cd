"""Random and mutated frames on the line while cycles run; no crash, and no verdict that comes of nothing.

Three ends on one virtual bus: a station with prepared shots, a controller, and a source of noise of six
kinds, see `Noise`. On the station's own identifiers it flips one to three bits, which the CRC must find every
time; on the controller's identifiers it is also wholly random. Of that one frame in 256 has a right CRC by
chance, and one in 1280 the right counter too: such a frame is a command like any other, and the station must
answer it in a defined way.
"""

from __future__ import annotations

import itertools
import threading
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

import can

from alignment.errors import LineError
from db.records import CycleOutcome
from db.store import ResultStore
from station.cycle import CycleReport, Observer, Outcome
from station.line.plc import PlcOrder, PlcResult, PlcSimulator, PlcTimeouts
from station.line.wire import (
    BusSettings,
    LineBus,
    LineDatabase,
    LineHealth,
    LineOptions,
    LineStatus,
    load_line_database,
    open_bus,
    read_status,
)
from station.rehearsal.prepared import open_rehearsal

NOISE_KINDS = ("random", "flipped", "replayed", "length", "strange", "foreign")
_TIMEOUTS = PlcTimeouts(
    connect_s=30.0, ready_s=5.0, busy_s=1.0, done_s=5.0, acknowledged_s=2.0, silence_s=5.0
)
_OPTIONS = LineOptions(communication_timeout_s=5.0)
_REMEMBERED, _AHEAD = 64, 200
_CATCH_UP_S = 30.0
# A frame takes 0.2 ms on a bus of 500 kbit/s; the noise comes about as fast.
_PAUSE_S = 0.01
_CHANNELS = itertools.count(1)


class Noise:
    """Makes frames: random, real with flipped bits, repeated, of wrong length, of a strange kind, foreign.

    Parameters
    ----------
    database
        Of the line.
    rng
        All its choices.
    """

    def __init__(self, database: LineDatabase, rng: Random) -> None:
        self._rng = rng
        self._heard: list[can.Message] = []
        asked = database.messages_from("PLC")
        self._asked = [m.frame_id for m in database.definition.messages if m.name in asked]

    def hear(self, frame: can.Message) -> None:
        """Remember a real frame."""
        self._heard = [*self._heard[1 - _REMEMBERED :], frame]

    def make(self, kind: str) -> can.Message:
        """One frame of a kind."""
        rng, heard = self._rng, self._heard
        identifier = rng.choice(self._asked)
        data = bytearray(rng.randbytes(8))
        if kind in ("flipped", "replayed") and heard:
            real = rng.choice(heard)
            identifier, data = real.arbitration_id, bytearray(real.data)
            if kind == "flipped":
                for bit in rng.sample(range(8 * len(data)), min(rng.randint(1, 3), 8 * len(data))):
                    data[bit // 8] ^= 1 << bit % 8
        elif kind == "length":
            data = bytearray(rng.randbytes(rng.randint(0, 7)))
        elif kind == "foreign":
            identifier = rng.randrange(0x400, 0x800)
        if kind == "strange":
            remote = rng.random() < 0.5
            return can.Message(
                arbitration_id=identifier,
                is_extended_id=rng.random() < 0.5,
                is_remote_frame=remote,
                is_error_frame=not remote and rng.random() < 0.5,
                data=None if remote else data,
                dlc=8,
            )
        return can.Message(arbitration_id=identifier, is_extended_id=False, data=data)


@dataclass
class NoiseReport:
    """What came of it.

    Attributes
    ----------
    frames
        Frames of noise by kind.
    good_cycles, failed_cycles
        Cycles that the controller finished, and that the noise ended: by a reset, an abort or a start that
        was a right one by chance, or by a lost communication.
    wrong
        What must not be, one sentence each.
    health
        Of the station's line at the end.
    """

    frames: Counter[str] = field(default_factory=Counter)
    good_cycles: int = 0
    failed_cycles: int = 0
    wrong: list[str] = field(default_factory=list)
    health: LineHealth | None = None


class _Watch(Observer):
    def __init__(self, wrong: list[str]) -> None:
        self._wrong = wrong

    def cycle_done(self, report: CycleReport) -> None:
        committed = report.committed_s is not None and report.record.outcome is CycleOutcome.OK
        if report.told is Outcome.OK and not committed:
            self._wrong.append(f"start {report.trigger.sequence} was told ok and is {report.record.outcome}")


def run_noise(
    folder: Path, dbc: Path, frames: int, seed: int, progress: Callable[[int], None]
) -> NoiseReport:
    """Send so many frames of noise while cycles run; the database stays in the folder.

    Raises
    ------
    LineError
        When a receiving thread does not keep up: it hangs or has died.
    """
    database = load_line_database(dbc)
    url = f"sqlite:///{folder / 'noise.db'}"
    settings = BusSettings(channel=f"noise-{next(_CHANNELS)}")
    report, stopping, over = NoiseReport(), threading.Event(), threading.Event()
    results: list[PlcResult] = []
    with (
        open_bus(settings) as station_bus,
        open_bus(settings) as plc_bus,
        open_bus(settings) as noise_bus,
        open_rehearsal(
            station_bus, database, url, observer=_Watch(report.wrong), options=_OPTIONS, acknowledge_s=0.5
        ) as station,
        ThreadPoolExecutor(2, "noise") as pool,
    ):
        noise = Noise(database, Random(seed))
        noise_bus.listen(noise.hear)
        noise_bus.listen(_status_watch(database, report.wrong))
        served = pool.submit(station.cycle.serve, stopping)
        ordered = pool.submit(_order_on, plc_bus, database, over, report, results)
        try:
            _make_noise(noise, noise_bus, (station_bus, plc_bus), frames, report, Random(seed + 1), progress)
        finally:
            over.set()
            ordered.result()
            stopping.set()
        served.result()
        report.health = station.line.health
    report.wrong += _not_stored(results, url)
    return report


def _make_noise(
    noise: Noise,
    bus: LineBus,
    receivers: tuple[LineBus, ...],
    frames: int,
    report: NoiseReport,
    rng: Random,
    progress: Callable[[int], None],
) -> None:
    wait = threading.Event()
    # What is repeated and flipped is then a cycle's traffic.
    _wait_until(lambda: report.good_cycles > 0, "expected a good cycle before the noise, found none")
    for number in range(1, frames + 1):
        kind = rng.choice(NOISE_KINDS)
        bus.send(noise.make(kind))
        report.frames[kind] += 1
        if number % _AHEAD == 0:
            # Nobody may be drowned: on a real bus a frame takes its time.
            _wait_until(
                lambda: min(receiver.health.received for receiver in receivers) >= report.frames.total(),
                f"expected both receivers to take {number} frames, but one hangs",
            )
            wait.wait(_PAUSE_S)
            progress(number)
    good = report.good_cycles
    _wait_until(
        lambda: report.good_cycles > good, f"expected a good cycle after the noise; {good} came before"
    )


def _wait_until(reached: Callable[[], bool], problem: str) -> None:
    wait = threading.Event()
    for _ in range(int(_CATCH_UP_S / 0.001)):
        if reached():
            return
        wait.wait(0.001)
    raise LineError(problem)


def _order_on(
    bus: LineBus, database: LineDatabase, over: threading.Event, report: NoiseReport, results: list[PlcResult]
) -> None:
    """Measure vehicle after vehicle; what the noise ends is begun anew."""
    with PlcSimulator(bus, database, timeouts=_TIMEOUTS) as plc:
        while not over.is_set():
            try:
                plc.start_up()
                while not over.is_set():
                    results.append(plc.run(PlcOrder(f"TWNXSE{len(results):011d}")))
                    report.good_cycles += 1
            except LineError:
                report.failed_cycles += 1


def _status_watch(database: LineDatabase, wrong: list[str]) -> Callable[[can.Message], None]:
    def look(frame: can.Message) -> None:
        if database.name_of(frame) != "Status":
            return
        status = read_status(database.decode(frame))
        if problem := contradiction(status):
            wrong.append(f"{problem}: {status}")

    return look


def contradiction(status: LineStatus) -> str | None:
    """What of a Status cannot be true together; None when all can."""
    if status.ready and (status.busy or status.done or status.fault):
        return "ready with something in hand"
    if status.busy and status.done:
        return "busy and done"
    return None


def _not_stored(results: list[PlcResult], url: str) -> list[str]:
    """Results that the controller has and the database has not."""
    with ResultStore(url) as store:
        stored = {
            (cycle.record.vehicle.vin, cycle.record.trigger_sequence): str(cycle.record.outcome)
            for cycle in store.recent_cycles(10 * len(results) + 100)
            if cycle.record.vehicle is not None
        }
    wrong = []
    for result in results:
        assert result.order is not None
        outcome = str(result.vehicle.outcome)
        if outcome in ("ok", "nok") and stored.get((result.order.vin, result.sequence)) != outcome:
            wrong.append(f"{result.order.vin}, start {result.sequence}: told {outcome}, which is not stored")
    return wrong
