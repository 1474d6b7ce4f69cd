"""Recalibration in use: which camera moved, from the crosses of ordinary wheels, and where it looks now.

Corresponding crosses lie on one row of the rectified head. When a camera was knocked or refocused they leave
it. Of all cameras the one is held to have changed whose movement explains that best; its pose alone (and its
focal length when asked) is estimated anew, everything else is held, and all uncertainties are carried along
(the consider filter of Schmidt 1966). What rows cannot tell, a shift along the baseline above all, stays as
uncertain as the allowed movement, and the covariance says so.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from alignment.calibration.cross_pairs import CrossPairs, cross_pairs, joined
from alignment.calibration.observations import CameraKey
from alignment.errors import DegenerateInputError
from alignment.geometry.cameras import PosedCamera
from alignment.measure import measure_wheel
from alignment.stereo.rectification import Rectification
from alignment.values import HeadCalibration, MeasureSettings, RigCalibration, StereoImages, WheelMeasurement

Array = NDArray[np.float64]

_LEAST_PAIRS = 60
_LEAST_SIGMA_PX = 0.02
_SYSTEMATIC_PX = 0.03  # what crosses of one shot have in common: the projector's lines, gloss
_STEPS = np.array([1e-6] * 3 + [1e-4] * 3)
_ITERATIONS = 4
_CLEAR_EVIDENCE = 10.0  # difference of −2 log evidence that decides
_BETTER_FIT = 0.8  # ratio of the wheels' residuals that tells a head's two cameras apart; near 1 is chance
_TUKEY = 4.685


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
class Refreshed:
    """What a recalibration in use found.

    Attributes
    ----------
    heads
        How every head's rows agreed before.
    camera
        The camera that changed; None when none did.
    certain
        False where the other camera of its head explains the rows as well and the wheels do not tell.
    moved
        (6,) rotation about its axes, radians, and shift of its centre, rig frame, millimetres.
    focal_change
        Relative change of its focal length.
    row_rms_px
        RMS of the row differences of its head, pixels, afterwards.
    calibration
        With the new pose and the joint covariance; the given one when nothing changed.
    """

    heads: tuple[HeadState, ...]
    camera: CameraKey | None
    certain: bool
    moved: Array
    focal_change: float
    row_rms_px: float
    calibration: RigCalibration


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
        Images of ordinary wheels, each one pair per head; ten or more make the rows' curvature visible.
    calibration
        As in force, with its covariance.
    settings
        Of the measurement.
    movement
        How far a camera may have moved; None for the defaults.

    Raises
    ------
    DegenerateInputError
        When the calibration has no covariance, or a head shows too few crosses, or cameras of two heads
        changed: then a plate is needed.
    """
    every = [cross_pairs(images, calibration, settings) for images in shots]
    pairs = [joined([of_shot[k] for of_shot in every]) for k in range(len(calibration.heads))]
    found = refresh_from_pairs(pairs, calibration, movement)
    if found.camera is None or found.certain:
        return found
    other = other_camera(found.camera)
    second = estimate(pairs, calibration, other, movement)
    # The rows alone do not tell left from right; a wheel is round only with the right one.
    here, there = (_wheel_residual(shots, c, settings) for c in (found.calibration, second.calibration))
    if there < _BETTER_FIT * here:
        return replace(second, heads=found.heads, certain=True)
    return replace(found, certain=here < _BETTER_FIT * there)


def refresh_from_pairs(
    pairs: Sequence[CrossPairs], calibration: RigCalibration, movement: Movement | None = None
) -> Refreshed:
    """As `refresh`, from crosses that are paired already, one `CrossPairs` per head.

    `certain` is then False whenever both cameras of the head explain the rows about equally.
    """
    heads = tuple(_state(calibration, k, head_pairs) for k, head_pairs in enumerate(pairs))
    changed = [k for k, state in enumerate(heads) if state.changed]
    if not changed:
        worst = max(state.row_rms_px for state in heads)
        return Refreshed(heads, None, True, np.zeros(6), 0.0, worst, calibration)
    if len(changed) > 1:
        raise DegenerateInputError(
            field="shots",
            expected="one camera that changed",
            seen=f"changes in {', '.join(heads[k].name for k in changed)}",
            cure="Calibrate the rig with the plate.",
        )
    name = heads[changed[0]].name
    both = [
        _consider(calibration, changed[0], side, pairs[changed[0]], movement or Movement())
        for side in range(2)
    ]
    best = int(both[1].evidence < both[0].evidence)
    certain = abs(both[1].evidence - both[0].evidence) > _CLEAR_EVIDENCE
    camera: CameraKey = (name, "left" if best == 0 else "right")
    return replace(estimate(pairs, calibration, camera, movement), heads=heads, certain=certain)


def estimate(
    pairs: Sequence[CrossPairs],
    calibration: RigCalibration,
    camera: CameraKey,
    movement: Movement | None = None,
) -> Refreshed:
    """Estimate the pose of one camera anew from the crosses of its head, the others held.

    Raises
    ------
    DegenerateInputError
        When the calibration has no covariance, no such camera, or there are too few crosses.
    """
    names = [head.name for head in calibration.heads]
    if camera[0] not in names:
        raise DegenerateInputError(field="camera", expected=f"a camera of {', '.join(names)}", seen=camera[0])
    head = names.index(camera[0])
    side = 0 if camera[1] == "left" else 1
    result = _consider(calibration, head, side, pairs[head], movement or Movement())
    residuals = _rows(result.calibration.heads[head], pairs[head])
    return Refreshed(
        heads=(),
        camera=camera,
        certain=True,
        moved=result.step[:6],
        focal_change=float(result.step[6]) if len(result.step) > 6 else 0.0,
        row_rms_px=_robust_rms(residuals),
        calibration=result.calibration,
    )


def other_camera(camera: CameraKey) -> CameraKey:
    """Return the other camera of the same head."""
    return camera[0], "right" if camera[1] == "left" else "left"


@dataclass(frozen=True, eq=False)
class _Considered:
    """The changed camera's step (6 or 7,), the calibration with it, and −2 log evidence of the hypothesis."""

    step: Array
    calibration: RigCalibration
    evidence: float


def _rows(head: HeadCalibration, pairs: CrossPairs) -> Array:
    """(N,) row differences of the pairs in the rectified head, pixels."""
    frame = Rectification.of(head.left, head.right)
    left, _ = frame.coordinates(head.left, pairs.left)
    right, _ = frame.coordinates(head.right, pairs.right)
    out: Array = (left[:, 1] - right[:, 1]) * 0.5 * (head.left.model.fx + head.right.model.fx)
    return out


def _sizes(calibration: RigCalibration) -> list[tuple[int, int]]:
    """Number of parameters of the left and right camera of each head."""
    return [(_size(head.left), _size(head.right)) for head in calibration.heads]


def _size(camera: PosedCamera) -> int:
    return 6 + len(camera.model.parameters)


def _moved(camera: PosedCamera, step: Array) -> PosedCamera:
    """Camera after a step of all its parameters."""
    return PosedCamera(
        camera.model.with_parameters(camera.model.parameters + step[6:]),
        camera.rig_from_camera.perturbed(step[:3], step[3:6]),
    )


def _jacobian(head: HeadCalibration, pairs: CrossPairs) -> Array:
    """(N, P) derivatives of the row differences by all parameters of the head, by central differences."""
    columns = []
    for side, camera in enumerate(head.cameras):
        steps = np.concatenate([_STEPS, 1e-6 * np.maximum(1.0, np.abs(camera.model.parameters))])
        for k, size in enumerate(steps):
            step = np.zeros(len(steps))
            step[k] = size
            ahead, behind = (
                _rows(_with(head, side, _moved(camera, sign * step)), pairs) for sign in (1.0, -1.0)
            )
            columns.append((ahead - behind) / (2.0 * size))
    return np.column_stack(columns)


def _with(head: HeadCalibration, side: int, camera: PosedCamera) -> HeadCalibration:
    return replace(head, left=camera) if side == 0 else replace(head, right=camera)


@dataclass(frozen=True, eq=False)
class _Compressed:
    """Row differences as equations with unit noise: values (R,) and derivatives (R, P)."""

    values: Array
    derivatives: Array


def _compressed(head: HeadCalibration, pairs: CrossPairs) -> _Compressed:
    """Bring the rows of thousands of pairs to as many equations as there are parameters.

    Raises
    ------
    DegenerateInputError
        When there are too few pairs.
    """
    if len(pairs.left) < _LEAST_PAIRS:
        raise DegenerateInputError(
            field=head.name,
            expected=f"at least {_LEAST_PAIRS} crosses of light lines that both cameras see",
            seen=str(len(pairs.left)),
            cure="Take more shots of ordinary wheels.",
        )
    values = _rows(head, pairs)
    derivatives = _jacobian(head, pairs)
    # What a changed camera does to the rows is smooth over the image; the rest is noise and wrong pairs.
    uv = (pairs.left - pairs.left.mean(axis=0)) / pairs.left.std(axis=0)
    smooth = np.column_stack([np.ones(len(uv)), uv, uv[:, 0] * uv[:, 1], uv**2])
    weight = np.ones(len(uv))
    for _ in range(10):
        weighted = smooth * weight[:, None]
        fit = np.linalg.solve(_products(weighted, smooth), np.einsum("na,n->a", weighted, values))
        rest = values - smooth @ fit
        sigma = max(1.4826 * float(np.median(np.abs(rest))), _LEAST_SIGMA_PX)
        weight = np.clip(1.0 - (rest / (_TUKEY * sigma)) ** 2, 0.0, None)
    # Crosses of one shot share errors, so the noise does not average down for ever.
    effective = float(weight.sum())
    sigma = math.sqrt(sigma**2 + effective * _SYSTEMATIC_PX**2 / 4.0) if effective > 0 else sigma
    whitened = np.column_stack([derivatives, values]) * (np.sqrt(weight) / sigma)[:, None]
    length = np.maximum(np.linalg.norm(whitened, axis=0), 1e-300)
    products = _products(whitened / length, whitened / length)
    # Of the derivatives' products the eigenvectors are the equations; the tiniest are rounding.
    squares, vectors = np.linalg.eigh(products[:-1, :-1])
    real = squares > 1e-12 * squares[-1]
    root, vectors = np.sqrt(squares[real]), vectors[:, real]
    return _Compressed(
        vectors.T @ products[:-1, -1] / root * length[-1], root[:, None] * vectors.T * length[:-1]
    )


def _products(a: Array, b: Array) -> Array:
    """Aᵀ B of (N, p) and (N, q), in one thread: threaded products wait for each other on busy cores."""
    out: Array = np.einsum("na,nb->ab", a, b)
    return out


def _blocks(calibration: RigCalibration, head: int) -> tuple[slice, Array]:
    """Rows of a head in the joint covariance, and that covariance.

    Raises
    ------
    DegenerateInputError
        When there is none.
    """
    if calibration.covariance is None:
        raise DegenerateInputError(
            field="covariance",
            expected="a calibration with its covariance",
            seen="none",
            cure="Calibrate the rig with the plate.",
        )
    sizes = [sum(pair) for pair in _sizes(calibration)]
    return slice(sum(sizes[:head]), sum(sizes[: head + 1])), calibration.covariance


def _state(calibration: RigCalibration, head: int, pairs: CrossPairs) -> HeadState:
    rows, covariance = _blocks(calibration, head)
    known = calibration.heads[head]
    equations = _compressed(known, pairs)
    spread = equations.derivatives @ covariance[rows, rows] @ equations.derivatives.T + np.eye(
        len(equations.values)
    )
    excess = float(equations.values @ np.linalg.solve(spread, equations.values))
    limit = float(chi2.ppf(1.0 - 1e-4, len(equations.values)))
    return HeadState(known.name, len(pairs.left), _robust_rms(_rows(known, pairs)), excess, limit)


def _robust_rms(values: Array) -> float:
    """RMS without the pairs that are wrong."""
    spread = 1.4826 * float(np.median(np.abs(values - np.median(values))))
    near = values[np.abs(values - np.median(values)) <= 5.0 * spread + 1e-12]
    return float(np.sqrt(np.square(near).mean()))


def _consider(
    calibration: RigCalibration, head: int, side: int, pairs: CrossPairs, movement: Movement
) -> _Considered:
    """Estimate the step of one camera, all other parameters considered with their covariance but held."""
    rows, joint = _blocks(calibration, head)
    sizes = _sizes(calibration)[head]
    first = rows.start + (sizes[0] if side else 0)
    size = sizes[side]
    # Unknowns of the step in terms of the camera's parameters: pose, and both focal lengths together.
    unknowns = 6 + (movement.focal > 0)
    camera = calibration.heads[head].cameras[side]
    basis = np.zeros((size, unknowns))
    basis[range(6), range(6)] = 1.0
    if movement.focal > 0:
        basis[6, 6], basis[7, 6] = camera.model.fx, camera.model.fy
    allowed = np.diag(
        [movement.rotation**2] * 3 + [movement.shift_mm**2] * 3 + [movement.focal**2] * (unknowns - 6)
    )
    prior = joint.copy()
    mine = slice(first, first + size)
    prior[mine, mine] += basis @ allowed @ basis.T
    step, evidence = np.zeros(unknowns), 0.0
    current = calibration.heads[head]
    for _ in range(_ITERATIONS):
        equations = _compressed(current, pairs)
        h = np.zeros((len(equations.values), len(joint)))
        h[:, rows] = equations.derivatives
        spread = h @ prior @ h.T + np.eye(len(h))
        # Row differences as they would be at the old calibration, to first order about the new one.
        values = equations.values - h[:, mine] @ basis @ step
        gain = np.linalg.solve(spread, h @ prior[:, mine] @ np.linalg.pinv(basis).T).T
        step = -gain @ values
        evidence = float(values @ np.linalg.solve(spread, values) + np.linalg.slogdet(spread)[1])
        current = _with(calibration.heads[head], side, _moved(camera, basis @ step))
    change = np.zeros((len(joint), len(h)))
    change[mine] = basis @ gain
    keep = np.eye(len(joint)) - change @ h
    covariance = keep @ prior @ keep.T + change @ change.T
    heads = tuple(current if k == head else known for k, known in enumerate(calibration.heads))
    refreshed = replace(calibration, heads=heads, covariance=0.5 * (covariance + covariance.T))
    return _Considered(step, refreshed, evidence)


def _wheel_residual(
    shots: Sequence[Sequence[StereoImages]], calibration: RigCalibration, settings: MeasureSettings
) -> float:
    """Mean RMS residual of the wheels, millimetres; infinite when one is refused."""
    found = [measure_wheel(images, calibration, settings) for images in shots]
    residuals = [m.residual_rms_mm for m in found if isinstance(m, WheelMeasurement)]
    return float(np.mean(residuals)) if len(residuals) == len(found) else math.inf
