"""Study `knocked`: cameras and heads that moved since their calibration, seen in ordinary measurements.

Rendered wheels before rigs of several kinds are measured with calibrations that err as their covariance says:
so many intact rigs. Then a camera or a whole head is knocked, about or along each of its axes. The knock is
put into the calibration, the other way round, in place of the images: what counts is how the two differ. A
knock is missed where it is neither refused nor warned of, and changes an angle by more than the result
states: its 95 % interval as calibrated and what a movement that no image shows could add. Those beyond the
interval as calibrated alone are counted, too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure

from alignment.arrays import Array
from alignment.calibration import adjust, cameras_of_rig, stepped, with_camera
from alignment.geometry import PosedCamera, RigidTransform
from alignment.measure import measure_wheel
from alignment.units import ARCMIN
from alignment.values import (
    HeadCalibration,
    MeasureSettings,
    Refusal,
    RigCalibration,
    StereoImages,
    WheelMeasurement,
)
from db.exports import in_style, legend_outside
from sensors.simulation import SHAPES, draw_pose, draw_scene, plate_positions
from station.figures import Goal, Progress, Row, Study, StudyResult
from station.studies.coverage import drawn
from station.studies.refresh import PIXEL
from station.studies.simulated_views import ViewErrors, observe, square_plate
from station.studies.wheels import exposed, lights, study_rig

WHEELS, RIGS, KNOCKS = 20, 200, 400
QUICK_WHEELS, QUICK_RIGS, QUICK_KNOCKS = 1, 6, 12
PRESETS = ("standard", "dense", "central", "standard")
TURN_ARCMIN, SHIFT_MM = (0.5, 5.0), (0.02, 0.5)
"""Least and largest knock; drawn evenly in the logarithm, so that small ones are as many as large ones."""
FALSE_ALARMS, MISSES = 0.01, 0.01


@dataclass(frozen=True)
class KnockKind:
    """What moves, a camera or a whole head, and about or along which of its axes (0 to 2)."""

    whole_head: bool
    turns: bool
    axis: int

    def __str__(self) -> str:
        what = "head" if self.whole_head else "camera"
        return f"{what} {'turned about' if self.turns else 'shifted along'} {'xyz'[self.axis]}"


KNOCK_KINDS = tuple(
    KnockKind(whole, turns, axis) for whole in (False, True) for turns in (True, False) for axis in range(3)
)


@dataclass(frozen=True, eq=False)
class _Pictured:
    """A wheel, the true cameras with the covariance of a calibration from the plate, and the images."""

    preset: str
    tyre: str
    rig: RigCalibration
    covariance: Array
    images: list[StereoImages]


def plate_covariance(true: RigCalibration, rng: np.random.Generator) -> Array:
    """Joint covariance that a calibration from seven views of the plate states."""
    poses = [
        RigidTransform.from_rotvec(np.array([*position.tilt, 0.0]), np.array(position.stage_mm))
        if any(position.tilt)
        else position.stage_mm
        for position in plate_positions()
    ]
    views = observe(cameras_of_rig(true), square_plate(), poses, rng, ViewErrors(pixel=PIXEL))
    known = adjust(views.data).rig_calibration("plate", true.rig, true.side, true.vehicle_from_rig)
    if known.covariance is None or known.parameter_names != true.parameter_names:
        raise AssertionError("the joint adjustment states a covariance of the lens model that it was given")
    return known.covariance


def knocked(
    calibration: RigCalibration, kind: KnockKind, head: int, side: int, size: float
) -> RigCalibration:
    """Calibration of which one camera (side 0 or 1) or a whole head has moved by radians or millimetres.

    A head turns about its middle; axes are those of the camera, of a head those of its left one.
    """
    known = calibration.heads[head]
    step = np.zeros(3)
    step[kind.axis] = size
    if not kind.whole_head:
        camera = known.cameras[side]
        by = np.zeros(6 + len(camera.model.parameters))
        if kind.turns:
            by[:3] = step
        else:
            by[3:6] = camera.rig_from_camera.rotation @ step
        return with_camera(calibration, head, side, stepped(camera, by))
    middle = np.mean([camera.rig_from_camera.translation for camera in known.cameras], axis=0)
    in_rig = known.left.rig_from_camera.rotation @ step
    turn, shift = (in_rig, np.zeros(3)) if kind.turns else (np.zeros(3), in_rig)
    move = RigidTransform.from_rotvec(turn, middle + shift) @ RigidTransform(np.eye(3), -middle)
    left, right = (PosedCamera(camera.model, move @ camera.rig_from_camera) for camera in known.cameras)
    heads = list(calibration.heads)
    heads[head] = HeadCalibration(known.name, left, right)
    return replace(calibration, heads=tuple(heads))


def _pictured(seed: int, number: int) -> _Pictured:
    rng = np.random.default_rng([seed, 31, number])
    preset = PRESETS[number % len(PRESETS)]
    rig = study_rig(preset, seed + number, "left" if number % 2 else "right")
    shape = sorted(SHAPES)[number % len(SHAPES)]
    camber, toe = np.radians(rng.uniform(-3.0, 3.0, 2))
    scene = draw_scene(rig.spec, rig.side, draw_pose(rng, camber, toe), rng, shape, seed=seed + number)
    scene = replace(scene, ambient=float(rng.uniform(0.05, 0.6)))
    images = exposed(lights(scene, rig.true), scene, rng, float(rng.uniform(2.5, 6.0)))
    return _Pictured(preset, shape, rig.true, plate_covariance(rig.true, rng), images)


def _row(
    number: int,
    wheel: _Pictured,
    kind: str,
    size: float,
    result: WheelMeasurement | Refusal,
    intact: Array | None,
) -> Row:
    row: dict[str, str | float | int | None] = {
        "rig": number,
        "preset": wheel.preset,
        "tyre": wheel.tyre,
        "kind": kind,
        "size": size,
        "outcome": "refused",
        "evidence": None,
        "row_px": None,
        "change_arcmin": None,
        "change_over_u95": None,
        "unseen_arcmin": None,
        "change_over_stated": None,
    }
    if not isinstance(result, WheelMeasurement):
        return row
    rows = [head.row_px for head in result.heads if head.row_px is not None]
    unseen = np.zeros(2) if result.unseen is None else np.array(result.unseen)
    row |= {
        "outcome": "measured" if result.warning is None else "warned",
        "evidence": result.knock_evidence,
        "row_px": max(rows, default=None),
        "unseen_arcmin": float(unseen.max()) / ARCMIN,
    }
    if intact is not None:
        change = np.abs(np.array([result.camber, result.toe]) - intact)
        row["change_arcmin"] = float(change.max()) / ARCMIN
        u95 = np.array([result.camber_u95, result.toe_u95])
        row["change_over_u95"] = float((change / u95).max())
        row["change_over_stated"] = float((change / (u95 + unseen)).max())
    return row


def run(seed: int, quick: bool, progress: Progress) -> StudyResult:
    """Run the study; see `RunStudy`."""
    wheels, rigs, knocks = (QUICK_WHEELS, QUICK_RIGS, QUICK_KNOCKS) if quick else (WHEELS, RIGS, KNOCKS)
    pictured = []
    for k in range(wheels):
        progress(0.5 * k / wheels, f"wheel {k + 1} of {wheels}")
        pictured.append(_pictured(seed, k))
    rows: list[Row] = []
    settings = MeasureSettings()
    for n in range(rigs):
        progress(0.5 + 0.5 * n / rigs, f"rig {n + 1} of {rigs}")
        wheel = pictured[n % wheels]
        rng = np.random.default_rng([seed, 32, n])
        known = drawn(wheel.rig, wheel.covariance, rng)
        result = measure_wheel(wheel.images, known, settings)
        rows.append(_row(n + 1, wheel, "", 0.0, result, None))
        if not isinstance(result, WheelMeasurement):
            continue
        intact = np.array([result.camber, result.toe])
        for k in range(n * knocks // rigs, (n + 1) * knocks // rigs):
            # Every wheel meets every kind, a single one in their order.
            kind = KNOCK_KINDS[(k + (n // wheels if wheels > 1 else 0)) % len(KNOCK_KINDS)]
            least, most = (np.array(TURN_ARCMIN) * ARCMIN) if kind.turns else SHIFT_MM
            size = float(np.exp(rng.uniform(math.log(least), math.log(most))) * rng.choice([-1.0, 1.0]))
            head, side = int(rng.integers(len(known.heads))), int(rng.integers(2))
            found = measure_wheel(wheel.images, knocked(known, kind, head, side, size), settings)
            shown = size / ARCMIN if kind.turns else size
            rows.append(_row(n + 1, wheel, str(kind), shown, found, intact))
    return _summarise(rows)


def _summarise(rows: list[Row]) -> StudyResult:
    """Figures, goals, text and plot of the rows."""
    intact = [row for row in rows if not row["kind"]]
    moved = [row for row in rows if row["kind"]]

    def number(row: Row, name: str) -> float:
        return float(row[name] or 0.0)

    alarms = sum(row["outcome"] != "measured" for row in intact)
    silent = [row for row in moved if row["outcome"] == "measured"]
    beyond = [row for row in silent if number(row, "change_over_u95") > 1.0]
    missed = [row for row in silent if number(row, "change_over_stated") > 1.0]
    covered = sum(row["outcome"] == "warned" and number(row, "change_over_u95") > 1.0 for row in moved)
    unseen = [number(row, "unseen_arcmin") for row in intact if row["outcome"] != "refused"]
    lines = [
        "| knock | rigs | refused | warned | silent, beyond ± as calibrated | missed: beyond ± and unseen | "
        "largest silent change, ′ |",
        "|---|---|---|---|---|---|---|",
    ]
    for kind in map(str, KNOCK_KINDS):
        mine = [row for row in moved if row["kind"] == kind]
        counts = [
            *(sum(row["outcome"] == outcome for row in mine) for outcome in ("refused", "warned")),
            *(sum(row["kind"] == kind for row in some) for some in (beyond, missed)),
        ]
        worst = max((number(row, "change_arcmin") for row in silent if row["kind"] == kind), default=0.0)
        lines.append(f"| {kind} | {len(mine)} | {' | '.join(map(str, counts))} | {worst:.3f} |")
    figures = {
        "false_alarm_share": alarms / max(len(intact), 1),
        "missed_share": len(missed) / max(len(moved), 1),
        "beyond_as_calibrated_share": len(beyond) / max(len(moved), 1),
        "largest_silent_change_arcmin": max((number(row, "change_arcmin") for row in silent), default=0.0),
        "unseen_arcmin": float(np.median(unseen)) if unseen else 0.0,
        "largest_unseen_arcmin": max(unseen, default=0.0),
        "warned_beyond_interval_share": covered / max(len(moved), 1),
        "highest_intact_evidence": max((float(row["evidence"] or 0.0) for row in intact), default=0.0),
        "intact_rigs": float(len(intact)),
        "knocked_rigs": float(len(moved)),
    }
    goals = (
        Goal("false_alarm_share", "at_most", FALSE_ALARMS),
        Goal("missed_share", "at_most", MISSES),
        Goal("beyond_as_calibrated_share", "at_most", MISSES),
    )
    text = f"""
{len(intact)} intact rigs, {alarms} of them refused or warned of. {len(moved)} knocked ones, turned by
{TURN_ARCMIN[0]:g} to {TURN_ARCMIN[1]:g}′ or shifted by {SHIFT_MM[0]:g} to {SHIFT_MM[1]:g} mm, small knocks
as often as large ones. Without a warning, {len(beyond)} changed an angle by more than the 95 % interval as
calibrated, {len(missed)} of them by more than that and what the result says that no image shows (`unseen`).

"""
    return StudyResult(tuple(rows), figures, goals, text + "\n".join(lines), {"knocked": _plot(moved)})


@in_style
def _plot(moved: list[Row]) -> Figure:
    figure = Figure(figsize=(8, 4), layout="constrained")
    axes = figure.subplots()
    for outcome in ("measured", "warned"):
        mine = [row for row in moved if row["outcome"] == outcome]
        axes.plot(
            [max(float(row["change_arcmin"] or 0.0), 1e-4) for row in mine],
            [float(row["evidence"] or 0.0) for row in mine],
            "o",
            ms=3,
            label=outcome,
        )
    axes.set_xscale("log")
    axes.set_xlabel("change of the angle by the knock, arcmin")
    axes.set_ylabel("2 ln evidence of a knock")
    legend_outside(figure)
    return figure


STUDY = Study(
    "knocked", "Cameras and heads that moved since their calibration: false alarms and misses.", run
)
