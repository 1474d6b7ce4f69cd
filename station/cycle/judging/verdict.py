"""The verdict: each angle or length is declared with its limits, starts unset, gets its value later.

Nothing but a finite value with a positive uncertainty, measured with a valid calibration and inside its
limits, is OK. An angle that nobody set is not a pass; a value that is no number is not a failed vehicle
either but a fault of the station.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

from db.records import CycleOutcome, Verdict, missed_limit
from station.configuration import Limits


class Status(enum.StrEnum):
    """What is known of an angle, or of several.

    UNSET: declared, but no value came. UNJUDGED: a good value without limits. INVALID: a value that cannot be
    judged, because it is no finite number, has no uncertainty, or rests on no valid calibration. OK and NOK:
    inside and outside of the limits.
    """

    UNSET = "unset"
    UNJUDGED = "unjudged"
    INVALID = "invalid"
    OK = "ok"
    NOK = "nok"

    @property
    def verdict(self) -> Verdict:
        """The verdict as it is stored: OK, NOK, or none."""
        return {Status.OK: Verdict.OK, Status.NOK: Verdict.NOK}.get(self, Verdict.NONE)


@dataclass(frozen=True)
class Angle:
    """One angle of a wheel, an axle or a vehicle, or one length of the vehicle.

    Attributes
    ----------
    name
        Such as ``front_left.camber``; that of a length is one of `alignment.vehicle.LENGTHS`.
    limits
        None where the angle is reported but not judged.
    guard_band
        Whether the limits are narrowed by the expanded uncertainty before the comparison, so that a value is
        accepted only when it is proven to be inside (ISO 14253-1, proving conformance).
    value, expanded_uncertainty
        Radians, of a length millimetres; None until measured.
    calibration_valid
        Whether the calibration behind the value is known and in force.
    """

    name: str
    limits: Limits | None
    guard_band: bool = True
    value: float | None = None
    expanded_uncertainty: float | None = None
    calibration_valid: bool = False

    def measured(self, value: float, expanded_uncertainty: float, *, calibration_valid: bool) -> Angle:
        """Return the same angle with its value."""
        return replace(
            self,
            value=value,
            expanded_uncertainty=expanded_uncertainty,
            calibration_valid=calibration_valid,
        )

    @property
    def status(self) -> Status:
        """The verdict on this angle alone."""
        if self.value is None:
            return Status.UNSET
        uncertainty = self.expanded_uncertainty
        if uncertainty is None or not 0.0 < uncertainty < math.inf:
            return Status.INVALID
        if not math.isfinite(self.value) or not self.calibration_valid:
            return Status.INVALID
        if self.limits is None:
            return Status.UNJUDGED
        margin = uncertainty if self.guard_band else 0.0
        missed = missed_limit(self.value, self.limits.low, self.limits.high, margin)
        return Status.OK if missed is None else Status.NOK


def missed_in_words(angle: Angle) -> str:
    """Return which wheel's or axle's angle is outside of its limits, and by what, in degrees.

    `angle` has a value and limits; a guard band counts only where it decides.
    """
    assert angle.value is not None
    assert angle.limits is not None
    assert angle.expanded_uncertainty is not None
    value, low, high = map(math.degrees, (angle.value, angle.limits.low, angle.limits.high))
    text = f"{angle.name.replace('.', ' ')} {value:+.4f}°, limits {low:+.4f}° to {high:+.4f}°"
    if angle.guard_band and low <= value <= high:
        text += f" less its uncertainty of {math.degrees(angle.expanded_uncertainty):.4f}°"
    return text


def combined(angles: Iterable[Angle]) -> Status:
    """Return the verdict on several angles together.

    One invalid angle makes the whole invalid, one unset angle makes it unset: a vehicle that was not wholly
    measured is neither good nor bad. Then one NOK makes it NOK. No angle at all is unset, not a pass.
    """
    statuses = {angle.status for angle in angles}
    for status in (Status.INVALID, Status.UNSET, Status.NOK, Status.OK, Status.UNJUDGED):
        if status in statuses:
            return status
    return Status.UNSET


def cycle_outcome(angles: Iterable[Angle], *, fault: bool, aborted: bool) -> CycleOutcome:
    """Return the outcome of a cycle, which keeps vehicle, station and operator apart.

    Parameters
    ----------
    angles
        All angles that were asked for, measured or not.
    fault
        The station already knows that it failed.
    aborted
        The operator or the line stopped the cycle; this outweighs a fault, because nobody waits any more.
    """
    if aborted:
        return CycleOutcome.ABORTED
    status = combined(angles)
    if fault or status not in (Status.OK, Status.NOK):
        return CycleOutcome.FAULT
    return CycleOutcome.OK if status is Status.OK else CycleOutcome.NOK
