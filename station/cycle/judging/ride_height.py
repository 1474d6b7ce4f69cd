"""Ride height: camber and toe of a wheel, brought to the design height of its vehicle type."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

from alignment.values import Refusal
from alignment.vehicle import WheelAngles
from station.configuration import LEAST_HEIGHT_MM, MOST_HEIGHT_MM, RideHeightOptions
from station.cycle.words import RideHeights

NOT_CORRECTED = "not brought to the design height"


class HeightOutcome(enum.StrEnum):
    """What became of the ride height of a wheel.

    NOT_ASKED: the vehicle type has no curve of it. CORRECTED: camber and toe are those at the design height.
    NOT_KNOWN: none was told, and the vehicle type lets the wheel be judged as it stands. MISSING: none was
    told, and the wheel is not judged. REFUSED: it cannot be, or lies too far from the design height, and the
    wheel is not judged.
    """

    NOT_ASKED = "not_asked"
    CORRECTED = "corrected"
    NOT_KNOWN = "not_known"
    MISSING = "missing"
    REFUSED = "refused"


@dataclass(frozen=True)
class HeightUsed:
    """The ride height of a wheel, and what follows.

    Attributes
    ----------
    outcome
        What became of it.
    reason
        Why the wheel is not corrected, or refused, in words; None where it is corrected or was not asked for.
    height_mm, height_u_mm, design_mm
        As told, its standard uncertainty, and of the vehicle type; None where it is none.
    camber, toe, camber_u, toe_u
        To be added to the measured angles, radians, and standard uncertainties; 0 where nothing is.
    """

    outcome: HeightOutcome
    reason: str | None = None
    height_mm: float | None = None
    height_u_mm: float | None = None
    design_mm: float | None = None
    camber: float = 0.0
    toe: float = 0.0
    camber_u: float = 0.0
    toe_u: float = 0.0

    @property
    def refused(self) -> bool:
        """Whether the wheel is not judged."""
        return self.outcome in (HeightOutcome.MISSING, HeightOutcome.REFUSED)

    def at_design(self, raw: WheelAngles) -> WheelAngles:
        """Return the angles of the wheel at the design height; as they are where it is not corrected."""
        return WheelAngles(
            raw.camber + self.camber,
            raw.toe + self.toe,
            math.hypot(raw.camber_u, self.camber_u),
            math.hypot(raw.toe_u, self.toe_u),
        )


NO_HEIGHT = HeightUsed(HeightOutcome.NOT_ASKED)


def ride_height(options: RideHeightOptions | None, wheel: str, told: RideHeights | None) -> HeightUsed:
    """Return what follows from the ride height of one wheel.

    Parameters
    ----------
    options
        Of the vehicle type; None where it says nothing of ride heights.
    wheel
        Its name.
    told
        The heights that the line told; None where it told none.
    """
    described = None if options is None else options.of(wheel)
    if options is None or described is None:
        return NO_HEIGHT
    design_mm = described.design_mm
    height_mm = None if told is None else told.of(wheel, options.oldest_s)
    if height_mm is None:
        outcome = HeightOutcome.MISSING if options.require else HeightOutcome.NOT_KNOWN
        return HeightUsed(
            outcome,
            f"{NOT_CORRECTED}: no ride height of this wheel was told, or too long ago",
            design_mm=design_mm,
        )
    if not LEAST_HEIGHT_MM <= height_mm <= MOST_HEIGHT_MM:
        return HeightUsed(
            HeightOutcome.REFUSED,
            f"{NOT_CORRECTED}: no vehicle stands at {height_mm:g} mm; check what tells its ride height",
            design_mm=design_mm,
        )
    found = described.curve(options.largest_mm).correction(height_mm, design_mm, options.sigma_mm)
    if isinstance(found, Refusal):
        reason = f"{NOT_CORRECTED}: {found.reason}"
        return HeightUsed(HeightOutcome.REFUSED, reason, height_mm, options.sigma_mm, design_mm)
    return HeightUsed(
        HeightOutcome.CORRECTED,
        None,
        height_mm,
        options.sigma_mm,
        design_mm,
        found.camber,
        found.toe,
        math.sqrt(float(found.covariance[0, 0])),
        math.sqrt(float(found.covariance[1, 1])),
    )
