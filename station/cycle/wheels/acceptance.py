"""What counts of a wheel that was measured: its zero measurement taken off, or why nothing does."""

from __future__ import annotations

import math

from alignment.counting import listed
from alignment.values import Refusal, Side, WheelMeasurement
from db.records import WheelOutcome, ZeroRecord
from station.cycle.wheels.zero import correction_of
from station.cycle.words import ErrorCode, Failure, fault

LARGEST_UNCERTAINTY = math.radians(1.0)
"""Expanded; beyond it a value says nothing about a vehicle, and the line cannot carry it."""


def corrected_and_judged(
    found: WheelMeasurement | Refusal, wheel: str, side: Side, zero: ZeroRecord | None, needs_place: bool
) -> tuple[WheelMeasurement | None, Failure | None]:
    """Return what counts of a wheel that was measured, or why nothing does.

    Parameters
    ----------
    found
        By the measurement.
    wheel, side
        Of the vehicle.
    zero
        Corrects it; None where there is none.
    needs_place
        Whether a wheel without a place is refused.
    """
    if isinstance(found, Refusal):
        return None, _refused(wheel, str(found.code), found.reason)
    if zero is not None:
        found = correction_of(zero, side).corrected(found)
    uncertainties = found.camber_u, found.toe_u
    finite = all(map(math.isfinite, (found.camber, found.toe, *uncertainties)))
    if not finite or min(uncertainties) <= 0:
        return None, fault(
            ErrorCode.INTERNAL_FAULT,
            f"{wheel}: expected finite angles with uncertainties above 0 from the measurement, "
            f"found camber {found.camber}, toe {found.toe}, uncertainties {listed(uncertainties)}; "
            "report this as a defect",
        )
    expanded = found.coverage_factor * max(uncertainties)
    if expanded > LARGEST_UNCERTAINTY:
        return None, _refused(
            wheel,
            "too_uncertain",
            f"expected an expanded uncertainty of at most {math.degrees(LARGEST_UNCERTAINTY):g}°, found "
            f"{math.degrees(expanded):.2f}°; clean the tyre and the windows of the heads, and check the "
            "calibration",
        )
    if needs_place and found.reference is None:
        return None, _refused(
            wheel,
            "no_place",
            "expected to see the outermost ring of the sidewall, which gives the wheel its place in the "
            f"vehicle, found none by '{found.method}'; check that the heads see the widest part of the tyre, "
            "and that measure.method is 'revolution'",
        )
    return found, None


def _refused(wheel: str, code: str, why: str) -> Failure:
    return Failure(WheelOutcome.REFUSED, ErrorCode.MEASUREMENT_REFUSED, code, f"{wheel}: {why}")
