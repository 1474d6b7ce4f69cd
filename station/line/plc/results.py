"""The results of a vehicle as a controller reads them: complete, of one start, and without contradiction."""

from __future__ import annotations

from collections.abc import Mapping

from alignment.errors import LineError
from station.cycle import AxleAnswer, Outcome, QuantityState, WheelAnswer, vehicle_outcome
from station.line.wire import (
    LineDatabase,
    Value,
    VehicleReport,
    read_axle,
    read_geometry,
    read_steering,
    read_vehicle,
    read_wheel,
)

Results = Mapping[str, dict[str, Value]]


def missing_results(database: LineDatabase, results: Results, sequence: int) -> list[str]:
    """Messages of a start's results that did not arrive."""
    return [
        name
        for name in database.result_messages
        if name not in results or results[name]["Sequence"] != sequence
    ]


def read_results(
    database: LineDatabase, results: Results, sequence: int
) -> tuple[VehicleReport, tuple[WheelAnswer, ...], tuple[AxleAnswer, ...]]:
    """Read the results of a start.

    Raises
    ------
    LineError
        When one is missing, or they contradict themselves or each other.
    """
    if missing := missing_results(database, results, sequence):
        raise LineError(
            f"ResultValid was shown, but these results of {sequence} are missing: {', '.join(missing)}"
        )
    wheels = tuple(
        read_wheel(name, *(results[f"Wheel{what}{ending}"] for what in ("Result", "Uncertainty", "Axis")))
        for name, ending in database.wheels.items()
    )
    axles = tuple(
        read_axle(name, results[f"AxleResult{ending}"], results[f"AxleUncertainty{ending}"])
        for name, ending in database.axles.items()
    )
    geometry, steering = read_geometry(database, results), read_steering(database, results)
    vehicle = read_vehicle(results["VehicleResult"], geometry, steering)
    parts = vehicle_outcome(wheels, axles, None)
    if vehicle.outcome is Outcome.OK and parts is not Outcome.OK:
        raise LineError(f"the vehicle of sequence {sequence} is shown as ok, but its parts are {parts}")
    missed = [q.name for q in vehicle.geometry.quantities if q.state is QuantityState.NOK]
    missed += vehicle.steering.missed
    if vehicle.outcome is Outcome.OK and missed:
        raise LineError(
            f"the vehicle of sequence {sequence} is shown as ok, but out of limits: {', '.join(missed)}"
        )
    return vehicle, wheels, axles
