"""Study `coverage`: how often do the stated 95 % intervals hold the truth?

Tyre, pose and light are drawn at random. The rig is calibrated once from a rendered plate; for each shot the
cameras that measure are drawn anew from the covariance that this calibration states, and carry it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import get_args

import numpy as np
from matplotlib.figure import Figure
from scipy import stats

from alignment.arrays import Array
from alignment.geometry import PosedCamera
from alignment.measure import measure_wheel
from alignment.prepared import PreparedRig
from alignment.units import ARCMIN
from alignment.values import (
    HeadCalibration,
    MeasureSettings,
    PlaneMethod,
    Refusal,
    RigCalibration,
    WheelMeasurement,
)
from db.exports import REFERENCE, in_style, legend_outside
from sensors.simulation import SHAPES, WheelScene, draw_pose, draw_scene
from station.figures import Goal, Progress, Row, Study, StudyResult
from station.studies.wheels import calibrate_from_plate, errors_arcmin, exposed, lights, study_rig

PLANE_METHODS: tuple[PlaneMethod, ...] = get_args(PlaneMethod)
SHOTS, QUICK_SHOTS = 300, 12
_NUMBERS = ("camber_error_arcmin", "toe_error_arcmin", "camber_u_arcmin", "toe_u_arcmin")
LOWEST, HIGHEST = 0.92, 0.98


def drawn(calibration: RigCalibration, covariance: Array, rng: np.random.Generator) -> RigCalibration:
    """Cameras, and a measured pose, that deviate from a calibration's by a draw from a covariance.

    They carry the covariance along.
    """
    values, vectors = np.linalg.eigh(covariance)
    move = vectors @ (np.sqrt(np.maximum(values, 0.0)) * rng.standard_normal(len(values)))
    heads, at = [], 0
    for head in calibration.heads:
        cameras = []
        for camera in head.cameras:
            size = 6 + len(camera.model.parameters)
            cameras.append(_moved(camera, move[at : at + size]))
            at += size
        heads.append(HeadCalibration(head.name, *cameras))
    pose = calibration.vehicle_from_rig
    if calibration.vehicle_from_rig_measured:
        pose = pose.perturbed(move[at : at + 3], move[at + 3 :])
    return replace(calibration, heads=tuple(heads), vehicle_from_rig=pose, covariance=covariance)


def _moved(camera: PosedCamera, by: Array) -> PosedCamera:
    return PosedCamera(
        camera.model.with_parameters(camera.model.parameters + by[6:]),
        camera.rig_from_camera.perturbed(by[:3], by[3:6]),
    )


def run(seed: int, quick: bool, progress: Progress) -> StudyResult:
    """Run the study; see `RunStudy`."""
    count = QUICK_SHOTS if quick else SHOTS
    rig = study_rig("standard", seed)
    rng = np.random.default_rng([seed, 5])
    progress(0.0, "plate")
    covariance = calibrate_from_plate(rig, seed).covariance
    assert covariance is not None  # the joint adjustment always states one
    rows: list[Row] = []
    for k in range(count):
        progress((k + 1) / (count + 1), f"shot {k + 1} of {count}")
        camber, toe = np.radians(rng.uniform(-3.0, 3.0, 2))
        shape = str(rng.choice(sorted(SHAPES)))
        scene = replace(
            draw_scene(rig.spec, rig.side, draw_pose(rng, float(camber), float(toe)), rng, shape, seed=seed),
            ambient=float(rng.uniform(0.05, 0.6)),
        )
        exposure = float(rng.uniform(2.5, 6.0))
        images = exposed(lights(scene, rig.true), scene, rng, exposure)
        prepared = PreparedRig.of(drawn(rig.true, covariance, rng), MeasureSettings())
        for method in PLANE_METHODS:
            result = measure_wheel(images, prepared, MeasureSettings(method=method))
            rows.append(
                {
                    "shot": k + 1,
                    "tyre": shape,
                    "exposure_ms": exposure,
                    "camber_deg": math.degrees(camber),
                    "toe_deg": math.degrees(toe),
                    "method": method,
                    **_found(result, scene),
                }
            )
    return summarise_coverage(rows, quick)


def _found(result: WheelMeasurement | Refusal, scene: WheelScene) -> Row:
    """Errors and stated uncertainties; None where the wheel was refused."""
    if not isinstance(result, WheelMeasurement):
        return dict.fromkeys(_NUMBERS)
    off = errors_arcmin(result, scene)
    return dict(zip(_NUMBERS, (*off, result.camber_u / ARCMIN, result.toe_u / ARCMIN), strict=True))


def summarise_coverage(rows: Sequence[Row], quick: bool) -> StudyResult:
    """Count for each method how many intervals hold the truth; a few shots are judged as chance allows."""
    figures: dict[str, float] = {}
    goals: list[Goal] = []
    every: dict[str, Array] = {}
    slack = 0.2 if quick else 0.0
    for method in PLANE_METHODS:
        mine = [row for row in rows if row["method"] == method]
        values = [[row[name] for name in _NUMBERS] for row in mine if row[_NUMBERS[0]] is not None]
        table = np.array(values, dtype=np.float64).reshape(-1, len(_NUMBERS))
        ratios = every[method] = table[:, :2] / table[:, 2:]
        inside = np.abs(ratios) <= stats.norm.ppf(0.975)
        figures |= {
            f"{method}_covered": float(inside.mean()),
            f"{method}_camber_covered": float(inside[:, 0].mean()),
            f"{method}_toe_covered": float(inside[:, 1].mean()),
            f"{method}_camber_error_over_stated_rms": float(np.sqrt(np.square(ratios[:, 0]).mean())),
            f"{method}_toe_error_over_stated_rms": float(np.sqrt(np.square(ratios[:, 1]).mean())),
            f"{method}_stated_median_arcmin": float(np.median(table[:, 2:])),
            f"{method}_largest_error_arcmin": float(np.abs(table[:, :2]).max()),
            f"{method}_refused": float(len(mine) - len(values)),
        }
        goals += [
            Goal(f"{method}_covered", "at_least", LOWEST - slack),
            Goal(f"{method}_covered", "at_most", HIGHEST + slack),
        ]
    shots = len({row["shot"] for row in rows})
    told = ", ".join(f"{100 * figures[f'{method}_covered']:.1f} % ({method})" for method in PLANE_METHODS)
    text = f"""
{shots} random shots (three tyre shapes, any pose within ±3° and ±8 mm, ambient light and exposure drawn);
for each the cameras were drawn anew from the covariance of a calibration from a rendered plate, and the same
images were measured by every method. The 95 % intervals of camber and toe hold the truth in
{told}.

The two methods that are kept for comparison state what limits them, which is not noise: a plane follows the
relief of the sidewall, which stands out at the same radius before every head, and a bend of a light line is
found up or down the sidewall, all those of a head alike.
"""
    return StudyResult(tuple(rows), figures, tuple(goals), text, {"coverage": _plot(every)})


@in_style
def _plot(ratios: Mapping[str, Array]) -> Figure:
    figure = Figure(figsize=(11, 3.6), layout="constrained")
    x = np.linspace(-4.0, 4.0, 200)
    for axes, (method, of_method) in zip(figure.subplots(1, len(ratios)), ratios.items(), strict=True):
        for values, name in zip(of_method.T, ("camber", "toe"), strict=True):
            axes.hist(values, bins=np.linspace(-4.0, 4.0, 25).tolist(), density=True, alpha=0.5, label=name)
        axes.plot(x, stats.norm.pdf(x), color=REFERENCE, label="normal")
        axes.set_title(method)
        axes.set_xlabel("error / stated standard uncertainty")
    figure.axes[0].set_ylabel("density")
    legend_outside(figure)
    return figure


STUDY = Study("coverage", "How often the stated 95 % intervals of random shots hold the truth.", run)
