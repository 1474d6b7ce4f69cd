"""Trends of cameras for a person: where each figure began, where it is, how fast it goes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from alignment.errors import DegenerateInputError
from alignment.statistics import LEAST_TIMES, DriftFit, fit_drift
from db.records import CameraFigure
from station.health.figures import Figure

_HOURS_PER_MONTH = 24.0 * 30.0


@dataclass(frozen=True)
class Trend:
    """One figure of one camera over a period.

    Attributes
    ----------
    camera, figure
        Which.
    shots
        How many in the period.
    first
        Mean of the first shots after the newest calibration; None where nothing is compared with them.
    newest
        Mean of the newest day.
    minimum, maximum
        In the period.
    per_month
        Slope of a straight line through the means of the days, weighted by their shots, per thirty days; None
        with less than three days.
    days
        Of each: whole hours since 1970 of its begin, and its mean.
    drift
        A line through the means of the whole days after the newest calibration, in time (days since 1970) and
        the camera's own temperature, where it tells one; None with too few days, and where nobody can tell
        the two apart.
    """

    camera: str
    figure: str
    shots: int
    first: float | None
    newest: float
    minimum: float
    maximum: float
    per_month: float | None
    days: tuple[tuple[int, float], ...]
    drift: DriftFit | None = None


def trends(figures: Iterable[CameraFigure]) -> tuple[Trend, ...]:
    """Return the trend of each camera and figure, by their names; those without a day have none."""
    found = []
    order = sorted(figures, key=lambda one: one.which)
    warmth: dict[str, dict[int, float]] = {}
    for one in order:
        if one.figure == Figure.TEMPERATURE and one.hours == 24:
            warmth.setdefault(one.camera, {})[one.start] = one.mean
    for (camera, figure), group in groupby(order, key=lambda one: (one.camera, one.figure)):
        rows = list(group)
        days = [row for row in rows if row.hours == 24]
        if not days:
            continue
        first = [row for row in rows if row.hours == 0]
        found.append(
            Trend(
                camera,
                figure,
                sum(day.n for day in days),
                first[-1].mean if first else None,
                days[-1].mean,
                min(day.minimum for day in days),
                max(day.maximum for day in days),
                _per_month(days),
                tuple((day.start, day.mean) for day in days),
                _drift(_since(days, first), {} if figure == Figure.TEMPERATURE else warmth.get(camera, {})),
            )
        )
    return tuple(found)


def _per_month(days: list[CameraFigure]) -> float | None:
    if len(days) < 3:
        return None
    months = np.array([day.start - days[0].start for day in days]) / _HOURS_PER_MONTH
    # The deviation of a mean falls with the root of the number, and that is how polyfit weighs.
    weights = np.sqrt([day.n for day in days])
    return float(np.polyfit(months, [day.mean for day in days], 1, w=weights)[0])


def _since(days: list[CameraFigure], first: list[CameraFigure]) -> list[CameraFigure]:
    """Return the whole days after the newest calibration: a new one is a step, and no drift."""
    return [day for day in days if not first or day.start >= first[-1].start]


def _drift(days: list[CameraFigure], warmth: dict[int, float]) -> DriftFit | None:
    """Fit the means of the days; with the temperature, over the days that have one, where enough do."""
    known = [day for day in days if day.start in warmth]
    used = known if len(known) >= LEAST_TIMES else days
    if len(used) < LEAST_TIMES:
        return None
    times = np.array([day.start / 24.0 for day in used])
    values = np.array([day.mean for day in used])
    temperatures = np.array([warmth[day.start] for day in used]) if used is known else None
    try:
        return fit_drift(times, values, temperatures)
    except DegenerateInputError:
        return None
