"""Study `coverage`: how often do the stated 95 % intervals hold the truth?

Tyre, pose and light are drawn at random. The rig is calibrated once from a rendered plate; for each shot the
cameras that measure are drawn anew from the covariance that this calibration states, and carry it.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure
from scipy import stats

from alignment.arrays import Array
from alignment.geometry import PosedCamera
from alignment.measure import measure_wheel
from alignment.units import ARCMIN
from alignment.values import HeadCalibration, MeasureSettings, RigCalibration, WheelMeasurement
from db.exports import REFERENCE, in_style, legend_outside
from sensors.simulation import SHAPES, draw_pose, draw_scene
from station.figures import Goal, Progress, Row, Study, StudyResult
from station.studies.wheels import calibrate_from_plate, errors_arcmin, exposed, lights, study_rig

SHOTS, QUICK_SHOTS = 300, 12
LOWEST, HIGHEST = 0.92, 0.98


def drawn(calibration: RigCalibration, covariance: Array, rng: np.random.Generator) -> RigCalibration:
    """Cameras that deviate from a calibration's by a draw from a covariance, which they carry along."""
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
    return replace(calibration, heads=tuple(heads), covariance=covariance)


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
    refused = 0
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
        result = measure_wheel(images, drawn(rig.true, covariance, rng), MeasureSettings())
        if not isinstance(result, WheelMeasurement):
            refused += 1
            continue
        off = errors_arcmin(result, scene)
        rows.append(
            {
                "shot": k + 1,
                "tyre": shape,
                "exposure_ms": exposure,
                "camber_deg": math.degrees(camber),
                "toe_deg": math.degrees(toe),
                "camber_error_arcmin": off[0],
                "toe_error_arcmin": off[1],
                "camber_u_arcmin": result.camber_u / ARCMIN,
                "toe_u_arcmin": result.toe_u / ARCMIN,
            }
        )
    errors = np.array([[r["camber_error_arcmin"], r["toe_error_arcmin"]] for r in rows], dtype=np.float64)
    stated = np.array([[r["camber_u_arcmin"], r["toe_u_arcmin"]] for r in rows], dtype=np.float64)
    ratios = errors.reshape(-1, 2) / stated.reshape(-1, 2)
    inside = np.abs(ratios) <= stats.norm.ppf(0.975)
    figures = {
        "camber_covered": float(inside[:, 0].mean()),
        "toe_covered": float(inside[:, 1].mean()),
        "both_covered": float(inside.mean()),
        "camber_error_over_stated_rms": float(np.sqrt(np.square(ratios[:, 0]).mean())),
        "toe_error_over_stated_rms": float(np.sqrt(np.square(ratios[:, 1]).mean())),
        "largest_error_arcmin": float(np.abs(errors).max()),
        "shots": float(len(rows)),
        "refused": float(refused),
    }
    # A few shots cannot show 95 %: the quick form allows what chance allows.
    slack = 0.2 if quick else 0.0
    goals = (
        Goal("both_covered", "at_least", LOWEST - slack),
        Goal("both_covered", "at_most", HIGHEST + slack),
    )
    text = f"""
{len(rows)} random shots (three tyre shapes, any pose within ±3° and ±8 mm, ambient light and exposure drawn);
for each the cameras were drawn anew from the covariance of a calibration from a rendered plate. The 95 %
intervals of camber and toe hold the truth in {100 * inside.mean():.1f} %.
"""
    return StudyResult(tuple(rows), figures, goals, text, {"coverage": _plot(ratios)})


@in_style
def _plot(ratios: Array) -> Figure:
    figure = Figure(figsize=(8, 3.6), layout="constrained")
    axes = figure.subplots()
    x = np.linspace(-4.0, 4.0, 200)
    for values, name in zip(ratios.T, ("camber", "toe"), strict=True):
        axes.hist(values, bins=np.linspace(-4.0, 4.0, 25).tolist(), density=True, alpha=0.5, label=name)
    axes.plot(x, stats.norm.pdf(x), color=REFERENCE, label="normal")
    axes.set_xlabel("error / stated standard uncertainty")
    axes.set_ylabel("density")
    legend_outside(figure)
    return figure


STUDY = Study("coverage", "How often the stated 95 % intervals of random shots hold the truth.", run)
