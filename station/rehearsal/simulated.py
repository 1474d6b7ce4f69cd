"""A station with prepared shots in this process, for whoever needs one to talk to."""

from __future__ import annotations

import itertools
import tempfile
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from station.cycle import Mode
from station.line.wire import DEFAULT_OPTIONS, BusSettings, LineDatabase, LineOptions, open_bus
from station.rehearsal.prepared import open_rehearsal

SHOT_S = 0.2
_CHANNELS = itertools.count(1)


@contextmanager
def simulated_station(
    database: LineDatabase, shot_s: float = SHOT_S, options: LineOptions = DEFAULT_OPTIONS
) -> Iterator[BusSettings]:
    """Serve in a thread of its own until the end; yields how to reach it.

    Parameters
    ----------
    database
        Of the line.
    shot_s
        How long each wheel takes, seconds.
    options
        Of its line.
    """
    settings = BusSettings(channel=f"simulated-{next(_CHANNELS)}")
    stopping = threading.Event()
    with (
        tempfile.TemporaryDirectory() as folder,
        open_bus(settings) as bus,
        open_rehearsal(
            bus,
            database,
            f"sqlite:///{Path(folder) / 'results.db'}",
            shot_s=shot_s,
            options=replace(options, modes=options.modes | {Mode.SWEEP}),
            acknowledge_s=0.5,
        ) as station,
        ThreadPoolExecutor(1, "station") as pool,
    ):
        served = pool.submit(station.cycle.serve, stopping)
        try:
            yield settings
        finally:
            stopping.set()
            served.result()
