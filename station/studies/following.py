"""Study `following`: a wheel whose tie rod is turned, followed from image to image and measured whole.

Views of the wheel are rendered at small steps of toe; an operator turns through them forth and back, and
every frame has noise of its own. Every frame is followed, and measured whole beside it: the same images, the
same calibration. In the middle the wheel jumps by a degree between two frames, and back again.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure

from alignment.arrays import Singles
from alignment.follow import FollowedWheel, FollowRules, follow_wheel
from alignment.kernels import on_one_core
from alignment.measure import measure_wheel
from alignment.prepared import PreparedRig
from alignment.units import ARCMIN
from alignment.values import MeasureSettings, Refusal, RigCalibration, StereoImages, WheelMeasurement
from db.exports import in_style, legend_outside
from sensors.formats import TyreLoad
from sensors.simulation import WheelScene, draw_pose, draw_scene, truth_of
from station.figures import Goal, Progress, Row, Study, StudyResult
from station.studies.wheels import StudyRig, exposed, lights, study_rig

PRESET, QUICK_PRESET = "standard", "ccir"
FRAMES, VIEWS, QUICK_FRAMES, QUICK_VIEWS = 500, 16, 10, 3
STEP_DEG, COUPLING = 0.02, 0.3
"""Of toe from view to view, half a degree in a second at 25 frames; and the share that camber follows."""
JUMP_DEG, JUMP_FRAMES = 1.0, 5
LOADED_FRAMES, LOAD_MM = 100, 5.0
SAME_ARCMIN, LOST_FRAMES = 0.01, 2
FOLLOW_RULES = FollowRules()


@dataclass(frozen=True)
class FollowedFrame:
    """One frame: angles in radians, (camber, toe).

    Attributes
    ----------
    jumped
        Whether it shows the wheel where it jumped to.
    followed, whole, true
        Of following, of a whole measurement, and of the scene; None where refused.
    u
        Standard uncertainty that following states.
    why
        Why this frame was measured whole in place of followed; empty where it was followed.
    """

    jumped: bool
    followed: tuple[float, float] | None
    whole: tuple[float, float] | None
    true: tuple[float, float]
    u: tuple[float, float]
    why: str

    @property
    def difference(self) -> float:
        """Largest of both angles, followed less whole, arcminutes; infinite where one of them is refused."""
        if self.followed is None or self.whole is None:
            return 0.0 if self.followed == self.whole else math.inf
        return max(abs(a - b) for a, b in zip(self.followed, self.whole, strict=True)) / ARCMIN


@dataclass(frozen=True, eq=False)
class View:
    """One rendered view of the wheel; light on the chips of each head's cameras, in half precision."""

    scene: WheelScene
    light: list[tuple[np.ndarray[tuple[int, ...], np.dtype[np.float16]], ...]]

    @classmethod
    def of(cls, rig: StudyRig, scene: WheelScene) -> View:
        """Render it."""
        half = [tuple(each.astype(np.float16) for each in pair) for pair in lights(scene, rig.true)]
        return cls(scene, half)

    def exposed(self, rng: np.random.Generator) -> list[StereoImages]:
        """One frame of it."""
        light: list[tuple[Singles, Singles]] = [
            (left.astype(np.float32), right.astype(np.float32)) for left, right in self.light
        ]
        return exposed(light, self.scene, rng)


def rod_turned(scene: WheelScene, toe_deg: float) -> WheelScene:
    """The wheel with its tie rod turned: toe, and a share of it of camber."""
    toe = math.radians(toe_deg)
    pose = replace(scene.pose, toe=scene.pose.toe + toe, camber=scene.pose.camber + COUPLING * toe)
    return replace(scene, pose=pose)


def tie_rod(rig: StudyRig, views: int, seed: int, progress: Progress, load_mm: float = 0.0) -> list[View]:
    """Views of a wheel whose tie rod is turned, `STEP_DEG` apart, and a last one that is off by a degree."""
    rng = np.random.default_rng([seed, 31])
    pose = draw_pose(rng, math.radians(0.4), math.radians(-0.3))
    scene = draw_scene(rig.spec, rig.side, pose, rng, seed=seed)
    if load_mm > 0.0:
        scene = replace(scene, load=TyreLoad(load_mm))
    out = []
    for k, toe_deg in enumerate([*(STEP_DEG * k for k in range(views)), JUMP_DEG]):
        progress(k / (views + 1), f"view {k + 1} of {views + 1}")
        out.append(View.of(rig, rod_turned(scene, toe_deg)))
    return out


def tie_rod_images(preset: str, views: int, seed: int) -> tuple[list[Sequence[StereoImages]], RigCalibration]:
    """Images of the views of a wheel whose tie rod is turned, and the true cameras."""
    rig = study_rig(preset, seed)
    rng = np.random.default_rng([seed, 33])
    seen = tie_rod(rig, views, seed, lambda done, doing: None)[:-1]
    return [view.exposed(rng) for view in seen], rig.true


def order(frames: int, views: int) -> Iterator[int]:
    """Number of the view of each frame: forth and back, and for some frames in the middle the last one."""
    middle = frames // 2
    for k in range(frames):
        place = k % (2 * views - 2)
        back = 2 * views - 2 - place
        yield views if middle <= k < middle + JUMP_FRAMES else min(place, back)


def followed_frames(
    rig: StudyRig, views: Sequence[View], numbers: Sequence[int], seed: int, progress: Progress
) -> list[FollowedFrame]:
    """Follow the wheel through its views, and measure every frame whole beside it."""
    settings = MeasureSettings()
    prepared = PreparedRig.of(rig.true, settings)
    rng = np.random.default_rng([seed, 32])
    wheel: FollowedWheel | None = None
    out = []
    for k, number in enumerate(numbers):
        progress(k / len(numbers), f"frame {k + 1} of {len(numbers)}")
        view = views[number]
        images = view.exposed(rng)
        with on_one_core():
            found = follow_wheel(images, prepared, settings, wheel, FOLLOW_RULES)
            whole = measure_wheel(images, prepared, settings)
        wheel = found.wheel
        truth = truth_of(view.scene)
        followed = found.result
        out.append(
            FollowedFrame(
                jumped=number == len(views) - 1,
                followed=_angles(followed),
                whole=_angles(whole),
                true=(math.radians(truth.camber_deg), math.radians(truth.toe_deg)),
                u=(math.nan, math.nan)
                if isinstance(followed, Refusal)
                else (followed.camber_u, followed.toe_u),
                why=found.whole or "",
            )
        )
    return out


def _angles(found: WheelMeasurement | Refusal) -> tuple[float, float] | None:
    return (found.camber, found.toe) if isinstance(found, WheelMeasurement) else None


def frames_to_follow(frames: Sequence[FollowedFrame]) -> int:
    """Most frames that a jump took until a result was that of a whole measurement; the frame itself is 1."""
    most = 0
    for k in range(1, len(frames)):
        if frames[k].jumped != frames[k - 1].jumped:
            late = 1
            while k + late - 1 < len(frames) and frames[k + late - 1].difference > SAME_ARCMIN:
                late += 1
            most = max(most, late)
    return most


def summed_up(frames: Sequence[FollowedFrame], loaded: Sequence[FollowedFrame] = ()) -> StudyResult:
    """Sum the study up."""
    off = np.array([frame.difference for frame in frames])
    errors = [
        abs(a - b) / ARCMIN for f in frames if f.followed for a, b in zip(f.followed, f.true, strict=True)
    ]
    figures = {
        "frames": float(len(frames)),
        "followed_share": float(np.mean([not frame.why for frame in frames])),
        "refused": float(sum(frame.followed is None for frame in [*frames, *loaded])),
        "largest_difference_arcmin": float(off.max()),
        "p95_difference_arcmin": float(np.quantile(off, 0.95, method="higher")),
        "p95_error_arcmin": float(np.quantile(errors, 0.95)) if errors else math.nan,
        "u_arcmin": float(np.nanmedian([frame.u for frame in frames])) / ARCMIN,
        "frames_to_follow_a_jump": float(frames_to_follow(frames)),
    }
    goals = [
        Goal("followed_share", "at_least", 0.7),
        Goal("refused", "at_most", 0),
        Goal("largest_difference_arcmin", "at_most", SAME_ARCMIN),
        Goal("frames_to_follow_a_jump", "at_most", LOST_FRAMES),
    ]
    if loaded:
        off = np.array([frame.difference for frame in loaded])
        figures |= {
            "loaded_frames": float(len(loaded)),
            "loaded_followed_share": float(np.mean([not frame.why for frame in loaded])),
            "loaded_largest_difference_arcmin": float(off.max()),
            "loaded_u_arcmin": float(np.nanmedian([frame.u for frame in loaded])) / ARCMIN,
        }
    text = f"""
{len(frames)} frames of a wheel whose tie rod is turned by {STEP_DEG:g}° from frame to frame, camber with it;
it jumps by {JUMP_DEG:g}° and back. Followed, and measured whole beside it in the same images, they differ
by at most {figures["largest_difference_arcmin"]:.4f}′. One in {FOLLOW_RULES.whole_every} is measured whole in
any case, and each that is in doubt. {len(loaded)} more are of a wheel under load, whose load is kept from one
whole measurement to the next: a whole one finds it anew each time, and there the difference is that.
"""
    rows = [_row(number, frame) for number, frame in enumerate([*frames, *loaded], start=1)]
    return StudyResult(tuple(rows), figures, tuple(goals), text, {"following": _plot(frames)})


def run(seed: int, quick: bool, progress: Progress) -> StudyResult:
    """Run the study; see `RunStudy`."""
    rig = study_rig(QUICK_PRESET if quick else PRESET, seed)
    count, number = (QUICK_VIEWS, QUICK_FRAMES) if quick else (VIEWS, FRAMES)

    def part(first: float, last: float) -> Progress:
        return lambda done, doing: progress(first + (last - first) * done, doing)

    views = tie_rod(rig, count, seed, part(0.0, 0.3))
    frames = followed_frames(rig, views, list(order(number, count)), seed, part(0.3, 0.8))
    if quick:
        return summed_up(frames)
    views = tie_rod(rig, 4, seed, part(0.8, 0.9), LOAD_MM)[:-1]
    # No view is one of a jump here.
    numbers = [number for number in order(LOADED_FRAMES, 4) if number < len(views)]
    loaded = [
        replace(frame, jumped=False) for frame in followed_frames(rig, views, numbers, seed, part(0.9, 1.0))
    ]
    return summed_up(frames, loaded)


def _row(number: int, frame: FollowedFrame) -> Row:
    followed, whole = frame.followed or (None, None), frame.whole or (None, None)
    return {
        "frame": number,
        "jumped": int(frame.jumped),
        "camber_arcmin": None if followed[0] is None else followed[0] / ARCMIN,
        "toe_arcmin": None if followed[1] is None else followed[1] / ARCMIN,
        "whole_camber_arcmin": None if whole[0] is None else whole[0] / ARCMIN,
        "whole_toe_arcmin": None if whole[1] is None else whole[1] / ARCMIN,
        "difference_arcmin": frame.difference,
        "camber_u_arcmin": frame.u[0] / ARCMIN,
        "toe_u_arcmin": frame.u[1] / ARCMIN,
        "measured_whole": frame.why,
    }


@in_style
def _plot(frames: Sequence[FollowedFrame]) -> Figure:
    figure = Figure(figsize=(8, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    for k, name in enumerate(("camber", "toe")):
        left.plot(
            [frame.followed[k] / ARCMIN if frame.followed else math.nan for frame in frames], label=name
        )
    left.set_xlabel("frame")
    left.set_ylabel("followed, ′")
    right.plot([frame.difference for frame in frames], ".")
    right.axhline(SAME_ARCMIN, color="0.6", linestyle="--")
    right.set_xlabel("frame")
    right.set_ylabel("followed less whole, ′")
    legend_outside(figure, [left])
    return figure


STUDY = Study("following", "A wheel that is adjusted, followed and measured whole: the same angles.", run)
