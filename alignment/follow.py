"""A wheel followed: what was measured last says where its lines are, and where the fit begins.

While somebody turns a tie rod the wheel hardly moves from image to image. Its lines are then looked for in
strips around the places where they were seen last (`imaging.strips`), and the surface is fitted from the last
one on (`wheel.revolution.fit_near`): the same centres, points, weights and gates as in a whole measurement,
for a third of its work. What following does not look at, a whole measurement now and then does: other
lines, the rows of crosses, a load. Following never refuses a wheel and never guesses: where anything is in
doubt the same images are measured whole, and that result counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from alignment.arrays import Array, Mask
from alignment.errors import DegenerateInputError
from alignment.imaging.lines import LightLines
from alignment.imaging.strips import Strips, look_again
from alignment.measure import (
    FULL_SCALE_SHARE,
    Sight,
    evaluate_sight,
    full_scale_share,
    measure_and_show,
    refused_images,
)
from alignment.measure_heads import DOUBT, HeadSigns, HeadSums, head_signs, judged_by_rows
from alignment.prepared import PreparedRig
from alignment.stereo.paired import PairedLines, match_again, view_of
from alignment.stereo.pool import PointPool
from alignment.stereo.rows import RowFields, row_fields
from alignment.values import (
    MeasureSettings,
    Refusal,
    RigCalibration,
    StereoImages,
    WheelMeasurement,
    WheelReference,
)
from alignment.wheel.agreement import head_moves
from alignment.wheel.gloss import gloss_shifts
from alignment.wheel.held_load import HeldLoad
from alignment.wheel.load import leaned
from alignment.wheel.reference import moved_reference
from alignment.wheel.revolution import RevolutionFit, fit_near
from alignment.wheel.search import WheelSurface

_ON_WHEEL = 3.0  # mm; what is nearer to the surface, letters among it, is looked for again
_BESIDE = 4  # points on either side of a right line's, for its left partner's rows move a little
_LIGHT = 16  # line points of which one tells of too much light
_FEWEST_SEEN = (
    0.9  # of the points that were there at first, of each image and on each head's part of the wheel
)
_MOST_RMS = 1.25  # times what the wheel left at first
_MOVED = 0.005  # radians, 17′, between two images: a jump, and lines may have been taken for others
_SAME = 0.75  # deviations of the image noise by which following may differ on the very same images
_MORE_EVIDENCE = 2.0  # than at first, that a head moved; then it is for a whole measurement to say
_MORE_MISFIT = 0.003  # mm


@dataclass(frozen=True)
class FollowRules:
    """How a wheel is followed.

    Attributes
    ----------
    whole_every
        Each so many-th result is measured whole; at 25 results a second that is once a second. 1 follows
        nothing.
    """

    whole_every: int = 25


@dataclass(frozen=True, eq=False)
class _First:
    """What following found in the images of the whole measurement itself, to be compared with.

    Attributes
    ----------
    seen
        (2 H,) points of each image.
    used
        (H,) points of each head with weight.
    rms
        Of the residuals, millimetres.
    evidence
        That something moved; None where it was not judged.
    misfits
        (H,) of the heads, millimetres.
    """

    seen: Array
    used: Array
    rms: float
    evidence: float | None
    misfits: Array


@dataclass(frozen=True, eq=False)
class FollowedWheel:
    """What is known of a wheel that is followed; made and taken by `follow_wheel`, and by nobody changed.

    Attributes
    ----------
    calibration, settings
        It was measured with; nothing is followed with others.
    heads, rig
        As of `Sight`.
    strips
        Where the lines of each image are, left and right of each head.
    paired
        Which of them belong together, of each head.
    near
        The surface, as it was fitted last.
    load
        Of the last whole measurement; None where there was none.
    rows
        Row differences of the last whole measurement; None where the rig cannot be judged.
    place
        Of the wheel by the last whole measurement; None where it was not found.
    begun
        The surface of the last whole measurement.
    signs
        Of the heads, of the last whole measurement.
    first
        What following made of its images.
    since
        Results that were followed since.
    """

    calibration: RigCalibration
    settings: MeasureSettings
    heads: tuple[int, ...]
    rig: PreparedRig
    strips: tuple[Strips, ...]
    paired: tuple[PairedLines, ...]
    near: RevolutionFit
    load: HeldLoad | None
    rows: RowFields | None
    place: WheelReference | None
    begun: RevolutionFit
    signs: HeadSigns
    first: _First | None
    since: int


@dataclass(frozen=True, eq=False)
class FollowResult:
    """A result, and what to follow the wheel by.

    Attributes
    ----------
    result
        As of `measure_wheel`.
    wheel
        For the next images; None where the wheel cannot be followed.
    whole
        Why these images were measured whole, in words; None where they were followed.
    """

    result: WheelMeasurement | Refusal
    wheel: FollowedWheel | None
    whole: str | None


class _Doubt(Exception):  # noqa: N818
    """Why a wheel is not followed in these images."""


def follow_wheel(
    images: Sequence[StereoImages],
    calibration: RigCalibration | PreparedRig,
    settings: MeasureSettings,
    wheel: FollowedWheel | None,
    rules: FollowRules,
) -> FollowResult:
    """Measure a wheel that was measured just before, in a third of the time.

    Parameters
    ----------
    images, calibration, settings
        As for `measure_wheel`, and the same calibration and settings for all images of one wheel.
    wheel
        Of the result before; None for the first images, and after anything that may have changed the wheel.
    rules
        How often it is measured whole.

    Returns
    -------
    FollowResult
        Every refusal is one of a whole measurement.

    Raises
    ------
    DegenerateInputError
        As `measure_wheel`.
    """
    if wheel is None:
        return _whole(images, calibration, settings, rules, "nothing to follow yet")
    if wheel.since + 1 >= rules.whole_every:
        return _whole(images, calibration, settings, rules, "its turn")
    known = PreparedRig.of(calibration, settings).calibration
    if wheel.calibration is not known or wheel.settings != settings:
        return _whole(images, calibration, settings, rules, "another calibration, or other settings")
    wrong = refused_images(images, known)
    if wrong is not None:
        return FollowResult(wrong, None, "other images")
    try:
        result, after = _followed(images, settings, wheel)
    except (_Doubt, DegenerateInputError) as doubt:
        return _whole(images, calibration, settings, rules, str(doubt))
    return FollowResult(result, after, None)


def _whole(
    images: Sequence[StereoImages],
    calibration: RigCalibration | PreparedRig,
    settings: MeasureSettings,
    rules: FollowRules,
    why: str,
) -> FollowResult:
    """Measure whole, and begin to follow where following says the same of these very images."""
    result, sight = measure_and_show(images, calibration, settings)
    if sight is None or not isinstance(result, WheelMeasurement) or rules.whole_every < 2:
        return FollowResult(result, None, why)
    begun = _begin(sight, result, PreparedRig.of(calibration, settings).calibration, settings)
    if begun is None:
        return FollowResult(result, None, why)
    try:
        again, after = _followed(images, settings, begun)
    except (_Doubt, DegenerateInputError):
        return FollowResult(result, None, why)
    common = sight.rig.angle_covariance
    noise = np.diag(result.angle_covariance - (0.0 if common is None else common))
    off = np.array([again.camber - result.camber, again.toe - result.toe])
    if (off**2 > _SAME**2 * noise).any():
        return FollowResult(result, None, why)
    return FollowResult(result, replace(after, since=0), why)


def _begin(
    sight: Sight, result: WheelMeasurement, calibration: RigCalibration, settings: MeasureSettings
) -> FollowedWheel | None:
    """What to follow a wheel by; None where not all of its lines were looked at."""
    surface, matched, rig = sight.surface, sight.matched, sight.rig
    thinned = any(lines.share < 1.0 for pair in sight.lines for lines in pair)
    if thinned or any(each.every > 1 for each in matched):
        return None
    load = None if sight.loaded is None else HeldLoad.of(sight.loaded)
    near = np.abs(surface.fit.height(surface.points.points)) < _ON_WHEEL
    chosen = np.flatnonzero(surface.chosen)[near]
    head, axes = surface.points.head[near], rig.image_axes
    way = gloss_shifts(
        surface.points.points[near], head, surface.points.light[near], axes, surface.fit.normal,
        surface.fit.centre,
    )  # fmt: skip
    strips: list[Strips] = []
    paired: list[PairedLines] = []
    first = 0
    for k, ((left, right), candidates) in enumerate(zip(sight.lines, matched, strict=True)):
        mine = chosen[head == k] - first
        first += len(candidates.points)
        of_left, of_right = candidates.left_point[mine], candidates.right_point[mine]
        wanted = _marked(right, of_right, _BESIDE)
        pair = (Strips.of(left, _marked(left, of_left, 0)), Strips.of(right, wanted))
        seen = [
            view_of(each, rig.geometry.packed[2 * k + side], rig.geometry.turns[2 * k + side])
            for side, each in enumerate(pair)
        ]
        strips += pair
        # One candidate was chosen of each point, and they stand in the order of the points.
        partner = (np.cumsum(wanted) - 1)[of_right]
        paired.append(PairedLines(seen[0], seen[1], partner, way[head == k]))
    rows = None
    if rig.knock_model is not None:
        rows = row_fields(sight.lines, matched, surface.chosen, rig.row_views, surface.fit.height)
    return FollowedWheel(
        calibration, settings, sight.heads, rig, tuple(strips), tuple(paired), surface.fit, load, rows,
        result.reference, surface.fit, sight.signs, None, 0,
    )  # fmt: skip


def _marked(lines: LightLines, numbers: Array, beside: int) -> Mask:
    """Mask (N,) of the points of these numbers, and of some on either side of each."""
    out = np.zeros(len(lines.points), dtype=np.bool_)
    for off in range(-beside, beside + 2 if beside else 1):
        out[np.clip(numbers + off, 0, len(out) - 1)] = True
    return out


def _followed(
    images: Sequence[StereoImages], settings: MeasureSettings, wheel: FollowedWheel
) -> tuple[WheelMeasurement, FollowedWheel]:
    """Follow a wheel into new images, or raise the doubt."""
    rig, first = wheel.rig, wheel.first
    every = [image for k in wheel.heads for image in (images[k].left, images[k].right)]
    looked = look_again(every, wheel.strips)
    seen = np.array([len(each.numbers) for each in looked], dtype=np.float64)
    if first is not None and (seen < _FEWEST_SEEN * first.seen).any():
        raise _Doubt("lines are not where they were")
    for image, each in zip(every, looked, strict=True):
        if full_scale_share(image, each.lines, _LIGHT) > FULL_SCALE_SHARE:
            raise _Doubt("too much light")
    pairs = list(zip(looked[::2], looked[1::2], strict=True))
    matched, pool = match_again(pairs, wheel.paired, rig.geometry, settings.depth_range_mm)
    if min(len(candidates.points) for candidates in matched) < settings.minimum_points:
        raise _Doubt("lines match no more")
    surface = _fitted(pool, wheel)
    lines = [(left.lines, right.lines) for left, right in pairs]
    sight = _judged(Sight(wheel.heads, rig, lines, matched, surface, None, wheel.signs), wheel)
    result = evaluate_sight(sight, settings, lambda seen: _place(seen, wheel))
    if isinstance(result, Refusal):
        raise _Doubt(result.reason)
    if len(wheel.heads) < len(images):
        result = replace(result, degraded=True)
    strips = tuple(each.strips for each in looked)
    if first is None:
        sums = HeadSums.of(surface, len(matched))
        misfits = sight.signs.moves.misfits()
        first = _First(seen, sums.numbers, sums.rms, sight.signs.judgement.evidence, misfits)
    return result, replace(wheel, strips=strips, near=sight.surface.fit, first=first, since=wheel.since + 1)


def _fitted(pool: PointPool, wheel: FollowedWheel) -> WheelSurface:
    """The surface, with the load taken off."""
    near = wheel.near
    if wheel.load is not None:
        pool = replace(
            pool,
            points=pool.points
            - wheel.load.heights(pool.points, near.centre, near.tilt_axes)[:, None] * near.normal,
        )
    fit = fit_near(pool.points, pool.sigma, pool.rays, pool.cluster, near, line=pool.line, spread=pool.spread)
    if float(np.linalg.norm(fit.normal - near.normal)) > _MOVED:
        raise _Doubt("the wheel moved far")
    return WheelSurface(fit, np.ones(len(pool.points), dtype=np.bool_), pool)


def _place(sight: Sight, wheel: FollowedWheel) -> WheelReference | None:
    if wheel.place is None:
        return None
    return moved_reference(wheel.place, wheel.begun, sight.surface.fit)


def _judged(sight: Sight, wheel: FollowedWheel) -> Sight:
    """Ask what a whole measurement asks of the heads; rows and load are those of the last one."""
    surface, rig, first = sight.surface, sight.rig, wheel.first
    heads = len(sight.matched)
    sums = HeadSums.of(surface, heads)
    if first is not None:
        if (sums.numbers < _FEWEST_SEEN * first.used).any():
            raise _Doubt("fewer points lie on the wheel")
        if sums.rms > _MOST_RMS * first.rms:
            raise _Doubt("the points leave the wheel")
    moves = head_moves(surface.points.points, surface.points.head, heads, surface.fit)
    misfits = moves.misfits()
    if wheel.load is not None:
        if first is not None and (misfits > first.misfits + _MORE_MISFIT).any():
            raise _Doubt("the heads see another load")
        loaded = wheel.load.loaded
        # What is not of the wheel was judged with the load free to explain it.
        signs = replace(wheel.signs, moves=moves, numbers=sums.numbers)
        fit = leaned(surface.fit, loaded.model.turn)
        surface = replace(surface, fit=fit)
        return replace(sight, surface=surface, loaded=replace(loaded, surface=surface), signs=signs)
    assert wheel.rows is not None or rig.knock_model is None
    judge = wheel.signs.judge
    if wheel.rows is not None:
        judge = judged_by_rows(wheel.rows, surface.fit, sums.rms, rig)
    signs = head_signs(moves, misfits, sums.numbers, sums.rms, judge, rig)
    before = DOUBT if first is None or first.evidence is None else max(DOUBT, first.evidence)
    if signs.refusal is not None and wheel.signs.refusal is None:
        raise _Doubt(signs.refusal.reason)
    if first is not None and (signs.judgement.evidence or 0.0) > before + _MORE_EVIDENCE:
        raise _Doubt("a head may have moved, or the tyre carries a load")
    return replace(sight, signs=signs)
