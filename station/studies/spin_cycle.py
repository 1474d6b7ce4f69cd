"""Study `spin-cycle`: the spin axis of wheels that turn, wander and carry a load; its answer; its memory.

Wheels on simulated rollers go twice round in sixteen exposures, with lettering and motion blur, and wander by
±1 mm and ±3′. What counts is the mean spin axis over the exposures. A series under load is compared with the
single exposures that it is made of: the load does not turn, and no series averages it out.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from alignment.arrays import Array
from alignment.measure import measure_wheel
from alignment.measure_spin import SeriesMeasurement, SeriesUnderWay
from alignment.prepared import PreparedRig
from alignment.units import ARCMIN
from alignment.values import MeasureSettings, Refusal, RigCalibration, StereoImages, WheelMeasurement
from alignment.wheel import SeriesRules
from db.exports import in_style, legend_outside
from sensors.formats import TyreLoad, WheelTruth
from sensors.simulation import (
    SHAPES,
    Rollers,
    TurningWheel,
    draw_pose,
    draw_scene,
    mean_truth,
    simulate_shot,
    truth_of,
)
from station.configuration import default_config
from station.figures import Goal, Progress, Row, Study, StudyResult
from station.rehearsal import TurningTimes, planes_station, run_turning
from station.studies.wheels import StudyRig, study_rig

WHEELS, LOADED, CYCLES = 50, 50, 1000
QUICK_WHEELS, QUICK_LOADED, QUICK_CYCLES = 1, 0, 30
PRESET = "ccir"
RULES = SeriesRules()
RUN_OUT_MM, RADIUS_MM = 2.0, 300.0
ROLLERS = Rollers()
"""Sixteen exposures twice round, at 170° per second."""
_SETTLED = 200
_MOST_GROWTH_MB = 5.0


@dataclass(frozen=True)
class SpunWheel:
    """One wheel: errors of its series, and root mean square ones of its exposures, (camber, toe) in radians.

    `series` is None where it was refused; `reason` says why.
    """

    load_mm: float
    series: tuple[float, float] | None
    u: tuple[float, float] | None
    exposures: tuple[float, float]
    run_out_error: float | None
    reason: str


def spun_wheel(rig: StudyRig, number: int, load_mm: float, seed: int) -> SpunWheel:
    """Render and measure one wheel on rollers with true cameras; each number has another tyre and wander."""
    rng = np.random.default_rng([seed, 16, number])
    camber, toe = np.radians(rng.uniform(-2.0, 2.0, 2))
    run_out = math.asin(0.5 * RUN_OUT_MM / RADIUS_MM)
    pose = draw_pose(rng, float(camber), float(toe), run_out=run_out)
    shape = str(rng.choice(sorted(SHAPES)))
    scene = draw_scene(rig.spec, rig.side, pose, rng, shape, seed=seed)
    if load_mm > 0.0:
        scene = replace(scene, load=TyreLoad(load_mm))
    wheel = TurningWheel(scene, ROLLERS, rng)
    scenes = [wheel.exposure(k) for k in range(1, RULES.exposures + 1)]
    return measured(
        rig.true,
        [truth_of(one) for one in scenes],
        (simulate_shot(one, rig.true, rng).images for one in scenes),
        load_mm,
    )


def measured(
    calibration: RigCalibration,
    truths: list[WheelTruth],
    shots: Iterable[Sequence[StereoImages]],
    load_mm: float,
) -> SpunWheel:
    """Measure the exposures of one wheel, and compare with the truth of each and of their mean."""
    prepared, settings = PreparedRig.of(calibration, MeasureSettings()), MeasureSettings()
    planes: list[WheelMeasurement] = []

    def one(
        images: Sequence[StereoImages], rig: PreparedRig, settings: MeasureSettings
    ) -> WheelMeasurement | Refusal:
        found = measure_wheel(images, rig, settings)
        if isinstance(found, WheelMeasurement):
            planes.append(found)
        return found

    series = SeriesUnderWay(prepared, settings, RULES, one)
    refusal: Refusal | None = None
    for number, images in enumerate(shots, start=1):
        refusal = refusal or series.take(number, images)
    singles = [
        (m.camber - math.radians(t.camber_deg), m.toe - math.radians(t.toe_deg))
        for m, t in zip(planes, truths, strict=False)
    ]
    rms = np.sqrt(np.mean(np.square(singles), axis=0)) if singles else np.full(2, np.nan)
    exposures = (float(rms[0]), float(rms[1]))
    found = refusal or series.result()
    if not isinstance(found, SeriesMeasurement):
        return SpunWheel(load_mm, None, None, exposures, None, found.reason)
    mean, spin = mean_truth(truths), found.spin
    off = (spin.camber - math.radians(mean.camber_deg), spin.toe - math.radians(mean.toe_deg))
    mm = spin.run_out_mm(mean.runout_radius_mm)
    run_out_error = None if mm is None else mm - mean.runout_mm
    return SpunWheel(load_mm, off, (spin.camber_u, spin.toe_u), exposures, run_out_error, "")


def run_parts(
    rig: StudyRig, counts: tuple[int, int, int], seed: int, progress: Progress
) -> tuple[list[SpunWheel], TurningTimes]:
    """Measure so many wheels without and with load, and run so many cycles with prepared planes."""
    unloaded, loaded, cycles = counts
    rng = np.random.default_rng([seed, 17])
    loads = [0.0] * unloaded + [float(load) for load in rng.uniform(2.0, 8.0, loaded)]
    total = len(loads) + 1
    wheels = []
    for k, load_mm in enumerate(loads):
        progress(k / total, f"wheel {k + 1} of {len(loads)}")
        wheels.append(spun_wheel(rig, k, load_mm, seed))
    with tempfile.TemporaryDirectory() as folder:
        times = run_turning(
            Path(folder),
            default_config(None, "line.dbc").resolve(),
            cycles,
            planes_station(seed),
            0.0,
            lambda done: progress((len(loads) + done / cycles) / total, f"cycle {done} of {cycles}"),
        )
    return wheels, times


def summary(wheels: list[SpunWheel], times: TurningTimes) -> StudyResult:
    """Sum the study up."""
    free = [wheel for wheel in wheels if not wheel.load_mm]
    loaded = [wheel for wheel in wheels if wheel.load_mm]
    errors = _errors(free)
    known = [(wheel.series, wheel.u) for wheel in free if wheel.series and wheel.u]
    ratio = np.array([np.array(off) / np.array(u) for off, u in known])
    cycles = len(times.rss_mb)
    figures = {
        "wheels": float(len(free)),
        "refused": float(sum(wheel.series is None for wheel in free)),
        "median_error_arcmin": float(np.median(errors)) if errors.size else math.nan,
        "p95_error_arcmin": float(np.quantile(errors, 0.95)) if errors.size else math.nan,
        "largest_error_arcmin": float(errors.max()) if errors.size else math.nan,
        "error_over_stated_rms": float(np.sqrt(np.mean(np.square(ratio)))) if ratio.size else math.nan,
        "largest_run_out_error_mm": max(
            (abs(w.run_out_error) for w in free if w.run_out_error is not None), default=math.nan
        ),
        "loaded_wheels": float(len(loaded)),
        "loaded_refused": float(sum(wheel.series is None for wheel in loaded)),
        "loaded_series_rms_arcmin": _rms([w.series for w in loaded if w.series]),
        "loaded_exposures_rms_arcmin": _rms([w.exposures for w in loaded if w.series]),
        "cycles": float(cycles),
        "cycles_not_ok": float(sum(outcome != "ok" for outcome in times.outcomes)),
        "memory_growth_mb": times.growth_mb(min(_SETTLED, max(1, cycles // 3))),
        "prepared_answer_median_ms": times.answer_ms(50),
    }
    figures["loaded_series_over_exposures"] = (
        figures["loaded_series_rms_arcmin"] / figures["loaded_exposures_rms_arcmin"]
    )
    goals = [
        Goal("refused", "at_most", 0),
        Goal("largest_error_arcmin", "at_most", 0.1),
        Goal("cycles_not_ok", "at_most", 0),
        Goal("memory_growth_mb", "at_most", _MOST_GROWTH_MB),
    ]
    if loaded:
        goals += [
            Goal("loaded_refused", "at_most", 0),
            Goal("loaded_series_over_exposures", "at_most", 1.1),
        ]
    text = f"""
{len(free)} wheels without load and {len(loaded)} with loads of 2 to 8 mm, {RULES.exposures} exposures each,
twice round, run-out {RUN_OUT_MM:g} mm, lettering, motion blur, wander of ±1 mm and ±3′, true cameras. Then
{cycles} cycles of four wheels with {RULES.exposures} prepared exposures each through series, cycle, database
and bus: memory grows by {figures["memory_growth_mb"]:.2f} MB.
"""
    rows: list[Row] = [_row(number, wheel) for number, wheel in enumerate(wheels, start=1)]
    return StudyResult(tuple(rows), figures, tuple(goals), text, {"spin-cycle": _plot(wheels, times)})


def run(seed: int, quick: bool, progress: Progress) -> StudyResult:
    """Run the study; see `RunStudy`."""
    counts = (QUICK_WHEELS, QUICK_LOADED, QUICK_CYCLES) if quick else (WHEELS, LOADED, CYCLES)
    return summary(*run_parts(study_rig(PRESET, seed), counts, seed, progress))


def _errors(wheels: Sequence[SpunWheel]) -> Array:
    """Of camber and toe of those that were measured, arcminutes."""
    return np.abs([error for wheel in wheels if wheel.series for error in wheel.series]) / ARCMIN


def _rms(errors: Sequence[tuple[float, float]]) -> float:
    return float(np.sqrt(np.mean(np.square(errors)))) / ARCMIN if errors else math.nan


def _row(number: int, wheel: SpunWheel) -> Row:
    off = (None, None) if wheel.series is None else wheel.series
    u = (None, None) if wheel.u is None else wheel.u
    return {
        "wheel": number,
        "load_mm": wheel.load_mm,
        "camber_error_arcmin": None if off[0] is None else off[0] / ARCMIN,
        "toe_error_arcmin": None if off[1] is None else off[1] / ARCMIN,
        "camber_u_arcmin": None if u[0] is None else u[0] / ARCMIN,
        "toe_u_arcmin": None if u[1] is None else u[1] / ARCMIN,
        "exposures_camber_rms_arcmin": wheel.exposures[0] / ARCMIN,
        "exposures_toe_rms_arcmin": wheel.exposures[1] / ARCMIN,
        "run_out_error_mm": wheel.run_out_error,
        "refused": wheel.reason,
    }


@in_style
def _plot(wheels: Sequence[SpunWheel], times: TurningTimes) -> Figure:
    figure = Figure(figsize=(8, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    for k, name in enumerate(("camber", "toe")):
        known = [(wheel.load_mm, wheel.series[k] / ARCMIN) for wheel in wheels if wheel.series]
        left.plot([load for load, _ in known], [error for _, error in known], "o", label=name)
    left.set_xlabel("load, mm")
    left.set_ylabel("error of the mean spin axis, ′")
    right.plot(times.rss_mb)
    right.set_xlabel("cycle")
    right.set_ylabel("memory, MB")
    legend_outside(figure, [left])
    return figure


STUDY = Study(
    "spin-cycle", "The spin axis of wheels on rollers, through the cycle: accuracy and memory.", run
)
