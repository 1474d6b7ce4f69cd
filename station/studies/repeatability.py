"""Study `repeatability`: one wheel without run-out, elsewhere, turned and in new noise each time."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from alignment.arrays import Array
from alignment.errors import DegenerateInputError
from alignment.measure import measure_wheel
from alignment.prepared import PreparedRig
from alignment.units import ARCMIN
from alignment.values import MeasureSettings, WheelMeasurement
from db.exports import in_style, legend_outside, whole_numbers
from sensors.simulation import draw_pose, draw_scene
from station.figures import Goal, Progress, Row, Study, StudyResult
from station.studies.wheels import errors_arcmin, exposed, lights, study_rig

REPEATS, QUICK_REPEATS = 25, 6
_LIMIT = 0.02
CAMBER, TOE = math.radians(-0.8), math.radians(0.2)


def run(seed: int, quick: bool, progress: Progress) -> StudyResult:
    """Run the study; see `RunStudy`."""
    return run_repeats(QUICK_REPEATS if quick else REPEATS, seed, progress)


def run_repeats(count: int, seed: int, progress: Progress) -> StudyResult:
    """Run the study with so many repeats."""
    rig = study_rig("standard", seed)
    rng = np.random.default_rng([seed, 4])
    wheel = draw_scene(rig.spec, rig.side, draw_pose(rng, CAMBER, TOE), rng, seed=seed)
    rows: list[Row] = []
    settings = MeasureSettings()
    known = PreparedRig.of(rig.true, settings)
    for k in range(count):
        progress(k / count, f"repeat {k + 1} of {count}")
        scene = replace(wheel, pose=draw_pose(rng, CAMBER, TOE))
        result = measure_wheel(exposed(lights(scene, rig.true), scene, rng), known, settings)
        if not isinstance(result, WheelMeasurement):
            raise DegenerateInputError(field=f"repeat {k + 1}", expected="a measurement", seen=result.reason)
        camber, toe = errors_arcmin(result, scene)
        rows.append(
            {
                "repeat": k + 1,
                "spin_deg": math.degrees(scene.pose.spin),
                "x_mm": scene.pose.offset_mm[0],
                "y_mm": scene.pose.offset_mm[1],
                "z_mm": scene.pose.offset_mm[2],
                "camber_error_arcmin": camber,
                "toe_error_arcmin": toe,
                "camber_u_arcmin": result.camber_u / ARCMIN,
                "toe_u_arcmin": result.toe_u / ARCMIN,
            }
        )
    errors = np.array(
        [[row["camber_error_arcmin"], row["toe_error_arcmin"]] for row in rows], dtype=np.float64
    )
    stated = np.array([[row["camber_u_arcmin"], row["toe_u_arcmin"]] for row in rows], dtype=np.float64)
    scatter = errors.std(axis=0, ddof=1)
    figures = {
        "camber_standard_deviation_arcmin": float(scatter[0]),
        "toe_standard_deviation_arcmin": float(scatter[1]),
        "camber_mean_error_arcmin": float(errors[:, 0].mean()),
        "toe_mean_error_arcmin": float(errors[:, 1].mean()),
        "stated_standard_uncertainty_arcmin": float(np.sqrt(np.square(stated).mean())),
    }
    goals = tuple(Goal(name, "at_most", _LIMIT) for name in list(figures)[:2])
    text = f"""
{count} shots of one wheel without run-out, each in another place within ±8 mm, turned by any angle, with new
noise; true cameras. Standard deviation of camber {scatter[0]:.4f}′, of toe {scatter[1]:.4f}′.
"""
    return StudyResult(tuple(rows), figures, goals, text, {"repeatability": _plot(errors)})


@in_style
def _plot(errors: Array) -> Figure:
    figure = Figure(figsize=(8, 3.6), layout="constrained")
    axes = figure.subplots()
    for values, name in zip(errors.T, ("camber", "toe"), strict=True):
        axes.plot(np.arange(1, len(values) + 1), values, "o-", ms=4, lw=0.7, label=name)
    axes.set_xlabel("repeat")
    axes.set_ylabel("error, arcmin")
    whole_numbers(axes, "x")
    legend_outside(figure)
    return figure


STUDY = Study("repeatability", "Scatter of one wheel in other places, turned, in new noise.", run)
