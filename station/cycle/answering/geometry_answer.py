"""What the line is told of a vehicle's geometry: nothing but what the record says."""

from __future__ import annotations

import math
from collections.abc import Iterator

from alignment.units import in_degrees
from alignment.vehicle import LENGTHS
from db.records import AngleVerdict, CycleRecord, GeometryRecord, VehicleAnglesRecord, judge_angle
from station.cycle.words import NO_GEOMETRY, GeometryAnswer, QuantityAnswer, QuantityState

_STATES = {
    AngleVerdict.OK: QuantityState.OK,
    AngleVerdict.NOK: QuantityState.NOK,
    AngleVerdict.WITHOUT_LIMITS: QuantityState.UNJUDGED,
}


def told_state(verdict: AngleVerdict) -> QuantityState:
    """What is told of a quantity; one that the station did not judge was not measured."""
    return _STATES.get(verdict, QuantityState.NOT_MEASURED)


def geometry_answer(record: CycleRecord) -> GeometryAnswer:
    """Return every quantity of the geometry, with its state, and what angles refer to.

    Quantities without limits are told too where they are known. Where the rigs stand in no common frame,
    angles refer to the stand, and there are no lengths.
    """
    if all(wheel.camber is None for wheel in record.wheels):
        return NO_GEOMETRY
    found = record.geometry
    if found is None:
        toes = () if record.vehicle_angles is None else tuple(_toes_to_thrust(record, record.vehicle_angles))
        return GeometryAnswer("stand", None, toes)
    lengths = tuple(_quantity(name, found) for name in ("yaw", *LENGTHS))
    toes = tuple(_toes_to_thrust(record, record.vehicle_angles))
    return GeometryAnswer(found.reference, found.end_points, (*lengths, *toes))


def _quantity(name: str, found: GeometryRecord) -> QuantityAnswer:
    value, u = getattr(found, name), getattr(found, f"{name}_u")
    verdict, _ = judge_angle(
        value,
        u,
        getattr(found, f"{name}_low", None),
        getattr(found, f"{name}_high", None),
        guard_band=found.guard_band,
        coverage_factor=found.coverage_factor,
        part=found.verdict,
    )
    state, k = told_state(verdict), found.coverage_factor
    if not state.measured or u is None or k is None:
        return QuantityAnswer(name, QuantityState.NOT_MEASURED)
    factor = 1.0 if name in LENGTHS else math.degrees(1.0)
    return QuantityAnswer(name, state, factor * value, factor * k * u)


def _toes_to_thrust(record: CycleRecord, angles: VehicleAnglesRecord | None) -> Iterator[QuantityAnswer]:
    """Front toes against the thrust line.

    How toe and thrust angle depend on each other is not stored: their uncertainties are added, which is never
    too little.
    """
    toe_u = {wheel.wheel: wheel.toe_u for wheel in record.wheels}
    for side in ("left", "right"):
        wheel = f"front_{side}"
        name, own = f"{wheel}.toe_to_thrust", toe_u.get(wheel)
        if angles is None or own is None or angles.coverage_factor is None:
            yield QuantityAnswer(name, QuantityState.NOT_MEASURED)
            continue
        value = angles.front_toe_left_to_thrust if side == "left" else angles.front_toe_right_to_thrust
        u95 = angles.coverage_factor * (own + angles.thrust_angle_u)
        yield QuantityAnswer(name, QuantityState.UNJUDGED, in_degrees(value), in_degrees(u95))
