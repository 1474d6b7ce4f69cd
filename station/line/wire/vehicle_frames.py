"""The vehicle's geometry to frames and back: what it refers to, and one message for each quantity."""

from __future__ import annotations

from collections.abc import Mapping
from typing import cast

import can

from alignment.errors import LineError
from alignment.vehicle import EndPoints
from db.records import Reference
from station.cycle import GeometryAnswer, QuantityAnswer, QuantityState
from station.line.wire.dbc import LineDatabase, Value
from station.line.wire.numbers import fitting, read_number, rounded_up

NONE = "none"


def geometry_frames(
    database: LineDatabase, sequence: int, geometry: GeometryAnswer
) -> tuple[can.Message, ...]:
    """What the vehicle refers to, then every quantity, in the order of sending.

    Raises
    ------
    InputError
        When a value does not fit its signal.
    """
    reference = database.encode(
        "VehicleReference",
        {
            "Reference": geometry.reference or NONE,
            "Sequence": sequence,
            "Between": geometry.between or NONE,
        },
    )
    quantities = (
        _quantity_frame(database, message, sequence, geometry.of(name))
        for name, message in database.geometry.items()
    )
    return (reference, *quantities)


def read_geometry(database: LineDatabase, results: Mapping[str, Mapping[str, Value]]) -> GeometryAnswer:
    """The vehicle's geometry from its decoded messages.

    Raises
    ------
    LineError
        When a message contradicts itself.
    """
    said = results["VehicleReference"]
    reference, between = str(said["Reference"]), str(said["Between"])
    try:
        return GeometryAnswer(
            None if reference == NONE else cast("Reference", reference),
            None if between == NONE else cast("EndPoints", between),
            tuple(
                QuantityAnswer(
                    name,
                    QuantityState(str(results[message]["State"])),
                    read_number(results[message]["Value"]),
                    read_number(results[message]["U95"]),
                )
                for name, message in database.geometry.items()
                if results[message]["State"] != NONE
            ),
        )
    except ValueError as error:
        raise LineError(f"the geometry of the vehicle contradicts itself: {error}") from error


def _quantity_frame(
    database: LineDatabase, message: str, sequence: int, quantity: QuantityAnswer
) -> can.Message:
    return database.encode(
        message,
        {
            "State": str(quantity.state),
            "Sequence": sequence,
            "Value": fitting(database, message, "Value", quantity.value),
            "U95": rounded_up(database, message, "U95", quantity.u95),
        },
    )
