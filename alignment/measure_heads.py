"""Is it a wheel before intact heads? Heads that moved are told from a tyre that carries load, or refused."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from alignment.arrays import Array
from alignment.calibration.judgement import Judgement, judge, unjudged
from alignment.imaging.lines import LightLines
from alignment.prepared import PreparedRig
from alignment.refusals import head_knocked
from alignment.stereo.correspondence import Candidates
from alignment.stereo.pool import PointPool
from alignment.stereo.rows import RowFields, row_fields
from alignment.values import MeasureSettings, Refusal, RefusalCode, RigCalibration
from alignment.vehicle.angles import camber_toe_jacobian
from alignment.wheel.agreement import MOVES, HeadMoves, head_moves, head_sums
from alignment.wheel.load import LoadedWheel, carry
from alignment.wheel.revolution import RevolutionFit
from alignment.wheel.search import WheelSurface

_WORST_RMS = 0.5  # mm; a sidewall that leaves more is not a body of revolution
_LEAST_SHARE = 0.05  # of a head's points; most may lie on rim and obstacles
_LEAST_OF_ALL = 0.15  # of the points of all heads; fewer meet on some surface by chance
DOUBT = 0.0
"""Evidence that something moved from which a load is looked for."""
_SHAPE_SHARE = 0.004  # of a load, by which its shapes may miss what a tyre does
_UNDETERMINED = 1e-6  # of the heads' own movements, what all of them do together
_DOWN = np.array([0.0, 0.0, -1.0])  # vehicle frame
# A head whose patch of the tyre would fit better elsewhere moved: by more than the errors of the calibration
# explain (`PreparedRig.worst_misfit`) and the noise of the head's points, which five movements fit a little.
_DEVIATIONS, _MOVEMENTS = 3.0, 5
_LEAD = 5.0  # logarithm of how much likelier a load must be than moved heads, or intact ones without it


@dataclass(frozen=True, eq=False)
class HeadSigns:
    """What one exposure of a wheel that turns says of its heads, to be judged with all others.

    An uneven tyre looks like heads that moved; but its signs turn with it, and those of a knock stay.

    Attributes
    ----------
    moves
        As a knock or a load would make them; a load that was found is free to explain them.
    numbers
        (H,) points with weight.
    noise
        Of the heights, millimetres.
    judgement
        Of this exposure alone.
    refusal
        Why it would be refused alone; None where it would not.
    judge
        Weighs other moves in place of these.
    """

    moves: HeadMoves
    numbers: Array
    noise: float
    judgement: Judgement
    refusal: Refusal | None
    judge: Callable[[HeadMoves], Judgement]


@dataclass(frozen=True, eq=False)
class HeadSums:
    """Of the points of each head with weight: their number, their weight, and weighted squares, (H,) each."""

    numbers: Array
    weights: Array
    squares: Array

    @classmethod
    def of(cls, surface: WheelSurface, heads: int) -> HeadSums:
        """Sums of a surface before so many heads."""
        fit = surface.fit
        return cls(*head_sums(surface.points.head, heads, fit.weights, fit.residuals))

    @property
    def rms(self) -> float:
        """Of all residuals, millimetres."""
        return math.sqrt(self.squares.sum() / self.weights.sum())


def told_apart(
    lines: Sequence[tuple[LightLines, LightLines]],
    matched: list[Candidates],
    everything: PointPool,
    surface: WheelSurface,
    rig: PreparedRig,
    settings: MeasureSettings,
) -> tuple[LoadedWheel | None, HeadSigns] | Refusal:
    """Tell a load from heads that moved; a refusal where neither makes the surface a wheel before its rig."""
    heads = len(matched)
    sums = HeadSums.of(surface, heads)
    few_points = _too_few(sums.numbers, matched, rig, settings)
    plain: HeadSigns | None = None
    if few_points is None:
        if sums.rms > _WORST_RMS:
            return _no_wheel(sums.rms)
        moves = head_moves(surface.points.points, surface.points.head, heads, surface.fit)
        judge = judged_shot(lines, matched, surface, sums.rms, rig)
        plain = head_signs(moves, moves.misfits(), sums.numbers, sums.rms, judge, rig)
        if plain.refusal is None and (plain.judgement.evidence or 0.0) <= DOUBT:
            return None, plain
    # What a load lifts before two heads may leave the third one off a surface that these agree on.
    loaded = _loaded(everything, surface, rig)
    sums = HeadSums.of(surface if loaded is None else loaded.surface, heads)
    few = _too_few(sums.numbers, matched, rig, settings) is not None
    if loaded is None or few or sums.rms > _WORST_RMS:
        if plain is None:
            assert few_points is not None
            return few_points
        return plain.refusal if plain.refusal is not None and settings.judge_heads else (None, plain)
    judge = judged_shot(lines, matched, loaded.surface, loaded.noise, rig, loaded.lift_mm)
    found = head_signs(loaded.moves, loaded.misfits(), sums.numbers, loaded.noise, judge, rig)
    return found.refusal if found.refusal is not None and settings.judge_heads else (loaded, found)


def head_signs(
    moves: HeadMoves,
    misfits: Array,
    numbers: Array,
    noise: float,
    judge: Callable[[HeadMoves], Judgement],
    rig: PreparedRig,
) -> HeadSigns:
    """Judge one exposure.

    Parameters
    ----------
    moves, misfits
        Of the heads; see `HeadMoves`.
    numbers, noise
        As of `HeadSigns`.
    judge
        Of `judged_shot`.
    rig
        Before which the wheel stands.
    """
    judgement = judge(moves)
    moved = _moved(misfits, numbers, noise, judgement, rig)
    return HeadSigns(moves, numbers, noise, judgement, moved, judge)


def judged_together(signs: Sequence[HeadSigns], rig: PreparedRig) -> Judgement | Refusal:
    """Judge the heads by all exposures of a wheel that turned: by those of their signs that do not turn."""
    normal = np.mean([one.moves.normal for one in signs], axis=0)
    target = np.mean([one.moves.target for one in signs], axis=0)
    last = signs[-1]
    judgement = last.judge(replace(last.moves, normal=normal, target=target))
    noise = float(np.median([one.noise for one in signs]))
    numbers = np.sum([one.numbers for one in signs], axis=0)
    moved = _moved(_common_misfits(signs, normal, target), numbers, noise, judgement, rig)
    if moved is not None:
        return moved
    return head_knocked(judgement, rig) if judgement.knocked else judgement


def _common_misfits(signs: Sequence[HeadSigns], normal: Array, target: Array) -> Array:
    """(H,) RMS of the heights that one movement of each head explains in all exposures, millimetres."""
    heads = signs[0].moves.square.shape[0]
    unit = np.sqrt(np.maximum(np.diag(normal), 1e-30))
    scaled = np.linalg.pinv(normal / np.outer(unit, unit), rcond=_UNDETERMINED, hermitian=True)
    amounts = (scaled @ (target / unit) / unit).reshape(heads, MOVES)
    explained, weight = np.zeros(heads), np.zeros(heads)
    for one in signs:
        of_ring = np.einsum("rha,ha->rh", one.moves.rings, amounts)
        mine = one.moves.rings[:, :, 0]
        mean = of_ring.sum(axis=1) / np.maximum(mine.sum(axis=1), 1e-12)
        explained += np.einsum("hab,ha,hb->h", one.moves.square, amounts, amounts)
        explained += (mine * mean[:, None] ** 2 - 2.0 * of_ring * mean[:, None]).sum(axis=0)
        weight += mine.sum(axis=0)
    out: Array = np.sqrt(np.maximum(explained, 0.0) / np.maximum(weight, 1e-12))
    return out


def _no_wheel(rms: float) -> Refusal:
    return Refusal(
        RefusalCode.NOT_A_WHEEL,
        f"the points leave a surface of revolution by {rms:.2f} mm RMS, at most {_WORST_RMS} is a wheel; "
        "check the calibration and what stands in front of the heads",
    )


def _loaded(pool: PointPool, surface: WheelSurface, rig: PreparedRig) -> LoadedWheel | None:
    """Take a load off the wheel, where that explains what the heads see better than a head that moved."""
    down = rig.calibration.vehicle_from_rig.rotation.T @ _DOWN
    model, amounts = rig.knock_model, MOVES * len(rig.heads)
    knocks = [] if model is None else [knock.signs[:amounts] for knock in model.knocks]
    known = None
    if model is not None and rig.calibration.covariance is not None:
        known = model.covariance[:amounts, :amounts]
    loaded = carry(pool, surface, rig.image_axes, down, known, knocks)
    return loaded if loaded is not None and loaded.lead > _LEAD else None


def judged_shot(
    lines: Sequence[tuple[LightLines, LightLines]],
    matched: list[Candidates],
    surface: WheelSurface,
    rms: float,
    rig: PreparedRig,
    lift_mm: float = 0.0,
) -> Callable[[HeadMoves], Judgement]:
    """Return what weighs the signs of knocked cameras and mixed pictures in moves of the heads.

    `lift_mm` is by how much a load lifts the tyre.
    """
    if rig.knock_model is None:
        return lambda moves: unjudged(len(matched))
    rows = row_fields(lines, matched, surface.chosen, rig.row_views, surface.fit.height)
    return judged_by_rows(rows, surface.fit, rms, rig, lift_mm)


def judged_by_rows(
    rows: RowFields, fit: RevolutionFit, rms: float, rig: PreparedRig, lift_mm: float = 0.0
) -> Callable[[HeadMoves], Judgement]:
    """As `judged_shot`, of row differences that are known; `fit` is the wheel."""
    model = rig.knock_model
    if model is None:
        return lambda moves: unjudged(len(rows.pairs))
    if lift_mm > 0.0:
        model = model.beside_load(_SHAPE_SHARE * lift_mm)
    turn = angles_by_normal(fit.normal, rig.calibration) @ fit.tilt_axes.T
    normal = fit.normal
    return lambda moves: judge(moves, rms, rows, model, normal, turn)


def _moved(
    misfits: Array, numbers: Array, rms: float, judgement: Judgement, rig: PreparedRig
) -> Refusal | None:
    """Refuse a head whose patch would fit better elsewhere by more than noise and calibration explain."""
    limits = rig.worst_misfit + _DEVIATIONS * rms * np.sqrt(_MOVEMENTS / numbers)
    worst = int((misfits - limits).argmax())
    if misfits[worst] <= limits[worst]:
        return None
    # What explains all signs is likelier to blame than the head that is off the most.
    name = rig.heads[judgement.head if judgement.knocked else worst].name
    return Refusal(
        RefusalCode.HEAD_MOVED,
        f"{name} does not fit the other heads: a movement of whole heads explains "
        f"{1e3 * misfits[worst]:.0f} µm of the residuals, noise at most {1e3 * limits[worst]:.0f} µm; "
        "check that it has not been knocked, and calibrate again",
        name,
    )


def _too_few(
    numbers: Array, matched: list[Candidates], rig: PreparedRig, settings: MeasureSettings
) -> Refusal | None:
    """Refuse a head, or all of them, of whose line points hardly any lie on the wheel."""
    for number, candidates, head in zip(numbers, matched, rig.heads, strict=True):
        count = int(number)
        if count < max(settings.minimum_points, _LEAST_SHARE * candidates.offered):
            return Refusal(
                RefusalCode.TOO_FEW_POINTS,
                f"{head.name}: {count} of {candidates.offered} line points lie on the wheel, at least "
                f"{settings.minimum_points} and {_LEAST_SHARE:.0%} of them are needed; check for dirt, an "
                "obstacle, or a head that moved since its calibration",
                head.name,
            )
    share = int(numbers.sum()) / sum(candidates.offered for candidates in matched)
    if share < _LEAST_OF_ALL:
        return Refusal(
            RefusalCode.NOT_A_WHEEL,
            f"only {share:.0%} of the line points lie on one surface of revolution, at least "
            f"{_LEAST_OF_ALL:.0%} do on a wheel; check that left and right images are not swapped, and that "
            "the calibration is the rig's",
        )
    return None


def angles_by_normal(normal: Array, calibration: RigCalibration) -> Array:
    """(2, 3) change of camber and toe by a change of the normal, rig frame."""
    rotation = calibration.vehicle_from_rig.rotation
    out: Array = camber_toe_jacobian(rotation @ normal, calibration.side) @ rotation
    return out
