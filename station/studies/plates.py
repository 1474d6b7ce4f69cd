"""Study `plates`: a head calibrated with plates that people own, against a ring-marked plate of that size.

The head of the study `parallel-head`, 752 × 582 pixels, is calibrated six times over from the same positions
of the stage: with the plate with ring marks, and with grids of circles, of white circles, every other circle,
a chessboard and a ChArUco board, all 80 mm wide, all with marks off by up to ±0.01 mm. Points of the volume
are then measured by the calibrated cameras from where the true ones see them, without noise: what is left is
the calibration's own error.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from alignment.arrays import Array
from alignment.calibration import CalibrationInput, CameraKey, cameras_of_rig
from alignment.errors import DegenerateInputError
from alignment.geometry import PosedCamera
from alignment.stereo import triangulate
from alignment.units import ARCMIN
from alignment.values import RigCalibration
from db.exports import BAD, SERIES, in_style, legend_outside
from sensors.formats import PatternPlateFile, PlateDescription, PlateTruth, describe_plate
from station.calibration import observe_session
from station.figures import Goal, Progress, Row, Study, StudyResult
from station.studies.heads import HeadSpec, build_head, calibrate_jointly, ringed_plate, take_images

OWN = "ring_marks"
LARGEST_RATIO = 1.5
SPEC = HeadSpec(
    focal_mm=10.0,
    baseline_mm=60.0,
    distance_mm=300.0,
    coefficients=(-0.08, 0.05, 0.0, 0.0, 0.0),
    lens=(0.01, 0.01, 2e-4, 2e-4, 0.0),
)
_STAGES = (
    (0.0, 0.0, 0.0),
    (0.0, 0.0, -30.0),
    (4.0, 4.0, -15.0),
    (-4.0, 4.0, 15.0),
    (0.0, 0.0, 30.0),
    (4.0, -4.0, 8.0),
    (-4.0, -4.0, -8.0),
)
_FEW_STAGES = 5  # of them, for the quick study and the tests
_PITCH_MM, _DIAMETER_MM = 8.0, 5.4
_HALF_MM = 40.0
_LABELS = {"charuco": "ChArUco"}


def compared_plates() -> dict[str, PlateDescription]:
    """Return the plates that are compared, by name, the one with ring marks first."""
    grid = {"columns": (-5, 5), "rows": (-5, 5), "pitch_x_mm": _PITCH_MM, "pitch_y_mm": _PITCH_MM}
    circles = {"mark_diameter_mm": _DIAMETER_MM, "orientation": "stage"}
    diagonal = _PITCH_MM / math.sqrt(2.0)
    every_other = {"columns": (-7, 7), "rows": (-7, 6), "pitch_x_mm": diagonal, "pitch_y_mm": diagonal}
    marker = {"dictionary": "DICT_4X4_250", "marker_mm": 0.75 * _PITCH_MM}
    described = {
        "circles": ("circles", grid | circles),
        "white_circles": ("circles", grid | circles | {"bright": True}),
        "asymmetric_circles": ("asymmetric_circles", every_other | {"mark_diameter_mm": _DIAMETER_MM}),
        "chessboard": ("chessboard", grid | {"rows": (-5, 4)}),
        "charuco": ("charuco", grid | marker),
    }
    own = {OWN: ringed_plate(11, _PITCH_MM, _DIAMETER_MM)}
    return own | {name: described_plate(name, *what) for name, what in described.items()}


def described_plate(name: str, pattern: str, fields: Mapping[str, Any]) -> PlateDescription:
    """Return a plate without ring marks, of these fields of its file."""
    known = {"schema": "truewheel.pattern-plate/1", "name": name.replace("_", "-"), "pattern": pattern}
    return describe_plate(PatternPlateFile.model_validate(known | dict(fields)))


def observed_with(
    true: RigCalibration, plate: PlateDescription, rng: np.random.Generator, views: int
) -> tuple[CalibrationInput, PlateTruth]:
    """Marks of rendered images of a plate before a head, and the truth.

    Raises
    ------
    DegenerateInputError
        When the plate is not recognised in an image.
    """
    session, truth = take_images(true, plate, _STAGES[:views], rng)
    seen, refusals = observe_session(session, lambda _share, _what: None)
    if refusals:
        view, key, refusal = refusals[0]
        raise DegenerateInputError(
            field=f"{view}, {' '.join(key)}", expected="the plate", seen=refusal.reason
        )
    return CalibrationInput(plate.plate, seen, dict(session.sizes), session.stage_sigma_mm), truth


def misnumbered(true: RigCalibration, data: CalibrationInput, truth: PlateTruth) -> int:
    """How many marks were not seen where the truth puts the mark of that number."""
    cameras, wrong = cameras_of_rig(true), 0
    for view in data.views:
        for key, seen in view.observations.items():
            points = truth.rig_from_plate[view.name].apply(truth.points[seen.marks])
            off = np.hypot(*(cameras[key].project(points) - seen.pixels).T)
            wrong += int((off > 5.0).sum())
    return wrong


def calibration_errors(true: RigCalibration, found: Mapping[CameraKey, PosedCamera]) -> tuple[float, float]:
    """RMS errors of what a calibration measures: of points, µm; of the normals of planes, arcminutes."""
    known = cameras_of_rig(true)
    left, right = cameras_of_rig(true)
    steps = np.linspace(-_HALF_MM, _HALF_MM, 9)
    x, y = (values.ravel() for values in np.meshgrid(steps, steps))
    points, normals = [], []
    for z in (-30.0, 0.0, 30.0):
        plane = np.column_stack([x, y, np.full(x.size, z)])
        pixels = [known[key].project(plane) for key in (left, right)]
        measured, _ = triangulate(found[left], found[right], *pixels)
        points.append(measured - plane)
        design = np.column_stack([x, y, np.ones(x.size)])
        normals.append(np.linalg.lstsq(design, measured[:, 2], rcond=None)[0][:2] / ARCMIN)
    return 1000.0 * _rms(np.concatenate(points)), _rms(np.array(normals))


def _rms(values: Array) -> float:
    return math.sqrt(float(np.square(values).sum(axis=1).mean()))


def run(seed: int, quick: bool, progress: Progress) -> StudyResult:
    """Run the study; see `RunStudy`."""
    return run_plates(2 if quick else 8, _FEW_STAGES if quick else len(_STAGES), seed, progress)


def run_plates(heads: int, views: int, seed: int, progress: Progress) -> StudyResult:
    """Run the study with so many heads and views of each plate."""
    compared = compared_plates()
    points: dict[str, list[float]] = {name: [] for name in compared}
    angles: dict[str, list[float]] = {name: [] for name in compared}
    wrong = 0
    for k in range(heads):
        true = build_head(SPEC, np.random.default_rng([seed, k]))
        for n, (name, plate) in enumerate(compared.items()):
            progress((k + n / len(compared)) / heads, f"head {k + 1} of {heads}, {name}")
            data, truth = observed_with(true, plate, np.random.default_rng([seed, k, 1]), views)
            wrong += misnumbered(true, data, truth)
            point, angle = calibration_errors(true, calibrate_jointly(data))
            points[name].append(point)
            angles[name].append(angle)
    figures: dict[str, float] = {"misnumbered_marks": float(wrong)}
    rows: list[Row] = []
    for name in compared:
        of_points, of_angles = (math.sqrt(float(np.mean(np.square(of[name])))) for of in (points, angles))
        figures |= {f"{name}_points_um": of_points, f"{name}_angles_arcmin": of_angles}
        ratios = {
            "points_over_own": of_points / figures[f"{OWN}_points_um"],
            "angles_over_own": of_angles / figures[f"{OWN}_angles_arcmin"],
        }
        figures |= {f"{name}_{what}": ratio for what, ratio in ratios.items() if name != OWN}
        row: Row = {"plate": name, "points_um": of_points, "angles_arcmin": of_angles, "heads": heads}
        rows.append({**row, **ratios})
    goals = tuple(
        Goal(f"{name}_{what}_over_own", "at_most", LARGEST_RATIO)
        for name in compared
        if name != OWN
        for what in ("points", "angles")
    )
    text = f"""
{heads} heads, {views} views of each plate, all plates {2 * _HALF_MM:g} mm wide, marks and stage off by up to
±0.01 mm. Points: RMS error of points in the volume, measured with the calibrated cameras from where the true
cameras see them. Angles: RMS tilt of planes of such points. Goal: at most {LARGEST_RATIO:g} times the figures
of the plate with ring marks. The grids of circles look the same turned by 90°; the stage told how they lay.
"""
    goals = (Goal("misnumbered_marks", "at_most", 0.0), *goals)
    return StudyResult(tuple(rows), figures, goals, text, {"plates": _plot(points)})


@in_style
def _plot(points: Mapping[str, list[float]]) -> Figure:
    figure = Figure(figsize=(8, 4.5), layout="constrained")
    at = figure.subplots()
    for k, of_heads in enumerate(points.values()):
        label = "a head" if k == 0 else None
        at.plot(np.full(len(of_heads), k), of_heads, "o", color=SERIES[0], alpha=0.6, label=label)
    own = math.sqrt(float(np.mean(np.square(points[OWN]))))
    at.axhline(LARGEST_RATIO * own, color=BAD, label="goal")
    at.set_xticks(range(len(points)), [_LABELS.get(name, name.replace("_", "\n")) for name in points])
    at.set_ylabel("RMS error of points, µm")
    at.set_ylim(bottom=0.0)
    legend_outside(figure)
    return figure


STUDY = Study("plates", "Calibration with plates that people own, against one with ring marks.", run)
