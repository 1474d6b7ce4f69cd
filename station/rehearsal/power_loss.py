"""Both sides of the line killed at every step of a cycle: what is left must be right.

After each end the process is started again. Then the controller has the result that is stored, or a fault;
the database has the whole record, or none; and no verdict was on the bus that is not stored.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import can

from alignment.counting import count_of
from alignment.errors import LineError
from db.records import CycleOutcome, CycleRecord
from db.store import ResultStore
from station.cycle import Outcome, WheelAnswer
from station.line.plc import PlcOrder, PlcSimulator, PlcTimeouts
from station.line.tools import Cable
from station.line.wire import LineDatabase, ProtectedLink, VehicleReport, load_line_database, open_bus
from station.rehearsal.nursery import Nursery
from station.rehearsal.plc_process import PlcProcessOrder
from station.rehearsal.processes import RehearsalProcess, read_lines
from station.rehearsal.station_process import StationOrder

_STATION, _PLC = "station.rehearsal.station_process", "station.rehearsal.plc_process"
_TIMEOUTS = PlcTimeouts(
    connect_s=60.0, ready_s=30.0, busy_s=10.0, done_s=30.0, acknowledged_s=10.0, silence_s=1.5
)
_VERDICTS = (str(Outcome.OK), str(Outcome.NOK))


@dataclass(frozen=True)
class PowerLoss:
    """What a kill at one step left.

    Attributes
    ----------
    step
        Name of the step.
    ended
        How it ended: ``result`` when the controller has the stored result, ``fault`` when it has none, or was
        told a fault that is stored.
    stored
        Whether the database has the record.
    wrong
        What is not as it must be, one sentence each.
    """

    step: str
    ended: str
    stored: bool
    wrong: tuple[str, ...]


@dataclass(frozen=True)
class _Kept:
    """A result that the controller kept before it acknowledged."""

    outcome: str
    cambers_deg: tuple[float | None, ...]

    def __str__(self) -> str:
        return f"{self.outcome} with camber {_in_words(self.cambers_deg)}"


class PowerLossBench:
    """Station and controller over one cable, with one database; use `open_power_loss`."""

    def __init__(self, folder: Path, dbc: Path, cable: Cable, nursery: Nursery) -> None:
        self._folder = folder
        self._nursery = nursery
        self._dbc = dbc
        self._cable = cable
        self._url = f"sqlite:///{folder / 'results.db'}"
        self._database: LineDatabase = load_line_database(dbc)
        self._vehicles = 0

    def station_steps(self) -> list[str]:
        """Names of the steps of a good cycle in the station."""
        with self._station("steps", steps=True), self._plc([]) as plc:
            plc.start_up()
            plc.run(PlcOrder(self._vin()))
        lines = read_lines(self._folder / "steps.jsonl")
        return next(list(line["steps"]) for line in lines if "steps" in line)

    def controller_steps(self) -> list[str]:
        """Names of the steps of a good cycle in the controller."""
        with self._station("steps_plc"):
            self._run_plc(self._vin(), None)
        return next(list(line["steps"]) for line in read_lines(self._journal) if "steps" in line)

    def kill_station(self, step: int, name: str) -> PowerLoss:
        """Kill the station at a step of a cycle, start it again, and look what is left."""
        vin = self._vin()
        report = f"kill_{step}"
        kept: list[_Kept] = []
        with self._plc(kept) as plc, self._witness() as seen:
            with self._station(report, kill_at=step) as station:
                plc.start_up()
                kept.clear()
                try:
                    plc.run(PlcOrder(vin))
                except LineError:
                    # The station is gone, as it should be.
                    station.wait()
            with self._station(report):
                # Held results come first; without any the order has failed.
                plc.start_up()
        record = self._stored(vin)
        wrong = list(_contradictions(kept, record))
        if any(verdict in _VERDICTS for verdict in seen) and record is None:
            wrong.append(f"{', '.join(seen)} went out and nothing is stored")
        ended = "result" if any(result.outcome in _VERDICTS for result in kept) else "fault"
        return PowerLoss(name, ended, record is not None, tuple(wrong))

    def kill_controller(self, step: int, name: str) -> PowerLoss:
        """Kill the controller at a step of a cycle, start it again, and look what is left."""
        vin = self._vin()
        self._journal.unlink(missing_ok=True)
        with self._station(f"kill_plc_{step}"):
            self._run_plc(vin, step)
            self._run_plc(None, None)
        lines = read_lines(self._journal)
        results = [line for line in lines if "result" in line]
        faults = [line for line in lines if "fault" in line]
        ordered = any("order" in line for line in lines)
        record = self._stored(vin)
        wrong = []
        if ordered and len({line["result"] for line in results}) + bool(faults) != 1:
            counts = count_of(len(results), "result"), count_of(len(faults), "fault")
            wrong.append(f"expected one result or one fault, found {' and '.join(counts)}")
        if results and record is None:
            wrong.append("the controller has a result and nothing is stored")
        for line in results:
            if record is not None and not _same_angles(line["camber_deg"], record):
                told, stored = _in_words(line["camber_deg"]), _in_words(_cambers(record))
                wrong.append(f"the controller has {told}, stored is {stored}")
        if not ordered and record is not None:
            wrong.append("a vehicle that was not ordered is stored")
        wrong += _incomplete(record)
        return PowerLoss(name, "result" if results else "fault", record is not None, tuple(wrong))

    @property
    def _journal(self) -> Path:
        return self._folder / "journal.jsonl"

    def _vin(self) -> str:
        self._vehicles += 1
        return f"TWPWRX{self._vehicles:011d}"

    @contextmanager
    def _station(
        self, report: str, steps: bool = False, kill_at: int | None = None
    ) -> Iterator[RehearsalProcess]:
        order = StationOrder(
            "slcan",
            self._cable.ends[0],
            str(self._dbc),
            self._url,
            str(self._folder / f"{report}.jsonl"),
            steps,
            kill_at,
        )
        with RehearsalProcess(_STATION, order, self._nursery) as process:
            yield process

    @contextmanager
    def _plc(self, kept: list[_Kept]) -> Iterator[PlcSimulator]:
        def keep(sequence: int, vehicle: VehicleReport, wheels: tuple[WheelAnswer, ...]) -> None:
            kept.append(_Kept(str(vehicle.outcome), tuple(wheel.camber_deg for wheel in wheels)))

        with (
            open_bus(self._cable.settings(1)) as bus,
            PlcSimulator(bus, self._database, timeouts=_TIMEOUTS, keep=keep) as plc,
        ):
            self._bus = bus
            yield plc

    @contextmanager
    def _witness(self) -> Iterator[list[str]]:
        """Collect the verdicts of vehicles that are on the bus, good frames only."""
        seen: list[str] = []
        link = ProtectedLink(self._bus, self._database, lambda: 0.0)

        def look(frame: can.Message) -> None:
            read = link.read(frame)
            if read is not None and read[0] == "VehicleResult" and read[1]["Outcome"] != "none":
                seen.append(str(read[1]["Outcome"]))

        self._bus.listen(look)
        try:
            yield seen
        finally:
            self._bus.unlisten(look)

    def _run_plc(self, vin: str | None, kill_at: int | None) -> None:
        order = PlcProcessOrder(
            "slcan", self._cable.ends[1], str(self._dbc), str(self._journal), vin, kill_at
        )
        with RehearsalProcess(_PLC, order, self._nursery) as process:
            process.wait(120.0)

    def _stored(self, vin: str) -> CycleRecord | None:
        with ResultStore(self._url) as store:
            cycles = [c.record for c in store.recent_cycles(3)]
        found = [r for r in cycles if r.vehicle is not None and r.vehicle.vin == vin]
        return found[0] if found else None


@contextmanager
def open_power_loss(folder: Path, dbc: Path) -> Iterator[PowerLossBench]:
    """Open a bench whose database, reports and journal are in the folder."""
    with Nursery(_STATION, _PLC) as nursery, Cable() as cable:
        yield PowerLossBench(folder, dbc, cable, nursery)


def kill_all(
    steps: Iterable[tuple[int, str]],
    kill: Callable[[int, str], PowerLoss],
    progress: Callable[[str], None],
) -> list[PowerLoss]:
    """Kill at each of some steps."""
    found = []
    for number, name in steps:
        progress(name)
        found.append(kill(number, name))
    return found


def _contradictions(kept: list[_Kept], record: CycleRecord | None) -> Iterator[str]:
    if kept and record is None:
        yield f"the controller has {' and '.join(map(str, kept))} and nothing is stored"
    if record is not None and not kept:
        yield f"stored is {record.outcome} and the controller has nothing"
    for result in kept if record is not None else []:
        assert record is not None
        if result.outcome != str(record.outcome):
            yield f"the controller has {result.outcome}, stored is {record.outcome}"
        told_nothing = record.outcome is CycleOutcome.FAULT and set(result.cambers_deg) == {None}
        if not told_nothing and not _same_angles(result.cambers_deg, record):
            told, stored = _in_words(result.cambers_deg), _in_words(_cambers(record))
            yield f"the controller has {told}, stored is {stored}"
    yield from _incomplete(record)


def _incomplete(record: CycleRecord | None) -> list[str]:
    if record is None or ((len(record.wheels), len(record.axles)) == (4, 2) and record.vehicle_angles):
        return []
    if record.outcome is CycleOutcome.FAULT and len(record.wheels) == 4:
        # What the line was told where it is not certain that the results were stored in time.
        return []
    return [f"a part of the record is missing: {len(record.wheels)} wheels, {len(record.axles)} axles"]


def _cambers(record: CycleRecord) -> list[float | None]:
    wheels = {wheel.wheel: wheel.camber for wheel in record.wheels}
    names = ("front_left", "front_right", "rear_left", "rear_right")
    return [None if (angle := wheels.get(name)) is None else math.degrees(angle) for name in names]


def _in_words(cambers_deg: Iterable[float | None]) -> str:
    return ", ".join("none" if angle is None else f"{angle:.4f}°" for angle in cambers_deg)


def _same_angles(cambers_deg: Sequence[float | None], record: CycleRecord) -> bool:
    pairs = zip(cambers_deg, _cambers(record), strict=True)
    return all(a is not None and b is not None and abs(a - b) <= 1e-4 for a, b in pairs)
