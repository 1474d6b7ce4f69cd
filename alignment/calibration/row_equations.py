"""What corresponding crosses tell of a head's cameras: they lie on one row of the rectified head."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np

from alignment.arrays import Array
from alignment.calibration.crosses import CrossPairs
from alignment.calibration.dense import products
from alignment.errors import DegenerateInputError
from alignment.geometry.cameras import PosedCamera
from alignment.robust import BIWEIGHT, deviation_of
from alignment.stereo.rectification import Rectification
from alignment.values import HeadCalibration, RigCalibration

_LEAST_PAIRS = 60
_LEAST_SIGMA_PX = 0.02
_SYSTEMATIC_PX = 0.03  # what crosses of one shot have in common: the projector's lines, gloss
_STEPS = np.array([1e-6] * 3 + [1e-4] * 3)


@dataclass(frozen=True, eq=False)
class Equations:
    """Linear equations with unit noise: values (R,) = derivatives (R, P) · error of the calibration."""

    values: Array
    derivatives: Array


def joined_equations(parts: list[Equations]) -> Equations:
    """Return several sets of equations in the same parameters as one."""
    return Equations(
        np.concatenate([part.values for part in parts]), np.concatenate([part.derivatives for part in parts])
    )


def as_noisy_as_they_are(shapes: Equations, misfit: Array, prior: Array) -> tuple[Equations, float]:
    """Equations of wheels with the noise that their misfit shows, and what that adds to −2 log evidence.

    What all wheels have in common, the projector's lines, the way in which tyres are not round, does not show
    in how they differ.
    """
    h = shapes.derivatives
    spread = h @ prior @ h.T + np.eye(len(h))
    factor = math.sqrt(max(1.0, float(misfit @ np.linalg.solve(spread, misfit)) / len(misfit)))
    return Equations(shapes.values / factor, h / factor), 2.0 * len(misfit) * math.log(factor)


def row_differences(head: HeadCalibration, pairs: CrossPairs) -> Array:
    """(N,) row differences of the pairs in the rectified head, pixels."""
    frame = Rectification.of(head.left, head.right)
    left, _ = frame.coordinates(head.left, pairs.left)
    right, _ = frame.coordinates(head.right, pairs.right)
    out: Array = (left[:, 1] - right[:, 1]) * 0.5 * (head.left.model.fx + head.right.model.fx)
    return out


def robust_rms(values: Array) -> float:
    """RMS without the pairs that are wrong."""
    spread = deviation_of(values - np.median(values))
    near = values[np.abs(values - np.median(values)) <= 5.0 * spread + 1e-12]
    return float(np.sqrt(np.square(near).mean()))


def camera_rows(calibration: RigCalibration) -> list[slice]:
    """Rows of the joint covariance of each camera, heads in order, left before right."""
    sizes = [6 + len(camera.model.parameters) for head in calibration.heads for camera in head.cameras]
    first = np.cumsum([0, *sizes])
    return [slice(int(a), int(b)) for a, b in itertools.pairwise(first)]


def stepped(camera: PosedCamera, step: Array) -> PosedCamera:
    """Camera after a step of all its parameters, ordered as in the covariance."""
    return PosedCamera(
        camera.model.with_parameters(camera.model.parameters + step[6:]),
        camera.rig_from_camera.perturbed(step[:3], step[3:6]),
    )


def with_camera(calibration: RigCalibration, head: int, side: int, camera: PosedCamera) -> RigCalibration:
    """Calibration with another left (0) or right (1) camera of a head."""
    heads = list(calibration.heads)
    old = heads[head]
    heads[head] = replace(old, right=camera) if side else replace(old, left=camera)
    return replace(calibration, heads=tuple(heads))


def row_equations(calibration: RigCalibration, head: int, pairs: CrossPairs) -> Equations:
    """Bring the rows of thousands of pairs of a head to as many equations as its cameras have parameters.

    Raises
    ------
    DegenerateInputError
        When there are too few pairs.
    """
    known = calibration.heads[head]
    if len(pairs.left) < _LEAST_PAIRS:
        raise DegenerateInputError(
            field=known.name,
            expected=f"at least {_LEAST_PAIRS} crosses of light lines that both cameras see",
            seen=str(len(pairs.left)),
            cure="Take more shots of ordinary wheels.",
        )
    values = row_differences(known, pairs)
    rows = camera_rows(calibration)
    mine = slice(rows[2 * head].start, rows[2 * head + 1].stop)
    derivatives = _jacobian(calibration, head, pairs)
    # What a changed camera does to the rows is smooth over the image; the rest is noise and wrong pairs.
    uv = (pairs.left - pairs.left.mean(axis=0)) / pairs.left.std(axis=0)
    smooth = np.column_stack([np.ones(len(uv)), uv, uv[:, 0] * uv[:, 1], uv**2])
    weight = np.ones(len(uv))
    for _ in range(10):
        weighted = smooth * weight[:, None]
        fit = np.linalg.solve(products(weighted, smooth), np.einsum("na,n->a", weighted, values))
        rest = values - smooth @ fit
        sigma = max(deviation_of(rest), _LEAST_SIGMA_PX)
        weight = np.clip(1.0 - (rest / (BIWEIGHT * sigma)) ** 2, 0.0, None)
    # Crosses of one shot share errors, so the noise does not average down for ever.
    effective = float(weight.sum())
    sigma = math.sqrt(sigma**2 + effective * _SYSTEMATIC_PX**2 / 4.0) if effective > 0 else sigma
    whitened = np.column_stack([derivatives, values]) * (np.sqrt(weight) / sigma)[:, None]
    normal = products(whitened, whitened)
    found, _ = compressed(normal[:-1, :-1], normal[:-1, -1])
    wide = np.zeros((len(found.values), len(calibration.parameter_names)))
    wide[:, mine] = found.derivatives
    return Equations(found.values, wide)


def _jacobian(calibration: RigCalibration, head: int, pairs: CrossPairs) -> Array:
    """(N, P) derivatives of the row differences by all parameters of the head, by central differences."""
    columns = []
    for side, camera in enumerate(calibration.heads[head].cameras):
        steps = np.concatenate([_STEPS, 1e-6 * np.maximum(1.0, np.abs(camera.model.parameters))])
        for k, size in enumerate(steps):
            step = np.zeros(len(steps))
            step[k] = size
            ahead, behind = (
                row_differences(
                    with_camera(calibration, head, side, stepped(camera, sign * step)).heads[head], pairs
                )
                for sign in (1.0, -1.0)
            )
            columns.append((ahead - behind) / (2.0 * size))
    return np.column_stack(columns)


def compressed(normal: Array, right: Array) -> tuple[Equations, Array]:
    """Bring normal equations (P, P), (P,) of unit noise to as few equations as they have rank.

    Returns
    -------
    equations, mixing
        `mixing` (R, P) makes the equations' values of the normal equations' right side.
    """
    length = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    # The eigenvectors are the equations; the tiniest are rounding.
    squares, vectors = np.linalg.eigh(normal / np.outer(length, length))
    real = squares > 1e-10 * squares[-1]
    root, vectors = np.sqrt(squares[real]), vectors[:, real]
    mixing = vectors.T / root[:, None] / length
    return Equations(mixing @ right, root[:, None] * vectors.T * length), mixing
