"""What a database says of a wheel is turned back into what was measured in front of its rig."""

from __future__ import annotations

import pytest

from station.replay.stored import _values
from tests.station.cycle.test_vehicle_frame import bench_of


@pytest.mark.parametrize("yaw_deg", [0.1, -0.4])
@pytest.mark.parametrize("reference", ["vehicle", "stand", None])
def test_toe_against_the_centreline_is_turned_back_into_the_stand_s(reference: str, yaw_deg: float) -> None:
    with bench_of(reference, yaw_deg) as bench:  # type: ignore[arg-type]
        report = bench.trigger()
    assert report is not None
    for wheel, judged in zip(report.record.wheels, report.evaluation.wheels, strict=True):
        assert wheel.wheel == judged.result.wheel
        measured = judged.result.measurement
        assert measured is not None
        values, loose = _values(report.record, wheel)
        if reference == "vehicle":
            assert wheel.toe != pytest.approx(measured.toe, abs=1e-4)
            assert abs(values["camber"] - measured.camber) <= loose["camber"]
            assert abs(values["toe"] - measured.toe) <= loose["toe"]
            # They have parts of the other wheels in the vehicle's own frame.
            assert {"camber_u", "toe_u"}.isdisjoint(values)
        else:
            assert loose == {}
            names = ("camber", "toe", "camber_u", "toe_u", "points_used", "knock_evidence")
            assert [values[name] for name in names] == [getattr(measured, name) for name in names]
