"""How sure a steering axis is: errors of all positions together, carried through to angles and lengths."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from alignment.arrays import Array
from alignment.vehicle.steering_model import (
    KnownBeside,
    SweepSeen,
    TurnedWheel,
    circle_rows,
    normals_by_angles,
    quantities,
    residuals_of,
    roll_of,
    tangents,
    turned,
    turned_with,
    upward,
)
from alignment.vehicle.steering_values import SteeredWheel, SteeringRules
from alignment.vehicle.wheel_axes import AXIS_SIZE

_LEAST_SIGMA = 1e-10  # radians; positions without any noise have weights too
_SCRUB_STEP = 0.01  # mm
_STEP, _STEP_MM = 1e-6, 1e-3  # of derivatives


@dataclass(frozen=True, eq=False)
class SweepSpread:
    """Errors of N positions.

    Attributes
    ----------
    own
        (N, 5, 5) covariance of each alone.
    common
        (N, 5, M) what independent errors of unit size do at all positions: those of the calibration, then
        those of the load.
    by_angles
        (N, 2) change of k · n by camber and toe.
    scale
        By which the own covariances are larger than stated.
    """

    own: Array
    common: Array
    by_angles: Array
    scale: float = 1.0

    @cached_property
    def weight(self) -> Array:
        """(N, N) inverse of the covariance of k · n at all positions."""
        alone = np.einsum("na,nab,nb->n", self.by_angles, self.own[:, :2, :2], self.by_angles)
        shared = np.einsum("na,nam->nm", self.by_angles, self.common[:, :2])
        whole = np.diag(alone + _LEAST_SIGMA**2) + shared @ shared.T
        out: Array = np.linalg.inv(whole)
        return out


def spread_of(
    series: Sequence[SteeredWheel], seen: SweepSeen, direction: Array, rules: SteeringRules
) -> SweepSpread:
    """Return the errors of positions; what is not known of the load drifts with the steering angle."""
    camber, toe = seen.state[:, 0], seen.state[:, 1]
    by_angles: Array = np.einsum("a,nab->nb", direction, normals_by_angles(camber, toe, seen.side))
    loads = [wheel.load_covariance for wheel in series if wheel.load_covariance is not None]
    common = np.array([wheel.common for wheel in series])
    if loads:
        root = _root(np.mean(loads, axis=0))
        steered = toe - 0.5 * (toe.min() + toe.max())
        u = steered / np.abs(steered).max()
        orders = np.column_stack([np.ones(len(u)), rules.load_drift * u, rules.load_drift * u**2])
        load = np.zeros((len(u), AXIS_SIZE, 2 * orders.shape[1]))
        load[:, :2] = np.einsum("ab,no->naob", root, orders).reshape(len(u), 2, -1)
        common = np.concatenate([common, load], axis=2)
    return SweepSpread(np.array([wheel.axis.covariance for wheel in series]), common, by_angles)


def _root(covariance: Array) -> Array:
    """(n, n) whose product with its transpose is a covariance."""
    values, vectors = np.linalg.eigh(covariance)
    out: Array = vectors * np.sqrt(np.maximum(values, 0.0))
    return out


def covariance_of(
    seen: SweepSeen,
    known: KnownBeside,
    here: TurnedWheel,
    solve: Array,
    spread: SweepSpread,
    unknowns: Sequence[Mapping[str, float]],
    unseen: float,
) -> Array:
    """(Q, Q) covariance of the quantities that are known, in their order.

    Parameters
    ----------
    seen, known, here
        Positions, and the wheel about its axis.
    solve
        (2, N) what errors of k · n make of the direction.
    spread
        Errors of the positions.
    unknowns
        One standard deviation each of independent errors of `known`.
    unseen
        Size, radians, that systematic errors of k · n may have in the first and the second order of the
        steering angle, which no residual shows.
    """
    asked = _Asked(seen, known, here, solve)
    by_state = asked.by_state()
    columns = [np.einsum("qna,nam->qm", by_state, spread.common)]
    columns += [asked.by_known(error)[:, None] for error in unknowns]
    if unseen:
        u = here.angles / np.abs(here.angles).max()
        columns += [asked.by_residuals(unseen * u**order)[:, None] for order in (1, 2)]
    shared = np.concatenate(columns, axis=1)
    out: Array = (
        spread.scale * np.einsum("qna,nab,pnb->qp", by_state, spread.own, by_state) + shared @ shared.T
    )
    return out


class _Asked:
    """Derivatives of the quantities, by differences of fit and model about the solution."""

    def __init__(self, seen: SweepSeen, known: KnownBeside, here: TurnedWheel, solve: Array) -> None:
        self._seen, self._known, self._here, self._solve = seen, known, here, solve
        self._names = list(quantities(here, seen.side, known.heading))

    def by_state(self) -> Array:
        """(Q, N, 5) by what was measured at each position."""
        here, state = self._here, self._seen.state
        count = len(state)
        by_angles = normals_by_angles(state[:, 0], state[:, 1], self._seen.side)
        along = np.einsum("a,nab->nb", here.direction, by_angles)
        out = np.zeros((len(self._names), count, 5))
        # The direction as fitted; then, about that direction, the wheel's lean to it, and its place.
        by_direction = np.array([self._difference(direction=t) for t in tangents(here.direction)])
        out[:, :, :2] -= np.einsum("tq,tn,nb->qnb", by_direction, self._solve, along)
        by_cosine = self._difference(cosine=1.0)
        out[:, :, :2] += by_cosine[:, None, None] * along / count
        by_place = np.array([self._difference(place=row) for row in np.eye(5)])
        out += np.einsum("pq,npb->qnb", by_place, self._place_by_state(by_angles, along))
        if self._known.turns_a_lean and "scrub" in self._names:
            # A scrub radius that is off makes another roll, and so another axis.
            scrub = out[self._names.index("scrub")].copy()
            out += self._by_roll()[:, None, None] * scrub
        return out

    def _place_by_state(self, by_angles: Array, along: Array) -> Array:
        """(N, 5, 5) change of the circle's middle and radius and of the mean place along the axis."""
        here, known = self._here, self._known
        count = len(here.angles)
        half = 0.0 if known.width_mm is None else 0.5 * known.width_mm
        across = tangents(here.direction)
        solve = np.linalg.pinv(circle_rows(here.angles)).reshape(4, 2, count).transpose(2, 0, 1)
        flat = here.normals @ across.T
        level = np.column_stack([-flat[:, 1], flat[:, 0]]) / np.square(flat).sum(axis=1)[:, None]
        angle = np.einsum("nt,ta,nab->nb", level, across, by_angles)
        x, y = here.radius
        cosine, sine = np.cos(here.angles), np.sin(here.angles)
        way = np.column_stack([-sine * x - cosine * y, cosine * x - sine * y])
        out = np.zeros((count, 5, 5))
        out[:, :4, 2:] = solve @ across
        out[:, :4, :2] = -half * solve @ across @ by_angles
        out[:, :4, :2] -= np.einsum("npt,nt,nb->npb", solve, way, angle)
        out[:, 4, 2:] = here.direction / count
        out[:, 4, :2] = -half * along / count
        return out

    def _difference(
        self, direction: Array | None = None, cosine: float = 0.0, place: Array | None = None
    ) -> Array:
        """(Q,) by a change of what is fitted, the positions being what they are."""
        there = []
        for sign in (_STEP, -_STEP):
            turn = np.zeros(3) if direction is None else sign * direction
            off = np.zeros(5) if place is None else _STEP_MM / _STEP * sign * place
            moved = turned_with(
                self._seen,
                self._known,
                upward(self._here.direction + turn),
                self._here.roll,
                sign * cosine,
                off,
            )
            there.append(np.array(list(quantities(moved, self._seen.side, self._known.heading).values())))
        out: Array = (there[0] - there[1]) / (2.0 * (_STEP if place is None else _STEP_MM))
        return out

    def by_known(self, error: Mapping[str, float]) -> Array:
        """(Q,) change by an error of what is known beside."""
        out: Array = 0.5 * np.subtract(
            *[self._solved(self._known.changed(error, sign)) for sign in (1.0, -1.0)]
        )
        return out

    def by_residuals(self, errors: Array) -> Array:
        """(Q,) change by errors (N,) of k · n."""
        out: Array = 0.5 * np.subtract(
            *[
                self._told(self._moved(sign * errors + self._here.residuals), self._seen, self._known)
                for sign in (1.0, -1.0)
            ]
        )
        return out

    def _by_roll(self) -> Array:
        roll = roll_of(self._here, self._known, self._seen.side, _SCRUB_STEP)
        out: Array = (self._about(self._seen, roll) - self._about(self._seen)) / _SCRUB_STEP
        return out

    def _about(self, seen: SweepSeen, roll: Array | None = None) -> Array:
        """Quantities by other positions or another roll, the direction fitted again."""
        roll = self._here.roll if roll is None else roll
        residuals = residuals_of(seen.normals - roll, self._here.direction)
        return self._told(self._moved(residuals), seen, self._known, roll)

    def _solved(self, known: KnownBeside) -> Array:
        there = turned(self._seen, known, self._here.direction)
        return self._told(self._moved(there.residuals), self._seen, known, there.roll)

    def _moved(self, residuals: Array) -> Array:
        """(3,) direction fitted to residuals that were those of the solution before they changed."""
        across = tangents(self._here.direction)
        return upward(self._here.direction - self._solve @ (residuals - self._here.residuals) @ across)

    def _told(
        self, direction: Array, seen: SweepSeen, known: KnownBeside, roll: Array | None = None
    ) -> Array:
        roll = self._here.roll if roll is None else roll
        there = turned_with(seen, known, direction, roll)
        return np.array(list(quantities(there, seen.side, known.heading).values()))
