"""Study `degraded`: bad pictures. What is accepted must be right; what cannot be right must be refused.

Every shot has one disturbance of drawn strength: dirt, something in the way, sun, missing lines, low
contrast, blur, a dark camera, a head or a camera that moved since the calibration, cables and lumps in view,
exchanged images. The rig is calibrated from rendered images of a plate.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from alignment.arrays import Array
from alignment.geometry import PosedCamera, RigidTransform
from alignment.measure import measure_wheel
from alignment.prepared import PreparedRig
from alignment.units import ARCMIN
from alignment.values import (
    HeadCalibration,
    MeasureSettings,
    RigCalibration,
    StereoImages,
    WheelMeasurement,
)
from db.exports import BAD, REFERENCE, in_style, legend_outside
from sensors.simulation import SHAPES, Material, Obstacle, Sun, WheelScene, cable, draw_pose, draw_scene, lump
from station.figures import Goal, Progress, Row, Study, StudyResult
from station.studies.mixtures import mixture_row, mixture_table, mixtures
from station.studies.wheels import StudyRig, calibrate_from_plate, errors_arcmin, exposed, lights, study_rig

SHOTS, QUICK_SHOTS = 600, 24
WORST_ARCMIN, SIGMAS, BEYOND, ACCEPTED = 1.0, 3.0, 1.0 / 200.0, 0.8
LITTLE = 0.2
"""Share of the view up to which something in the way must not stop a measurement."""


@dataclass(frozen=True, eq=False)
class DegradedShot:
    """One disturbed shot.

    Attributes
    ----------
    kind
        Name of the disturbance.
    strength
        In words, for the table.
    occluded
        Share of the heads' view that something hides, where that is the disturbance.
    scene, images
        The truth, and what the cameras saw.
    """

    kind: str
    strength: str
    occluded: float | None
    scene: WheelScene
    images: list[StereoImages]


@dataclass(frozen=True, eq=False)
class _Setting:
    """What a disturbance changes: the scene, or the cameras, or the order of the images."""

    scene: WheelScene
    cameras: RigCalibration
    strength: str
    occluded: float | None = None
    swapped: int | None = None


_Disturb = Callable[[StudyRig, WheelScene, np.random.Generator], _Setting]


def _dirt(rig: StudyRig, scene: WheelScene, rng: np.random.Generator) -> _Setting:
    patches, strength = int(rng.integers(5, 60)), float(rng.uniform(0.2, 0.9))
    tyre = scene.tyre.with_dirt(rng, patches, strength)
    return _Setting(replace(scene, tyre=tyre), rig.true, f"{patches} patches of {strength:.1f}")


def _occlusion(rig: StudyRig, scene: WheelScene, rng: np.random.Generator) -> _Setting:
    share = float(rng.uniform(0.02, 0.4))
    heads = rig.spec.heads
    # Nothing hides more than nine tenths of one head's view: the rest goes before the next head.
    first = rng.permutation(heads)
    split = rng.dirichlet(np.ones(heads)) if share > 0.25 else np.eye(heads)[0]
    obstacles = []
    for head, part in zip(first, split, strict=True):
        hidden = min(share * heads * float(part), 0.9)
        if hidden > 0.01:
            obstacles.append(_hiding(rig, int(head), hidden, rng))
    return _Setting(
        replace(scene, obstacles=tuple(obstacles)), rig.true, f"{share:.0%} hidden", occluded=share
    )


def _hiding(rig: StudyRig, head: int, share: float, rng: np.random.Generator) -> Obstacle:
    """Build a lump that hides a share of a head's view of the sidewall."""
    place = rig.spec.rig_from_head(head)
    camera = rig.spec.camera
    height = float(rng.uniform(40.0, 120.0))
    near = 1.0 - height / rig.spec.distance_mm
    width = camera.width / camera.fx * rig.spec.distance_mm
    depth = min(camera.height / camera.fy * rig.spec.distance_mm, 115.0)
    # An ellipse of the view's proportions and that area, at the edge of the view or in it.
    half = math.sqrt(share / math.pi) * near * np.array([width, depth])
    shift = rng.uniform(-0.5, 0.5, 2) * np.maximum(np.array([width, depth]) * near - 2.0 * half, 0.0)
    centre = place.apply(np.array([shift[0], shift[1], rig.spec.distance_mm - height]))
    body = lump(np.zeros(3), (float(half[0]), float(half[1]), 10.0), Material(float(rng.uniform(0.03, 0.5))))
    return replace(body, vertices=body.vertices @ place.rotation.T + centre)


def _sun(rig: StudyRig, scene: WheelScene, rng: np.random.Generator) -> _Setting:
    angle = rng.uniform(0.0, 2.0 * math.pi)
    level, radius = float(rng.uniform(2.0, 40.0)), float(rng.uniform(15.0, 90.0))
    sun = Sun(
        towards=(float(rng.normal(0.0, 0.6)), float(rng.normal(0.0, 0.6)), 1.0),
        through_mm=(260.0 * math.cos(angle), 260.0 * math.sin(angle), 0.0),
        radius_mm=radius,
        level=level,
    )
    return _Setting(replace(scene, sun=sun), rig.true, f"level {level:.0f}, radius {radius:.0f} mm")


def _missing_lines(rig: StudyRig, scene: WheelScene, rng: np.random.Generator) -> _Setting:
    projectors, total = [], 0
    for projector in scene.projectors:
        pattern = projector.pattern
        columns = rng.choice(pattern.columns, int(rng.integers(0, 6)), replace=False)
        rows = rng.choice(pattern.rows, int(rng.integers(0, 5)), replace=False)
        total += len(columns) + len(rows)
        dark = replace(
            pattern,
            missing_columns=tuple(map(int, np.sort(columns))),
            missing_rows=tuple(map(int, np.sort(rows))),
        )
        projectors.append(replace(projector, pattern=dark))
    return _Setting(replace(scene, projectors=tuple(projectors)), rig.true, f"{total} lines dark")


def _low_contrast(rig: StudyRig, scene: WheelScene, rng: np.random.Generator) -> _Setting:
    factor, ambient = float(10.0 ** rng.uniform(-1.3, -0.2)), float(rng.uniform(0.1, 2.0))
    projectors = tuple(replace(p, level=p.level * factor) for p in scene.projectors)
    return _Setting(
        replace(scene, projectors=projectors, ambient=ambient),
        rig.true,
        f"projector × {factor:.2f}, ambient {ambient:.1f}",
    )


def _blur(rig: StudyRig, scene: WheelScene, rng: np.random.Generator) -> _Setting:
    blur = float(rng.uniform(1.2, 6.0))
    return _Setting(replace(scene, optics=replace(scene.optics, blur_px=blur)), rig.true, f"{blur:.1f} px")


def _dark_camera(rig: StudyRig, scene: WheelScene, rng: np.random.Generator) -> _Setting:
    head = rig.true.heads[int(rng.integers(rig.spec.heads))]
    passed = float(rng.uniform(0.0, 0.3))
    name = f"{head.name}.{rng.choice(['left', 'right'])}"
    return _Setting(replace(scene, transmission={name: passed}), rig.true, f"{name} passes {passed:.0%}")


def _moved(rig: StudyRig, scene: WheelScene, rng: np.random.Generator) -> _Setting:
    """Move a head, or one camera, by hundredths of a degree to a degree and hundredths to millimetres."""
    k = int(rng.integers(rig.spec.heads))
    head = rig.true.heads[k]
    alone = bool(rng.random() < 0.3)
    turn = rng.normal(size=3)
    turn *= math.radians(10.0 ** rng.uniform(-1.7, 0.0)) / np.linalg.norm(turn)
    shift = rng.normal(size=3)
    shift *= 10.0 ** rng.uniform(-1.5, 0.5) / np.linalg.norm(shift)
    about = np.mean([camera.rig_from_camera.translation for camera in head.cameras], axis=0)
    move = RigidTransform.from_rotvec(turn, about + shift) @ RigidTransform(np.eye(3), -about)

    def moved(camera: PosedCamera) -> PosedCamera:
        return PosedCamera(camera.model, move @ camera.rig_from_camera)

    left = moved(head.left)
    right = head.right if alone else moved(head.right)
    heads = [*rig.true.heads]
    heads[k] = HeadCalibration(head.name, left, right)
    degrees, length = math.degrees(float(np.linalg.norm(turn))), float(np.linalg.norm(shift))
    return _Setting(
        scene,
        replace(rig.true, heads=tuple(heads), covariance=None),
        f"{head.name}{' left' if alone else ''} by {degrees:.3f}° and {length:.2f} mm",
    )


def _objects(rig: StudyRig, scene: WheelScene, rng: np.random.Generator) -> _Setting:
    obstacles = []
    for _ in range(int(rng.integers(1, 5))):
        angle, lean = rng.uniform(0.0, 2.0 * math.pi, 2)
        centre = np.array([260.0 * math.cos(angle), 260.0 * math.sin(angle), rng.uniform(20.0, 120.0)])
        albedo = Material(float(rng.uniform(0.02, 0.8)))
        if rng.random() < 0.5:
            half = 250.0 * np.array([math.cos(lean), math.sin(lean), 0.0])
            obstacles.append(cable(centre - half, centre + half, float(rng.uniform(3.0, 20.0)), albedo))
        else:
            x, y, z = (float(value) for value in rng.uniform(8.0, 40.0, 3))
            body = lump(np.zeros(3), (x, y, min(z, centre[2] - 5.0)), albedo)
            turned = body.vertices @ Rotation.from_euler("z", lean).as_matrix().T
            obstacles.append(replace(body, vertices=turned + centre))
    return _Setting(replace(scene, obstacles=tuple(obstacles)), rig.true, f"{len(obstacles)} things")


def _swapped(rig: StudyRig, scene: WheelScene, rng: np.random.Generator) -> _Setting:
    k = int(rng.integers(rig.spec.heads))
    return _Setting(scene, rig.true, f"{rig.true.heads[k].name}: left for right", swapped=k)


DISTURBANCES: dict[str, tuple[_Disturb, float]] = {
    "dirt": (_dirt, 0.13),
    "occlusion": (_occlusion, 0.24),
    "sun": (_sun, 0.1),
    "missing lines": (_missing_lines, 0.08),
    "low contrast": (_low_contrast, 0.09),
    "blur": (_blur, 0.08),
    "dark camera": (_dark_camera, 0.05),
    "moved": (_moved, 0.12),
    "objects": (_objects, 0.08),
    "swapped images": (_swapped, 0.03),
}
"""By name: what it does, and its share of the shots."""


def degraded_shot(rig: StudyRig, seed: int, number: int, kind: str | None = None) -> DegradedShot:
    """Make the shot of a number; each can be made again alone.

    Parameters
    ----------
    rig
        True cameras.
    seed, number
        Of all random choices.
    kind
        One of `KINDS`; None draws it.
    """
    rng = np.random.default_rng([seed, 6, number])
    names = list(DISTURBANCES)
    drawn = str(rng.choice(names, p=[share for _, share in DISTURBANCES.values()]))
    kind = kind or drawn
    camber, toe = np.radians(rng.uniform(-3.0, 3.0, 2))
    shape = str(rng.choice(sorted(SHAPES)))
    scene = draw_scene(rig.spec, rig.side, draw_pose(rng, float(camber), float(toe)), rng, shape, seed=seed)
    setting = DISTURBANCES[kind][0](rig, scene, rng)
    images = exposed(lights(setting.scene, setting.cameras), setting.scene, rng)
    if setting.swapped is not None:
        pair = images[setting.swapped]
        images[setting.swapped] = StereoImages(pair.right, pair.left)
    return DegradedShot(kind, setting.strength, setting.occluded, setting.scene, images)


def run(seed: int, quick: bool, progress: Progress) -> StudyResult:
    """Run the study; see `RunStudy`."""
    rig = study_rig("standard", seed)
    progress(0.0, "plate")
    known = PreparedRig.of(calibrate_from_plate(rig, seed), MeasureSettings())
    result = run_shots(QUICK_SHOTS if quick else SHOTS, rig, known, seed, progress)
    if quick:
        return result
    scene, mixed = mixtures(rig, seed)
    return with_mixtures(result, [mixture_row(k, each, scene, known) for k, each in enumerate(mixed)])


def run_shots(count: int, rig: StudyRig, known: PreparedRig, seed: int, progress: Progress) -> StudyResult:
    """Run the study with a number of shots."""
    rows: list[Row] = []
    for k in range(count):
        progress((k + 1) / (count + 1), f"shot {k + 1} of {count}")
        shot = degraded_shot(rig, seed, k)
        rows.append(table_row(k, shot, known))
    return summarise(rows)


def table_row(number: int, shot: DegradedShot, known: PreparedRig) -> Row:
    """Measure a shot: a row of the table."""
    result = measure_wheel(shot.images, known, MeasureSettings())
    accepted = isinstance(result, WheelMeasurement)
    errors = errors_arcmin(result, shot.scene) if isinstance(result, WheelMeasurement) else None
    stated = (
        (result.camber_u / ARCMIN, result.toe_u / ARCMIN) if isinstance(result, WheelMeasurement) else None
    )
    return {
        "shot": number,
        "kind": shot.kind,
        "strength": shot.strength,
        "occluded": shot.occluded,
        "accepted": int(accepted),
        "camber_error_arcmin": errors[0] if errors else None,
        "toe_error_arcmin": errors[1] if errors else None,
        "camber_u_arcmin": stated[0] if stated else None,
        "toe_u_arcmin": stated[1] if stated else None,
        "refusal": "" if isinstance(result, WheelMeasurement) else str(result.code),
        "head": "" if isinstance(result, WheelMeasurement) else result.head or "",
    }


def summarise(rows: list[Row]) -> StudyResult:
    """Figures, goals, text and plot of the rows."""
    kept = [row for row in rows if row["accepted"]]
    errors = np.array(
        [[row["camber_error_arcmin"], row["toe_error_arcmin"]] for row in kept], dtype=np.float64
    ).reshape(-1, 2)
    stated = np.array(
        [[row["camber_u_arcmin"], row["toe_u_arcmin"]] for row in kept], dtype=np.float64
    ).reshape(-1, 2)
    beyond = np.asarray((np.abs(errors) > SIGMAS * stated).any(axis=1), dtype=np.bool_)
    hidden = [row for row in rows if row["occluded"] is not None and float(row["occluded"]) <= LITTLE]
    figures = {
        "accepted_above_one_arcmin": float((np.abs(errors) > WORST_ARCMIN).any(axis=1).sum()),
        "largest_accepted_error_arcmin": float(np.abs(errors).max(initial=0.0)),
        "share_beyond_three_sigma": float(beyond.sum()) / max(len(rows), 1),
        "shots": float(len(rows)),
        "accepted": float(len(kept)),
    }
    goals = [
        Goal("accepted_above_one_arcmin", "at_most", 0.0),
        Goal("share_beyond_three_sigma", "at_most", BEYOND),
    ]
    little = f"No shot had up to {LITTLE:.0%} of the view hidden."
    if hidden:
        share = float(np.mean([float(row["accepted"] or 0) for row in hidden]))
        figures["little_occluded_accepted"] = share
        goals.append(Goal("little_occluded_accepted", "at_least", ACCEPTED))
        little = (
            f"Of {len(hidden)} with up to {LITTLE:.0%} of the view hidden, {100 * share:.0f} % were accepted."
        )
    lines = ["| disturbance | shots | accepted | largest error, ′ | beyond 3 u |", "|---|---|---|---|---|"]
    for kind in DISTURBANCES:
        of_kind = [row for row in rows if row["kind"] == kind]
        at = np.array([row["kind"] == kind for row in kept], dtype=np.bool_)
        worst = float(np.abs(errors[at]).max(initial=0.0))
        lines.append(f"| {kind} | {len(of_kind)} | {int(at.sum())} | {worst:.3f} | {int(beyond[at].sum())} |")
    text = f"""
{len(rows)} disturbed shots, {len(kept)} accepted, {int(beyond.sum())} of them beyond three stated standard uncertainties.
{little}

"""  # noqa: E501
    return StudyResult(
        tuple(rows), figures, tuple(goals), text + "\n".join(lines), {"degraded": _plot(kept, errors, stated)}
    )


def with_mixtures(result: StudyResult, rows: list[Row]) -> StudyResult:
    """Add the table of mixed pictures and its figures."""
    silent = [row for row in rows if row["outcome"] == "measured"]
    beyond = sum(float(row["error_over_u"] or 0.0) > SIGMAS for row in rows)
    figures = {
        **result.figures,
        "mixtures": float(len(rows)),
        "mixtures_measured": float(len(silent)),
        "mixtures_beyond_three_sigma": float(beyond),
        "largest_mixture_error_arcmin": max(
            (float(row["largest_error_arcmin"] or 0.0) for row in silent), default=0.0
        ),
    }
    text = f"{result.text}\n\nPictures that do not belong together:\n\n{mixture_table(rows)}"
    return replace(result, figures=figures, text=text)


@in_style
def _plot(kept: list[Row], errors: Array, stated: Array) -> Figure:
    figure = Figure(figsize=(8, 5), layout="constrained")
    axes = figure.subplots()
    for index, kind in enumerate(DISTURBANCES):
        at = np.array([row["kind"] == kind for row in kept], dtype=np.bool_)
        if at.any():
            axes.loglog(stated[at].ravel(), np.abs(errors[at]).ravel(), "osv^<>Dph*"[index], ms=4, label=kind)
    ends = np.array([1e-3, 10.0])
    axes.loglog(ends, SIGMAS * ends, "--", color=REFERENCE, lw=1, label="three stated")
    axes.axhline(WORST_ARCMIN, color=BAD, lw=1, label=f"allowed, {WORST_ARCMIN:g}′")
    axes.set_xlabel("stated standard uncertainty, arcmin")
    axes.set_ylabel("|error|, arcmin")
    legend_outside(figure)
    return figure


STUDY = Study(
    "degraded", "Disturbed pictures: what is accepted is right, what cannot be right is refused.", run
)
