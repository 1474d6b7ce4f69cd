"""Study `refresh`: a camera is knocked, and ordinary wheels bring the angles back.

Each rig is calibrated from simulated views of the plate with all its errors; then one camera, drawn at
random, turns and shifts. Rendered shots of different wheels are what `truewheel calibration refresh` gets.
Scored is what the calibrations make of a nominal wheel, against the true cameras.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.figure import Figure

from alignment.arrays import Array
from alignment.calibration import (
    CameraKey,
    NominalWheel,
    Refreshed,
    adjust,
    angle_covariance,
    cameras_of_rig,
    refresh,
    stepped,
    wheel_points,
    with_camera,
)
from alignment.geometry import RigidTransform
from alignment.units import ARCMIN
from alignment.values import MeasureSettings, RigCalibration, StereoImages
from db.exports import REFERENCE, in_style, legend_outside, whole_numbers
from sensors.simulation import (
    RIG_SPECS,
    SHAPES,
    build_rig,
    draw_pose,
    draw_scene,
    plate_positions,
    simulate_shot,
)
from station.figures import Goal, Progress, Row, Study, StudyResult
from station.studies.covariance import measured_angles
from station.studies.simulated_views import ViewErrors, observe, square_plate

RIGS, QUICK_RIGS = 20, 2
SHOTS, QUICK_SHOTS = 10, 3
TURN, SHIFT_MM = 1e-3, 0.05
"""Standard deviations of a knock."""
PIXEL = 0.01  # what finding the marks of a sharp plate leaves
ACROSS_ARCMIN = 0.05
_HONEST = 0.15


KnockedRig = tuple[RigCalibration, RigCalibration, CameraKey]
_Estimating = Callable[[Sequence[Sequence[StereoImages]], RigCalibration, MeasureSettings], Refreshed]


def knocked_rig(rng: np.random.Generator) -> KnockedRig:
    """Return a calibration in force, the true cameras since a knock, and which one was knocked."""
    true = build_rig(RIG_SPECS["standard"], "front_left", "left", rng)
    poses = [
        RigidTransform.from_rotvec(np.array([*position.tilt, 0.0]), np.array(position.stage_mm))
        if any(position.tilt)
        else position.stage_mm
        for position in plate_positions()
    ]
    views = observe(cameras_of_rig(true), square_plate(), poses, rng, ViewErrors(pixel=PIXEL))
    known = adjust(views.data).rig_calibration("plate", true.rig, true.side, true.vehicle_from_rig)
    head, side = int(rng.integers(3)), int(rng.integers(2))
    camera = true.heads[head].cameras[side]
    step = np.zeros(6 + len(camera.model.parameters))
    step[:6] = np.concatenate([rng.normal(0.0, TURN, 3), rng.normal(0.0, SHIFT_MM, 3)])
    now = with_camera(true, head, side, stepped(camera, step))
    return known, now, (true.heads[head].name, "right" if side else "left")


def angle_errors(known: RigCalibration, true: RigCalibration) -> Array:
    """(2,) errors of camber and toe of a nominal wheel, radians."""
    seen = [
        (head.left.project(points), head.right.project(points))
        for head, points in ((head, wheel_points(head, NominalWheel())) for head in true.heads)
    ]
    out: Array = np.subtract(measured_angles(known, seen), measured_angles(true, seen))
    return out


def _row(rig: int, found: Refreshed, known: RigCalibration, now: RigCalibration, camera: CameraKey) -> Row:
    before, after = angle_errors(known, now), angle_errors(found.calibration, now)
    # The two other heads hold the angles well across, and badly about, the line that joins them.
    variances, axes = np.linalg.eigh(angle_covariance(found.calibration))
    across, along = axes.T @ after
    return {
        "rig": rig,
        "camera": " ".join(camera),
        "found": int(found.moved is not None and found.moved.camera == camera),
        "certain": int(found.certain),
        "before_arcmin": float(np.linalg.norm(before)) / ARCMIN,
        "after_arcmin": float(np.linalg.norm(after)) / ARCMIN,
        "along_arcmin": float(along) / ARCMIN,
        "along_u_arcmin": math.sqrt(variances[1]) / ARCMIN,
        "across_arcmin": float(across) / ARCMIN,
        "across_u_arcmin": math.sqrt(variances[0]) / ARCMIN,
    }


def run(seed: int, quick: bool, progress: Progress) -> StudyResult:
    """Run the study; see `RunStudy`."""
    rigs, shots = (QUICK_RIGS, QUICK_SHOTS) if quick else (RIGS, SHOTS)
    return run_rigs(rigs, shots, seed, progress)


def _pictured(now: RigCalibration, rng: np.random.Generator) -> tuple[StereoImages, ...]:
    """Rendered images of a wheel, drawn at random, before these cameras."""
    camber, toe = rng.uniform(-0.03, 0.03, 2)
    pose, spec = draw_pose(rng, camber, toe), RIG_SPECS["standard"]
    scene = draw_scene(spec, "left", pose, rng, str(rng.choice(sorted(SHAPES))))
    return simulate_shot(scene, now, rng).images


def run_rigs(
    rigs: int,
    shots: int,
    seed: int,
    progress: Progress,
    *,
    knock: Callable[[np.random.Generator], KnockedRig] = knocked_rig,
    picture: Callable[[RigCalibration, np.random.Generator], Sequence[StereoImages]] = _pictured,
    estimate: _Estimating = refresh,
) -> StudyResult:
    """Run the study with so many rigs and shots; how rigs, pictures and estimates come about is given."""
    rows: list[Row] = []
    for k in range(rigs):
        rng = np.random.default_rng([seed, 11, k])
        known, now, camera = knock(rng)
        images = []
        for n in range(shots):
            progress((k + n / (shots + 1)) / rigs, f"rig {k + 1} of {rigs}, shot {n + 1} of {shots}")
            images.append(picture(now, rng))
        progress((k + shots / (shots + 1)) / rigs, f"rig {k + 1} of {rigs}, refresh")
        rows.append(_row(k + 1, estimate(images, known, MeasureSettings()), known, now, camera))
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0] if name != "camera"}

    def rms(name: str) -> float:
        return float(np.sqrt(np.square(columns[name]).mean()))

    figures = {
        "cameras_found": float(columns["found"].mean()),
        "before_rms_arcmin": rms("before_arcmin"),
        "along_rms_arcmin": rms("along_arcmin"),
        "along_predicted_arcmin": rms("along_u_arcmin"),
        "along_over_predicted": rms("along_arcmin") / rms("along_u_arcmin"),
        "across_rms_arcmin": rms("across_arcmin"),
        "across_predicted_arcmin": rms("across_u_arcmin"),
        "rigs": float(rigs),
        "shots": float(shots),
    }
    # So many repeats know a standard deviation to 1/√(2K) themselves.
    goals = (
        Goal("cameras_found", "at_least", 1.0),
        Goal("across_rms_arcmin", "at_most", ACROSS_ARCMIN),
        Goal("along_over_predicted", "at_most", 1.0 + _HONEST + 2.0 / math.sqrt(2.0 * rigs)),
    )
    text = f"""
{rigs} rigs, each with one camera that turned by {1e3 * TURN:g} mrad and shifted by {SHIFT_MM:g} mm
(standard deviations, about and along each axis), {shots} shots each. The angles were off by
{figures["before_rms_arcmin"]:.1f}′ RMS. Afterwards they are right to
{figures["across_rms_arcmin"]:.3f}′ across, and to {figures["along_rms_arcmin"]:.3f}′ along the
direction in which a wheel leans about the line that joins the two heads that did not move;
predicted {figures["along_predicted_arcmin"]:.3f}′. That direction rests on how well the plate
knows these two heads, which more shots do not change.
"""
    return StudyResult(tuple(rows), figures, goals, text, {"refresh": _plot(columns)})


@in_style
def _plot(columns: dict[str, Array]) -> Figure:
    figure = Figure(figsize=(8, 3.6), layout="constrained")
    axes = figure.subplots()
    for name in ("along", "across"):
        axes.errorbar(
            columns["rig"],
            columns[f"{name}_arcmin"],
            columns[f"{name}_u_arcmin"],
            fmt="o",
            label=f"{name} the weak direction",
        )
    axes.axhline(0.0, color=REFERENCE, lw=0.8)
    axes.set_xlabel("rig")
    axes.set_ylabel("error after refresh, arcmin")
    whole_numbers(axes, "x")
    legend_outside(figure)
    return figure


STUDY = Study(
    "refresh", "A knocked camera estimated anew from ordinary wheels: angles before and after.", run
)
