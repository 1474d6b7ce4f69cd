"""The record of a vehicle's geometry: what was measured, against which limits, and what it refers to."""

from __future__ import annotations

import math
from typing import Any

from alignment.vehicle import TYRE_WIDTH, VehicleGeometry
from db.records import GEOMETRY_LIMITED, OF_GEOMETRY, GeometryRecord
from station.cycle.judging.evaluation import Evaluation
from station.cycle.judging.verdict import combined


def geometry_record(evaluation: Evaluation) -> GeometryRecord | None:
    """Return the record of a vehicle in a frame of its own.

    None where the rigs stand in no common frame, or nothing of it was measured and nothing has limits.
    """
    vehicle = evaluation.vehicle
    if vehicle is None or (vehicle.geometry is None and not vehicle.lengths):
        return None
    judged = {each.name: each.limits for each in vehicle.lengths}
    values: dict[str, Any] = {}
    for name in GEOMETRY_LIMITED:
        limits = judged.get(name)
        if limits is not None:
            values |= {f"{name}_low": limits.low, f"{name}_high": limits.high}
    found = vehicle.geometry
    if found is not None:
        for name in OF_GEOMETRY:
            values |= {str(name): found.value(name), f"{name}_u": found.u(name)}
        values["thrust_angle_tyre_u"] = tyre_u(found, "thrust_angle")
    return GeometryRecord(
        # Without the vehicle's own centreline the toes that there are refer to the stand.
        reference="stand" if found is None else evaluation.reference,
        end_points=None if found is None else found.between,
        verdict=combined(vehicle.lengths).verdict,
        guard_band=evaluation.guard_band,
        coverage_factor=evaluation.coverage_factor,
        **values,
    )


def tyre_u(geometry: VehicleGeometry, name: str) -> float:
    """Return what the spread of tyre widths makes of a quantity's standard uncertainty, in its unit."""
    return math.sqrt(geometry.share(name, TYRE_WIDTH)) * geometry.u(name)
