"""The verdict of one angle: its own, not that of the wheel, axle or vehicle it belongs to.

Records hold one verdict for each part and, for each angle, what decided it: value, uncertainty, limits and
guard band. The angle's own verdict follows from these, so it is derived here, once for reports, exports and
certificates.
"""

from __future__ import annotations

import enum
import math


class Verdict(enum.StrEnum):
    """The comparison with the limits; `none` where there is no value or no limit to compare."""

    OK = "ok"
    NOK = "nok"
    NONE = "none"


class AngleVerdict(enum.StrEnum):
    """What is known of one angle.

    NOT_JUDGED: a value with limits to which the station gave no verdict, because no valid calibration or
    uncertainty stood behind it.
    """

    OK = "ok"
    NOK = "nok"
    WITHOUT_LIMITS = "without limits"
    NOT_MEASURED = "not measured"
    NOT_JUDGED = "not judged"


class LimitSide(enum.StrEnum):
    """Which limit was missed."""

    LOW = "low"
    HIGH = "high"


def missed_limit(value: float, low: float | None, high: float | None, margin: float) -> LimitSide | None:
    """The limit that a value misses, None inside; limits themselves are accepted.

    Parameters
    ----------
    value, low, high
        Of one unit; a limit that is None is not there.
    margin
        By which the limits are narrowed: the expanded uncertainty with a guard band (ISO 14253-1), else 0.
    """
    if low is not None and not value >= low + margin:
        return LimitSide.LOW
    if high is not None and not value <= high - margin:
        return LimitSide.HIGH
    return None


def judge_angle(
    value: float | None,
    u: float | None,
    low: float | None,
    high: float | None,
    *,
    guard_band: bool | None,
    coverage_factor: float | None,
    part: Verdict,
) -> tuple[AngleVerdict, LimitSide | None]:
    """Verdict of an angle as it is stored, and the limit that it missed.

    Parameters
    ----------
    value, u, low, high
        Value, standard uncertainty and limits, of one unit.
    guard_band, coverage_factor
        How the limits were used.
    part
        Verdict of its wheel, axle or vehicle: where that has none though there are limits, the station did
        not judge, and nobody does so afterwards.
    """
    if value is None:
        return AngleVerdict.NOT_MEASURED, None
    if low is None and high is None:
        return AngleVerdict.WITHOUT_LIMITS, None
    if part is Verdict.NONE or u is None or coverage_factor is None or not math.isfinite(value):
        return AngleVerdict.NOT_JUDGED, None
    side = missed_limit(value, low, high, coverage_factor * u if guard_band else 0.0)
    return (AngleVerdict.OK if side is None else AngleVerdict.NOK), side
