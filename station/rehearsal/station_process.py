"""A station with prepared shots as a process: ``python -m station.rehearsal.station_process JSON``.

Serves until its standard input ends. Writes one JSON line per cycle to its report: the number of the start,
when the commit returned, and at the end the steps, if it counted them.
"""

from __future__ import annotations

import json
import sys
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import IO, cast

from station.cycle import CycleReport, Line, Observer, StationState, Store
from station.line.wire import Channel, LineBus, LineOptions, load_line_database
from station.rehearsal.cable_settings import settings_of
from station.rehearsal.prepared import open_rehearsal
from station.rehearsal.steps import Stepped, SteppedBus, Steps


@dataclass(frozen=True)
class StationOrder:
    """What the station's process is told.

    Attributes
    ----------
    interface, channel
        Its end of the bus.
    dbc, database
        File of the DBC, URL of the result database.
    report
        File that it appends to.
    steps
        Whether it counts the steps of the first cycle.
    kill_at
        Step at which it kills itself.
    communication_timeout_s
        Without a good Command frame for so long the controller is lost; None takes the DBC's timeout.
    """

    interface: str
    channel: str
    dbc: str
    database: str
    report: str
    steps: bool = False
    kill_at: int | None = None
    communication_timeout_s: float | None = None


class _Report(Observer):
    def __init__(self, file: IO[str], steps: Steps) -> None:
        self._file = file
        self._steps = steps
        self._begun = False

    def cycle_done(self, report: CycleReport) -> None:
        self._begun = True
        self.write(sequence=report.trigger.sequence, committed_s=report.committed_s)

    def entered(self, state: StationState) -> None:
        if state is StationState.IDLE and self._begun:
            self._steps.end()
            self.write(steps=self._steps.names)
            self._begun = False

    def write(self, **values: object) -> None:
        self._file.write(json.dumps(values) + "\n")
        self._file.flush()


def serve(order: StationOrder, stopping: threading.Event) -> None:
    """Serve until told to stop."""
    steps = Steps(order.kill_at)
    counting = order.steps or order.kill_at is not None
    if counting:
        steps.watch_database()
    channel = Channel(settings_of(order.interface, order.channel))

    def opened() -> SteppedBus:
        return SteppedBus(channel(), steps)

    def wrapped(line: Line, store: Store) -> tuple[Line, Store]:
        if not counting:
            return line, store
        return cast("Line", Stepped(line, steps)), cast("Store", Stepped(store, steps))

    database = load_line_database(order.dbc)
    with (
        Path(order.report).open("a", encoding="utf-8") as file,
        LineBus(opened if counting else channel, released=channel.release) as bus,
        open_rehearsal(
            bus,
            database,
            order.database,
            observer=_Report(file, steps),
            options=LineOptions(communication_timeout_s=order.communication_timeout_s),
            wrapped=wrapped,
        ) as station,
    ):
        sys.stdout.write("ready\n")
        sys.stdout.flush()
        station.cycle.serve(stopping)


def main() -> None:
    """Run the process."""
    order = StationOrder(**json.loads(sys.argv[1]))
    stopping = threading.Event()

    def wait_for_the_end() -> None:
        try:
            sys.stdin.buffer.read()
        finally:
            # Whatever was wrong with what came, the station must not be left without an end.
            stopping.set()

    threading.Thread(target=wait_for_the_end, name="line stdin", daemon=True).start()
    serve(order, stopping)


if __name__ == "__main__":
    main()
