"""The records of a sweep: the steering axis of each wheel, and the differences beside the steering wheel."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from alignment.vehicle import SteeringAxis
from db.records import SteeringAxisRecord, SteeringRecord, Verdict
from station.cycle.judging import Angle, JudgedAxis, SweepFound, combined

_METHOD = "sweep/normals"
_NO_AXIS = "no_steering_axis"


def axis_records(
    found: SweepFound, *, guard_band: bool, coverage_factor: float
) -> tuple[SteeringAxisRecord, ...]:
    """Return one record for each steered wheel that was asked for."""
    return tuple(_record(axis, guard_band, coverage_factor) for axis in found.axes)


def with_differences(
    steering: SteeringRecord | None, found: SweepFound, *, guard_band: bool, coverage_factor: float
) -> SteeringRecord | None:
    """Return the record of the steering wheel with the differences of the axes, where there are any."""
    if not found.differences:
        return steering
    steering = steering or SteeringRecord("not_asked", guard_band=guard_band, coverage_factor=coverage_factor)
    status = combined(angle for angle in found.differences.values() if angle.limits is not None)
    verdicts = {steering.verdict, status.verdict}
    verdict = next((v for v in (Verdict.NOK, Verdict.OK) if v in verdicts), Verdict.NONE)
    return replace(steering, verdict=verdict, **_columns(found.differences, coverage_factor))


def _record(axis: JudgedAxis, guard_band: bool, coverage_factor: float) -> SteeringAxisRecord:
    found = axis.found
    refused = isinstance(found, str)
    return SteeringAxisRecord(
        wheel=axis.wheel,
        verdict=axis.status.verdict,
        guard_band=guard_band,
        coverage_factor=coverage_factor,
        method=None if refused else _METHOD,
        positions=axis.positions,
        residual=float(found.scatter) if isinstance(found, SteeringAxis) else None,
        reason_code=_NO_AXIS if refused else None,
        warning=found.warning if isinstance(found, SteeringAxis) else None,
        reason_text=found if isinstance(found, str) else None,
        **_columns(axis.angles, coverage_factor),
    )


def _columns(angles: Mapping[str, Angle], coverage_factor: float) -> dict[str, Any]:
    return dict(_pairs(angles, coverage_factor))


def _pairs(angles: Mapping[str, Angle], coverage_factor: float) -> Iterator[tuple[str, float | None]]:
    for name, angle in angles.items():
        u95 = angle.expanded_uncertainty
        yield name, None if angle.value is None else float(angle.value)
        yield f"{name}_u", None if u95 is None else float(u95) / coverage_factor
        yield f"{name}_low", None if angle.limits is None else angle.limits.low
        yield f"{name}_high", None if angle.limits is None else angle.limits.high
