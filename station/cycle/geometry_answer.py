"""What the line is told of a vehicle's geometry, from what was judged."""

from __future__ import annotations

import math

from alignment.vehicle import LENGTHS
from station.cycle.geometry_words import (
    GEOMETRY,
    NO_GEOMETRY,
    GeometryAnswer,
    QuantityAnswer,
    QuantityState,
)
from station.cycle.judging import Evaluation, JudgedVehicle
from station.cycle.verdict import Status

_STATES = {Status.OK: QuantityState.OK, Status.NOK: QuantityState.NOK}


def geometry_answer(evaluation: Evaluation) -> GeometryAnswer:
    """Return every quantity of the geometry, with its state, and what angles refer to.

    Quantities without limits are told too where they are known. Without a vehicle, or without a common frame
    of the rigs, there are none.
    """
    vehicle = evaluation.vehicle
    if all(wheel.values is None for wheel in evaluation.wheels):
        return NO_GEOMETRY
    if vehicle is None:
        return GeometryAnswer(evaluation.reference)
    # Where lengths have limits, or the wheels make no vehicle, it was asked for.
    asked = bool(vehicle.lengths) or evaluation.problem is not None or vehicle.geometry is not None
    if not asked:
        return GeometryAnswer(evaluation.reference)
    return GeometryAnswer(
        evaluation.reference,
        None if vehicle.geometry is None else vehicle.geometry.between,
        tuple(_quantity(name, vehicle) for name in GEOMETRY),
    )


def _quantity(name: str, vehicle: JudgedVehicle) -> QuantityAnswer:
    geometry = vehicle.geometry
    if geometry is None or name not in geometry:
        return QuantityAnswer(name, QuantityState.NOT_MEASURED)
    judged = next((length for length in vehicle.lengths if length.name == name), None)
    state = QuantityState.UNJUDGED
    if judged is not None and judged.limits is not None:
        state = _STATES.get(judged.status, QuantityState.NOT_MEASURED)
    if not state.measured:
        return QuantityAnswer(name, state)
    factor = 1.0 if name in LENGTHS else math.degrees(1.0)
    return QuantityAnswer(name, state, factor * geometry.value(name), factor * geometry.u95(name))
