"""Study `sweep`: caster, kingpin inclination and steering axis from a sweep of the steering.

Rendered exposures of a loaded wheel at several angles of the steering tell the noise of a shot; the
covariance of a calibration with the plate, and of the rig's placing with a gauge frame, what all positions
have in common. Sweeps are then drawn by numbers. The full study renders ten sweeps, whose cameras are drawn
from their covariance.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from matplotlib.figure import Figure

from alignment.errors import DegenerateInputError
from alignment.units import ARCMIN
from alignment.values import Refusal, RefusalCode
from alignment.vehicle import SteeringAxis, SteeringRules, steering_axis
from db.exports import in_style, legend_outside
from station.figures import Goal, Progress, Row, Study, StudyResult
from station.studies.coverage import HIGHEST, LOWEST
from station.studies.steered_wheels import (
    LOAD_MM,
    RUN_OUT_MM,
    KnownSweep,
    ShotNoise,
    errors_of_calibration,
    even_steers,
    exact_sweep,
    rendered_sweep,
    shot_noise,
    steered_vehicle,
    sweep_by_numbers,
    sweep_rig,
)

SWEEPS, RENDERED, EXACT = 300, 10, 20
POSITIONS, REACH, SMALL = 41, math.radians(10.0), math.radians(2.0)
ANGLES_DEG, QUICK_ANGLES_DEG = (-10.0, -5.0, 0.0, 5.0, 10.0), (0.0, 10.0)
EXPOSURES, QUICK_EXPOSURES = 16, 8
_NAMES = ("caster", "kpi", "included_angle", "trail", "scrub")
_LENGTHS = ("trail", "scrub")


@dataclass(eq=False)
class _Errors:
    """Errors and what was stated, by quantity; arcminutes and millimetres."""

    refused: list[str] = field(default_factory=list)
    errors: dict[str, list[float]] = field(default_factory=lambda: {name: [] for name in _NAMES})
    stated: dict[str, list[float]] = field(default_factory=lambda: {name: [] for name in _NAMES})
    warned: int = 0
    scatter: list[float] = field(default_factory=list)

    def add(self, sweep: KnownSweep) -> None:
        found = steering_axis(sweep.series, sweep.stand, None, sweep.run_out)
        if isinstance(found, Refusal):
            self.refused.append(found.reason)
            return
        for name in _NAMES:
            unit = 1.0 if name in _LENGTHS else ARCMIN
            self.errors[name].append(_off(found, sweep, name) / unit)
            self.stated[name].append(found.u95(name) / unit)
        self.warned += found.warning is not None
        self.scatter.append(found.scatter)

    def p95(self, name: str) -> float:
        return float(np.quantile(np.abs(self.errors[name]), 0.95)) if self.errors[name] else math.nan

    def true(self, name: str) -> float:
        inside = np.abs(self.errors[name]) <= self.stated[name]
        return float(inside.mean()) if len(inside) else math.nan


def _off(found: SteeringAxis, sweep: KnownSweep, name: str) -> float:
    truth = {
        "caster": math.radians(sweep.truth.caster_deg),
        "kpi": math.radians(sweep.truth.kpi_deg),
        "included_angle": math.radians(sweep.truth.included_angle_deg),
        "trail": sweep.truth.trail_mm,
        "scrub": sweep.truth.scrub_mm,
    }
    return found.value(name) - truth[name]


def run(seed: int, quick: bool, progress: Progress) -> StudyResult:
    """Run the study; see `RunStudy`."""
    rendered = 0 if quick else RENDERED
    rig = sweep_rig(seed)
    steers = even_steers(REACH, POSITIONS)
    rng = np.random.default_rng([seed, 52])
    progress(0.0, "noise of rendered shots")
    angles = np.radians(QUICK_ANGLES_DEG if quick else ANGLES_DEG)
    exposures = QUICK_EXPOSURES if quick else EXPOSURES
    noise = shot_noise(rig, steered_vehicle(seed, 0), [float(a) for a in angles], exposures, rng)
    if isinstance(noise, Refusal):
        raise DegenerateInputError(
            field="rendered shots", expected="a steered wheel that is measured", seen=noise.reason
        )
    common = errors_of_calibration(rig, steered_vehicle(seed, 0), steers)
    drift = SteeringRules().load_drift
    by_numbers, images = _Errors(), _Errors()
    exact = []
    for k in range(SWEEPS):
        progress(0.2 + (0.8 if quick else 0.1) * k / SWEEPS, f"sweep {k + 1} of {SWEEPS}")
        vehicle = steered_vehicle(seed, k)
        by_numbers.add(sweep_by_numbers(vehicle, steers, noise, common, drift, rng))
        if k < EXACT:
            exact.append(_exact(exact_sweep(vehicle, steers)))
    for k in range(rendered):
        progress(0.3 + 0.7 * k / rendered, f"rendered sweep {k + 1} of {rendered}")
        found = rendered_sweep(rig, steered_vehicle(seed, k), steers, np.random.default_rng([seed, 53, k]))
        if isinstance(found, Refusal):
            images.refused.append(found.reason)
        else:
            images.add(found)
    small = sweep_by_numbers(
        steered_vehicle(seed, 0), even_steers(SMALL, POSITIONS), noise, common, drift, rng
    )
    refusal = steering_axis(small.series, small.stand, None, small.run_out)
    is_small = isinstance(refusal, Refusal) and refusal.code is RefusalCode.SWEEP_TOO_SMALL
    return _summary(by_numbers, images, noise, max(exact), is_small)


def _exact(sweep: KnownSweep) -> float:
    """Largest error of an angle of a sweep without noise, radians."""
    found = steering_axis(sweep.series, sweep.stand, None, sweep.run_out)
    if isinstance(found, Refusal):
        return math.inf
    return max(abs(_off(found, sweep, name)) for name in _NAMES if name not in _LENGTHS)


def _summary(
    numbers: _Errors, images: _Errors, noise: Sequence[ShotNoise], exact: float, small: bool
) -> StudyResult:
    figures = {
        "sweeps": float(len(numbers.errors["caster"]) + len(numbers.refused)),
        "refused": float(len(numbers.refused)),
        "exact_largest_error_rad": exact,
        "caster_p95_arcmin": numbers.p95("caster"),
        "kpi_p95_arcmin": numbers.p95("kpi"),
        "included_angle_p95_arcmin": numbers.p95("included_angle"),
        "trail_p95_mm": numbers.p95("trail"),
        "scrub_p95_mm": numbers.p95("scrub"),
        "caster_intervals_true": numbers.true("caster"),
        "kpi_intervals_true": numbers.true("kpi"),
        "scrub_intervals_true": numbers.true("scrub"),
        "accused_of_moving": numbers.warned / max(len(numbers.scatter), 1),
        "two_degrees_refused": float(small),
        "shot_scatter_over_stated": math.sqrt(float(np.mean([one.scatter for one in noise]))),
        "shot_camber_u_arcmin": _u(noise, 0),
        "shot_toe_u_arcmin": _u(noise, 1),
        "shot_largest_mean_error_arcmin": float(max(np.abs(one.off).max() for one in noise)) / ARCMIN,
        "rendered_sweeps": float(len(images.errors["caster"]) + len(images.refused)),
        "rendered_refused": float(len(images.refused)),
        "rendered_caster_largest_arcmin": max(map(abs, images.errors["caster"]), default=math.nan),
        "rendered_kpi_largest_arcmin": max(map(abs, images.errors["kpi"]), default=math.nan),
        "rendered_intervals_true": _all_true(images),
        "rendered_scatter_over_stated": float(np.mean(images.scatter)) if images.scatter else math.nan,
    }
    goals = [
        Goal("refused", "at_most", 0),
        Goal("exact_largest_error_rad", "at_most", 1e-9),
        Goal("caster_p95_arcmin", "at_most", 0.15),
        Goal("kpi_p95_arcmin", "at_most", 2.0),
        *(Goal(f"{name}_intervals_true", "at_least", LOWEST) for name in ("caster", "kpi")),
        *(Goal(f"{name}_intervals_true", "at_most", HIGHEST) for name in ("caster", "kpi")),
        Goal("two_degrees_refused", "at_least", 1),
    ]
    if figures["rendered_sweeps"]:
        goals += [
            Goal("rendered_refused", "at_most", 0),
            Goal("rendered_caster_largest_arcmin", "at_most", 0.3),
            Goal("rendered_kpi_largest_arcmin", "at_most", 4.0),
        ]
    text = f"""
Sweeps of ±{math.degrees(REACH):g}° in {POSITIONS} positions, a load of {LOAD_MM:g} mm, a run-out of up to
{RUN_OUT_MM:g} mm that rolls by the scrub radius and is known from a series on rollers, tyres of equal width.
The plate of the calibration stood at depths of ±60 mm, as far as a steered wheel reaches.
"""
    rows = [*_rows("numbers", numbers), *_rows("images", images)]
    return StudyResult(tuple(rows), figures, tuple(goals), text, {"sweep": _plot(numbers, images)})


def _u(noise: Sequence[ShotNoise], place: int) -> float:
    return math.sqrt(float(np.mean([one.stated[place, place] for one in noise]))) / ARCMIN


def _all_true(images: _Errors) -> float:
    return float(np.mean([images.true(name) for name in ("caster", "kpi")])) if images.scatter else math.nan


def _rows(kind: str, found: _Errors) -> list[Row]:
    rows: list[Row] = []
    for k in range(len(found.scatter)):
        row: dict[str, str | float | int | None] = {"sweep": k + 1, "by": kind}
        for name in _NAMES:
            unit = "mm" if name in _LENGTHS else "arcmin"
            row[f"{name}_error_{unit}"] = found.errors[name][k]
            row[f"{name}_u95_{unit}"] = found.stated[name][k]
        rows.append({**row, "scatter_over_stated": found.scatter[k]})
    return rows


@in_style
def _plot(numbers: _Errors, images: _Errors) -> Figure:
    figure = Figure(figsize=(8, 3.6), layout="constrained")
    axes = figure.subplots(1, 2)
    for axis, name, words in zip(axes, ("caster", "kpi"), ("caster", "kingpin inclination"), strict=True):
        axis.hist(numbers.errors[name], 25, alpha=0.6, label="by numbers")
        axis.plot(images.errors[name], [1.0] * len(images.errors[name]), "k|", ms=16, label="rendered")
        axis.set_xlabel(f"error of {words}, ′")
    axes[0].set_ylabel("sweeps")
    legend_outside(figure, [axes[0]])
    return figure


STUDY = Study("sweep", "Caster, kingpin inclination and steering axis from a sweep of the steering.", run)
