"""The heart: six images of one exposure and a calibration in, camber and toe of the tyre plane out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from alignment.calibration.prediction import angle_covariance, predicted_misfits
from alignment.errors import DegenerateInputError
from alignment.imaging.extraction import level_share
from alignment.imaging.lines import LightLines, extract_many
from alignment.stereo.correspondence import Candidates, match_heads
from alignment.stereo.rectification import epipolar_directions
from alignment.stereo.surface import PlaneHypothesis, nearest_candidates, plane_hypotheses
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
from alignment.wheel.agreement import head_misfits
from alignment.wheel.plane import fit_plane
from alignment.wheel.revolution import RevolutionFit, fit_revolution
from alignment.wheel.ridges import fit_ridges

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_PLANE_GATE = 30.0  # mm; relief of a sidewall about its mean plane
_SURFACE_GATE = 2.0  # mm; a ghost is farther than that from the fitted surface
_STRETCH = 25  # line points that count as one cluster
_GOOD_SCALE = 3.0  # residuals in units of the image noise below which no other hypothesis needs a look
_FEW_OF_MEDIAN = 0.3  # of the points that the middle one of the heads has on the wheel
_ROUNDS = 6  # of choosing points and fitting, where the first choice was bad
_WORST_RMS = 0.5  # mm; a sidewall that leaves more is not a body of revolution
_LEAST_SHARE = 0.05  # of a head's points; most may lie on rim and obstacles
_LEAST_OF_ALL = 0.15  # of the points of all heads; fewer meet on some surface by chance
# A head whose patch of the tyre would fit better elsewhere, by so many millimetres RMS, moved: more than the
# skin of a tyre explains, more than the noise of the head's points does, which five movements fit a little,
# and more than the errors of the calibration do: three stated deviations, or a hundredth of a millimetre
# where it states none.
_LEAST_MISFIT, _UNSTATED_MISFIT, _DEVIATIONS, _MOVEMENTS = 0.003, 0.01, 3.0, 5
_FULL_SCALE_SHARE = 0.75  # of a head's lines; something bright before a part of them does not spoil the rest
_FARTHEST_AXIS = 60.0  # mm
_FEWEST_HEADS = 2


@dataclass(frozen=True, eq=False)
class _Pool:
    """Candidates of all heads in one table; `head` tells whose they are."""

    points: Array
    sigma: Array
    rays: Array
    group: Index
    cluster: Index
    line: Index
    head: Index


@dataclass(frozen=True, eq=False)
class _Surface:
    """A fitted wheel and which candidates it chose."""

    fit: RevolutionFit
    chosen: NDArray[np.bool_]


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
    found_lines = iter(extract_many(every, epipolar_directions(calibration)))
    lines: list[tuple[LightLines, LightLines]] = []
    for pair, head in zip(images, calibration.heads, strict=True):
        left, right = next(found_lines), next(found_lines)
        for image, found, side in ((pair.left, left, "left"), (pair.right, right, "right")):
            if found is None or len(found.points) < settings.minimum_points // 4:
                return _no_light(image, head, side)
            if _full_scale_share(image, found) > _FULL_SCALE_SHARE:
                return Refusal(
                    RefusalCode.HEAD_SATURATED,
                    f"{head.name} {side}: most of the light lines are at full scale; shorten the exposure "
                    "or shield the station from the sun",
                    head.name,
                )
        assert left is not None
        assert right is not None
        lines.append((left, right))
    matched = match_heads(lines, calibration.heads, settings.depth_range_mm)
    for candidates, head in zip(matched, calibration.heads, strict=True):
        if len(candidates.points) < settings.minimum_points:
            return _no_match(candidates, head, settings)
    pool = _pool(matched)
    slope_limit = float(np.tan(settings.maximum_angle)) + 0.05
    hypotheses = plane_hypotheses(pool.points, pool.group, settings.depth_range_mm, slope_limit)
    surface = _best_surface(pool, hypotheses)
    if isinstance(surface, Refusal):
        return surface
    return _evaluate(pool, matched, surface, calibration, settings)


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
    return level_share(image, lines.points, 255 if image.dtype == np.uint8 else -1)


def _pool(matched: list[Candidates]) -> _Pool:
    groups, lines, stretches, heads = [], [], [], []
    next_group = next_line = 0
    for k, c in enumerate(matched):
        groups.append(c.left_point + next_group)
        # Candidates stand in the order of lines and points: another stretch begins where either changes.
        lines.append(c.left_line + next_line)
        stretches.append(lines[-1] * 65536 + c.left_point // _STRETCH)
        heads.append(np.full(len(c.points), k))
        next_group += int(c.left_point.max()) + 1
        next_line += int(c.left_line.max()) + 1
    stretch = np.concatenate(stretches)
    return _Pool(
        points=np.concatenate([c.points for c in matched]),
        sigma=np.concatenate([c.sigma for c in matched]),
        rays=np.concatenate([c.rays for c in matched]),
        group=np.concatenate(groups),
        cluster=np.concatenate([[0], np.cumsum(stretch[1:] != stretch[:-1])]),
        line=np.concatenate(lines),
        head=np.concatenate(heads),
    )


def _best_surface(pool: _Pool, hypotheses: list[PlaneHypothesis]) -> _Surface | Refusal:
    """Fit the hypotheses in turn; the one with the least residuals in units of the noise is the wheel."""
    best: _Surface | None = None
    for hypothesis in hypotheses:
        try:
            surface = _fit_hypothesis(pool, hypothesis)
        except DegenerateInputError:
            continue
        if best is None or surface.fit.scale < best.fit.scale:
            best = surface
        if best.fit.scale < _GOOD_SCALE:
            break
    if best is not None and (best.fit.scale >= _GOOD_SCALE or _one_head_is_off(pool, best)):
        best = _without_intruder(pool, best)
    if best is None:
        return Refusal(
            RefusalCode.NOT_A_WHEEL,
            "the points of the heads do not lie around one axis; check that the wheel stands in the "
            "measuring volume and that nothing else is in view",
        )
    return best


def _fit_hypothesis(pool: _Pool, hypothesis: PlaneHypothesis) -> _Surface:
    c = hypothesis.coefficients
    heights = pool.points[:, 2] - (c[0] + c[1] * pool.points[:, 0] + c[2] * pool.points[:, 1])
    chosen = nearest_candidates(heights, pool.group, _PLANE_GATE)
    fit = _fit(pool, chosen, np.array([-c[1], -c[2], 1.0]), np.array([0.0, 0.0, c[0]]))
    # Near the plane's gate a neighbour may have been nearer to it than the true partner: choose again.
    heights = np.nan_to_num(fit.height(pool.points), nan=np.inf)
    again = nearest_candidates(heights, pool.group, _SURFACE_GATE)
    if np.count_nonzero(again & ~chosen) > 0.01 * np.count_nonzero(chosen):
        fit, chosen = _fit(pool, again, fit.normal, fit.centre), again
    return _Surface(fit, chosen)


def _one_head_is_off(pool: _Pool, surface: _Surface) -> bool:
    """Tell whether the wheel was fitted to hardly any points of one head: it may look at something else."""
    counts = np.bincount(
        pool.head[surface.chosen][surface.fit.weights > 0], minlength=int(pool.head.max()) + 1
    )
    return bool(counts.min() < _FEW_OF_MEDIAN * np.median(counts))


def _without_intruder(pool: _Pool, surface: _Surface) -> _Surface:
    """Start again from all heads but one: something before that head may have spoilt the fit."""
    best, most = surface, 0
    if surface.fit.scale < _GOOD_SCALE:
        most = int(np.count_nonzero(surface.fit.weights))
    for head in range(int(pool.head.max()) + 1):
        chosen = surface.chosen & (pool.head != head)
        try:
            fit = _fit(pool, chosen, surface.fit.normal, surface.fit.centre)
            for _ in range(_ROUNDS):
                heights = np.nan_to_num(fit.height(pool.points), nan=np.inf)
                chosen = nearest_candidates(heights, pool.group, _SURFACE_GATE)
                fit = _fit(pool, chosen, fit.normal, fit.centre)
                if fit.scale < _GOOD_SCALE:
                    break
        except DegenerateInputError:
            continue
        # Of those that fit, the one on which most points lie.
        if fit.scale < _GOOD_SCALE and np.count_nonzero(fit.weights) > most:
            best, most = _Surface(fit, chosen), int(np.count_nonzero(fit.weights))
    return best


def _fit(pool: _Pool, chosen: NDArray[np.bool_], normal: Array, centre: Array) -> RevolutionFit:
    return fit_revolution(
        pool.points[chosen], pool.sigma[chosen], pool.rays[chosen], pool.cluster[chosen], normal, centre,
        line=pool.line[chosen],
    )  # fmt: skip


def _evaluate(
    pool: _Pool,
    matched: list[Candidates],
    surface: _Surface,
    calibration: RigCalibration,
    settings: MeasureSettings,
) -> WheelMeasurement | Refusal:
    fit, head = surface.fit, pool.head[surface.chosen]
    used = fit.weights > 0
    qualities = []
    for k, (candidates, camera_pair) in enumerate(zip(matched, calibration.heads, strict=True)):
        mine = used & (head == k)
        count = int(mine.sum())
        if count < max(settings.minimum_points, _LEAST_SHARE * candidates.offered):
            return Refusal(
                RefusalCode.TOO_FEW_POINTS,
                f"{camera_pair.name}: {count} of {candidates.offered} line points lie on the wheel, at least "
                f"{settings.minimum_points} and {_LEAST_SHARE:.0%} of them are needed; check for dirt, an "
                "obstacle, or a head that moved since its calibration",
                camera_pair.name,
            )
        qualities.append(
            HeadQuality(camera_pair.name, count, candidates.offered, _rms(fit.residuals, fit.weights, mine))
        )
    share = sum(quality.points for quality in qualities) / sum(
        quality.points_offered for quality in qualities
    )
    if share < _LEAST_OF_ALL:
        return Refusal(
            RefusalCode.NOT_A_WHEEL,
            f"only {share:.0%} of the line points lie on one surface of revolution, at least "
            f"{_LEAST_OF_ALL:.0%} do on a wheel; check that left and right images are not swapped, and that "
            "the calibration is the rig's",
        )
    rms = _rms(fit.residuals, fit.weights, used)
    if rms > _WORST_RMS:
        return Refusal(
            RefusalCode.NOT_A_WHEEL,
            f"the points leave a surface of revolution by {rms:.2f} mm RMS, at most {_WORST_RMS} is a wheel; "
            "check the calibration and what stands in front of the heads",
        )
    misfits = head_misfits(pool.points[surface.chosen], head, len(matched), fit)
    counts = np.array([quality.points for quality in qualities])
    limits = _worst_misfit(calibration) + _DEVIATIONS * rms * np.sqrt(_MOVEMENTS / counts)
    worst = int((misfits - limits).argmax())
    if misfits[worst] > limits[worst]:
        name = calibration.heads[worst].name
        return Refusal(
            RefusalCode.HEAD_MOVED,
            f"{name} does not fit the other heads: a movement of the whole head explains "
            f"{1e3 * misfits[worst]:.0f} µm of its residuals, noise at most {1e3 * limits[worst]:.0f} µm; "
            "check that it has not been knocked, and calibrate again",
            name,
        )
    points, weights = pool.points[surface.chosen][used], fit.weights[used]
    normal, covariance, tilt_axes = fit.normal, fit.covariance, fit.tilt_axes
    if settings.method == "plane":
        plane = fit_plane(points, pool.cluster[surface.chosen][used], fit.normal)
        normal, covariance, tilt_axes = plane.normal, plane.covariance, plane.tilt_axes
        rms = _rms(plane.residuals, plane.weights, plane.weights > 0)
    elif settings.method == "ridges":
        try:
            plane = fit_ridges(
                pool.points[surface.chosen], head, pool.line[surface.chosen], fit, len(matched)
            )
        except DegenerateInputError as error:
            return Refusal(RefusalCode.TOO_FEW_POINTS, f"the light lines show no circular ridge: {error}")
        normal, covariance, tilt_axes = plane.normal, plane.covariance, plane.tilt_axes
        rms = _rms(plane.residuals, plane.weights, plane.weights > 0)
    above = np.einsum("ij,j->i", points - fit.centre, normal)
    height = float((weights * above).sum() / weights.sum())
    centre = fit.centre + height * normal
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
    turn = camber_toe_jacobian(in_vehicle, calibration.side) @ rotation @ tilt_axes.T
    noise = turn @ covariance @ turn.T
    return WheelMeasurement(
        camber=camber,
        toe=toe,
        angle_covariance=noise + _from_calibration(calibration),
        normal=normal,
        centre=centre,
        offset_mm=float(centre @ normal),
        points_used=int(used.sum()),
        residual_rms_mm=rms,
        heads=tuple(qualities),
        method=f"tyre_plane/{settings.method}",
        coverage_factor=settings.coverage_factor,
    )


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


def _rms(residuals: Array, weights: Array, mask: NDArray[np.bool_]) -> float:
    """Weighted root mean square over the mask; 0 for none."""
    total = float(weights[mask].sum())
    return float(np.sqrt((weights[mask] * residuals[mask] ** 2).sum() / total)) if total > 0 else 0.0


def _outside(what: str) -> Refusal:
    return Refusal(
        RefusalCode.OUTSIDE_VOLUME,
        f"the wheel is outside the measuring volume: {what}; check its position and the calibration's rig",
    )
