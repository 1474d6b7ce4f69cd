"""The heart: six images of one exposure and a calibration in, camber and toe of the tyre plane out."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from alignment.arrays import Array
from alignment.calibration.judgement import Judgement, unjudged
from alignment.counting import count_of
from alignment.errors import DegenerateInputError
from alignment.imaging.extraction import LEAST_SHARE, MAX_LINES, MAX_POINTS, level_share
from alignment.imaging.lines import LightLines, extract_many
from alignment.measure_heads import HeadSums, angles_by_normal, told_apart
from alignment.prepared import PreparedRig
from alignment.refusals import head_knocked, no_light, no_match, outside, too_bright, warning
from alignment.stereo.correspondence import Candidates, match_heads
from alignment.stereo.pool import PointPool
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
from alignment.vehicle.angles import camber_toe
from alignment.wheel.load import LoadedWheel
from alignment.wheel.plane import PlaneFit, fit_plane
from alignment.wheel.reference import wheel_reference
from alignment.wheel.ridges import fit_ridges
from alignment.wheel.search import WheelSurface, find_surface

_SOME = 4  # line points of which one tells of the light
_FEW = 16  # and of which one is enough for a median
_FULL_SCALE_SHARE = 0.75  # of a head's lines; something bright before a part of them does not spoil the rest
_WHITE_SHARE = 0.25  # of an image without lines; more light hides them than a lamp in view
_LEAST_FULL_SCALE = 1023  # of a camera whose images have 16 bit
_FARTHEST_AXIS = 60.0  # mm
_FEWEST_HEADS = 2


LoadFound = Callable[[LoadedWheel], None]


def _nothing(_load: LoadedWheel) -> None:
    """Nobody asks for the load."""


def measure_wheel(
    images: Sequence[StereoImages],
    calibration: RigCalibration | PreparedRig,
    settings: MeasureSettings,
    load_found: LoadFound = _nothing,
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
        Cameras and pose of the rig. A plain calibration is prepared anew at each call, which costs 20 ms, and
        40 ms where it states its covariance: as much as the measurement itself, or twice. Who measures more
        than once passes a `PreparedRig` and keeps it.
    settings
        See `MeasureSettings`.
    load_found
        Given the load that was taken off, where there is one: for wheels that are shot several times under
        the same load.

    Returns
    -------
    WheelMeasurement or Refusal
        A refusal says what was wrong and what to do; it is false.

    Raises
    ------
    DegenerateInputError
        When the rig was prepared for another depth range than that of the settings, or a head of a
        calibration with covariance cannot see a wheel.
    """
    rig = PreparedRig.of(calibration, settings)
    wrong = _check_images(images, rig.calibration)
    if wrong is not None:
        return wrong
    result = _measure(images, rig, settings, load_found)
    if isinstance(result, Refusal) and settings.allow_lost_head and len(images) >= _FEWEST_HEADS + 1:
        names = [head.name for head in rig.heads]
        if result.head in names:
            return _without_head(names.index(result.head), images, rig, settings, load_found) or result
    return result


def _without_head(
    lost: int,
    images: Sequence[StereoImages],
    rig: PreparedRig,
    settings: MeasureSettings,
    load_found: LoadFound,
) -> WheelMeasurement | Refusal:
    """Measure with the other heads alone."""
    others = [pair for k, pair in enumerate(images) if k != lost]
    result = _measure(others, rig.without[lost], settings, load_found)
    return replace(result, degraded=True) if isinstance(result, WheelMeasurement) else result


def _measure(
    images: Sequence[StereoImages], rig: PreparedRig, settings: MeasureSettings, load_found: LoadFound
) -> WheelMeasurement | Refusal:
    lines = _lines(images, rig, settings)
    if isinstance(lines, Refusal):
        return lines
    matched = match_heads(lines, rig.geometry, settings.depth_range_mm)
    for candidates, head in zip(matched, rig.heads, strict=True):
        if len(candidates.points) < settings.minimum_points:
            return no_match(candidates, head, settings)
    pool = PointPool.of(matched)
    slope_limit = float(np.tan(settings.maximum_angle)) + 0.05
    hypotheses = plane_hypotheses(pool.points, pool.group, settings.depth_range_mm, slope_limit)
    surface = find_surface(pool, hypotheses, rig.image_axes)
    if surface is None:
        return Refusal(
            RefusalCode.NOT_A_WHEEL,
            "the points of the heads do not lie around one axis; check that the wheel stands in the "
            "measuring volume and that nothing else is in view",
        )
    return _evaluate(lines, matched, pool, surface, rig, settings, load_found)


def _lines(
    images: Sequence[StereoImages], rig: PreparedRig, settings: MeasureSettings
) -> list[tuple[LightLines, LightLines]] | Refusal:
    """Light lines of both images of each head."""
    every = [image for pair in images for image in (pair.left, pair.right)]
    found_lines = iter(extract_many(every, rig.epipolar_directions, rig.shared_views))
    lines: list[tuple[LightLines, LightLines]] = []
    for pair, head in zip(images, rig.heads, strict=True):
        left, right = next(found_lines), next(found_lines)
        for image, found, side in ((pair.left, left, "left"), (pair.right, right, "right")):
            if found is not None and found.crowded:
                return _too_many(head, side)
            if found is None or len(found.points) < settings.minimum_points // 4:
                return too_bright(head, side) if _is_white(image) else no_light(image, head, side)
            if _full_scale_share(image, found) > _FULL_SCALE_SHARE:
                return too_bright(head, side)
        assert left is not None
        assert right is not None
        lines.append((left, right))
    return lines


def _check_images(images: Sequence[StereoImages], calibration: RigCalibration) -> Refusal | None:
    if len(images) != len(calibration.heads):
        return Refusal(
            RefusalCode.WRONG_IMAGES,
            f"{count_of(len(images), 'image pair')} for a rig of {count_of(len(calibration.heads), 'head')}; "
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


def _too_many(head: HeadCalibration, side: str) -> Refusal:
    return Refusal(
        RefusalCode.TOO_MANY_LINES,
        f"{head.name} {side}: more light lines than can be looked at, at most {MAX_LINES - 1} pieces of "
        f"lines and {MAX_POINTS / LEAST_SHARE:.0f} points; lower the camera's gain, and check that it looks "
        "at a wheel in the projector's light",
        head.name,
    )


def _is_white(image: Image) -> bool:
    """Tell whether so much of an image is at full scale that lines cannot show; 16-bit cameras may end below
    65535, but none below 1023."""
    top = 255 if image.dtype == np.uint8 else max(int(image.max()), _LEAST_FULL_SCALE)
    return float(np.mean(image >= top)) > _WHITE_SHARE


def _full_scale_share(image: Image, lines: LightLines) -> float:
    """Share of line points whose pixel is at the top of the range; 16-bit cameras may end below 65535."""
    return level_share(image, lines.points[::_SOME], 255 if image.dtype == np.uint8 else -1)


def _evaluate(
    lines: Sequence[tuple[LightLines, LightLines]],
    matched: list[Candidates],
    everything: PointPool,
    surface: WheelSurface,
    rig: PreparedRig,
    settings: MeasureSettings,
    load_found: LoadFound,
) -> WheelMeasurement | Refusal:
    """Ask whether the surface is a wheel before intact heads, and take its angles from it."""
    told = told_apart(lines, matched, everything, surface, rig, settings)
    if isinstance(told, Refusal):
        return told
    loaded, signs = told
    judgement = signs.judgement
    surface = surface if loaded is None else loaded.surface
    sums = HeadSums.of(surface, len(matched))
    try:
        normal, covariance, tilt_axes, rms = _plane(surface, sums.rms, len(matched), settings)
    except DegenerateInputError as error:
        return Refusal(RefusalCode.TOO_FEW_POINTS, f"the light lines show no circular ridge: {error}")
    centre = _centre(surface, normal)
    angles = _angles(normal, centre, rig.calibration, settings)
    if isinstance(angles, Refusal):
        return angles
    if judgement.knocked and signs.refusal is None:
        signs = replace(signs, refusal=head_knocked(judgement, rig))
    if signs.refusal is not None:
        if settings.judge_heads:
            return signs.refusal
        judgement = unjudged(len(matched))
    turn = angles_by_normal(normal, rig.calibration) @ tilt_axes.T
    if loaded is not None:
        covariance = covariance + loaded.covariance
        load_found(loaded)
    noise = turn @ covariance @ turn.T
    common = rig.angle_covariance
    reference = None
    if settings.method == "revolution":
        reference = wheel_reference(surface.fit, surface.points.points, rig.calibration, rig.axis_covariance)
    return WheelMeasurement(
        camber=angles[0],
        toe=angles[1],
        angle_covariance=noise + (0.0 if common is None else common) + judgement.covariance,
        normal=normal,
        centre=centre,
        offset_mm=float(centre @ normal),
        points_used=int(np.count_nonzero(surface.fit.weights > 0)),
        residual_rms_mm=rms,
        heads=_qualities(sums, lines, matched, judgement, rig),
        method=f"tyre_plane/{settings.method}",
        coverage_factor=settings.coverage_factor,
        knock_evidence=judgement.evidence,
        warning=warning(judgement, rig) if judgement.suspected else None,
        unseen=_unseen(judgement),
        load_mm=None if loaded is None else loaded.lift_mm,
        reference=reference,
        load_covariance=None if loaded is None else turn @ loaded.covariance @ turn.T,
        signs=None if settings.judge_heads else signs,
    )


def _centre(surface: WheelSurface, normal: Array) -> Array:
    """(3,) where the axis meets the mean height of the points, rig frame, millimetres."""
    fit = surface.fit
    mean = np.einsum("i,ij->j", fit.weights, surface.points.points) / fit.weights.sum()
    out: Array = fit.centre + float((mean - fit.centre) @ normal) * normal
    return out


def _angles(
    normal: Array, centre: Array, calibration: RigCalibration, settings: MeasureSettings
) -> tuple[float, float] | Refusal:
    """Camber and toe of a plane, radians, or why it is none inside the measuring volume."""
    try:
        camber, toe = camber_toe(calibration.vehicle_from_rig.rotation @ normal, calibration.side)
    except DegenerateInputError:
        return outside("its plane does not face the heads")
    if max(abs(camber), abs(toe)) > settings.maximum_angle:
        return outside(
            f"camber {np.degrees(camber):.2f}°, toe {np.degrees(toe):.2f}°, believable are at most "
            f"±{np.degrees(settings.maximum_angle):.1f}°"
        )
    if np.hypot(centre[0], centre[1]) > _FARTHEST_AXIS:
        return outside(f"its axis passes the rig's by ({centre[0]:.0f}, {centre[1]:.0f}) mm")
    return camber, toe


def _plane(
    surface: WheelSurface, rms: float, heads: int, settings: MeasureSettings
) -> tuple[Array, Array, Array, float]:
    """Normal, covariance of its tilts, their axes, and RMS of the residuals, by the chosen method."""
    fit, pool = surface.fit, surface.points
    if settings.method == "revolution":
        return fit.normal, fit.covariance, fit.tilt_axes, rms
    if settings.method == "plane":
        used = fit.weights > 0
        plane = fit_plane(pool.points[used], fit.radii(pool.points[used]), fit.normal)
    else:
        plane = fit_ridges(pool.points, pool.head, pool.line, fit, heads)
    return plane.normal, plane.covariance, plane.tilt_axes, _rms(plane)


def _qualities(
    sums: HeadSums,
    lines: Sequence[tuple[LightLines, LightLines]],
    matched: list[Candidates],
    judgement: Judgement,
    rig: PreparedRig,
) -> tuple[HeadQuality, ...]:
    out = []
    for k, (candidates, head) in enumerate(zip(matched, rig.heads, strict=True)):
        row, sigma = float(judgement.row_px[k]), float(judgement.row_sigma_px[k])
        out.append(
            HeadQuality(
                name=head.name,
                points=int(sums.numbers[k]),
                points_offered=candidates.offered,
                residual_rms_mm=math.sqrt(sums.squares[k] / sums.weights[k])
                if sums.weights[k] > 0.0
                else 0.0,
                row_px=None if math.isnan(row) else row,
                row_sigma_px=None if math.isnan(sigma) else sigma,
                share_looked_at=min(each.share for each in lines[k]) / candidates.every,
                line_width_px=(float(lines[k][0].width), float(lines[k][1].width)),
                line_strength=(_strength(lines[k][0]), _strength(lines[k][1])),
            )
        )
    return tuple(out)


def _strength(lines: LightLines) -> float:
    """Median light of the lines of one image, of some of their points."""
    some = lines.strength[::_FEW]
    middle = len(some) // 2
    # NumPy's median takes five times as long.
    return float(np.partition(some, middle)[middle]) if len(some) else math.nan


def _unseen(judgement: Judgement) -> tuple[float, float] | None:
    if judgement.unseen is None:
        return None
    camber, toe = map(float, judgement.unseen)
    return camber, toe


def _rms(plane: PlaneFit) -> float:
    """Weighted root mean square of a plane's residuals, millimetres."""
    used = plane.weights > 0
    return float(np.sqrt(np.average(np.square(plane.residuals[used]), weights=plane.weights[used])))
