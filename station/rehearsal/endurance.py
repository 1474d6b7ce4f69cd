"""Many cycles between a station and a controller in two processes, over a cable of pseudo-terminals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from db.store import ResultStore
from station.cycle import Outcome
from station.line.plc import PlcOrder, PlcResult, PlcSimulator, PlcTimeouts
from station.line.tools import Cable
from station.line.wire import load_line_database, open_bus
from station.rehearsal.prepared import prepared_angles_deg
from station.rehearsal.processes import RehearsalProcess, read_lines, rss_mb
from station.rehearsal.station_process import StationOrder

SETTLED = 1000
_MODULE = "station.rehearsal.station_process"
# A computer that does other work at the same time must not end the run.
TIMEOUTS = PlcTimeouts(busy_s=20.0, done_s=60.0, ready_s=60.0, acknowledged_s=20.0, silence_s=10.0)


@dataclass(frozen=True)
class CycleTimes:
    """Of one cycle, seconds: start sent to busy seen, commit to first result seen, commit to all seen."""

    busy_s: float
    first_result_s: float
    all_results_s: float


@dataclass(frozen=True)
class Endurance:
    """What came of the cycles.

    Attributes
    ----------
    wrong
        Sentences about results that were lost, doubled, of another cycle, or not as stored.
    times
        Of every cycle.
    station_rss_mb, controller_rss_mb
        Memory of both processes after every cycle.
    """

    cycles: int
    wrong: tuple[str, ...]
    times: tuple[CycleTimes, ...]
    station_rss_mb: tuple[float, ...]
    controller_rss_mb: tuple[float, ...]

    def growth_mb(self, settled: int) -> tuple[float, float]:
        """Growth of both after so many cycles: the highest memory later on, less that of then."""
        index = min(settled, self.cycles) - 1
        station, controller = self.station_rss_mb, self.controller_rss_mb
        return max(station[index:]) - station[index], max(controller[index:]) - controller[index]

    def percentile_ms(self, name: str, percent: float) -> float:
        """Percentile of one of the times of `CycleTimes`, milliseconds."""
        return float(np.percentile([1e3 * getattr(times, name) for times in self.times], percent))


def vin_of(number: int) -> str:
    """VIN of the n-th vehicle."""
    return f"TWREHX{number:011d}"


def run_endurance(folder: Path, dbc: Path, cycles: int, progress: Callable[[int], None]) -> Endurance:
    """Run cycles; the station's database and report stay in the folder.

    Raises
    ------
    TruewheelError
        When a cycle fails.
    """
    url, report = f"sqlite:///{folder / 'results.db'}", folder / "station.jsonl"
    results: list[tuple[int, Outcome, float | None]] = []
    # Filled beforehand, so that the notes of the study itself do not look like growth of the controller.
    times, memory = np.full((cycles, 4), np.nan), np.full((cycles, 2), np.nan)
    database = load_line_database(dbc)
    with Cable() as cable:
        order = StationOrder(
            "slcan", cable.ends[0], str(dbc), url, str(report), communication_timeout_s=TIMEOUTS.silence_s
        )
        with (
            RehearsalProcess(_MODULE, order) as station,
            open_bus(cable.settings(1)) as bus,
            PlcSimulator(bus, database, timeouts=TIMEOUTS) as plc,
        ):
            plc.start_up()
            for number in range(cycles):
                result = plc.run(PlcOrder(vin_of(number)))
                results.append((result.sequence, result.vehicle.outcome, result.wheels[0].camber_deg))
                times[number] = _seen(result)
                memory[number] = station.rss_mb, rss_mb()
                progress(number + 1)
    commits = [line["committed_s"] for line in read_lines(report) if "committed_s" in line]
    return Endurance(
        cycles,
        tuple(_wrong(results, url, len(commits))),
        tuple(
            CycleTimes(busy - started, first - committed, done - committed)
            for (started, busy, first, done), committed in zip(times.tolist(), commits, strict=False)
        ),
        tuple(memory[:, 0].tolist()),
        tuple(memory[:, 1].tolist()),
    )


def _seen(result: PlcResult) -> tuple[float, float, float, float]:
    first = min(
        message.time_s
        for message in result.received
        if "Uncertainty" in message.name and message.values["Sequence"] == result.sequence
    )
    return result.started_s, result.busy_s, first, max(first, result.done_s)


def _wrong(results: list[tuple[int, Outcome, float | None]], url: str, commits: int) -> list[str]:
    wrong = [] if commits == len(results) else [f"{commits} commits for {len(results)} results"]
    with ResultStore(url) as store:
        stored = [cycle.record for cycle in reversed(store.recent_cycles(len(results) + 1))]
    if len(stored) != len(results):
        wrong.append(f"{len(stored)} cycles stored for {len(results)} results")
    for number, ((sequence, outcome, camber), record) in enumerate(zip(results, stored, strict=False)):
        expected, _ = prepared_angles_deg(number + 1)
        vin = record.vehicle.vin if record.vehicle else None
        if camber is None or abs(camber - expected) > 1e-4:
            wrong.append(f"cycle {number}: camber {camber}, expected {expected}")
        if (vin, record.trigger_sequence) != (vin_of(number), sequence):
            wrong.append(f"cycle {number}: stored as {vin}, start {record.trigger_sequence}")
        if str(outcome) != str(record.outcome):
            wrong.append(f"cycle {number}: told {outcome}, stored {record.outcome}")
    return wrong
