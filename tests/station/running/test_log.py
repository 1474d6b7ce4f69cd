"""What the station's log says of a vehicle, for whoever reads it in the morning."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator

import pytest

from station.cycle.ports import CycleReport
from station.running.app import _Log
from tests.station.bench import Bench, measurement, open_bench


@pytest.fixture
def bench() -> Iterator[Bench]:
    with open_bench() as bench:
        yield bench


def log_of(bench: Bench, caplog: pytest.LogCaptureFixture) -> str:
    caplog.set_level(logging.INFO, "truewheel.station")
    report = bench.trigger()
    assert isinstance(report, CycleReport)
    caplog.clear()
    _Log().cycle_done(report)
    [record] = caplog.records
    return record.message


def test_vehicle_out_of_limits_is_named_with_wheel_angle_value_and_limits(
    bench: Bench, caplog: pytest.LogCaptureFixture
) -> None:
    """It said "nok" and nothing else: which wheel, which angle and by how much stood in the database only."""
    bench.found["rear_left"] = measurement(toe=0.1)
    said = log_of(bench, caplog)
    assert re.search(
        r": nok \(rear_left toe \+5\.7296°, limits -\d\.\d{4}° to \+\d\.\d{4}°; .*\), line was told nok$",
        said,
    ), said
    assert "rear total_toe +5.7869°" in said
    assert "front" not in said


def test_good_vehicle_has_nothing_in_brackets(bench: Bench, caplog: pytest.LogCaptureFixture) -> None:
    assert re.search(r"VIN \w{17}: ok, line was told ok$", log_of(bench, caplog))
