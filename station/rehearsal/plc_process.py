"""A controller as a process of its own: ``python -m station.rehearsal.plc_process JSON``.

It keeps a journal as a careful controller would: an order before its start goes out, a result before it is
acknowledged. After a restart it takes over what the station holds, writes a fault for an order that has no
result, and goes on.
"""

from __future__ import annotations

import json
import os
import sys
from dataclasses import dataclass
from pathlib import Path

from alignment.errors import LineError
from station.cycle import WheelAnswer
from station.line.plc import PlcOrder, PlcSimulator, PlcTimeouts
from station.line.wire import Channel, LineBus, VehicleReport, load_line_database
from station.rehearsal.cable_settings import settings_of
from station.rehearsal.processes import read_lines
from station.rehearsal.steps import SteppedBus, Steps

_TIMEOUTS = PlcTimeouts(connect_s=30.0, busy_s=10.0, done_s=30.0, acknowledged_s=10.0, silence_s=5.0)


@dataclass(frozen=True)
class PlcProcessOrder:
    """What the controller's process is told: end of the bus, DBC, journal, vehicle, and the step of its end.

    Without a VIN it only takes over what the station holds.
    """

    interface: str
    channel: str
    dbc: str
    journal: str
    vin: str | None
    kill_at: int | None = None


class _Journal:
    def __init__(self, file: Path, steps: Steps) -> None:
        self._file = file
        self._steps = steps

    def write(self, **values: object) -> None:
        """Append a line that survives the end of the process."""
        self._steps.step(f"before journal {next(iter(values))}")
        with self._file.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(values) + "\n")
            stream.flush()
            os.fsync(stream.fileno())
        self._steps.step(f"after journal {next(iter(values))}")

    def keep(self, sequence: int, vehicle: VehicleReport, wheels: tuple[WheelAnswer, ...]) -> None:
        """Keep a result."""
        self.write(result=str(vehicle.outcome), sequence=sequence, camber_deg=[w.camber_deg for w in wheels])

    def open_orders(self) -> list[dict[str, object]]:
        """Orders that have neither result nor fault."""
        lines = read_lines(self._file)
        closed = {line["sequence"] for line in lines if "order" not in line}
        return [line for line in lines if "order" in line and line["sequence"] not in closed]


def run(order: PlcProcessOrder) -> None:
    """Take over what is held, then measure the vehicle."""
    steps = Steps(order.kill_at)
    channel = Channel(settings_of(order.interface, order.channel))
    journal = _Journal(Path(order.journal), steps)
    database = load_line_database(order.dbc)
    with (
        LineBus(lambda: SteppedBus(channel(), steps), released=channel.release) as bus,
        PlcSimulator(bus, database, timeouts=_TIMEOUTS, keep=journal.keep) as plc,
    ):
        sys.stdout.write("ready\n")
        sys.stdout.flush()
        plc.start_up()
        for left in journal.open_orders():
            journal.write(fault=left["order"], sequence=left["sequence"])
        if order.vin is None:
            return
        steps.begin()
        sequence = plc.next_sequence
        journal.write(order=order.vin, sequence=sequence)
        try:
            plc.run(PlcOrder(order.vin))
        except LineError as error:
            journal.write(fault=order.vin, sequence=sequence, text=str(error))
        steps.end()
        journal.write(steps=steps.names, sequence=0)


def main() -> None:
    """Run the process."""
    run(PlcProcessOrder(**json.loads(sys.argv[1])))


if __name__ == "__main__":
    main()
