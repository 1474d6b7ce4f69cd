"""What was turned on a vehicle: as found, as left, how often, how far and how long."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from db.records.plain import check_values

AdjusterWord = Literal["tie_rod", "camber_bolt"]
"""What of a wheel was turned."""
AdjustingWord = Literal["done", "unreachable", "unfinished"]
"""How the adjusting of a wheel ended: inside its limits; no turning could bring it there; before either."""
OutOfReachWord = Literal["no_adjuster", "range", "reaction"]
"""Why no turning could bring a wheel inside its limits."""


@dataclass(frozen=True)
class AdjustingRecord:
    """One adjuster of one wheel that was turned in a cycle; angles are radians.

    Attributes
    ----------
    wheel, adjuster
        What was turned.
    outcome, reason
        How the adjusting of the wheel ended; a reason only where it is `unreachable`.
    corrections
        How often a nut was to be loosened, turned and locked.
    turns
        From where it was found to where it was left, as far as movements tell; positive lengthens, or leans
        the top outboard.
    turns_made
        The same without signs: a turn forth and back is two.
    found_camber, found_toe
        Of the wheel, at rest, before anything of it was turned.
    left_camber, left_toe
        Of the wheel, as the measurement that counts says; None where it was not measured.
    begun_s, ended_s
        When it was first to be turned, and when the wheel was done with or last seen, in seconds after the
        trigger.
    nuts_locked
        Corrections of which the angle is known before and after the nut was locked.
    drift
        What locking added to the adjuster's own angle, their mean; None where none is known.
    operator
        Who turned; None where nobody told it.
    """

    wheel: str
    adjuster: AdjusterWord
    outcome: AdjustingWord
    corrections: int
    turns: float
    turns_made: float
    found_camber: float
    found_toe: float
    begun_s: float
    ended_s: float
    reason: OutOfReachWord | None = None
    left_camber: float | None = None
    left_toe: float | None = None
    nuts_locked: int = 0
    drift: float | None = None
    operator: str | None = None

    def __post_init__(self) -> None:
        check_values(self)
