"""The heart: six images of one exposure and a calibration in, camber and toe of the tyre plane out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from alignment.arrays import Array
from alignment.calibration.knocks import knock_model
from alignment.calibration.prediction import angle_covariance, predicted_misfits
from alignment.errors import DegenerateInputError
from alignment.imaging.extraction import level_share
from alignment.imaging.lines import LightLines, extract_many
from alignment.stereo.correspondence import Candidates, match_heads
from alignment.stereo.overlap import shared_views
from alignment.stereo.pool import PointPool
from alignment.stereo.rectification import epipolar_directions
from alignment.stereo.rows import row_fields
from alignment.stereo.surface import plane_hypotheses
from alignment.values import (
    HeadCalibration,
    HeadQuality,
    Image,
    MeasureSettings,
    Refusal,
    RefusalCode,
    RigCalibration,
    StereoImages,
    WheelMeasurement,
)
from alignment.vehicle.angles import camber_toe, camber_toe_jacobian
from alignment.wheel.agreement import HeadMoves, head_moves, head_sums
from alignment.wheel.judgement import KNOCKED, Judgement, judge, unjudged
from alignment.wheel.plane import PlaneFit, fit_plane
from alignment.wheel.ridges import fit_ridges
from alignment.wheel.search import WheelSurface, find_surface

_WORST_RMS = 0.5  # mm; a sidewall that leaves more is not a body of revolution
_LEAST_SHARE = 0.05  # of a head's points; most may lie on rim and obstacles
_LEAST_OF_ALL = 0.15  # of the points of all heads; fewer meet on some surface by chance
# A head whose patch of the tyre would fit better elsewhere, by so many millimetres RMS, moved: more than the
# skin of a tyre explains, more than the noise of the head's points does, which five movements fit a little,
# and more than the errors of the calibration do: three stated deviations, or a hundredth of a millimetre
# where it states none.
_LEAST_MISFIT, _UNSTATED_MISFIT, _DEVIATIONS, _MOVEMENTS = 0.003, 0.01, 3.0, 5
_SOME = 4  # line points of which one tells of the light
_FULL_SCALE_SHARE = 0.75  # of a head's lines; something bright before a part of them does not spoil the rest
_WHITE_SHARE = 0.25  # of an image without lines; more light hides them than a lamp in view
_LEAST_FULL_SCALE = 1023  # of a camera whose images have 16 bit
_FARTHEST_AXIS = 60.0  # mm
_FEWEST_HEADS = 2


def measure_wheel(
    images: Sequence[StereoImages], calibration: RigCalibration, settings: MeasureSettings
) -> WheelMeasurement | Refusal:
    """Measure the tyre plane of one wheel.

    Light lines are found in each image, matched between left and right along epipolar lines, triangulated
    into the rig frame, and a surface of revolution with a free profile is fitted to the points of all heads.
    Of several matchings (a periodic pattern allows its neighbours too) the one counts whose points make a
    body of revolution.

    Parameters
    ----------
    images
        One pair per head, in the order of `calibration.heads`; (height, width), 8 or 16 bit.
    calibration
        Cameras and pose of the rig.
    settings
        See `MeasureSettings`.

    Returns
    -------
    WheelMeasurement or Refusal
        A refusal says what was wrong and what to do; it is false.
    """
    wrong = _check_images(images, calibration)
    if wrong is not None:
        return wrong
    result = _measure(images, calibration, settings)
    if isinstance(result, Refusal) and settings.allow_lost_head and len(images) >= _FEWEST_HEADS + 1:
        names = [head.name for head in calibration.heads]
        if result.head in names:
            return _without_head(names.index(result.head), images, calibration, settings) or result
    return result


def _without_head(
    lost: int, images: Sequence[StereoImages], calibration: RigCalibration, settings: MeasureSettings
) -> WheelMeasurement | Refusal:
    """Measure with the other heads alone."""
    others = [pair for k, pair in enumerate(images) if k != lost]
    result = _measure(others, _others(calibration, lost), settings)
    return replace(result, degraded=True) if isinstance(result, WheelMeasurement) else result


@lru_cache(maxsize=16)
def _others(calibration: RigCalibration, lost: int) -> RigCalibration:
    """One value per lost head, so that what is computed once for a calibration stays."""
    return calibration.without_head(lost)


def _measure(
    images: Sequence[StereoImages], calibration: RigCalibration, settings: MeasureSettings
) -> WheelMeasurement | Refusal:
    every = [image for pair in images for image in (pair.left, pair.right)]
    views = shared_views(calibration, settings.depth_range_mm)
    found_lines = iter(extract_many(every, epipolar_directions(calibration), views))
    lines: list[tuple[LightLines, LightLines]] = []
    for pair, head in zip(images, calibration.heads, strict=True):
        left, right = next(found_lines), next(found_lines)
        for image, found, side in ((pair.left, left, "left"), (pair.right, right, "right")):
            if found is None or len(found.points) < settings.minimum_points // 4:
                return _too_bright(head, side) if _is_white(image) else _no_light(image, head, side)
            if _full_scale_share(image, found) > _FULL_SCALE_SHARE:
                return _too_bright(head, side)
        assert left is not None
        assert right is not None
        lines.append((left, right))
    matched = match_heads(lines, calibration.heads, settings.depth_range_mm)
    for candidates, head in zip(matched, calibration.heads, strict=True):
        if len(candidates.points) < settings.minimum_points:
            return _no_match(candidates, head, settings)
    pool = PointPool.of(matched)
    slope_limit = float(np.tan(settings.maximum_angle)) + 0.05
    hypotheses = plane_hypotheses(pool.points, pool.group, settings.depth_range_mm, slope_limit)
    surface = find_surface(pool, hypotheses, _image_axes(calibration))
    if surface is None:
        return Refusal(
            RefusalCode.NOT_A_WHEEL,
            "the points of the heads do not lie around one axis; check that the wheel stands in the "
            "measuring volume and that nothing else is in view",
        )
    return _evaluate(lines, matched, surface, calibration, settings)


def _check_images(images: Sequence[StereoImages], calibration: RigCalibration) -> Refusal | None:
    if len(images) != len(calibration.heads):
        return Refusal(
            RefusalCode.WRONG_IMAGES,
            f"{len(images)} image pairs for a rig of {len(calibration.heads)} heads; "
            "take the calibration of the rig that made the shot",
        )
    for pair, head in zip(images, calibration.heads, strict=True):
        for image, camera, side in zip((pair.left, pair.right), head.cameras, ("left", "right"), strict=True):
            size = (camera.model.height, camera.model.width)
            if image.shape != size or image.dtype not in (np.uint8, np.uint16):
                return Refusal(
                    RefusalCode.WRONG_IMAGES,
                    f"{head.name} {side}: an image of shape {image.shape} and type {image.dtype} where the "
                    f"calibration has {size}, 8 or 16 bit, one channel",
                )
    return None


def _too_bright(head: HeadCalibration, side: str) -> Refusal:
    return Refusal(
        RefusalCode.HEAD_SATURATED,
        f"{head.name} {side}: most of the light lines are at full scale; shorten the exposure "
        "or shield the station from the sun",
        head.name,
    )


def _is_white(image: Image) -> bool:
    """Tell whether so much of an image is at full scale that lines cannot show; 16-bit cameras may end below
    65535, but none below 1023."""
    top = 255 if image.dtype == np.uint8 else max(int(image.max()), _LEAST_FULL_SCALE)
    return float(np.mean(image >= top)) > _WHITE_SHARE


def _no_light(image: Image, head: HeadCalibration, side: str) -> Refusal:
    return Refusal(
        RefusalCode.HEAD_DARK,
        f"{head.name} {side}: no light lines (brightest pixel {int(image.max())}); check projector, "
        "lens cap, exposure, and that a wheel stands in front of the head",
        head.name,
    )


def _no_match(candidates: Candidates, head: HeadCalibration, settings: MeasureSettings) -> Refusal:
    lo, hi = settings.depth_range_mm
    return Refusal(
        RefusalCode.NO_CORRESPONDENCE,
        f"{head.name}: only {len(candidates.points)} of {candidates.offered} line points have a partner "
        f"between z = {lo:g} and {hi:g} mm; check that left and right images are not swapped, that the head "
        "has not moved since its calibration, and that the wheel is in place",
        head.name,
    )


def _full_scale_share(image: Image, lines: LightLines) -> float:
    """Share of line points whose pixel is at the top of the range; 16-bit cameras may end below 65535."""
    return level_share(image, lines.points[::_SOME], 255 if image.dtype == np.uint8 else -1)


def _evaluate(
    lines: Sequence[tuple[LightLines, LightLines]],
    matched: list[Candidates],
    surface: WheelSurface,
    calibration: RigCalibration,
    settings: MeasureSettings,
) -> WheelMeasurement | Refusal:
    fit, pool = surface.fit, surface.points
    numbers, weights, misfit = head_sums(pool.head, len(matched), fit.weights, fit.residuals)
    wrong = _too_few(numbers, matched, calibration, settings)
    if wrong is not None:
        return wrong
    rms = math.sqrt(misfit.sum() / weights.sum())
    if rms > _WORST_RMS:
        return Refusal(
            RefusalCode.NOT_A_WHEEL,
            f"the points leave a surface of revolution by {rms:.2f} mm RMS, at most {_WORST_RMS} is a wheel; "
            "check the calibration and what stands in front of the heads",
        )
    moves = head_moves(pool.points, pool.head, len(matched), fit)
    misfits = moves.misfits()
    limits = _worst_misfit(calibration) + _DEVIATIONS * rms * np.sqrt(_MOVEMENTS / numbers)
    worst = int((misfits - limits).argmax())
    judgement = _judged(lines, matched, surface, moves, rms, calibration)
    if misfits[worst] > limits[worst]:
        # What explains all signs is likelier to blame than the head that is off the most.
        name = calibration.heads[judgement.head if judgement.knocked else worst].name
        return Refusal(
            RefusalCode.HEAD_MOVED,
            f"{name} does not fit the other heads: a movement of whole heads explains "
            f"{1e3 * misfits[worst]:.0f} µm of the residuals, noise at most {1e3 * limits[worst]:.0f} µm; "
            "check that it has not been knocked, and calibrate again",
            name,
        )
    try:
        normal, covariance, tilt_axes, rms = _plane(surface, rms, len(matched), settings)
    except DegenerateInputError as error:
        return Refusal(RefusalCode.TOO_FEW_POINTS, f"the light lines show no circular ridge: {error}")
    mean = np.einsum("i,ij->j", fit.weights, pool.points) / fit.weights.sum()
    centre = fit.centre + float((mean - fit.centre) @ normal) * normal
    rotation = calibration.vehicle_from_rig.rotation
    in_vehicle = rotation @ normal
    try:
        camber, toe = camber_toe(in_vehicle, calibration.side)
    except DegenerateInputError:
        return _outside("its plane does not face the heads")
    if max(abs(camber), abs(toe)) > settings.maximum_angle:
        return _outside(
            f"camber {np.degrees(camber):.2f}°, toe {np.degrees(toe):.2f}°, believable are at most "
            f"±{np.degrees(settings.maximum_angle):.1f}°"
        )
    if np.hypot(centre[0], centre[1]) > _FARTHEST_AXIS:
        return _outside(f"its axis passes the rig's by ({centre[0]:.0f}, {centre[1]:.0f}) mm")
    by_normal = camber_toe_jacobian(in_vehicle, calibration.side) @ rotation
    if judgement.knocked:
        return _knocked(judgement, calibration)
    turn = by_normal @ tilt_axes.T
    noise = turn @ covariance @ turn.T
    return WheelMeasurement(
        camber=camber,
        toe=toe,
        angle_covariance=noise + _from_calibration(calibration) + judgement.covariance,
        normal=normal,
        centre=centre,
        offset_mm=float(centre @ normal),
        points_used=int(np.count_nonzero(fit.weights > 0)),
        residual_rms_mm=rms,
        heads=_qualities(numbers, weights, misfit, matched, judgement, calibration),
        method=f"tyre_plane/{settings.method}",
        coverage_factor=settings.coverage_factor,
        knock_evidence=judgement.evidence,
        warning=_warning(judgement, calibration) if judgement.suspected else None,
        unseen=_unseen(judgement),
    )


def _judged(
    lines: Sequence[tuple[LightLines, LightLines]],
    matched: list[Candidates],
    surface: WheelSurface,
    moves: HeadMoves,
    rms: float,
    calibration: RigCalibration,
) -> Judgement:
    """Weigh the signs of knocked cameras and mixed pictures."""
    fit = surface.fit
    try:
        model = knock_model(calibration)
    except DegenerateInputError:  # heads that look elsewhere than at the nominal wheel
        return unjudged(len(matched))
    rotation = calibration.vehicle_from_rig.rotation
    by_normal = camber_toe_jacobian(rotation @ fit.normal, calibration.side) @ rotation
    rows = row_fields(lines, matched, surface.chosen, calibration.heads, fit.height)
    return judge(moves, rms, rows, model, fit.normal, by_normal @ fit.tilt_axes.T)


def _too_few(
    numbers: Array, matched: list[Candidates], calibration: RigCalibration, settings: MeasureSettings
) -> Refusal | None:
    """Refuse a head, or all of them, of whose line points hardly any lie on the wheel."""
    for number, candidates, head in zip(numbers, matched, calibration.heads, strict=True):
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


def _plane(
    surface: WheelSurface, rms: float, heads: int, settings: MeasureSettings
) -> tuple[Array, Array, Array, float]:
    """Normal, covariance of its tilts, their axes, and RMS of the residuals, by the chosen method."""
    fit, pool = surface.fit, surface.points
    if settings.method == "revolution":
        return fit.normal, fit.covariance, fit.tilt_axes, rms
    if settings.method == "plane":
        used = fit.weights > 0
        plane = fit_plane(pool.points[used], pool.cluster[used], fit.normal)
    else:
        plane = fit_ridges(pool.points, pool.head, pool.line, fit, heads)
    return plane.normal, plane.covariance, plane.tilt_axes, _rms(plane)


def _qualities(
    numbers: Array,
    weights: Array,
    misfit: Array,
    matched: list[Candidates],
    judgement: Judgement,
    calibration: RigCalibration,
) -> tuple[HeadQuality, ...]:
    out = []
    for k, (candidates, head) in enumerate(zip(matched, calibration.heads, strict=True)):
        row, sigma = float(judgement.row_px[k]), float(judgement.row_sigma_px[k])
        out.append(
            HeadQuality(
                name=head.name,
                points=int(numbers[k]),
                points_offered=candidates.offered,
                residual_rms_mm=math.sqrt(misfit[k] / weights[k]) if weights[k] > 0.0 else 0.0,
                row_px=None if math.isnan(row) else row,
                row_sigma_px=None if math.isnan(sigma) else sigma,
            )
        )
    return tuple(out)


def _seen(judgement: Judgement) -> str:
    """Figures of a judgement, in words."""
    row, sigma = judgement.row_px[judgement.head], judgement.row_sigma_px[judgement.head]
    rows = f"its rows differ by {row:.2f} px, noise and calibration make {sigma:.2f}"
    if math.isnan(row):
        rows = "too few crosses of light lines for its rows"
    return f"evidence {judgement.evidence or 0.0:.0f}, refused above {KNOCKED:.0f}; {rows}"


def _unseen(judgement: Judgement) -> tuple[float, float] | None:
    if judgement.unseen is None:
        return None
    camber, toe = map(float, judgement.unseen)
    return camber, toe


def _knocked(judgement: Judgement, calibration: RigCalibration) -> Refusal:
    name = calibration.heads[judgement.head].name
    return Refusal(
        RefusalCode.HEAD_MOVED,
        f"{name} does not fit its calibration and the other heads: a movement of {judgement.suspect} would "
        f"explain it ({_seen(judgement)}); check that it has not been knocked and that all images are of one "
        "exposure, and calibrate again",
        name,
    )


def _warning(judgement: Judgement, calibration: RigCalibration) -> str:
    camber, toe = (60.0 * math.degrees(angle) for angle in judgement.angles)
    return (
        f"{calibration.heads[judgement.head].name} is suspect: a movement of {judgement.suspect} would "
        f"explain the shot ({_seen(judgement)}) and change camber by {camber:+.2f}′ and toe by {toe:+.2f}′, "
        "which the uncertainty covers; check the calibration"
    )


@lru_cache(maxsize=16)
def _image_axes(calibration: RigCalibration) -> Array:
    """(H, 3, 2) directions of the rows and columns of the heads' left images, rig frame."""
    return np.array([head.left.rig_from_camera.rotation[:, :2] for head in calibration.heads])


@lru_cache(maxsize=16)
def _from_calibration(calibration: RigCalibration) -> Array:
    """(2, 2) covariance of the angles by that of the cameras, on a nominal wheel; zero where it is unknown.

    The share of a calibration hardly depends on the wheel, so it is computed once for each.
    """
    if calibration.covariance is None:
        return np.zeros((2, 2))
    return angle_covariance(calibration)


@lru_cache(maxsize=16)
def _worst_misfit(calibration: RigCalibration) -> float:
    """Largest misfit of a head, millimetres, were there no noise; computed once for each calibration."""
    if calibration.covariance is None:
        return _UNSTATED_MISFIT
    return _LEAST_MISFIT + _DEVIATIONS * float(predicted_misfits(calibration).max())


def _rms(plane: PlaneFit) -> float:
    """Weighted root mean square of a plane's residuals, millimetres."""
    used = plane.weights > 0
    return float(np.sqrt(np.average(np.square(plane.residuals[used]), weights=plane.weights[used])))


def _outside(what: str) -> Refusal:
    return Refusal(
        RefusalCode.OUTSIDE_VOLUME,
        f"the wheel is outside the measuring volume: {what}; check its position and the calibration's rig",
    )
