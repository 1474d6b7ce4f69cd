"""Points of all heads in one table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from alignment.arrays import Array, Index, Mask
from alignment.kernels import njit
from alignment.stereo.correspondence import Candidates

STRETCH = 13
"""Line points that count as one cluster."""


@dataclass(frozen=True, eq=False)
class PointPool:
    """Points of all heads, head after head, each in the order of lines and line points.

    Attributes
    ----------
    points, sigma, rays, spread, light
        (N, 3), (N,), (N, 3), (N,), (N, 3) of `Candidates`.
    group
        (N,) number of the left line point; its candidates stand together.
    cluster
        (N,) number of the stretch of a line.
    line
        (N,) number of the line.
    head
        (N,) number of the head.
    """

    points: Array
    sigma: Array
    rays: Array
    spread: Array
    light: Array
    group: Index
    cluster: Index
    line: Index
    head: Index

    @classmethod
    def of(cls, matched: Sequence[Candidates]) -> PointPool:
        """Put the candidates of all heads together."""
        groups, lines, stretches, heads = [], [], [], []
        next_group = next_line = 0
        for k, c in enumerate(matched):
            groups.append(c.left_point + next_group)
            # Candidates stand in the order of lines and points: another stretch begins where either changes.
            lines.append(c.left_line + next_line)
            stretches.append(lines[-1] * 65536 + c.left_point // STRETCH)
            heads.append(np.full(len(c.points), k))
            next_group += int(c.left_point.max()) + 1
            next_line += int(c.left_line.max()) + 1
        stretch = np.concatenate(stretches)
        return cls(
            points=np.concatenate([c.points for c in matched]),
            sigma=np.concatenate([c.sigma for c in matched]),
            rays=np.concatenate([c.rays for c in matched]),
            spread=np.concatenate([c.spread for c in matched]),
            light=np.concatenate([c.light for c in matched]),
            group=np.concatenate(groups),
            cluster=np.concatenate([[0], np.cumsum(stretch[1:] != stretch[:-1])]),
            line=np.concatenate(lines),
            head=np.concatenate(heads),
        )

    def where(self, mask: Mask) -> PointPool:
        """Return the points of a mask (N,)."""
        return PointPool(
            *take_points(mask, self.points, self.sigma, self.rays, self.spread),
            _take_rows(mask, self.light),
            *(take_numbers(mask, each) for each in (self.group, self.cluster, self.line, self.head)),
        )

    def moved(self, way: Array) -> PointPool:
        """Points moved along their rays by (N,) millimetres."""
        return replace(self, points=self.points + way[:, None] * self.rays)


@njit(cache=True, nogil=True, error_model="numpy")
def _take_rows(mask: Mask, table: Array) -> Array:
    """Return the rows of a table (N, 3) that a mask (N,) tells."""
    out = np.empty((np.count_nonzero(mask), 3))
    k = 0
    for i in range(mask.size):
        if mask[i]:
            out[k, 0], out[k, 1], out[k, 2] = table[i, 0], table[i, 1], table[i, 2]
            k += 1
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def take_points(
    mask: Mask, points: Array, sigma: Array, rays: Array, spread: Array
) -> tuple[Array, Array, Array, Array]:
    """Points, deviations, rays and spreads of a mask (N,); many times faster than masked copies."""
    n = 0
    for i in range(mask.size):
        n += mask[i]
    out, out_sigma, out_rays, out_spread = np.empty((n, 3)), np.empty(n), np.empty((n, 3)), np.empty(n)
    k = 0
    for i in range(mask.size):
        if mask[i]:
            for a in range(3):
                out[k, a] = points[i, a]
                out_rays[k, a] = rays[i, a]
            out_sigma[k], out_spread[k] = sigma[i], spread[i]
            k += 1
    return out, out_sigma, out_rays, out_spread


@njit(cache=True, nogil=True, error_model="numpy")
def take_numbers(mask: Mask, numbers: Index) -> Index:
    """Return the numbers of a mask (N,)."""
    n = 0
    for i in range(mask.size):
        n += mask[i]
    out = np.empty(n, np.int64)
    k = 0
    for i in range(mask.size):
        if mask[i]:
            out[k] = numbers[i]
            k += 1
    return out
