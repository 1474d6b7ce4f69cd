"""Study `refresh-rates`: how often a refresh calls an intact rig changed, or overlooks a knocked one.

A few rendered wheels serve all rigs: instead of a camera its calibration is knocked, the other way round.
Every rig is calibrated from simulated views of the plate with all its errors.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from alignment.calibration import (
    Refreshed,
    SeenWheel,
    Sightings,
    adjust,
    cameras_of_rig,
    cross_pairs,
    joined,
    predict_angle_uncertainty,
    refresh_from,
    seen_wheel,
    with_camera,
)
from alignment.errors import DegenerateInputError
from alignment.geometry import PosedCamera, RigidTransform
from alignment.units import ARCMIN
from alignment.values import MeasureSettings, RigCalibration
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
from station.studies.refresh import PIXEL, angle_errors
from station.studies.simulated_views import ViewErrors, observe, square_plate

TURNS_ARCMIN = (0.5, 1.0, 2.0, 5.0)
SHIFTS_MM = (0.02, 0.05, 0.1, 0.5)
INTACT, QUICK_INTACT = 200, 4
EACH, QUICK_EACH = 9, 1
WHEELS, QUICK_WHEELS = 20, 4
SHOTS, QUICK_SHOTS = 4, 3


@dataclass(frozen=True)
class DrawnKnock:
    """What moved: nothing, a camera or a whole head; turned (arcminutes) or shifted (mm) along an axis."""

    body: str = "none"
    how: str = "none"
    axis: str = "x"
    size: float = 0.0

    @property
    def kind(self) -> str:
        """Its row of the table."""
        return "intact" if self.body == "none" else f"{self.body} {self.how} {self.axis} {self.size:g}"


KNOCKS = tuple(
    DrawnKnock(body, how, axis, size)
    for body in ("camera", "head")
    for how, sizes in (("turn", TURNS_ARCMIN), ("shift", SHIFTS_MM))
    for axis in "xyz"
    for size in sizes
)


def rendered_wheels(count: int, seed: int, progress: Progress) -> tuple[RigCalibration, list[SeenWheel]]:
    """Return the true cameras of a rig, and the light lines of wheels before it."""
    rng = np.random.default_rng([seed, 12])
    true = build_rig(RIG_SPECS["standard"], "front_left", "left", rng)
    shapes, wheels = sorted(SHAPES), []
    for n in range(count):
        progress(0.1 * n / count, f"wheel {n + 1} of {count}")
        camber, toe = rng.uniform(-0.03, 0.03, 2)
        pose = draw_pose(rng, camber, toe)
        scene = draw_scene(RIG_SPECS["standard"], "left", pose, rng, shapes[n % len(shapes)])
        wheels.append(seen_wheel(simulate_shot(scene, true, rng).images))
    return true, wheels


def calibrated_in_numbers(true: RigCalibration, rng: np.random.Generator) -> RigCalibration:
    """Return the rig as a plate session finds it."""
    poses = [
        RigidTransform.from_rotvec(np.array([*position.tilt, 0.0]), np.array(position.stage_mm))
        if any(position.tilt)
        else position.stage_mm
        for position in plate_positions()
    ]
    views = observe(cameras_of_rig(true), square_plate(), poses, rng, ViewErrors(pixel=PIXEL))
    return adjust(views.data).rig_calibration("plate", true.rig, true.side, true.vehicle_from_rig)


def with_drawn_knock(
    calibration: RigCalibration, knock: DrawnKnock, rng: np.random.Generator
) -> RigCalibration:
    """Return a calibration whose cameras did not see how one of them, or a head, drawn at random, moved.

    The axes are those of the camera, or of the head's left camera.
    """
    if knock.body == "none":
        return calibration
    number, side = int(rng.integers(len(calibration.heads))), int(rng.integers(2))
    step = np.eye(3)["xyz".index(knock.axis)] * knock.size * rng.choice([-1.0, 1.0])
    turn, shift = (step * ARCMIN, np.zeros(3)) if knock.how == "turn" else (np.zeros(3), step)
    head = calibration.heads[number]
    if knock.body == "camera":
        camera = head.cameras[side]
        pose = camera.rig_from_camera
        moved = PosedCamera(camera.model, pose.perturbed(turn, pose.rotation @ shift))
        return with_camera(calibration, number, side, moved)
    axes = head.left.rig_from_camera.rotation
    middle = 0.5 * (head.left.rig_from_camera.translation + head.right.rig_from_camera.translation)
    rotation = RigidTransform.from_rotvec(axes @ turn, np.zeros(3)).rotation

    def together(camera: PosedCamera) -> PosedCamera:
        pose = camera.rig_from_camera
        place = rotation @ (pose.translation - middle) + middle + axes @ shift
        return PosedCamera(camera.model, RigidTransform(rotation @ pose.rotation, place))

    heads = list(calibration.heads)
    heads[number] = replace(head, left=together(head.left), right=together(head.right))
    return replace(calibration, heads=tuple(heads))


def sightings(wheels: Sequence[SeenWheel], calibration: RigCalibration) -> Sightings:
    """What a refresh gathers of wheels whose lines are known."""
    settings = MeasureSettings()
    every = [cross_pairs(wheel, calibration, settings) for wheel in wheels]
    pairs = tuple(joined([of_shot[k] for of_shot in every]) for k in range(len(calibration.heads)))
    return Sightings(pairs, tuple(wheels), settings)


def refreshed(wheels: Sequence[SeenWheel], known: RigCalibration) -> Refreshed:
    """What a refresh with these wheels says of a calibration.

    Raises
    ------
    DegenerateInputError
        When only a plate can help.
    """
    return refresh_from(sightings(wheels, known), known)


def judged_refresh(
    wheels: Sequence[SeenWheel],
    known: RigCalibration,
    true: RigCalibration,
    knock: DrawnKnock,
    refresh: Callable[[Sequence[SeenWheel], RigCalibration], Refreshed] = refreshed,
) -> Row:
    """Refresh one rig: what it says, and what it leaves."""
    error = float(np.abs(angle_errors(known, true)).max())
    stated = 2.0 * max(predict_angle_uncertainty(known))
    contradiction, unseen = float("nan"), 0.0
    try:
        found = refresh(wheels, known)
    except DegenerateInputError:
        said = "plate"
    else:
        said = "unchanged" if found.moved is None else "camera"
        contradiction = float("nan") if found.contradiction is None else found.contradiction
        unseen = 0.0 if found.unseen is None else 2.0 * float(found.unseen.max())
    quiet = said == "unchanged"
    return {
        "kind": knock.kind,
        "said": said,
        "contradiction": contradiction,
        "error_arcmin": error / ARCMIN,
        "stated_arcmin": stated / ARCMIN,
        "unseen_arcmin": unseen / ARCMIN,
        "missed": int(quiet and knock.body != "none" and error > stated),
        "beyond_unseen": int(quiet and knock.body != "none" and error > float(np.hypot(stated, unseen))),
    }


def rate_rows(
    seed: int,
    intact: int,
    each: int,
    wheels: int,
    shots: int,
    progress: Progress,
    knocks: Sequence[DrawnKnock] = KNOCKS,
) -> list[Row]:
    """Judge so many intact rigs, and so many of every kind of knock."""
    true, seen = rendered_wheels(wheels, seed, progress)
    jobs = [DrawnKnock()] * intact + list(knocks) * each
    rows = []
    for number, knock in enumerate(jobs):
        progress(0.1 + 0.9 * number / len(jobs), f"rig {number + 1} of {len(jobs)}, {knock.kind}")
        rng = np.random.default_rng([seed, 13, number])
        known = with_drawn_knock(calibrated_in_numbers(true, rng), knock, rng)
        chosen = [seen[n] for n in rng.choice(len(seen), shots, replace=False)]
        rows.append(judged_refresh(chosen, known, true, knock))
    return rows


def run(seed: int, quick: bool, progress: Progress) -> StudyResult:
    """Run the study; see `RunStudy`."""
    if quick:
        knocks = [knock for knock in KNOCKS if knock.size == 5.0]
        rows = rate_rows(seed, QUICK_INTACT, QUICK_EACH, QUICK_WHEELS, QUICK_SHOTS, progress, knocks)
    else:
        rows = rate_rows(seed, INTACT, EACH, WHEELS, SHOTS, progress)
    return scored(rows, QUICK_SHOTS if quick else SHOTS)


def scored(rows: Sequence[Row], shots: int) -> StudyResult:
    """Count what the rows say, for each kind of knock."""
    intact = [row for row in rows if row["kind"] == "intact"]
    figures: dict[str, float] = {
        "intact_rigs": float(len(intact)),
        "false_alarms": share(intact, lambda row: row["said"] != "unchanged"),
        "largest_contradiction": max(number(row["contradiction"]) for row in intact),
        "unseen_arcmin": float(np.median([number(row["unseen_arcmin"]) for row in intact])),
    }
    for body in ("camera", "head"):
        mine = [row for row in rows if str(row["kind"]).startswith(body)]
        figures |= {
            f"{body}_rigs": float(len(mine)),
            f"{body}_missed": share(mine, lambda row: row["missed"] == 1),
            f"{body}_beyond_unseen": share(mine, lambda row: row["beyond_unseen"] == 1),
        }
    # A head that moved as one cannot be estimated: the plate is asked for, or nothing is said.
    heads = [row for row in rows if str(row["kind"]).startswith("head")]
    figures["head_called_camera"] = share(heads, lambda row: row["said"] == "camera")
    goals = (
        Goal("false_alarms", "at_most", 0.01),
        Goal("camera_beyond_unseen", "at_most", 0.01),
        Goal("head_beyond_unseen", "at_most", 0.01),
        Goal("head_called_camera", "at_most", 0.01),
    )
    return StudyResult(tuple(rows), figures, goals, _text(rows, figures, shots))


def share(rows: Sequence[Row], counts: Callable[[Row], bool]) -> float:
    """Return the share of rows that count; not a number of none."""
    return float(np.mean([counts(row) for row in rows])) if rows else float("nan")


def number(value: str | float | None) -> float:
    """Return a cell as a number; −inf where it has none."""
    return float(value) if isinstance(value, float | int) and not np.isnan(value) else -np.inf


def _text(rows: Sequence[Row], figures: dict[str, float], shots: int) -> str:
    lines = [
        f"{figures['intact_rigs']:.0f} intact rigs, {len(rows) - figures['intact_rigs']:.0f} knocked ones, "
        f"{shots} wheels each. Missed: nothing was said although the angles err by more than the calibration "
        "states. Beyond: by more than that and what the refresh says its wheels cannot show.",
        "",
        "| knock | rigs | camera named | plate asked for | nothing said | missed | beyond |",
        "|---|---|---|---|---|---|---|",
    ]
    for kind in dict.fromkeys(str(row["kind"]) for row in rows):
        mine = [row for row in rows if row["kind"] == kind]
        said = [sum(row["said"] == word for row in mine) for word in ("camera", "plate", "unchanged")]
        lost = [sum(row[name] == 1 for row in mine) for name in ("missed", "beyond_unseen")]
        lines.append(f"| {' | '.join(map(str, [kind, len(mine), *said, *lost]))} |")
    return "\n".join(lines)


STUDY = Study(
    "refresh-rates", "False alarms and misses of a refresh: intact rigs, knocked cameras and heads.", run
)
