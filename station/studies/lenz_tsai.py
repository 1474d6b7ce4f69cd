"""Study `lenz-tsai`: errors of points, pixels and x scale factor in two calibrations (thesis 3.3.4).

The thesis does not print its camera's place. Taken here, so that a scale error of 0.4 % alone costs Lenz
about the published 3 mm: 8 mm lens, board with 121 points 500 mm away, leaning by 40° about x. Errors lie
evenly between 0 and their size, as the thesis says of its own.
"""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from alignment.arrays import Array
from alignment.calibration import Known, calibrate_lenz, calibrate_tsai
from alignment.errors import DegenerateInputError
from alignment.geometry import CameraModel, PosedCamera, RigidTransform
from db.exports import REFERENCE, in_style, legend_outside
from station.figures import Goal, Progress, Row, Study, StudyResult

_SIZE = (752, 582)
SCALE_X, SCALE_Y = 116.589, 120.248
"""Pixels per millimetre of the CV-M50."""
FOCAL_MM, DISTANCE_MM, LEAN = 8.0, 500.0, math.radians(40.0)
PITCH_MM, HEIGHTS_MM = 26.0, (-40.0, 0.0, 40.0)
SCALE_ERRORS = (0.0, 0.001, 0.002, 0.003, 0.004)
LARGEST = 2.0


def camera() -> PosedCamera:
    """The true camera, in the frame of the board."""
    model = CameraModel(*_SIZE, SCALE_X * FOCAL_MM, SCALE_Y * FOCAL_MM, 375.5, 290.5, "division", (0.0,))
    look = Rotation.from_euler("x", math.pi + LEAN).as_matrix()
    return PosedCamera(model, RigidTransform(look, np.array([0.0, 0.0, DISTANCE_MM])).inverse())


def board(heights_mm: tuple[float, ...]) -> Array:
    """Points (121 · heights, 3), millimetres."""
    across = PITCH_MM * np.arange(-5, 6)
    x, y = np.meshgrid(across, across)
    return np.concatenate([np.column_stack([x.ravel(), y.ravel(), np.full(x.size, z)]) for z in heights_mm])


def position_error(found: PosedCamera, true: PosedCamera, points: Array) -> float:
    """Mean |(world from camera, found)(camera from world, true) x − x| of points x (N, 3), mm (3.144)."""
    moved = (found.rig_from_camera @ true.rig_from_camera.inverse()).apply(points)
    return float(np.linalg.norm(moved - points, axis=1).mean())


def _errors(
    true: PosedCamera, points_mm: float, pixels: float, rng: np.random.Generator, sets: int
) -> tuple[Array, Array]:
    """v of Lenz (sets, scale errors) and Tsai (sets, scale errors), NaN where Lenz finds no camera."""
    flat, space = board((0.0,)), board(HEIGHTS_MM)
    middle = slice(len(flat), 2 * len(flat))
    lenz, tsai = np.full((sets, len(SCALE_ERRORS)), np.nan), np.empty((sets, len(SCALE_ERRORS)))
    for k in range(sets):
        # The same errors for both methods: Lenz sees the middle board of Tsai's three.
        seen = true.project(space + points_mm * rng.uniform(0.0, 1.0, space.shape))
        seen += pixels * rng.uniform(0.0, 1.0, seen.shape)
        for s, error in enumerate(SCALE_ERRORS):
            known = Known(aspect=(1.0 + error) * SCALE_X / SCALE_Y)
            try:
                found = calibrate_lenz(flat, seen[middle], _SIZE, known)
                lenz[k, s] = position_error(found.camera, true, flat)
            except DegenerateInputError:
                pass
            tsai[k, s] = position_error(calibrate_tsai(space, seen, _SIZE, known).camera, true, space)
    return lenz, tsai


def run(seed: int, quick: bool, progress: Progress) -> StudyResult:
    """Run the study; see `RunStudy`."""
    true, sets = camera(), 10 if quick else 50
    levels = np.linspace(0.0, LARGEST, 5 if quick else 11)
    rows: list[Row] = []
    curves: dict[str, tuple[Array, Array]] = {}
    missing = 0
    flatness = 0.0
    for kind, (name, unit) in enumerate((("points", "mm"), ("pixels", "px"))):
        lenz_curve, tsai_curve = np.empty((len(levels), len(SCALE_ERRORS))), np.empty(len(levels))
        for k, level in enumerate(levels):
            progress((kind * len(levels) + k) / (2 * len(levels)), f"errors of {name}, {level:.1f} {unit}")
            # Every level has the same errors, larger: the curves are smooth.
            rng = np.random.default_rng([seed, kind])
            points_mm, pixels = (level, 0.0) if name == "points" else (0.0, level)
            lenz, tsai = _errors(true, points_mm, pixels, rng, sets)
            missing += int(np.isnan(lenz).sum())
            lenz_curve[k], tsai_curve[k] = np.nanmean(lenz, axis=0), tsai[:, 0].mean()
            flatness = max(flatness, float(np.ptp(tsai, axis=1).max()))
            for s, error in enumerate(SCALE_ERRORS):
                rows.append(
                    {
                        "errors_of": name,
                        "size": round(float(level), 6),
                        "unit": unit,
                        "scale_error_percent": 100.0 * error,
                        "lenz_mm": float(lenz_curve[k, s]),
                        "tsai_mm": float(tsai[:, s].mean()),
                        "sets": sets,
                    }
                )
        curves[name] = lenz_curve, tsai_curve
    by_points, by_pixels = curves["points"][0], curves["pixels"][0]
    figures = {
        "tsai_change_over_scale_error_mm": flatness,
        "lenz_at_scale_error_0.4_percent_mm": float(by_points[0, -1]),
        "lenz_at_scale_error_0.4_percent_and_points_2_mm_mm": float(by_points[-1, -1]),
        "lenz_at_scale_error_0.4_percent_and_pixels_2_px_mm": float(by_pixels[-1, -1]),
        "tsai_at_points_2_mm_mm": float(curves["points"][1][-1]),
        "tsai_at_pixels_2_px_mm": float(curves["pixels"][1][-1]),
        "lenz_without_result": float(missing),
    }
    goals = (
        Goal("tsai_change_over_scale_error_mm", "at_most", 1e-6),
        Goal("lenz_at_scale_error_0.4_percent_mm", "at_least", 2.5),
        Goal("lenz_at_scale_error_0.4_percent_mm", "at_most", 3.5),
    )
    text = f"""
Mean error of the position vector over the points and {sets} sets of errors. Camera: CV-M50, 752 × 582, 8 mm
lens; 121 points at {PITCH_MM:g} mm, {DISTANCE_MM:g} mm away, leaning by 40°; three heights for Tsai.

Published (figures 3.13 and 3.14): Tsai does not feel the scale error; Lenz errs by about 3 mm at 0.4 %, by
almost 6 mm with point errors up to 2 mm on top. Found: {by_points[0, -1]:.2f} mm and
{by_points[-1, -1]:.2f} mm. Published: above 0.2 % pixel errors hardly matter. Found at 0.4 %:
{by_pixels[0, -1]:.2f} mm without and {by_pixels[-1, -1]:.2f} mm with pixel errors of 2 px.
"""
    return StudyResult(tuple(rows), figures, goals, text, {"lenz-tsai": _plot(levels, curves)})


@in_style
def _plot(levels: Array, curves: dict[str, tuple[Array, Array]]) -> Figure:
    figure = Figure(figsize=(10, 4.5), layout="constrained")
    axes: list[Axes] = list(figure.subplots(1, 2, sharey=True))
    for at, (name, unit, published) in zip(
        axes, (("points", "mm", "3.13"), ("pixels", "px", "3.14")), strict=True
    ):
        lenz, tsai = curves[name]
        for error, curve in zip(SCALE_ERRORS, lenz.T, strict=True):
            at.plot(levels, curve, label=f"Lenz, scale off by {100 * error:.1f} %")
        at.plot(levels, tsai, "--", color=REFERENCE, label="Tsai, any scale error")
        at.set_xlabel(f"largest error of the {name}, {unit}")
        at.set_title(f"as figure {published} of the thesis")
    axes[0].set_ylabel("error of the position vector, mm")
    legend_outside(figure, axes[:1], columns=3)
    return figure


STUDY = Study(
    "lenz-tsai", "Lenz and Tsai under errors of points, pixels and the x scale factor (thesis 3.3.4).", run
)
