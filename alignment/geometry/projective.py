"""Projective geometry of the plane and of space (thesis, ch. 2): joins, meets, conics, homographies.

Points, lines and planes are homogeneous vectors, known up to scale: a point x lies on a line (plane) l when
l · x = 0. By duality one function does for both: what joins points also meets lines.
"""

from __future__ import annotations

import numpy as np

from alignment.arrays import Array
from alignment.errors import DegenerateInputError

LINE_AT_INFINITY = np.array([0.0, 0.0, 1.0])
PLANE_AT_INFINITY = np.array([0.0, 0.0, 0.0, 1.0])
CIRCULAR_POINTS = np.array([[1.0, 1.0j, 0.0], [1.0, -1.0j, 0.0]])
"""The two points that every circle of the plane goes through."""

_PARALLEL = 1e-12


def homogeneous(points: Array) -> Array:
    """Points (N, d) with a 1 appended, (N, d + 1)."""
    return np.column_stack([points, np.ones(len(points))])


def inhomogeneous(points: Array) -> Array:
    """Points (N, d) of homogeneous ones (N, d + 1).

    Raises
    ------
    DegenerateInputError
        When one lies at infinity.
    """
    points = np.asarray(points, dtype=np.float64)
    if (np.abs(points[:, -1]) <= _PARALLEL * np.linalg.norm(points, axis=1)).any():
        raise DegenerateInputError(field="points", expected="points at finite places", seen="one at infinity")
    return np.asarray(points[:, :-1] / points[:, -1:])


def join(*elements: Array) -> Array:
    """Line through two points of the plane, or plane through three points of space, length 1.

    By duality also the point in which two lines, or three planes, meet.

    Raises
    ------
    DegenerateInputError
        When they do not determine it: points that coincide or lie on a line.
    """
    rows = np.array([e / np.linalg.norm(e) for e in elements])
    if rows.shape[0] != rows.shape[1] - 1:
        raise DegenerateInputError(
            field="elements",
            expected="two of the plane (length 3) or three of space (length 4)",
            seen=f"{rows.shape[0]} of length {rows.shape[1]}",
        )
    _, values, vt = np.linalg.svd(rows, full_matrices=True)
    if values[-1] <= _PARALLEL:
        raise DegenerateInputError(
            field="elements",
            expected="elements that are independent",
            seen="one that follows from the others",
        )
    return np.asarray(vt[-1])


meet = join
"""Point common to two lines of the plane, or to three planes of space: the dual of `join`."""


def circle(centre: Array, radius: float) -> Array:
    """Conic (3, 3) of a circle about `centre` (2,)."""
    x, y = centre
    return np.array([[1.0, 0.0, -x], [0.0, 1.0, -y], [-x, -y, x * x + y * y - radius * radius]])


def conic_through(points: Array) -> Array:
    """Conic C (3, 3), symmetric, of norm 1, of least algebraic error xᵀ C x at points (N, 2), N ≥ 5.

    Raises
    ------
    DegenerateInputError
        For fewer than five points, or points that several conics go through.
    """
    points = np.asarray(points, dtype=np.float64)
    if len(points) < 5:
        raise DegenerateInputError(field="points", expected="at least five points", seen=str(len(points)))
    scaling = conditioning(points)
    x, y = (homogeneous(points) @ scaling.T)[:, :2].T
    solution, uniqueness = null_vector(np.column_stack([x * x, x * y, y * y, x, y, np.ones_like(x)]))
    if uniqueness < 1e-9:
        raise DegenerateInputError(
            field="points", expected="points that one conic alone goes through", seen="points on a line"
        )
    a, b, c, d, e, f = solution
    conic = scaling.T @ np.array([[a, b / 2, d / 2], [b / 2, c, e / 2], [d / 2, e / 2, f]]) @ scaling
    return np.asarray(conic / np.linalg.norm(conic))


def polar(conic: Array, point: Array) -> Array:
    """Line (3,) that is the polar of a point (3,); for a point on the conic its tangent."""
    return np.asarray(conic @ point)


def pole(conic: Array, line: Array) -> Array:
    """Point (3,) whose polar is a line (3,); of the line at infinity the conic's centre.

    Raises
    ------
    DegenerateInputError
        When the conic is a pair of lines.
    """
    if np.linalg.svd(conic, compute_uv=False)[-1] <= 1e-14 * np.linalg.norm(conic):
        raise DegenerateInputError(field="conic", expected="a conic", seen="a pair of lines")
    return np.asarray(np.linalg.solve(conic, line))


def mapped_conic(homography: Array, conic: Array) -> Array:
    """Image H⁻ᵀ C H⁻¹ of a conic under x → H x."""
    inverse = np.linalg.inv(homography)
    return np.asarray(inverse.T @ conic @ inverse)


def absolute_conic_image(k: Array) -> Array:
    """Image ω = K⁻ᵀ K⁻¹ of the absolute conic in a camera K (3, 3); the camera's pose does not matter."""
    inverse = np.linalg.inv(k)
    return np.asarray(inverse.T @ inverse)


def camera_of_absolute_conic(omega: Array) -> Array:
    """K (3, 3), upper triangular with K₃₃ = 1, of the image ω of the absolute conic, any sign and scale.

    Raises
    ------
    DegenerateInputError
        When ω is not definite, which no camera's is.
    """
    try:
        lower = np.linalg.cholesky(omega if omega[0, 0] > 0 else -omega)
    except np.linalg.LinAlgError:
        raise DegenerateInputError(
            field="omega", expected="a definite matrix", seen="one that no camera has"
        ) from None
    k = np.linalg.inv(lower.T)
    return np.asarray(k / k[2, 2])


def require_finite(points: Array, least: int = 1, field: str = "points") -> None:
    """Refuse fewer than `least` points (N, d), and any that is not finite, with which solvers fail.

    Raises
    ------
    DegenerateInputError
        Which of both it is.
    """
    if len(points) < least:
        raise DegenerateInputError(field=field, expected=f"at least {least}", seen=str(len(points)))
    if not np.isfinite(points).all():
        raise DegenerateInputError(field=field, expected="finite numbers", seen="others")


def conditioning(points: Array) -> Array:
    """Similarity (d + 1, d + 1) that brings points (N, d) to centroid 0 and root mean square distance √d.

    Without it the linear fits below are at the mercy of the units (Hartley, 1997).

    Raises
    ------
    DegenerateInputError
        For no point, or one that is not finite.
    """
    require_finite(points)
    centre = points.mean(axis=0)
    d = points.shape[1]
    spread = np.sqrt(np.square(points - centre).sum(axis=1).mean() / d) or 1.0
    matrix = np.eye(d + 1) / spread
    matrix[:d, d] = -centre / spread
    matrix[d, d] = 1.0
    return matrix


def null_vector(rows: Array) -> tuple[Array, float]:
    """Unit-free solution h (n,) of rows (m, n) · h ≈ 0, and how far it is from being unique.

    Columns are brought to equal length first, so that the solution does not depend on the units of the
    unknowns. The number is the second smallest singular value over the largest: 0 where two solutions exist.
    """
    length = np.linalg.norm(rows, axis=0)
    length[length == 0] = 1.0
    _, values, vt = np.linalg.svd(np.linalg.qr(rows / length, mode="r"))
    return vt[-1] / length, float(values[rows.shape[1] - 2] / values[0])


def linear_rows(points: Array, pixels: Array) -> Array:
    """Rows (2N, 3(d + 1)) of u (m₃·X) = m₁·X and v (m₃·X) = m₂·X, linear in the entries of a matrix M.

    Parameters
    ----------
    points
        (N, d + 1) homogeneous.
    pixels
        (N, 2).
    """
    zero = np.zeros_like(points)
    in_u = np.column_stack([points, zero, -pixels[:, :1] * points])
    in_v = np.column_stack([zero, points, -pixels[:, 1:] * points])
    return np.concatenate([in_u, in_v])


def fit_homography(points: Array, pixels: Array) -> Array:
    """Homography (3, 3), of norm 1, that maps plane points (N, 2) to pixels (N, 2); N ≥ 4.

    Least algebraic error, conditioned.

    Raises
    ------
    DegenerateInputError
        For fewer than 4 points, or points of which too many lie on a line.
    """
    points, pixels = np.asarray(points, dtype=np.float64), np.asarray(pixels, dtype=np.float64)
    if len(points) < 4 or points.shape != (len(points), 2) or pixels.shape != points.shape:
        raise DegenerateInputError(
            field="points, pixels",
            expected="at least four pairs of shapes (N, 2)",
            seen=f"{points.shape} and {pixels.shape}",
        )
    of_points, of_pixels = conditioning(points), conditioning(pixels)
    x = homogeneous(points) @ of_points.T
    solution, uniqueness = null_vector(linear_rows(x, (homogeneous(pixels) @ of_pixels.T)[:, :2]))
    if uniqueness < 1e-6:
        raise DegenerateInputError(
            field="points", expected="four points of which no three lie on a line", seen="points on a line"
        )
    matrix = np.linalg.inv(of_pixels) @ solution.reshape(3, 3) @ of_points
    return np.asarray(matrix / np.linalg.norm(matrix))
