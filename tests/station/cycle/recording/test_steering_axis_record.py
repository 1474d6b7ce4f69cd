"""Records of steering axes: whatever a sweep says of them can be stored."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from alignment.vehicle import SteeringAxis
from db.records import CycleOutcome, Verdict
from db.store import ResultStore
from station.configuration.steering import SteeringAxisTolerances
from station.cycle.judging.steering_axes import JudgedAxis, SweepFound
from station.cycle.judging.verdict import Angle
from station.cycle.recording.steering_axis_record import axis_records, with_differences
from tests.db.example_records import CALIBRATION, cycle, wheel

VALUES = {"caster": 0.08, "kpi": 0.2, "included_angle": 0.19, "camber": -0.01, "trail": 20.0, "scrub": -8.0}
LIMITS = SteeringAxisTolerances.model_validate({"caster": {"nominal_deg": 4.5, "tolerance_deg": 0.75}})


def axis(warning: str | None) -> SteeringAxis:
    return SteeringAxis(
        side="left", direction=np.array([0.0, 0.0, 1.0]), point=np.zeros(3), values=VALUES,
        covariance=np.eye(6) * 1e-8, angles=np.zeros(9), toes=np.zeros(9), straight_toe=0.0,
        residuals=np.zeros(9), scatter=1.25, axial_mm=np.zeros(9), pattern=0.0, pattern_p=1.0,
        warning=warning, classic_caster=0.08,
    )  # fmt: skip


def judged(found: SteeringAxis | str) -> SweepFound:
    angles = {}
    for name in ("caster", "kpi", "trail"):
        tolerance = LIMITS.stated.get(name)
        angle = Angle(f"front_left.{name}", None if tolerance is None else tolerance.limits())
        if isinstance(found, SteeringAxis):
            angle = angle.measured(found.value(name), 2.0 * found.u(name), calibration_valid=True)
        angles[name] = angle
    return SweepFound((JudgedAxis("front_left", found, 9, angles),), {})


@pytest.mark.parametrize("warning", [None, "the axis moves while it is turned"])
def test_an_axis_that_moves_is_stored_with_what_speaks_against_it(
    tmp_path: Path, warning: str | None
) -> None:
    """The warning was stored as a reason without its code, which no database takes: the cycle was lost."""
    (record,) = axis_records(judged(axis(warning)), guard_band=True, coverage_factor=2.0)
    assert (record.warning, record.reason_code, record.reason_text) == (warning, None, None)
    assert (record.verdict, record.residual, record.positions) == (Verdict.OK, 1.25, 9)
    assert (record.caster, record.caster_u) == (0.08, pytest.approx(1e-4))
    assert stored(tmp_path, steering_axes=(record,)).steering_axes == (record,)


def test_an_axis_that_was_refused_is_stored_with_its_reason_and_its_limits(tmp_path: Path) -> None:
    found = judged("the steering was turned by 2.0° only")
    (record,) = axis_records(found, guard_band=True, coverage_factor=2.0)
    assert (record.verdict, record.caster, record.warning) == (Verdict.NONE, None, None)
    assert record.reason_text == "the steering was turned by 2.0° only"
    assert record.caster_low is not None
    fault = {"outcome": CycleOutcome.FAULT, "reason_code": "sweep_fault", "reason_text": "no axis"}
    assert stored(tmp_path, steering_axes=(record,), **fault).steering_axes == (record,)
    assert with_differences(None, found, guard_band=True, coverage_factor=2.0) is None


def stored(folder: Path, **changes: Any) -> Any:
    record = cycle(wheels=(wheel(),), axles=(), vehicle_angles=None, **changes)
    with ResultStore(f"sqlite:///{folder / 'r.db'}", create=True) as store:
        store.record_calibration(CALIBRATION)
        store.write_cycle(record)
        found = store.cycle(record.uuid)
    assert found is not None
    return found.record
