"""What is answered of a vehicle's geometry: each quantity with its state, and what they all refer to.

Angles are in degrees and lengths in millimetres, as a controller reads them; names and signs are those of
`alignment.vehicle.VehicleGeometry`.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

from alignment.errors import InputError
from alignment.vehicle import LENGTHS, EndPoints
from db.records import Reference

GEOMETRY_ANGLES = ("yaw", "front_left.toe_to_thrust", "front_right.toe_to_thrust")
GEOMETRY = (*GEOMETRY_ANGLES, *LENGTHS)
"""Quantities that are answered of each vehicle, beside those of wheels and axles and the thrust angle."""


class QuantityState(enum.StrEnum):
    """What a quantity is worth; the words of the DBC's value table.

    OK, NOK: measured, inside or outside of its limits. UNJUDGED: measured, without limits. NOT_MEASURED:
    asked for, and not known. NONE: not asked for, or the rigs stand in no common frame.
    """

    NONE = "none"
    OK = "ok"
    NOK = "nok"
    UNJUDGED = "unjudged"
    NOT_MEASURED = "not_measured"

    @property
    def measured(self) -> bool:
        """True for those that stand for a value."""
        return self in (QuantityState.OK, QuantityState.NOK, QuantityState.UNJUDGED)


@dataclass(frozen=True)
class QuantityAnswer:
    """One quantity of the vehicle's geometry: of `GEOMETRY_ANGLES` degrees, of lengths millimetres.

    Raises
    ------
    InputError
        When state and values contradict each other.
    """

    name: str
    state: QuantityState
    value: float | None = None
    u95: float | None = None

    def __post_init__(self) -> None:
        for what, number in (("value", self.value), ("u95", self.u95)):
            if self.state.measured != (number is not None and math.isfinite(number)):
                expected = "a finite number" if self.state.measured else "no number"
                raise InputError(
                    field=f"{self.name}.{what}",
                    expected=f"{expected}, because the state is '{self.state}'",
                    seen=str(number),
                )
        if self.u95 is not None and self.u95 < 0.0:
            raise InputError(field=f"{self.name}.u95", expected="0 or more", seen=str(self.u95))


@dataclass(frozen=True)
class GeometryAnswer:
    """The vehicle's geometry; a quantity that is not named is none.

    Attributes
    ----------
    reference
        What individual toe and thrust angle refer to; None where nothing is told of it.
    between
        Between what wheelbase, track and setback were measured; None where they were not.
    quantities
        Of `GEOMETRY`, each at most once.

    Raises
    ------
    InputError
        For an unknown quantity, or one twice.
    """

    reference: Reference | None = None
    between: EndPoints | None = None
    quantities: tuple[QuantityAnswer, ...] = ()

    def __post_init__(self) -> None:
        names = [quantity.name for quantity in self.quantities]
        if len(set(names)) != len(names) or not set(names) <= set(GEOMETRY):
            raise InputError(
                field="quantities",
                expected=f"each of {', '.join(GEOMETRY)} at most once",
                seen=", ".join(names),
            )

    def of(self, name: str) -> QuantityAnswer:
        """One quantity."""
        found = (quantity for quantity in self.quantities if quantity.name == name)
        return next(found, QuantityAnswer(name, QuantityState.NONE))

    def withdrawn(self) -> GeometryAnswer:
        """Return what is told of a vehicle whose record does not count: nothing was measured."""
        asked = (quantity for quantity in self.quantities if quantity.state is not QuantityState.NONE)
        return GeometryAnswer(
            self.reference, None, tuple(QuantityAnswer(q.name, QuantityState.NOT_MEASURED) for q in asked)
        )


NO_GEOMETRY = GeometryAnswer()
