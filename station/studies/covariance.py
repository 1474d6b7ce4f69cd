"""Study `covariance`: is the predicted uncertainty of a calibration the scatter of many calibrations?

One rig is calibrated again and again from simulated views with fresh errors of marks, stage and pixels. Each
calibration measures the same points and the same wheel; what their results scatter is compared with what each
calibration predicted of itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from alignment.arrays import Array
from alignment.calibration import (
    NominalWheel,
    adjust,
    cameras_of_rig,
    point_covariance,
    predict_angle_uncertainty,
    wheel_points,
)
from alignment.stereo import Rectification, triangulate
from alignment.units import ARCMIN
from alignment.values import HeadCalibration, RigCalibration
from alignment.vehicle import camber_toe
from alignment.wheel import fit_revolution
from db.exports import in_style, legend_outside
from sensors.simulation import RIG_SPECS, build_rig
from station.figures import Goal, Progress, Row, Study, StudyResult
from station.studies.simulated_views import STAGES, observe, square_plate

WITHIN = 0.15
_POINTS = np.array([[0.0, 0.0, 0.0], [35.0, 30.0, 20.0], [-40.0, -30.0, -20.0]])
"""Measured by the first head, relative to the middle of its field, millimetres."""
_LINE_SIGMA_MM = 0.04


@dataclass(frozen=True, eq=False)
class Repeats:
    """Errors of many calibrations of one rig, and what each predicted.

    Attributes
    ----------
    angles, angles_u
        (K, 2) measured camber and toe, and their predicted standard deviations, radians.
    points, points_u
        (K, 3, 3) errors of three points and their predicted standard deviations, millimetres.
    """

    angles: Array
    angles_u: Array
    points: Array
    points_u: Array

    @property
    def angle_ratios(self) -> Array:
        """(2,) scatter of camber and toe over its prediction."""
        return _ratio(self.angles, self.angles_u)

    @property
    def point_ratios(self) -> Array:
        """(3, 3) scatter of the points' coordinates over its prediction."""
        return _ratio(self.points, self.points_u)


def _ratio(values: Array, predicted: Array) -> Array:
    out: Array = values.std(axis=0, ddof=1) / np.sqrt(np.square(predicted).mean(axis=0))
    return out


def repeat_calibrations(count: int, seed: int, progress: Progress, views: int = len(STAGES)) -> Repeats:
    """Calibrate one rig `count` times from fresh views.

    Parameters
    ----------
    count
        Calibrations.
    seed
        Of the rig and of all errors.
    progress
        Told how far it is.
    views
        Stage positions of each calibration.
    """
    true = build_rig(RIG_SPECS["standard"], "front_left", "left", np.random.default_rng(seed))
    cameras, plate = cameras_of_rig(true), square_plate()
    wheel = NominalWheel()
    seen = [
        (head.left.project(points), head.right.project(points))
        for head, points in ((head, wheel_points(head, wheel)) for head in true.heads)
    ]
    first = true.heads[0]
    points = _POINTS + np.array([0.0, 266.0, 0.0])
    left, right = first.left.project(points), first.right.project(points)
    angles, angles_u, errors, errors_u = [], [], [], []
    for k in range(count):
        progress(k / count, f"calibration {k + 1} of {count}")
        views_of_one = observe(cameras, plate, STAGES[:views], np.random.default_rng([seed, 1, k]))
        calibration = adjust(views_of_one.data).rig_calibration(
            "repeat", true.rig, true.side, true.vehicle_from_rig
        )
        angles.append(measured_angles(calibration, seen))
        angles_u.append(predict_angle_uncertainty(calibration))
        head = calibration.heads[0]
        errors.append(triangulate(head.left, head.right, left, right)[0] - points)
        errors_u.append(np.sqrt(np.diagonal(point_covariance(calibration, 0, points), axis1=1, axis2=2)))
    return Repeats(np.array(angles), np.array(angles_u), np.array(errors), np.array(errors_u))


def measured_angles(calibration: RigCalibration, seen: list[tuple[Array, Array]]) -> tuple[float, float]:
    """Camber and toe, radians, of the wheel whose points each head saw at these (left, right) pixels."""
    points = np.concatenate(
        [line_points(head, *pixels) for head, pixels in zip(calibration.heads, seen, strict=True)]
    )
    count = len(points)
    fit = fit_revolution(
        points,
        np.full(count, _LINE_SIGMA_MM),
        np.tile([0.0, 0.0, -1.0], (count, 1)),
        np.arange(count),
        np.array([0.0, 0.0, 1.0]),
        np.zeros(3),
    )
    return camber_toe(calibration.vehicle_from_rig.rotation @ fit.normal, calibration.side)


def line_points(head: HeadCalibration, left: Array, right: Array) -> Array:
    """Points (N, 3) where left rays meet right light lines that cross the epipolar lines at right angles."""
    frame = Rectification.of(head.left, head.right)
    uv, _ = frame.coordinates(head.left, left)
    of_right, _ = frame.coordinates(head.right, right)
    depth = frame.baseline / (uv[:, 0] - of_right[:, 0])
    rays = np.column_stack([uv, np.ones(len(uv))])
    out: Array = frame.origin + (rays * depth[:, None]) @ frame.rectified_from_rig
    return out


def run(seed: int, quick: bool, progress: Progress) -> StudyResult:
    """Run the study; see `RunStudy`."""
    count = 40 if quick else 200
    repeats = repeat_calibrations(count, seed, progress)
    rows: list[Row] = []
    for n, name in enumerate(("camber", "toe")):
        rows.append(_row(name, "arcmin", repeats.angles[:, n] / ARCMIN, repeats.angles_u[:, n] / ARCMIN))
    for p in range(len(_POINTS)):
        for n, axis in enumerate("xyz"):
            rows.append(
                _row(f"point_{p + 1}_{axis}", "mm", repeats.points[:, p, n], repeats.points_u[:, p, n])
            )
    angles, points = repeats.angle_ratios, repeats.point_ratios
    figures = {
        "camber_scatter_over_prediction": float(angles[0]),
        "toe_scatter_over_prediction": float(angles[1]),
        "points_scatter_over_prediction": float(np.sqrt(np.square(points).mean())),
        "camber_scatter_arcmin": float(repeats.angles[:, 0].std(ddof=1) / ARCMIN),
        "toe_scatter_arcmin": float(repeats.angles[:, 1].std(ddof=1) / ARCMIN),
        "calibrations": float(count),
    }
    # So many repeats know a standard deviation to 1/√(2K) themselves.
    limit = WITHIN + (2.0 / math.sqrt(2.0 * count) if quick else 0.0)
    goals = tuple(
        goal
        for name in list(figures)[:3]
        for goal in (Goal(name, "at_most", 1.0 + limit), Goal(name, "at_least", 1.0 - limit))
    )
    text = f"""
{count} calibrations of one rig of three heads from {len(STAGES)} stage positions of a plate, each with fresh
errors: marks and stage ±0.01 mm, pixels 0.02 px. A prediction is honest when it is the scatter; {count}
repeats know a standard deviation to {100 / math.sqrt(2 * count):.0f} %. Camber scatters by
{figures["camber_scatter_arcmin"]:.4f}′, toe by {figures["toe_scatter_arcmin"]:.4f}′.
"""
    return StudyResult(tuple(rows), figures, goals, text, {"covariance": _plot(repeats)})


def _row(name: str, unit: str, values: Array, predicted: Array) -> Row:
    scatter, stated = float(values.std(ddof=1)), float(np.sqrt(np.square(predicted).mean()))
    return {"of": name, "unit": unit, "scatter": scatter, "predicted": stated, "ratio": scatter / stated}


@in_style
def _plot(repeats: Repeats) -> Figure:
    figure = Figure(figsize=(10, 4.5), layout="constrained")
    axes = figure.subplots(1, 2)
    for at, n, name in zip(axes, (0, 1), ("camber", "toe"), strict=True):
        values = (repeats.angles[:, n] - repeats.angles[:, n].mean()) / ARCMIN
        stated = float(np.sqrt(np.square(repeats.angles_u[:, n]).mean())) / ARCMIN
        at.hist(values, bins=24, density=True, alpha=0.5, label="scatter")
        x = np.linspace(-4.0 * stated, 4.0 * stated, 200)
        at.plot(x, np.exp(-0.5 * (x / stated) ** 2) / (stated * math.sqrt(2.0 * math.pi)), label="predicted")
        at.set_xlabel(f"error of {name}, arcmin")
        at.set_ylabel("density, 1/arcmin")
    legend_outside(figure)
    return figure


STUDY = Study(
    "covariance", "Predicted uncertainty of points, camber and toe against the scatter of calibrations.", run
)
