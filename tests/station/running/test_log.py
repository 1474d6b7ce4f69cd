"""What the station's log says of a vehicle, for whoever reads it in the morning."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator

import pytest

from station.configuration.vehicle_types import VehicleType
from station.cycle.ports import CycleReport
from station.running.app import _Log
from tests.station.bench import Bench, measurement, open_bench
from tests.station.cycle.test_turning_wheels import SPUN, TURNING, opened
from tests.station.cycle.test_vehicle_frame import bench_of, seen


@pytest.fixture
def bench() -> Iterator[Bench]:
    with open_bench() as bench:
        yield bench


def log_of(bench: Bench, caplog: pytest.LogCaptureFixture, vehicle_type: int = 1) -> str:
    caplog.set_level(logging.INFO, "truewheel.station")
    report = bench.trigger(vehicle_type=vehicle_type)
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


def test_length_and_run_out_beyond_their_limits_are_named_in_millimetres(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """A length was logged as an angle: 2706 mm as 155042°; a run-out was not logged as a reason at all."""
    with bench_of("vehicle", 0.1) as bench:
        bench.found = dict(seen(0.1, {"front_left": (5.0, 0.0), "rear_left": (-1.0, 0.0)}))
        said = log_of(bench, caplog)
    assert re.search(r": nok \(.*wheelbase_difference is 6\.0\d\d ± 0\.\d{3} mm, accepted are", said), said
    assert "wheelbase_difference +" not in said
    axle = SPUN | {"run_out_mm": 1.9}
    kind = VehicleType.model_validate(
        TURNING.model_dump(exclude_none=True) | {"axles": {"front": axle, "rear": axle}}
    )
    with opened(types={3: kind}) as turning:
        said = log_of(turning, caplog, vehicle_type=3)
    assert re.search(r": nok \(.*rear_right run-out 1\.9\d\d ± 0\.\d{3} mm, limit 1\.9 mm", said), said


def test_good_vehicle_has_nothing_in_brackets(bench: Bench, caplog: pytest.LogCaptureFixture) -> None:
    assert re.search(r"VIN \w{17}: ok, line was told ok$", log_of(bench, caplog))
