"""The thesis's own calibration (4.2.2): a Newton system from x, one from y, their common values averaged."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.arrays import Array
from alignment.calibration.faugeras import calibrate_faugeras
from alignment.calibration.one_camera import (
    CalibratedCamera,
    Known,
    calibration_matrix,
    camera_model,
    checked,
    posed,
    require_spread,
)
from alignment.errors import DegenerateInputError

PARAMETERS = ("alpha", "beta", "gamma", "tx", "ty", "tz", "px", "py", "cx", "cy", "d")
_STEPS = 50


def _rotations(alpha: float, beta: float, gamma: float) -> tuple[Array, Array]:
    """R = Rz(γ) Ry(β) Rx(α), (3, 3), and its derivatives by α, β, γ, (3, 3, 3)."""
    (sa, sb, sg), (ca, cb, cg) = np.sin([alpha, beta, gamma]), np.cos([alpha, beta, gamma])
    rx = np.array([[1, 0, 0], [0, ca, -sa], [0, sa, ca]])
    ry = np.array([[cb, 0, sb], [0, 1, 0], [-sb, 0, cb]])
    rz = np.array([[cg, -sg, 0], [sg, cg, 0], [0, 0, 1]])
    dx = np.array([[0, 0, 0], [0, -sa, -ca], [0, ca, -sa]])
    dy = np.array([[-sb, 0, cb], [0, 0, 0], [-cb, 0, -sb]])
    dz = np.array([[-sg, -cg, 0], [cg, -sg, 0], [0, 0, 0]])
    return rz @ ry @ rx, np.array([rz @ ry @ dx, rz @ dy @ rx, dz @ ry @ rx])


def equations(parameters: Array, points: Array, pixels: Array) -> tuple[Array, Array]:
    """F_x and F_y of every point, (2, N), and their derivatives by `PARAMETERS`, (2, N, 11).

    F_x = (X − C_x) z − p_x (1 + dρ²) x and F_y = (Y − C_y) z − p_y (1 + dρ²) y, with (x, y, z) = R X + t and
    ρ² = ((X − C_x)/p_x)² + ((Y − C_y)/p_y)²; the derivatives are derived anew.

    Parameters
    ----------
    parameters
        (11,) radians, millimetres, pixels.
    points
        (N, 3) millimetres.
    pixels
        (N, 2).
    """
    alpha, beta, gamma, tx, ty, tz, px, py, cx, cy, d = parameters
    rotation, by_angle = _rotations(alpha, beta, gamma)
    x, y, z = (points @ rotation.T + (tx, ty, tz)).T
    dx, dy = pixels[:, 0] - cx, pixels[:, 1] - cy
    a, b = dx / px, dy / py
    g = 1.0 + d * (a * a + b * b)
    values = np.array([dx * z - px * g * x, dy * z - py * g * y])

    # By the point in the camera frame, then on to angles and translation.
    zero = np.zeros_like(z)
    by_point = np.array([np.column_stack([-px * g, zero, dx]), np.column_stack([zero, -py * g, dy])])
    jacobian = np.empty((2, len(points), len(PARAMETERS)))
    for k in range(3):
        jacobian[:, :, k] = np.einsum("snc,nc->sn", by_point, points @ by_angle[k].T)
    jacobian[:, :, 3:6] = by_point
    # By g, through ρ²: p_x, p_y, C_x, C_y, d.
    by_g = np.array([-px * x, -py * y])
    g_by = np.column_stack(
        [-2 * d * a * a / px, -2 * d * b * b / py, -2 * d * a / px, -2 * d * b / py, a * a + b * b]
    )
    jacobian[:, :, 6:] = by_g[:, :, None] * g_by
    jacobian[0, :, 6] -= g * x
    jacobian[1, :, 7] -= g * y
    jacobian[0, :, 8] -= z
    jacobian[1, :, 9] -= z
    return values, jacobian


def _newton(parameters: Array, points: Array, pixels: Array) -> Array:
    """Common parameters (11,) after one Newton step of each system, averaged with their information.

    A system's step is −N⁻¹g with N = JᵀJ/σ² and g = JᵀF/σ²; the average weighted with N is −(N_x + N_y)⁻¹
    (g_x + g_y), which needs neither inverse: N_x and N_y are singular.
    """
    values, jacobian = equations(parameters, points, pixels)
    scale = 1.0 / np.linalg.norm(jacobian, axis=(0, 1)).clip(1e-12)
    information, gradient = np.zeros((len(parameters),) * 2), np.zeros(len(parameters))
    for f, j in zip(values, jacobian * scale, strict=True):
        variance = max(float(f @ f) / len(f), 1e-24)
        information += j.T @ j / variance
        gradient += j.T @ f / variance
    step: Array = scale * np.linalg.lstsq(information, gradient, rcond=1e-15)[0]
    return parameters - step


def calibrate_two_system(
    points: Array, pixels: Array, size: tuple[int, int], known: Known | None = None
) -> CalibratedCamera:
    """Find a camera of the division model from points in space; see `OneCameraMethod`, nothing is known.

    Each system is solved by Newton's method with least squares from the start values of
    `calibrate_faugeras`. As printed, each has an exact family of solutions: F_x cannot tell a turn by α from
    a shift of C_y, because z + δy and d (Y − C_y − δ p_y/2d)² cancel, nor F_y one by β from C_x. A plain mean
    of the common parameters therefore errs by tens of pixels. The mean here is weighted with what each
    system knows (its information matrix), and both go on from it until it stays.

    Raises
    ------
    DegenerateInputError
        For fewer than 11 points, points in one plane, or values that do not settle.
    """
    del known
    points, pixels = checked(points, pixels, 11)
    require_spread(points, 3)
    start = calibrate_faugeras(points, pixels, size).camera
    camera_from_points = start.rig_from_camera.inverse()
    k = start.model
    angles = Rotation.from_matrix(camera_from_points.rotation).as_euler("xyz")
    parameters = np.array([*angles, *camera_from_points.translation, k.fx, k.fy, k.cx, k.cy, 0.0])
    for _ in range(_STEPS):
        new = _newton(parameters, points, pixels)
        settled = bool(np.abs(new - parameters).max() <= 1e-10 * np.abs(parameters).max())
        parameters = new
        if settled:
            break
    else:
        raise DegenerateInputError(
            field="points, pixels",
            expected="points that both systems agree on",
            seen=f"values that still change after {_STEPS} steps",
            cure="Add positions of the plate at other heights; check that marks and images belong together.",
        )
    *k_values, d = (float(value) for value in parameters[6:])
    model = camera_model(size, calibration_matrix(*k_values), "division", (d,))
    return posed(model, _rotations(*parameters[:3])[0], parameters[3:6], points, pixels)
