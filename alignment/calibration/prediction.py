"""What the joint covariance of a rig's cameras means for measured points and for camber and toe.

The errors of a calibration are common to all points of a head: they do not average out over thousands of
points, so the sensitivity of the whole fit is taken to each camera parameter, not that of each point.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array, Index
from alignment.calibration.projection import INTRINSICS, project_with_derivatives
from alignment.errors import DegenerateInputError
from alignment.geometry.cameras import PosedCamera
from alignment.kernels import njit
from alignment.values import HeadCalibration, RigCalibration
from alignment.vehicle.angles import camber_toe_jacobian
from alignment.wheel.reference import CREST_MM, FORM_DEGREE

_GRID = 24  # points per image row and column of the nominal wheel
_PROFILE_STEP = 2.0  # mm; knots of the profile that the fit leaves free
_LEAST_POINTS = 20
_CREST_PLACES = 101  # at which the form of the sidewall around its outermost ring is looked at


@dataclass(frozen=True)
class NominalWheel:
    """The tyre on which angles are predicted: an annulus around the rig's axis, crowned as sidewalls are.

    Attributes
    ----------
    inner_mm, outer_mm
        Radii between which its points lie; what no head sees of it does not count.
    crown_mm
        Height of the middle of the sidewall above its edges.
    """

    inner_mm: float = 200.0
    outer_mm: float = 320.0
    crown_mm: float = 6.0

    def height(self, radius: Array) -> Array:
        """Height z (N,) at radii (N,), millimetres."""
        return -self.crown_mm * self._place(radius) ** 2

    def slope(self, radius: Array) -> Array:
        """Slope dz/dρ (N,) at radii (N,)."""
        return -4.0 * self.crown_mm * self._place(radius) / (self.outer_mm - self.inner_mm)

    @property
    def ring_mm(self) -> float:
        """Radius of the ring that stands out farthest."""
        return 0.5 * (self.inner_mm + self.outer_mm)

    def _place(self, radius: Array) -> Array:
        return (radius - self.ring_mm) / (0.5 * (self.outer_mm - self.inner_mm))


def predict_angle_uncertainty(
    calibration: RigCalibration, wheel: NominalWheel | None = None
) -> tuple[float, float]:
    """Standard uncertainties (camber, toe), radians, that come from the calibration alone.

    The pose of the rig in the vehicle counts where it was measured; a nominal one is taken as it is.

    Raises
    ------
    DegenerateInputError
        When the calibration has no covariance, or its heads do not see the wheel.
    """
    covariance = angle_covariance(calibration, wheel)
    return math.sqrt(covariance[0, 0]), math.sqrt(covariance[1, 1])


def angle_covariance(calibration: RigCalibration, wheel: NominalWheel | None = None) -> Array:
    """(2, 2) covariance of (camber, toe), radians², from the calibration; errors as
    `predict_angle_uncertainty`."""
    sensitivity = angle_sensitivity(calibration, wheel)
    out: Array = sensitivity @ _covariance(calibration) @ sensitivity.T
    return out


def angle_sensitivity(calibration: RigCalibration, wheel: NominalWheel | None = None) -> Array:
    """(2, P) change of measured (camber, toe): the first rows of `axis_sensitivity`, which says how."""
    return axis_sensitivity(calibration, wheel)[:2]


def axis_covariance(calibration: RigCalibration, wheel: NominalWheel | None = None) -> Array:
    """(5, 5) covariance of camber, toe (radians) and the reference point in the vehicle frame (millimetres),
    from the calibration; errors as `predict_angle_uncertainty`."""
    sensitivity = axis_sensitivity(calibration, wheel)
    out: Array = sensitivity @ _covariance(calibration) @ sensitivity.T
    return out


def axis_sensitivity(calibration: RigCalibration, wheel: NominalWheel | None = None) -> Array:
    """(5, P) change of measured camber and toe and of the wheel's reference point, vehicle frame, per change
    of each parameter of `parameter_names`.

    A wheel point is where the ray of a left pixel meets the right light line, so it moves along the left ray
    with the right camera's errors along the epipolar line, and with the left ray itself. To the points of all
    heads a surface of revolution is fitted, its profile free. The reference point of the nominal wheel, where
    its axis meets the plane of the ring that stands out farthest, is the rig's origin.

    Raises
    ------
    DegenerateInputError
        When a head does not see the wheel.
    """
    wheel = wheel or NominalWheel()
    _, _, design, solution = _response(calibration, wheel)
    size = len(calibration.parameter_names)
    crest = _crest_functional(np.hypot(design[:, 0], design[:, 1]), wheel.ring_mm)
    normal_change = np.vstack([-solution[0], -solution[1], np.zeros(size)])
    point_change = np.vstack([solution[2:4], crest @ design[:, 4:] @ solution[4:]])
    if calibration.vehicle_from_rig_measured:
        # A turn ω of the rig takes its z axis to ω × z.
        normal_change[:, -6:-3] = [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]
    turn = calibration.vehicle_from_rig.rotation
    nominal = turn @ np.array([0.0, 0.0, 1.0])
    of_angles = camber_toe_jacobian(nominal, calibration.side) @ turn @ normal_change
    of_point = turn @ point_change
    if calibration.vehicle_from_rig_measured:
        of_point[:, -3:] = np.eye(3)
    return np.vstack([of_angles, of_point])


def _crest_functional(radius: Array, ring_mm: float) -> Array:
    """(N,) shares of the profile's heights at the points in the height of the outermost ring.

    That is found on a polynomial through the sidewall around it (`wheel.reference`), where each radius counts
    alike.
    """
    x = np.linspace(-1.0, 1.0, _CREST_PLACES)
    rows = np.vander(x, FORM_DEGREE + 1)
    at_middle = np.linalg.pinv(rows)[-1]
    nearest = np.abs(radius - (ring_mm + CREST_MM * x)[:, None]).argmin(axis=1)
    out: Array = np.bincount(nearest, at_middle, len(radius)).astype(np.float64)
    return out


def predicted_misfits(calibration: RigCalibration, wheel: NominalWheel | None = None) -> Array:
    """(H,) RMS height, millimetres, by which each head's points leave the common surface.

    One standard deviation, from the errors of the calibration alone.

    Raises
    ------
    DegenerateInputError
        As `predict_angle_uncertainty`.
    """
    head, heights, design, solution = _response(calibration, wheel or NominalWheel())
    left = heights - design @ solution
    variance = np.einsum("np,np->n", left @ _covariance(calibration), left)
    # Rounding may leave a variance of nothing below zero.
    out: Array = np.sqrt(np.bincount(head, np.maximum(variance, 0.0)) / np.bincount(head))
    return out


def _response(calibration: RigCalibration, wheel: NominalWheel) -> tuple[Index, Array, Array, Array]:
    """How a fit to a nominal wheel answers errors of the calibration's P parameters.

    Head (N,) of each point, change of its height (N, P), derivatives (N, U) of the fit's unknowns (slopes of
    z along x and y, the axis' place, the profile), and their change (U, P).
    """
    points, moves, heads = [], [], []
    first = 0
    size = len(calibration.parameter_names)
    for k, head in enumerate(calibration.heads):
        seen = wheel_points(head, wheel)
        local = line_sensitivity(head, seen)
        at_head = np.zeros((len(seen), 3, size))
        at_head[:, :, first : first + local.shape[2]] = local
        first += local.shape[2]
        points.append(seen)
        moves.append(at_head)
        heads.append(np.full(len(seen), k))
    x = np.concatenate(points)
    radius = np.hypot(x[:, 0], x[:, 1])
    slope = wheel.slope(radius)
    outward = x[:, :2] / radius[:, None]
    normal = np.column_stack([-slope[:, None] * outward, np.ones(len(x))])
    heights = np.einsum("na,nap->np", normal, np.concatenate(moves))
    design = np.column_stack([x[:, 0], x[:, 1], -slope[:, None] * outward, profile_basis(radius)])
    # Least norm: where the sidewall is flat, the axis' place has no effect and no value.
    solution = np.linalg.lstsq(design.T @ design, design.T @ heights, rcond=1e-12)[0]
    return np.concatenate(heads), heights, design, solution


def point_covariance(calibration: RigCalibration, head: int, points: Array) -> Array:
    """(N, 3, 3) covariance, millimetres², of points triangulated from both rays, from the calibration alone.

    Parameters
    ----------
    calibration
        With its covariance.
    head
        Number of the head that triangulates.
    points
        (N, 3) rig frame, millimetres, in front of both cameras.

    Raises
    ------
    DegenerateInputError
        When there is no covariance, or a camera does not see a point.
    """
    sizes = [sum(_size(camera) for camera in h.cameras) for h in calibration.heads]
    rows = slice(sum(sizes[:head]), sum(sizes[: head + 1]))
    local = _covariance(calibration)[rows, rows]
    move = _ray_sensitivity(calibration.heads[head], np.asarray(points, dtype=np.float64))
    out: Array = move @ local @ move.transpose(0, 2, 1)
    return out


def wheel_points(head: HeadCalibration, wheel: NominalWheel) -> Array:
    """(N, 3) points of a nominal wheel that both cameras of a head see, even over the left image.

    Raises
    ------
    DegenerateInputError
        When there are hardly any.
    """
    left = head.left.model
    u, v = np.meshgrid(np.linspace(0, left.width - 1, _GRID), np.linspace(0, left.height - 1, _GRID))
    rays = head.left.rays(np.column_stack([u.ravel(), v.ravel()]))
    origin = head.left.rig_from_camera.translation
    rays = rays[rays[:, 2] < -0.1]
    z = np.zeros(len(rays))
    for _ in range(4):
        points = origin + ((z - origin[2]) / rays[:, 2])[:, None] * rays
        z = wheel.height(np.hypot(points[:, 0], points[:, 1]))
    radius = np.hypot(points[:, 0], points[:, 1])
    points = points[(radius > wheel.inner_mm) & (radius < wheel.outer_mm)]
    if len(points):
        pixels = head.right.project(points)
        size = np.array([head.right.model.width, head.right.model.height])
        points = points[((pixels >= 0) & (pixels <= size - 1)).all(axis=1)]
    if len(points) < _LEAST_POINTS:
        raise DegenerateInputError(
            field=head.name,
            expected=f"a head that sees a wheel with radii {wheel.inner_mm:g} to {wheel.outer_mm:g} mm",
            seen=f"{len(points)} common points of it",
            cure="Check the poses of its cameras, and that left and right are not swapped.",
        )
    out: Array = points
    return out


def _covariance(calibration: RigCalibration) -> Array:
    if calibration.covariance is None:
        raise DegenerateInputError(
            field="covariance",
            expected="a calibration with its covariance",
            seen="none",
            cure="Calibrate by the joint adjustment.",
        )
    return calibration.covariance


def _size(camera: PosedCamera) -> int:
    return 6 + len(camera.model.parameters)


def camera_derivatives(camera: PosedCamera, points: Array) -> tuple[Array, Array]:
    """(N, 2, 3) derivatives of pixels by the point, rig frame, and (N, 2, P) by the camera's parameters."""
    size = _size(camera)
    by_point, by_camera, seen = _derivatives(
        np.ascontiguousarray(camera.rig_from_camera.inverse().apply(points)),
        np.ascontiguousarray(camera.rig_from_camera.rotation),
        camera.model.packed(),
    )
    if not seen:
        raise DegenerateInputError(
            field="points",
            expected="points that the camera sees",
            seen="one behind it or beyond its lens",
        )
    return by_point, by_camera[:, :, :size]


@njit(cache=True, nogil=True, error_model="numpy")
def _derivatives(inside: Array, rotation: Array, packed: Array) -> tuple[Array, Array, bool]:
    """By the point (N, 2, 3), rig frame, and by pose and intrinsics (N, 2, 24); False where one is unseen."""
    n = inside.shape[0]
    by_point, by_camera = np.zeros((n, 2, 3)), np.zeros((n, 2, 6 + INTRINSICS))
    local, intrinsics = np.zeros((2, 3)), np.zeros((2, INTRINSICS))
    for i in range(n):
        x, y, z = inside[i, 0], inside[i, 1], inside[i, 2]
        _, _, ok = project_with_derivatives(x, y, z, packed, local, intrinsics)
        if not ok:
            return by_point, by_camera, False
        for e in range(2):
            p0, p1, p2 = local[e, 0], local[e, 1], local[e, 2]
            by_camera[i, e, 0] = p1 * z - p2 * y
            by_camera[i, e, 1] = p2 * x - p0 * z
            by_camera[i, e, 2] = p0 * y - p1 * x
            for a in range(3):
                by_point[i, e, a] = p0 * rotation[a, 0] + p1 * rotation[a, 1] + p2 * rotation[a, 2]
                by_camera[i, e, 3 + a] = -by_point[i, e, a]
            for a in range(INTRINSICS):
                by_camera[i, e, 6 + a] = intrinsics[e, a]
    return by_point, by_camera, True


def _ray_sensitivity(head: HeadCalibration, points: Array) -> Array:
    """(N, 3, P) movement of points triangulated from both rays, per change of the head's parameters."""
    by_point, by_camera = head_derivatives(head, points)
    inverse = np.linalg.inv(by_point.transpose(0, 2, 1) @ by_point)
    out: Array = -inverse @ by_point.transpose(0, 2, 1) @ by_camera
    return out


def line_sensitivity(head: HeadCalibration, points: Array) -> Array:
    """(N, 3, P) movement of points where a left ray meets a right light line across the epipolar lines."""
    by_point, by_camera = head_derivatives(head, points)
    base = head.right.rig_from_camera.translation - head.left.rig_from_camera.translation
    along = by_point[:, 2:] @ base
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    equations = np.concatenate(
        [by_point[:, :2], np.einsum("ne,nea->na", along, by_point[:, 2:])[:, None]], axis=1
    )
    right = np.concatenate(
        [by_camera[:, :2], np.einsum("ne,nep->np", along, by_camera[:, 2:])[:, None]], axis=1
    )
    out: Array = -np.linalg.solve(equations, right)
    return out


def head_derivatives(head: HeadCalibration, points: Array) -> tuple[Array, Array]:
    """(N, 4, 3) and (N, 4, P) derivatives of left and right pixels by the point and by the head's cameras."""
    (left_point, left), (right_point, right) = (camera_derivatives(c, points) for c in head.cameras)
    by_camera = np.zeros((len(points), 4, left.shape[2] + right.shape[2]))
    by_camera[:, :2, : left.shape[2]] = left
    by_camera[:, 2:, left.shape[2] :] = right
    return np.concatenate([left_point, right_point], axis=1), by_camera


def profile_basis(radius: Array) -> Array:
    """(N, K) piecewise linear basis over the radius."""
    low, high = radius.min(), radius.max()
    count = max(2, math.ceil((high - low) / _PROFILE_STEP) + 1)
    place = (radius - low) / (high - low) * (count - 1)
    out: Array = np.maximum(1.0 - np.abs(place[:, None] - np.arange(count)), 0.0)
    return out
