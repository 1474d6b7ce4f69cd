"""A line on the virtual bus: the station's end, the controller's end."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Iterator

import pytest

from station.line.interface import StationLine
from station.line.wire.bus import LineBus, open_bus
from station.line.wire.channel import BusSettings
from station.line.wire.dbc import LineDatabase, load_line_database
from tests.station.line.line_bench import DBC, Bench, Clock, FakeCanBus

_channels = (f"test-{number}" for number in itertools.count())


@pytest.fixture(scope="session")
def database() -> LineDatabase:
    return load_line_database(DBC)


@pytest.fixture(autouse=True)
def no_line_threads_left() -> Iterator[None]:
    yield
    assert [t.name for t in threading.enumerate() if t.name.startswith("line ")] == []


@pytest.fixture
def channel() -> str:
    return next(_channels)


@pytest.fixture
def station_bus(channel: str) -> Iterator[LineBus]:
    with open_bus(BusSettings(channel=channel)) as bus:
        yield bus


@pytest.fixture
def plc_bus(channel: str) -> Iterator[LineBus]:
    with open_bus(BusSettings(channel=channel)) as bus:
        yield bus


@pytest.fixture
def bench(database: LineDatabase) -> Iterator[Bench]:
    fake, clock = FakeCanBus(), Clock()
    with LineBus(lambda: fake) as bus:
        line = StationLine(bus, database, clock)
        bench = Bench(database, fake, bus, clock, line)
        bench.idle()
        yield bench
        line.close()
