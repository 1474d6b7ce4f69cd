"""Normal equations of the joint adjustment: derivatives, accumulation, the marks eliminated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array, Index
from alignment.calibration.contour import contour_shift
from alignment.calibration.dense import eliminate, leverage
from alignment.calibration.problem import LOCAL, POSE, Problem, State
from alignment.calibration.projection import INTRINSICS, project_with_derivatives
from alignment.kernels import njit


@dataclass(frozen=True, eq=False)
class Linearised:
    """Residuals and derivatives at a working point, all whitened (in standard deviations).

    Attributes
    ----------
    residuals
        (N, 2) projected less observed.
    by_local
        (N, 2, 30) derivatives by camera pose, intrinsics, view pose.
    by_mark
        (N, 2, 3) derivatives by the mark's deviation.
    """

    residuals: Array
    by_local: Array
    by_mark: Array


@njit(cache=True, nogil=True, error_model="numpy")
def _linearise(
    camera: Index,
    view: Index,
    mark: Index,
    pixels: Array,
    whitening: Array,
    radius: Array,
    points: Array,
    rotations: Array,
    centres: Array,
    packed: Array,
    view_rotations: Array,
    view_shifts: Array,
    deviations: Array,
) -> tuple[Array, Array, Array, int]:
    n = camera.size
    residuals = np.zeros((n, 2))
    by_local = np.zeros((n, 2, LOCAL))
    by_mark = np.zeros((n, 2, 3))
    by_point = np.zeros((2, 3))
    by_intrinsics = np.zeros((2, INTRINSICS))
    row = np.zeros((2, LOCAL + 3))
    q, x, d, c = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    along_x, along_y = np.zeros(3), np.zeros(3)
    for i in range(n):
        k, v, m = camera[i], view[i], mark[i]
        rc, rv = rotations[k], view_rotations[v]
        for a in range(3):
            q[a] = points[m, a] + deviations[m, a]
        for a in range(3):
            x[a] = rv[a, 0] * q[0] + rv[a, 1] * q[1] + rv[a, 2] * q[2] + view_shifts[v, a]
            d[a] = x[a] - centres[k, a]
        for a in range(3):
            c[a] = rc[0, a] * d[0] + rc[1, a] * d[1] + rc[2, a] * d[2]
        pu, pv, ok = project_with_derivatives(c[0], c[1], c[2], packed[k], by_point, by_intrinsics)
        if not ok:
            return residuals, by_local, by_mark, i
        if radius[i] > 0.0:
            for a in range(3):
                along_x[a] = rc[0, a] * rv[0, 0] + rc[1, a] * rv[1, 0] + rc[2, a] * rv[2, 0]
                along_y[a] = rc[0, a] * rv[0, 1] + rc[1, a] * rv[1, 1] + rc[2, a] * rv[2, 1]
            du, dv, seen = contour_shift(c, along_x, along_y, radius[i], packed[k])
            if seen:
                pu += du
                pv += dv
        for e in range(2):
            p0, p1, p2 = by_point[e, 0], by_point[e, 1], by_point[e, 2]
            # Camera: X_c → X_c + X_c × ω.
            row[e, 0] = p1 * c[2] - p2 * c[1]
            row[e, 1] = p2 * c[0] - p0 * c[2]
            row[e, 2] = p0 * c[1] - p1 * c[0]
            # Rig frame: along the rows of rig_from_camera.
            g0 = p0 * rc[0, 0] + p1 * rc[0, 1] + p2 * rc[0, 2]
            g1 = p0 * rc[1, 0] + p1 * rc[1, 1] + p2 * rc[1, 2]
            g2 = p0 * rc[2, 0] + p1 * rc[2, 1] + p2 * rc[2, 2]
            row[e, 3], row[e, 4], row[e, 5] = -g0, -g1, -g2
            for a in range(INTRINSICS):
                row[e, POSE + a] = by_intrinsics[e, a]
            h0 = g0 * rv[0, 0] + g1 * rv[1, 0] + g2 * rv[2, 0]
            h1 = g0 * rv[0, 1] + g1 * rv[1, 1] + g2 * rv[2, 1]
            h2 = g0 * rv[0, 2] + g1 * rv[1, 2] + g2 * rv[2, 2]
            # View: q → q + ω × q.
            at = POSE + INTRINSICS
            row[e, at] = h2 * q[1] - h1 * q[2]
            row[e, at + 1] = h0 * q[2] - h2 * q[0]
            row[e, at + 2] = h1 * q[0] - h0 * q[1]
            row[e, at + 3], row[e, at + 4], row[e, at + 5] = g0, g1, g2
            row[e, LOCAL], row[e, LOCAL + 1], row[e, LOCAL + 2] = h0, h1, h2
        ru, rw = pu - pixels[i, 0], pv - pixels[i, 1]
        for e in range(2):
            w0, w1 = whitening[i, e, 0], whitening[i, e, 1]
            residuals[i, e] = w0 * ru + w1 * rw
            for a in range(LOCAL):
                by_local[i, e, a] = w0 * row[0, a] + w1 * row[1, a]
            for a in range(3):
                by_mark[i, e, a] = w0 * row[0, LOCAL + a] + w1 * row[1, LOCAL + a]
    return residuals, by_local, by_mark, -1


def linearise(problem: Problem, state: State) -> Linearised | None:
    """Residuals and derivatives at a working point; None where a camera does not see an observed mark."""
    residuals, by_local, by_mark, failed = _linearise(
        problem.camera,
        problem.view,
        problem.mark,
        problem.pixels,
        problem.whitening,
        problem.radius,
        problem.points,
        state.rotations,
        state.centres,
        state.packed,
        state.view_rotations,
        state.view_shifts,
        state.deviations,
    )
    return None if failed >= 0 else Linearised(residuals, by_local, by_mark)


@njit(cache=True, nogil=True, error_model="numpy")
def _accumulate(
    columns: Index, mark: Index, residuals: Array, by_local: Array, by_mark: Array, weight: Array,
    size: int, marks: int,
) -> tuple[Array, Array, Array, Array, Array]:  # fmt: skip
    matrix = np.zeros((size, size))
    vector = np.zeros(size)
    coupling = np.zeros((marks, 3, size))
    blocks = np.zeros((marks, 3, 3))
    mark_vector = np.zeros((marks, 3))
    used = np.empty(columns.shape[1], np.int64)
    for i in range(mark.size):
        w = weight[i]
        if w <= 0.0:
            continue
        m = mark[i]
        n = 0
        for a in range(columns.shape[1]):
            if columns[i, a] >= 0:
                used[n] = a
                n += 1
        r0, r1 = w * residuals[i, 0], w * residuals[i, 1]
        for s in range(n):
            a = used[s]
            row = columns[i, a]
            j0, j1 = w * by_local[i, 0, a], w * by_local[i, 1, a]
            vector[row] -= by_local[i, 0, a] * r0 + by_local[i, 1, a] * r1
            for t in range(s, n):
                b = used[t]
                matrix[row, columns[i, b]] += j0 * by_local[i, 0, b] + j1 * by_local[i, 1, b]
            for e in range(3):
                coupling[m, e, row] += j0 * by_mark[i, 0, e] + j1 * by_mark[i, 1, e]
        for e in range(3):
            mark_vector[m, e] -= by_mark[i, 0, e] * r0 + by_mark[i, 1, e] * r1
            for f in range(3):
                blocks[m, e, f] += w * (
                    by_mark[i, 0, e] * by_mark[i, 0, f] + by_mark[i, 1, e] * by_mark[i, 1, f]
                )
    for a in range(size):
        for b in range(a):
            matrix[a, b] = matrix[b, a]
    return matrix, vector, coupling, blocks, mark_vector


@dataclass(frozen=True, eq=False)
class Reduced:
    """Normal equations without the marks: (A − Wᵀ V⁻¹ W) x = a − Wᵀ V⁻¹ b.

    Attributes
    ----------
    matrix, vector
        (size, size) and (size,) of the full system's first part, priors included.
    coupling
        (M, 3, size) W: rows of the marks.
    inverse_blocks
        (M, 3, 3) V⁻¹.
    mark_vector
        (M, 3) b.
    """

    matrix: Array
    vector: Array
    coupling: Array
    inverse_blocks: Array
    mark_vector: Array

    def schur(self) -> tuple[Array, Array]:
        """Return the reduced matrix (size, size) and right side (size,)."""
        matrix, vector = eliminate(
            self.matrix, self.vector, self.coupling, self.inverse_blocks, self.mark_vector
        )
        return matrix, vector

    def back_substitute(self, step: Array) -> Array:
        """Step (M, 3) of the marks that belongs to a step (size,) of the others."""
        rest = self.mark_vector - np.einsum("mea,a->me", self.coupling, step)
        out: Array = np.einsum("mij,mj->mi", self.inverse_blocks, rest)
        return out


def _add_priors(problem: Problem, state: State, matrix: Array, vector: Array) -> None:
    """Add the priors of lens terms, view poses and stage axes."""
    columns = problem.camera_columns[:, 10:]
    known = columns >= 0
    weight = problem.coefficient_sigma[known] ** -2
    np.add.at(matrix, (columns[known], columns[known]), weight)
    np.add.at(vector, columns[known], -weight * state.packed[:, 6:][known])
    for residual, sigma, derivatives in _view_priors(problem, state):
        for e in range(len(residual)):
            row = derivatives[e]
            for a, ja in row:
                vector[a] -= ja * residual[e] / sigma**2
                for b, jb in row:
                    matrix[a, b] += ja * jb / sigma**2
    if problem.axes_columns[0] >= 0:
        at = problem.axes_columns
        matrix[at, at] += problem.priors.stage_axes**-2
        vector[at] -= _rotvec(state.axes) / problem.priors.stage_axes**2


Prior = tuple[Array, float, list[list[tuple[int, float]]]]


def _view_priors(problem: Problem, state: State) -> list[Prior]:
    """Residual (3,), sigma and derivatives of each prior of a view's pose."""
    out: list[Prior] = []
    for v, stage in enumerate(problem.stage):
        if np.isnan(stage[0]):
            continue
        turn, shift = problem.view_columns[v, :3], problem.view_columns[v, 3:]
        if turn[0] >= 0:
            rows = [[(int(turn[e]), 1.0)] for e in range(3)]
            out.append((_rotvec(state.view_rotations[v]), problem.priors.view_tilt, rows))
        if shift[0] >= 0:
            nominal = state.axes @ stage
            rows = [[(int(shift[e]), 1.0)] for e in range(3)]
            if problem.axes_columns[0] >= 0:
                x, y, z = nominal
                cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
                for e in range(3):
                    rows[e] += [
                        (int(problem.axes_columns[a]), float(cross[e, a])) for a in range(3) if a != e
                    ]
            out.append((state.view_shifts[v] - nominal, problem.data.stage_sigma_mm, rows))
    return out


def _rotvec(rotation: Array) -> Array:
    """Rotation vector (3,) of a small rotation: its skew part."""
    skew = 0.5 * (rotation - rotation.T)
    return np.array([skew[2, 1], skew[0, 2], skew[1, 0]])


def prior_cost(problem: Problem, state: State) -> float:
    """Sum of the squares of all priors' residuals in their standard deviations."""
    known = problem.camera_columns[:, 10:] >= 0
    total = float(np.square(state.packed[:, 6:][known] / problem.coefficient_sigma[known]).sum())
    total += float(np.square(state.deviations / problem.mark_sigma).sum())
    for residual, sigma, _ in _view_priors(problem, state):
        total += float(residual @ residual) / sigma**2
    if problem.axes_columns[0] >= 0:
        total += float(np.square(_rotvec(state.axes) / problem.priors.stage_axes).sum())
    return total


def normal_equations(problem: Problem, state: State, at: Linearised, weight: Array) -> Reduced:
    """Accumulate the normal equations with weights (N,) of the whitened observations."""
    matrix, vector, coupling, blocks, mark_vector = _accumulate(
        problem.columns, problem.mark, at.residuals, at.by_local, at.by_mark, weight,
        problem.size, len(problem.marks),
    )  # fmt: skip
    _add_priors(problem, state, matrix, vector)
    information = problem.mark_sigma**-2
    blocks[:, range(3), range(3)] += information
    mark_vector -= information * state.deviations
    inverse: Array = np.linalg.inv(blocks).astype(np.float64)
    return Reduced(matrix, vector, coupling, inverse, mark_vector)


def leverages(problem: Problem, at: Linearised, weight: Array, reduced: Reduced, covariance: Array) -> Array:
    """(N,) share of each observation, of its two equations, that the unknowns take up (0 to 2).

    Parameters
    ----------
    problem, at, weight, reduced
        Normal equations, and the weights (N,) and derivatives of which they were made.
    covariance
        (size, size) inverse of the reduced matrix.
    """
    out: Array = leverage(
        problem.columns,
        problem.mark,
        at.by_local,
        at.by_mark,
        weight,
        reduced.coupling,
        reduced.inverse_blocks,
        covariance,
    )
    return out
