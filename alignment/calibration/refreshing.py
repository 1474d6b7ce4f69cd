"""Recalibration in use: which camera moved, from shots of ordinary wheels, and where it looks now.

Two things tell. Corresponding crosses lie on one row of the rectified head, and the points of all heads lie
on one surface of revolution. When a camera was knocked or refocused both fail. Of all cameras the one is held
to have changed whose movement explains that best; its pose alone (and its focal length when asked) is
estimated anew, everything else is held, and all uncertainties are carried along (the consider estimate of
Schmidt 1966).

As the other cameras are held with their errors, the pose is not the most likely one but the one that makes
the angles right: an update of all parameters (Kalman's) says how camber, toe, rows and surfaces should
change, and the moved camera's pose is chosen to change them so.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.stats import chi2

from alignment.arrays import Array
from alignment.calibration.crosses import CrossPairs, SeenWheel, cross_pairs, joined, seen_wheel
from alignment.calibration.observations import CameraKey
from alignment.calibration.prediction import angle_sensitivity
from alignment.calibration.row_equations import (
    Equations,
    as_noisy_as_they_are,
    camera_rows,
    joined_equations,
    robust_rms,
    row_differences,
    row_equations,
    stepped,
    with_camera,
)
from alignment.calibration.suspicion import (
    FEWEST_WHEELS,
    Explanation,
    contradiction_limit,
    explanations,
    is_whole_head,
)
from alignment.calibration.wheel_equations import WheelBase, wheel_base, wheel_equations
from alignment.errors import DegenerateInputError
from alignment.values import MeasureSettings, RigCalibration, StereoImages

_ROW_ROUNDS, _MOST_ROUNDS = 2, 6
_CLEAR_EVIDENCE = 20.0  # difference of −2 log evidence that decides
_CLEAR_CAMERA = 10.0  # the same, by which one camera explains more than its whole head
_FALSE_ALARM = 1e-4  # of heads that have not changed
_WORTH_A_LOOK = 0.25  # of the best explanation's gain; heads whose own explain less did not move
_ANGLE_SIGMA = 6e-7  # radians, 0.002′; how much more the angles count than single equations


@dataclass(frozen=True)
class Movement:
    """How far a camera may have moved: standard deviations.

    Attributes
    ----------
    rotation
        Radians, about each of its axes.
    shift_mm
        Of its centre, each coordinate.
    focal
        Relative, of its focal lengths together; 0 leaves them as they are.
    """

    rotation: float = 5e-3
    shift_mm: float = 0.1
    focal: float = 0.0

    @property
    def covariance(self) -> Array:
        """(6, 6), or (7, 7) with the focal length."""
        variances = [self.rotation**2] * 3 + [self.shift_mm**2] * 3
        return np.diag(variances + ([self.focal**2] if self.focal > 0 else []))


@dataclass(frozen=True, eq=False)
class Sightings:
    """What several shots of ordinary wheels show.

    Attributes
    ----------
    pairs
        Crosses seen by both cameras, of all shots together, one `CrossPairs` per head.
    wheels
        Light lines of each shot; none leaves it to the rows.
    settings
        Of the measurement.
    """

    pairs: tuple[CrossPairs, ...]
    wheels: tuple[SeenWheel, ...] = ()
    settings: MeasureSettings = field(default_factory=MeasureSettings)


@dataclass(frozen=True, eq=False)
class HeadState:
    """How well the rows of one head agree.

    Attributes
    ----------
    name
        Of the head.
    pairs
        Crosses seen by both cameras.
    row_rms_px
        RMS of their row differences, pixels.
    excess
        Squared size of the systematic part in standard deviations of crosses and calibration.
    limit
        What `excess` exceeds once in ten thousand heads that have not changed.
    """

    name: str
    pairs: int
    row_rms_px: float
    excess: float
    limit: float

    @property
    def changed(self) -> bool:
        """Whether one of its cameras changed."""
        return self.excess > self.limit


@dataclass(frozen=True, eq=False)
class Moved:
    """A camera and how it moved.

    Attributes
    ----------
    camera
        Head and side.
    step
        (6,) rotation about its axes, radians, and shift of its centre, rig frame, millimetres.
    focal_change
        Relative change of its focal length.
    share
        Probability that it was this camera, of those that come into question.
    """

    camera: CameraKey
    step: Array
    focal_change: float
    share: float


@dataclass(frozen=True, eq=False)
class Refreshed:
    """What a recalibration in use found.

    Attributes
    ----------
    heads
        How every head's rows agreed before.
    moved
        The camera that changed; None when none did.
    other
        Another one that explains the shots nearly as well; None when it is certain.
    angle_difference
        (2,) by how much camber and toe would differ, radians, had it been the other one.
    row_rms_px
        RMS of the row differences of its head, pixels, afterwards.
    wheels
        Shots whose surfaces counted.
    calibration
        With the new pose and the joint covariance, which knows of the other possibility; the given one when
        nothing changed.
    contradiction
        How much the best movement explains of what surfaces and rows show, in units of what a rig that has
        not changed stays below; above 1 something moved. None where rows told already, or where fewer than
        three wheels leave nothing to judge by.
    unseen
        (2,) camber and toe, radians, one standard deviation, by which a camera or a head that moved may turn
        a wheel without showing in these shots; None where `contradiction` is.
    angle_change
        (2,) by how much camber and toe of a wheel become other ones, radians, to first order.
    """

    heads: tuple[HeadState, ...]
    moved: Moved | None
    other: Moved | None
    angle_difference: Array
    row_rms_px: float
    wheels: int
    calibration: RigCalibration
    contradiction: float | None = None
    angle_change: Array = field(default_factory=lambda: np.zeros(2))
    unseen: Array | None = None

    @property
    def certain(self) -> bool:
        """Whether the shots tell which camera it was."""
        return self.other is None


@dataclass(frozen=True, eq=False)
class Estimate:
    """One camera's movement as the shots show it.

    Attributes
    ----------
    camera
        Head and side.
    step
        (6 or 7,) movement, and relative change of the focal length.
    calibration
        With it, and with the joint covariance.
    evidence
        −2 log evidence of the hypothesis that it was this camera.
    row_rms_px
        RMS of the row differences of its head, pixels.
    wheels
        Shots whose surfaces counted.
    """

    camera: CameraKey
    step: Array
    calibration: RigCalibration
    evidence: float
    row_rms_px: float
    wheels: int


def refresh(
    shots: Sequence[Sequence[StereoImages]],
    calibration: RigCalibration,
    settings: MeasureSettings,
    movement: Movement | None = None,
) -> Refreshed:
    """Find the camera that changed since its calibration and estimate its pose anew.

    Parameters
    ----------
    shots
        Images of ordinary wheels, each one pair per head; ten of different wheels tell most of it.
    calibration
        As in force, with its covariance.
    settings
        Of the measurement.
    movement
        How far a camera may have moved; None for the defaults.

    Raises
    ------
    DegenerateInputError
        When the calibration has no covariance, or a head shows too few crosses; when cameras of two heads
        changed, or a whole head may have: then a plate is needed.
    """
    return refresh_from(gather(shots, calibration, settings), calibration, movement)


def gather(
    shots: Sequence[Sequence[StereoImages]], calibration: RigCalibration, settings: MeasureSettings
) -> Sightings:
    """Find light lines and pairs of crosses in all shots."""
    wheels = tuple(seen_wheel(images) for images in shots)
    every = [cross_pairs(wheel, calibration, settings) for wheel in wheels]
    pairs = tuple(joined([of_shot[k] for of_shot in every]) for k in range(len(calibration.heads)))
    return Sightings(pairs, wheels, settings)


def refresh_from(
    sightings: Sightings, calibration: RigCalibration, movement: Movement | None = None
) -> Refreshed:
    """As `refresh`, from what was seen already."""
    heads = tuple(_state(calibration, k, pairs) for k, pairs in enumerate(sightings.pairs))
    suspects = [k for k, state in enumerate(heads) if state.changed]
    if len(suspects) > 1:
        raise DegenerateInputError(
            field="shots",
            expected="one camera that changed",
            seen=f"changes in {', '.join(heads[k].name for k in suspects)}",
            cure="Calibrate the rig with the plate.",
        )
    surfaces = {
        k: _surfaces(sightings, calibration, k)
        for k in suspects or range(len(heads) if sightings.wheels else 0)
    }
    contradiction, unseen = None, None
    if not suspects and min(map(len, surfaces.values()), default=0) >= FEWEST_WHEELS:
        # A turn that shifts the image along the rows alone: any head may be the one.
        contradiction, unseen, suspects = _suspects(sightings, calibration, surfaces, movement or Movement())
    if not suspects:
        worst = max(state.row_rms_px for state in heads)
        unchanged = Refreshed(heads, None, None, np.zeros(2), worst, 0, calibration, contradiction)
        return replace(unchanged, unseen=unseen)
    found = [
        estimate(sightings, calibration, (heads[k].name, side), movement, surfaces[k])
        for k in suspects
        for side in ("left", "right")
    ]
    found.sort(key=lambda each: each.evidence)
    best, second = found[0], found[1]
    behind = second.evidence - best.evidence
    share = 1.0 / (1.0 + math.exp(-0.5 * min(behind, 200.0)))
    nominal = angle_sensitivity(calibration)
    change = nominal @ _parameters(calibration, best)
    if behind > _CLEAR_EVIDENCE:
        return Refreshed(
            heads,
            _as_moved(best, 1.0),
            None,
            np.zeros(2),
            best.row_rms_px,
            best.wheels,
            best.calibration,
            contradiction,
            change,
        )
    difference = _parameters(calibration, second) - _parameters(calibration, best)
    covariances = [each.calibration.covariance for each in (best, second)]
    assert covariances[0] is not None
    assert covariances[1] is not None
    # Of the two possibilities together, about the one that is believed.
    mixed = share * covariances[0] + (1.0 - share) * (covariances[1] + np.outer(difference, difference))
    return Refreshed(
        heads=heads,
        moved=_as_moved(best, share),
        other=_as_moved(second, 1.0 - share),
        angle_difference=nominal @ difference,
        row_rms_px=best.row_rms_px,
        wheels=best.wheels,
        calibration=replace(best.calibration, covariance=mixed),
        contradiction=contradiction,
        angle_change=change,
    )


def _suspects(
    sightings: Sightings,
    calibration: RigCalibration,
    surfaces: dict[int, list[WheelBase]],
    movement: Movement,
) -> tuple[float, Array, list[int]]:
    """How clearly rows and surfaces contradict the calibration, what stays unseen, and the suspected heads.

    Raises
    ------
    DegenerateInputError
        When a head may have moved as a whole.
    """
    _covariance(calibration)
    found: list[Explanation] = []
    for k, bases in surfaces.items():
        equations = joined_equations(
            [row_equations(calibration, k, sightings.pairs[k]), wheel_equations(bases, calibration)]
        )
        found += explanations(calibration, k, equations, movement.covariance[:6, :6])
    best = max(found, key=lambda each: each.gain)
    contradiction = best.gain / contradiction_limit(min(map(len, surfaces.values())))
    unseen = np.max([each.unseen for each in found], axis=0)
    if contradiction <= 1.0:
        return contradiction, unseen, []
    if is_whole_head(found, len(equations.values), _CLEAR_CAMERA):
        name = calibration.heads[best.head].name
        raise DegenerateInputError(
            field="shots",
            expected="one camera that changed",
            seen=f"surfaces that contradict the calibration, as if both cameras of {name} moved together",
            cure="Calibrate the rig with the plate; until then its angles may be off.",
        )
    return (
        contradiction,
        unseen,
        sorted({each.head for each in found if each.gain >= _WORTH_A_LOOK * best.gain}),
    )


def estimate(
    sightings: Sightings,
    calibration: RigCalibration,
    camera: CameraKey,
    movement: Movement | None = None,
    surfaces: Sequence[WheelBase] | None = None,
) -> Estimate:
    """Estimate the pose of one camera anew, the others held.

    Parameters
    ----------
    sightings
        What was seen.
    calibration
        As in force, with its covariance.
    camera
        Which one.
    movement
        How far it may have moved; None for the defaults.
    surfaces
        The wheels as the other heads see them, where that is known already.

    Raises
    ------
    DegenerateInputError
        When the calibration has no covariance, no such camera, or there are too few crosses.
    """
    movement = movement or Movement()
    names = [head.name for head in calibration.heads]
    if camera[0] not in names:
        raise DegenerateInputError(field="camera", expected=f"a camera of {', '.join(names)}", seen=camera[0])
    joint = _covariance(calibration)
    head, side = names.index(camera[0]), int(camera[1] == "right")
    known = calibration.heads[head].cameras[side]
    rows = camera_rows(calibration)[2 * head + side]
    # Unknowns of the step in terms of all parameters: pose, and both focal lengths together.
    allowed = movement.covariance
    basis = np.zeros((len(joint), len(allowed)))
    basis[range(rows.start, rows.start + 6), range(6)] = 1.0
    if len(allowed) > 6:
        basis[rows.start + 6 : rows.start + 8, 6] = known.model.fx, known.model.fy
    prior = joint + basis @ allowed @ basis.T
    angles = angle_sensitivity(calibration) / _ANGLE_SIGMA
    if surfaces is None:
        surfaces = _surfaces(sightings, calibration, head)

    step, current = np.zeros(len(allowed)), calibration
    for number in range(_MOST_ROUNDS):
        # Lines find their partners along rows that are about right: rows first.
        equations, scale = row_equations(current, head, sightings.pairs[head]), 0.0
        if surfaces and number >= _ROW_ROUNDS:
            shapes = wheel_equations(surfaces, current)
            misfit = shapes.values - shapes.derivatives @ basis @ step
            shapes, scale = as_noisy_as_they_are(shapes, misfit, prior)
            equations = joined_equations([equations, shapes])
        h = equations.derivatives
        # Values as they would be at the old calibration, to first order about the new one.
        values = equations.values - h @ basis @ step
        spread = h @ prior @ h.T + np.eye(len(h))
        kalman = np.linalg.solve(spread, h @ prior).T
        wanted = np.concatenate([angles, h])
        mine = wanted @ basis
        gain = np.linalg.solve(mine.T @ mine + np.linalg.inv(allowed), mine.T @ (wanted @ kalman))
        before, step = step, -gain @ values
        current = with_camera(calibration, head, side, stepped(known, (basis @ step)[rows]))
        if number >= _ROW_ROUNDS and np.abs(angles @ basis @ (step - before)).max() < 1.0:
            break
    keep = np.eye(len(joint)) - basis @ gain @ h
    covariance = keep @ prior @ keep.T + basis @ gain @ gain.T @ basis.T
    evidence = float(values @ np.linalg.solve(spread, values) + np.linalg.slogdet(spread)[1]) + scale
    rest = robust_rms(row_differences(current.heads[head], sightings.pairs[head]))
    refreshed = replace(current, covariance=0.5 * (covariance + covariance.T))
    return Estimate(camera, step, refreshed, evidence, rest, len(surfaces))


def _as_moved(found: Estimate, share: float) -> Moved:
    focal = float(found.step[6]) if len(found.step) > 6 else 0.0
    return Moved(found.camera, found.step[:6], focal, share)


def _parameters(calibration: RigCalibration, found: Estimate) -> Array:
    """(P,) change of all parameters of the rig by a camera's movement."""
    out = np.zeros(len(calibration.parameter_names))
    names = [head.name for head in calibration.heads]
    number = 2 * names.index(found.camera[0]) + int(found.camera[1] == "right")
    first = camera_rows(calibration)[number].start
    out[first : first + 6] = found.step[:6]
    if len(found.step) > 6:
        model = calibration.heads[number // 2].cameras[number % 2].model
        out[first + 6 : first + 8] = found.step[6] * np.array([model.fx, model.fy])
    return out


def _covariance(calibration: RigCalibration) -> Array:
    if calibration.covariance is None:
        raise DegenerateInputError(
            field="covariance",
            expected="a calibration with its covariance",
            seen="none",
            cure="Calibrate the rig with the plate.",
        )
    return calibration.covariance


def _state(calibration: RigCalibration, head: int, pairs: CrossPairs) -> HeadState:
    known = calibration.heads[head]
    excess, limit = _excess(calibration, row_equations(calibration, head, pairs))
    return HeadState(known.name, len(pairs.left), robust_rms(row_differences(known, pairs)), excess, limit)


def _excess(calibration: RigCalibration, equations: Equations) -> tuple[float, float]:
    """Squared size of the values in their standard deviations, the calibration's included; its limit."""
    h = equations.derivatives
    spread = h @ _covariance(calibration) @ h.T + np.eye(len(h))
    excess = float(equations.values @ np.linalg.solve(spread, equations.values))
    return excess, float(chi2.ppf(1.0 - _FALSE_ALARM, len(h)))


def _surfaces(sightings: Sightings, calibration: RigCalibration, head: int) -> list[WheelBase]:
    """The wheels as all heads but one see them."""
    bases = [wheel_base(wheel, calibration, head, sightings.settings) for wheel in sightings.wheels]
    return [base for base in bases if base is not None]
