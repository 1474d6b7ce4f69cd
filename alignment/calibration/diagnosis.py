"""What is wrong with views that contradict each other: which one, and how."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from alignment.arrays import Array
from alignment.calibration.adjustment import Adjustment, AdjustmentSettings, adjust, minimise
from alignment.calibration.observations import CalibrationInput, CameraKey, PlateView
from alignment.calibration.problem import build_problem, initial_state
from alignment.calibration.scale import stated_scale
from alignment.calibration.start import camera_from_plate
from alignment.errors import DegenerateInputError
from alignment.geometry.transforms import RigidTransform

_GOOD_SCALE = 3.0  # noise over what the marks' covariances state
_GOOD_OUTLIERS = 0.02
_FITS = 0.8  # share of a view's marks that must fit a hypothesis
_SAME_MM = 0.5
_PREDICTED_PX = 0.05
_AXES = "xyz"


def diagnose(
    data: CalibrationInput, settings: AdjustmentSettings, adjustment: Adjustment | None = None
) -> str | None:
    """Find the view, or the sign of the stage, that makes the others agree when it is left out or turned.

    What one common scale explains is blamed on the plate before any view. `adjustment` is what came of the
    data, None where nothing did.

    Returns
    -------
    str or None
        A sentence that names it; None when no single cause explains the contradiction.
    """
    simple = replace(settings, model="brown5")
    scaled = stated_scale(data, adjustment, lambda tried: _good(tried, simple))
    if scaled is not None:
        return scaled[1]
    findings = []
    for v, view in enumerate(data.views):
        rest = _good(replace(data, views=(*data.views[:v], *data.views[v + 1 :])), simple)
        if rest is not None and not _fits(data, view, rest):
            findings.append(_explain(data, view, rest))
    if findings:
        return min(findings, key=lambda finding: finding.rank).sentence
    for signs in product((1.0, -1.0), repeat=3):
        if min(signs) > 0:
            continue
        turned = [replace(v, stage_mm=None if v.stage_mm is None else v.stage_mm * signs) for v in data.views]
        moved = any(
            v.stage_mm is not None and not np.allclose(v.stage_mm, v.stage_mm * signs) for v in data.views
        )
        if moved and _good(replace(data, views=tuple(turned)), simple) is not None:
            axes = " and ".join(_AXES[a] for a in range(3) if signs[a] < 0)
            return (
                f"all stage positions have the wrong sign in {axes}: with it turned every view fits; "
                "correct the session"
            )
    return None


def _good(data: CalibrationInput, settings: AdjustmentSettings) -> Adjustment | None:
    """An adjustment in which everything agrees; None when there is none."""
    try:
        found = adjust(data, settings)
    except DegenerateInputError:
        return None
    outliers = float((found.weights < 0.5).mean())
    if outliers > _GOOD_OUTLIERS or max(found.noise_scale.values()) > _GOOD_SCALE:
        return None
    return found


@dataclass(frozen=True)
class _Finding:
    """A sentence; of several the most particular, with the least rank, is believed."""

    rank: int
    sentence: str


@dataclass(frozen=True, eq=False)
class _Placed:
    """Where cameras see the plate in one view: its pose, and the share of the marks that fit it."""

    rig_from_plate: RigidTransform
    share: float


def _place(data: CalibrationInput, view: PlateView, known: Adjustment) -> _Placed:
    """Find the pose of the plate in a view from known cameras, whatever the stage says."""
    free = replace(view, stage_mm=None)
    single = replace(data, views=(free,))
    problem = build_problem(
        single,
        known.cameras,
        known.model,
        AdjustmentSettings().priors,
        fixed_cameras=frozenset(known.cameras),
        frame_is_known=True,
    )
    # Cameras found without this view predict it less well than they fit their own.
    stated = float(np.median(1.0 / np.abs(problem.whitening[:, 0, 0])))
    scales = np.full(len(data.cameras), max(*known.noise_scale.values(), _PREDICTED_PX / stated))
    best = _Placed(RigidTransform.identity(), 0.0)
    for key, seen in view.observations.items():
        try:
            pose = known.cameras[key].rig_from_camera @ camera_from_plate(
                data.plate, known.cameras[key].model, seen
            )
            state, _, weights, _ = minimise(
                problem,
                initial_state(problem, known.cameras, [pose]),
                replace(AdjustmentSettings(known.model), outlier_sigma=20.0),
                scales,
            )
        except DegenerateInputError:
            continue
        placed = _Placed(
            RigidTransform(state.view_rotations[0], state.view_shifts[0]), float((weights > 0.5).mean())
        )
        if placed.share > best.share:
            best = placed
        if best.share > _FITS:
            break
    return best


def _fits(data: CalibrationInput, view: PlateView, known: Adjustment) -> bool:
    """Whether a view agrees with cameras that were found without it, and with its stage position."""
    placed = _place(data, view, known)
    if placed.share < _FITS:
        return False
    return view.stage_mm is None or bool(
        np.abs(placed.rig_from_plate.translation - view.stage_mm).max() < _SAME_MM
    )


def _explain(data: CalibrationInput, view: PlateView, known: Adjustment) -> _Finding:
    placed = _place(data, view, known)
    if placed.share >= _FITS and view.stage_mm is not None:
        found, said = placed.rig_from_plate.translation, view.stage_mm
        wrong = [a for a in range(3) if abs(found[a] - said[a]) > _SAME_MM]
        turned = [a for a in wrong if abs(found[a] + said[a]) < _SAME_MM]
        position = _position(said)
        if wrong and turned == wrong:
            axes = " and ".join(_AXES[a] for a in wrong)
            return _Finding(
                0,
                f"view {view.name}: its stage position {position} has the wrong sign in {axes}, the cameras "
                f"saw the plate at {_position(found)}; correct the session",
            )
        return _Finding(
            2,
            f"view {view.name}: its stage position is said to be {position}, the cameras saw the plate at "
            f"{_position(found)}; correct the session, or take the view again",
        )
    for head in data.heads:
        if _fits(data, _swapped(view, (head,)), known):
            return _Finding(
                1, f"view {view.name}: the left and right images of {head} are swapped; exchange them"
            )
    if _fits(data, _swapped(view, data.heads), known):
        return _Finding(
            1, f"view {view.name}: left and right images of every head are swapped; exchange them"
        )
    return _Finding(
        3,
        f"view {view.name} contradicts the others, which agree among themselves; a camera or the plate moved "
        "while it was taken, or its images belong to another session. Take it again, or leave it out",
    )


def _swapped(view: PlateView, heads: tuple[str, ...]) -> PlateView:
    """A view with the left and right observations of some heads exchanged."""
    seen = dict(view.observations)
    for head in heads:
        left: CameraKey = (head, "left")
        right: CameraKey = (head, "right")
        for key, other in ((left, right), (right, left)):
            seen.pop(key, None)
            if other in view.observations:
                seen[key] = view.observations[other]
    return replace(view, observations=seen)


def _position(x: Array) -> str:
    return f"({x[0]:.2f}, {x[1]:.2f}, {x[2]:.2f}) mm"
