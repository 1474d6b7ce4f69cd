"""The gate: a calibration that is weak, wrong or structured is refused, with what would make it good."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial import ConvexHull, QhullError, cKDTree

from alignment.arrays import Array, Index
from alignment.calibration.adjustment import Adjustment, AdjustmentSettings
from alignment.calibration.diagnosis import diagnose
from alignment.calibration.observations import CalibrationInput, CameraKey
from alignment.calibration.prediction import NominalWheel, predict_angle_uncertainty
from alignment.calibration.scale import scale_in_moves
from alignment.counting import count_of
from alignment.errors import DegenerateInputError
from alignment.units import ARCMIN
from alignment.values import RigCalibration

_NEIGHBOURS = 8
_COVERAGE_FACTOR = 2.0


class CalibrationProblem(enum.StrEnum):
    """Why a calibration is refused."""

    NOT_DETERMINED = "not_determined"
    PLATE_NOT_RECOGNISED = "plate_not_recognised"
    MISSING_VIEW = "missing_view"
    TOO_FEW_VIEWS = "too_few_views"
    TOO_FEW_MARKS = "too_few_marks"
    WRONG_INPUT = "wrong_input"
    SWAPPED_IMAGES = "swapped_images"
    COVERAGE = "coverage"
    VIEWS_TOO_ALIKE = "views_too_alike"
    ILL_CONDITIONED = "ill_conditioned"
    BLURRED = "blurred"
    DARK = "dark"
    NOISY = "noisy"
    STRUCTURED = "structured"
    UNCERTAIN = "uncertain"


@dataclass(frozen=True)
class GateLimits:
    """What a calibration must reach.

    Attributes
    ----------
    views
        Fewest views of the plate.
    marks
        Fewest observations of each camera, over all views.
    image_share
        Least share of each image that lies inside the hull of its marks.
    depth_share
        Least range of the marks' distances from each camera, over their mean distance.
    condition
        Largest condition of the adjustment.
    noise_scale
        Largest noise of a camera over what its marks' covariances state.
    outliers
        Largest share of observations without weight.
    structure
        Largest correlation of neighbouring residuals of a camera.
    blur_px, blur_warned_px
        Largest blur of the marks' edges in any view of a camera, standard deviation in pixels, and that which
        brings a warning. Marks keep their centres under an even blur; light lines and the blur of a lens that
        is out of focus are neither.
    contrast, contrast_warned
        Least contrast of the marks in any view of a camera over the noise of a pixel, and that which brings a
        warning.
    angle_u95
        Largest expanded uncertainty of camber and toe that comes from the calibration, radians.
    wheel
        The tyre for which that holds.
    """

    views: int = 3
    marks: int = 100
    image_share: float = 0.5
    depth_share: float = 0.03
    condition: float = 1e9
    noise_scale: float = 3.0
    outliers: float = 0.05
    structure: float = 0.25
    blur_px: float = 5.0
    blur_warned_px: float = 2.5
    contrast: float = 10.0
    contrast_warned: float = 40.0
    angle_u95: float = 0.06 * ARCMIN
    wheel: NominalWheel = field(default_factory=NominalWheel)


@dataclass(frozen=True)
class CameraFigures:
    """What the gate looked at in one camera; see `GateLimits`.

    `blur_px` and `contrast` are those of its worst view; None where they are not known.
    """

    camera: CameraKey
    views: int
    marks: int
    image_share: float
    depth_share: float
    noise_scale: float
    outliers: float
    structure: float
    blur_px: float | None = None
    contrast: float | None = None

    @property
    def name(self) -> str:
        """Head and side, for messages."""
        return " ".join(self.camera)


@dataclass(frozen=True)
class GateJudgement:
    """The gate's answer; true when accepted.

    Attributes
    ----------
    problem
        None when accepted.
    reason
        A sentence: what is wrong and what to add; for an accepted one, its figures.
    cameras
        What was looked at.
    camber_u95, toe_u95
        Expanded uncertainties from the calibration, radians; None where they were not reached.
    warnings
        Sentences: what is not as it should be, though not wrong enough to refuse.
    """

    problem: CalibrationProblem | None
    reason: str
    cameras: tuple[CameraFigures, ...] = ()
    camber_u95: float | None = None
    toe_u95: float | None = None
    warnings: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        return self.problem is None


def judge_input(data: CalibrationInput, limits: GateLimits | None = None) -> GateJudgement:
    """Judge what can be told before an adjustment: views and marks are there."""
    limits = limits or GateLimits()
    for view in data.views:
        blind = [key for key in data.cameras if not len(_marks_of(view.observations.get(key)))]
        # A plate held by hand may be out of some cameras' sight; on the stage it fills all fields.
        if len(blind) == len(data.cameras) or (blind and view.stage_mm is not None):
            whom = "any camera" if len(blind) == len(data.cameras) else ", ".join(map(" ".join, blind))
            return GateJudgement(
                CalibrationProblem.MISSING_VIEW,
                f"view {view.name} shows no marks to {whom}; take it again, or leave it out of the session",
            )
    if len(data.views) < limits.views:
        return GateJudgement(
            CalibrationProblem.TOO_FEW_VIEWS,
            f"{count_of(len(data.views), 'view')} of the plate, at least {limits.views} are needed; "
            "add views at other heights of the stage",
        )
    for key in data.cameras:
        count = sum(len(_marks_of(view.observations.get(key))) for view in data.views)
        if count < limits.marks:
            return GateJudgement(
                CalibrationProblem.TOO_FEW_MARKS,
                f"{' '.join(key)} saw {count} marks in all views, at least {limits.marks} are needed; "
                "use a plate that fills its field, or add views",
            )
    return GateJudgement(None, "views and marks are there")


def judge_failure(
    data: CalibrationInput, error: DegenerateInputError, settings: AdjustmentSettings | None = None
) -> GateJudgement:
    """Explain an adjustment that could not be made: by a view that contradicts the others, or as it says."""
    finding = diagnose(data, settings or AdjustmentSettings())
    warnings = image_warnings(data)
    if finding is not None:
        return GateJudgement(CalibrationProblem.WRONG_INPUT, finding, warnings=warnings)
    return GateJudgement(CalibrationProblem.NOT_DETERMINED, str(error), warnings=warnings)


def judge_calibration(
    adjustment: Adjustment, calibration: RigCalibration, limits: GateLimits | None = None
) -> GateJudgement:
    """Accept a calibration, or refuse it and say what to add.

    Parameters
    ----------
    adjustment
        How it was found.
    calibration
        What it is, made of the same adjustment.
    limits
        None for the defaults.
    """
    limits = limits or GateLimits()
    figures = camera_figures(adjustment)
    judged = _judged(adjustment, calibration, figures, limits)
    return replace(judged, warnings=image_warnings(adjustment.data, limits))


def _judged(
    adjustment: Adjustment,
    calibration: RigCalibration,
    figures: tuple[CameraFigures, ...],
    limits: GateLimits,
) -> GateJudgement:
    before = judge_input(adjustment.data, limits)
    if not before:
        return GateJudgement(before.problem, before.reason, figures)
    found = (
        _wrong(adjustment, calibration, figures, limits)
        or _unclear(adjustment.data, limits)
        or _weak(adjustment, figures, limits)
    )
    if found is not None:
        return GateJudgement(*found, figures)
    try:
        u = predict_angle_uncertainty(calibration, limits.wheel)
    except DegenerateInputError as error:
        return GateJudgement(CalibrationProblem.COVERAGE, str(error), figures)
    camber, toe = (_COVERAGE_FACTOR * value for value in u)
    worst = max(camber, toe)
    if worst > limits.angle_u95:
        return GateJudgement(
            CalibrationProblem.UNCERTAIN,
            f"the calibration alone would make camber uncertain by ±{camber / ARCMIN:.3f}′ and toe by "
            f"±{toe / ARCMIN:.3f}′ (95 %), allowed is ±{limits.angle_u95 / ARCMIN:.3f}′; add views, farther "
            "apart in height and shifted by half a pitch, or use a certified plate",
            figures,
            camber,
            toe,
        )
    return GateJudgement(
        None,
        f"camber ±{camber / ARCMIN:.3f}′, toe ±{toe / ARCMIN:.3f}′ (95 %) from the calibration; residuals "
        f"{adjustment.rms_px:.3f} px RMS",
        figures,
        camber,
        toe,
    )


def camera_figures(adjustment: Adjustment) -> tuple[CameraFigures, ...]:
    """What the gate looks at, camera by camera."""
    out = []
    data = adjustment.data
    for k, key in enumerate(data.cameras):
        mine = np.flatnonzero(adjustment.camera == k)
        out.append(
            CameraFigures(
                camera=key,
                views=len(np.unique(adjustment.view[mine])),
                marks=len(mine),
                image_share=image_share(adjustment.pixels[mine], data.sizes[key]),
                depth_share=_depth_share(adjustment, key, mine),
                noise_scale=adjustment.noise_scale[key],
                outliers=float((adjustment.weights[mine] < 0.5).mean()),
                structure=_structure(adjustment, mine),
                blur_px=worst_blur(data, key)[0],
                contrast=worst_contrast(data, key)[0],
            )
        )
    return tuple(out)


def worst_blur(data: CalibrationInput, key: CameraKey) -> tuple[float | None, str]:
    """Blur of the marks' edges in the least sharp view of a camera, pixels, and that view's name."""
    known = [
        (seen.blur_px, view.name)
        for view in data.views
        if (seen := view.observations.get(key)) is not None and seen.blur_px is not None
    ]
    return max(known, default=(None, ""))


def worst_contrast(data: CalibrationInput, key: CameraKey) -> tuple[float | None, str]:
    """Contrast of the marks over the noise in the darkest view of a camera, and that view's name."""
    known = [
        (seen.contrast, view.name)
        for view in data.views
        if (seen := view.observations.get(key)) is not None and seen.contrast is not None
    ]
    return min(known, default=(None, ""))


def image_warnings(data: CalibrationInput, limits: GateLimits | None = None) -> tuple[str, ...]:
    """Sentences about cameras whose images of the plate are blurred or dark, though they can be used."""
    limits = limits or GateLimits()
    out = []
    for key in data.cameras:
        name = " ".join(key)
        (blur, unsharp), (contrast, darkest) = worst_blur(data, key), worst_contrast(data, key)
        if blur is not None and blur > limits.blur_warned_px:
            out.append(
                f"{name}: the marks' edges are blurred over {blur:.1f} px in view {unsharp}, up to "
                f"{limits.blur_warned_px:g} px is sharp; focus the camera, hold the plate still and "
                "calibrate again"
            )
        if contrast is not None and contrast < limits.contrast_warned:
            out.append(
                f"{name}: the marks stand out by only {contrast:.0f} times the noise in view {darkest}, at "
                f"least {limits.contrast_warned:g} times is good; add light, or lengthen the exposure"
            )
    return tuple(out)


def _unclear(data: CalibrationInput, limits: GateLimits) -> tuple[CalibrationProblem, str] | None:
    """Images too blurred or too dark to be believed."""
    for key in data.cameras:
        name = " ".join(key)
        (blur, unsharp), (contrast, darkest) = worst_blur(data, key), worst_contrast(data, key)
        if blur is not None and blur > limits.blur_px:
            return (
                CalibrationProblem.BLURRED,
                f"{name}: the marks' edges are blurred over {blur:.1f} px in view {unsharp}, allowed are "
                f"{limits.blur_px:g} px; focus the camera, or hold the plate still",
            )
        if contrast is not None and contrast < limits.contrast:
            return (
                CalibrationProblem.DARK,
                f"{name}: the marks stand out by only {contrast:.1f} times the noise in view {darkest}, at "
                f"least {limits.contrast:g} times are needed; add light, or lengthen the exposure",
            )
    return None


def _marks_of(seen: object) -> Index:
    marks: Index = getattr(seen, "marks", np.zeros(0, np.int64))
    return marks


def _wrong(
    adjustment: Adjustment,
    calibration: RigCalibration,
    figures: tuple[CameraFigures, ...],
    limits: GateLimits,
) -> tuple[CalibrationProblem, str] | None:
    """Input that contradicts itself."""
    for head in calibration.heads:
        left, right = (camera.rig_from_camera for camera in head.cameras)
        if left.inverse().apply(right.translation[None])[0, 0] < 0:
            return (
                CalibrationProblem.SWAPPED_IMAGES,
                f"{head.name}: the camera called left stands on the right of the other; its left and right "
                "images are swapped",
            )
    bad = [f for f in figures if f.outliers > limits.outliers or f.noise_scale > limits.noise_scale]
    # A wrong pitch fits: it shows in how far the stage's moves would be off, all by the same share.
    if not bad and scale_in_moves(adjustment) is None:
        return None
    finding = diagnose(adjustment.data, AdjustmentSettings(adjustment.model), adjustment)
    if finding is not None:
        return CalibrationProblem.WRONG_INPUT, finding
    if not bad:
        return None
    worst = max(bad, key=lambda f: (f.outliers > limits.outliers, f.noise_scale))
    if worst.outliers > limits.outliers:
        return (
            CalibrationProblem.NOISY,
            f"{worst.name}: {100 * worst.outliers:.0f} % of its marks do not fit, allowed are "
            f"{100 * limits.outliers:.0f} %; check that the plate is the described one, clean, and did not "
            "move while the cameras exposed",
        )
    return (
        CalibrationProblem.NOISY,
        f"{worst.name}: residuals are {worst.noise_scale:.1f} times the noise of its marks, allowed is "
        f"{limits.noise_scale:.1f} times; check focus, light, and the plate's and stage's stated tolerances",
    )


def _weak(
    adjustment: Adjustment, figures: tuple[CameraFigures, ...], limits: GateLimits
) -> tuple[CalibrationProblem, str] | None:
    """Input that is not enough."""
    for f in figures:
        if f.image_share < limits.image_share:
            return (
                CalibrationProblem.COVERAGE,
                f"{f.name}: the marks cover {100 * f.image_share:.0f} % of its image, at least "
                f"{100 * limits.image_share:.0f} % are needed; use a plate that fills its field, or add "
                "views with the plate shifted",
            )
        if f.depth_share < limits.depth_share:
            return (
                CalibrationProblem.VIEWS_TOO_ALIKE,
                f"{f.name}: all marks lie within {100 * f.depth_share:.1f} % of their distance, at least "
                f"{100 * limits.depth_share:.1f} % are needed; add views at other heights, or tilted ones",
            )
    structured = max(figures, key=lambda f: f.structure)
    if structured.structure > limits.structure:
        return (
            CalibrationProblem.STRUCTURED,
            f"{structured.name}: neighbouring residuals agree (correlation {structured.structure:.2f}, "
            f"allowed {limits.structure:.2f}), which noise does not; choose a lens model with more terms "
            f"than {adjustment.model}, and check that the plate is flat",
        )
    if adjustment.condition > limits.condition:
        return (
            CalibrationProblem.ILL_CONDITIONED,
            f"with the lens model {adjustment.model} the views do not separate its terms (condition "
            f"{adjustment.condition:.0e}, allowed {limits.condition:.0e}); choose a simpler model, or add "
            "views",
        )
    return None


def image_share(pixels: Array, size: tuple[int, int]) -> float:
    """Share of an image (width, height) inside the hull of places (N, 2); 0 where they have none."""
    try:
        return float(ConvexHull(pixels).volume) / (size[0] * size[1])
    except (QhullError, ValueError):
        return 0.0


def _depth_share(adjustment: Adjustment, key: CameraKey, mine: Index) -> float:
    """Range of the distances of the marks of all views along the camera's axis, over their mean."""
    camera_from_rig = adjustment.cameras[key].rig_from_camera.inverse()
    depths = []
    for v in np.unique(adjustment.view[mine]):
        rows = adjustment.mark[mine[adjustment.view[mine] == v]]
        points = adjustment.rig_from_plate[v].apply(adjustment.data.plate.points[rows])
        depths.append(camera_from_rig.apply(points)[:, 2])
    depth = np.concatenate(depths)
    return float((np.percentile(depth, 95) - np.percentile(depth, 5)) / depth.mean())


def _structure(adjustment: Adjustment, mine: Index) -> float:
    """Correlation of each residual with that of the nearest other mark in the image, whatever the view."""
    rows = mine[adjustment.weights[mine] > 0]
    if len(rows) <= _NEIGHBOURS:
        return 0.0
    residuals, marks = adjustment.residuals[rows], adjustment.mark[rows]
    _, near = cKDTree(adjustment.pixels[rows]).query(adjustment.pixels[rows], k=_NEIGHBOURS)
    # The same mark in another view shares its own error.
    other = marks[near] != marks[:, None]
    found = other.any(axis=1)
    partner = np.take_along_axis(near, other.argmax(axis=1)[:, None], axis=1)[:, 0]
    squares = np.square(residuals[found]).sum()
    return float((residuals[found] * residuals[partner[found]]).sum() / squares) if squares > 0 else 0.0
