"""The steering axis of a front wheel from a sweep: caster, kingpin inclination, trail and scrub radius."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import f as f_distribution

from alignment.arrays import Array
from alignment.counting import count_of
from alignment.errors import DegenerateInputError
from alignment.units import ARCMIN, in_arcminutes
from alignment.values import Refusal, RefusalCode, Side
from alignment.vehicle.angles import SIGN
from alignment.vehicle.steering_model import (
    KnownBeside,
    SweepSeen,
    TurnedWheel,
    first_direction,
    quantities,
    tangents,
    turned,
    upward,
)
from alignment.vehicle.steering_spread import SweepSpread, covariance_of, spread_of
from alignment.vehicle.steering_values import (
    MOST_POSITIONS,
    RunOut,
    SteeredWheel,
    SteeringAxis,
    SteeringRules,
    SteeringStand,
    steered,
)

_SAME_ANGLE = math.radians(0.05)  # positions that are nearer are one
_MOST_LEAN = math.radians(30.0)  # of a steering axis
_WORST_RMS = 3.0 * ARCMIN  # by which normals may leave a plane; more is no wheel that is steered
_ROUNDS, _SETTLED = 20, 1e-14
_BY_CHANCE = 1e-3  # below this a pattern of the residuals counts
_UNSTATED_SCATTER = 3.0  # times what is stated
_PATTERN = (3, 4)  # orders in the steering angle; lower ones look like another axis


def steering_axis(
    series: Sequence[SteeredWheel],
    stand: SteeringStand | None = None,
    rules: SteeringRules | None = None,
    run_out: RunOut | None = None,
) -> SteeringAxis | Refusal:
    """Return the axis about which one front wheel is steered.

    Its direction k is the one for which k · n is the same for all axes n: the smallest singular vector of the
    centred normals to begin with, then the least squares weighted by the covariance of all positions
    together. Its place follows from the circle of the wheel's centres.

    Parameters
    ----------
    series
        The wheel at positions of the steering, in any order.
    stand
        Thrust line, wheel supports, tyre.
    rules
        What the sweep must be.
    run_out
        Where tyre planes were measured: how they lean from the spin axis. None for spin axes, and for wheels
        that do not roll.

    Returns
    -------
    SteeringAxis or Refusal
        One reason: too few positions, too small a sweep, a result not as sure as asked, or no steering axis.

    Raises
    ------
    DegenerateInputError
        When positions are of both sides, there are too many, their common parts do not match, or a run-out is
        to roll without a road and a tyre width.
    """
    stand, rules = stand or SteeringStand(), rules or SteeringRules()
    _check(series, stand, run_out)
    seen = SweepSeen(
        series[0].axis.side if series else "left",
        np.array([[w.axis.camber, w.axis.toe, *w.axis.point] for w in series]).reshape(-1, 5),
    )
    refusal = _too_small(seen, stand, rules)
    if refusal is not None:
        return refusal
    known = KnownBeside.of(stand, run_out)
    direction = first_direction(seen.normals)
    if direction[2] < math.cos(_MOST_LEAN):
        return _no_axis(f"it would lean by {math.degrees(math.acos(direction[2])):.0f}° from upright")
    spread = spread_of(series, seen, direction, rules)
    fitted = _fitted(seen, known, direction, spread)
    here, solve = fitted.here, fitted.solve
    rms = float(np.sqrt(np.mean(np.square(here.residuals))))
    if here.direction[2] < math.cos(_MOST_LEAN) or rms > _WORST_RMS:
        return _no_axis(f"the angle between wheel and axis scatters by {in_arcminutes(rms)}")
    judged = _judged(here, spread)
    scaled = replace(spread, scale=max(1.0, judged.scatter) ** 2)
    covariance = covariance_of(
        seen, known, here, solve, scaled, _Unknowns(stand, run_out).columns(), judged.unseen
    )
    found = _result(here, seen, known, covariance, judged, rules)
    unsure = _not_sure(found, rules)
    # A refusal is false.
    return found if unsure is None else unsure


@dataclass(frozen=True)
class _Unknowns:
    """What is known beside the sweep, but not exactly."""

    stand: SteeringStand
    run_out: RunOut | None

    def columns(self) -> list[dict[str, float]]:
        """Independent errors, one standard deviation each, by the numbers of `KnownBeside`."""
        out = [{"heading": self.stand.heading_u}]
        if self.stand.tyre_width_mm is not None:
            out.append({"width_mm": self.stand.tyre_width_sigma_mm})
        if self.run_out is not None:
            values, vectors = np.linalg.eigh(self.run_out.covariance)
            out += [
                {"run_out.0": float(root * vector[0]), "run_out.1": float(root * vector[1])}
                for root, vector in zip(np.sqrt(np.maximum(values, 0.0)), vectors.T, strict=True)
            ]
        return out


@dataclass(frozen=True, eq=False)
class _Fitted:
    """The wheel about its axis; (2, N) what errors of k · n make of the direction, along `tangents`."""

    here: TurnedWheel
    solve: Array


@dataclass(frozen=True)
class _Judged:
    """What residuals say, as `SteeringAxis`; `unseen`: what a pattern may hide in lower orders, radians."""

    scatter: float
    pattern: float
    pattern_p: float
    unseen: float
    warning: str | None


def _check(series: Sequence[SteeredWheel], stand: SteeringStand, run_out: RunOut | None) -> None:
    if len(series) > MOST_POSITIONS:
        raise DegenerateInputError(
            field="series", expected=f"at most {MOST_POSITIONS} positions", seen=str(len(series))
        )
    sides = sorted({wheel.axis.side for wheel in series})
    if len(sides) > 1:
        raise DegenerateInputError(field="series", expected="one wheel", seen="wheels of both sides")
    sizes = sorted({wheel.common.shape[1] for wheel in series})
    if len(sizes) > 1:
        raise DegenerateInputError(
            field="common",
            expected="the same errors at all positions",
            seen=f"from {sizes[0]} to {sizes[-1]} of them",
        )
    if run_out is not None and stand.rolls and (stand.road_z_mm is None or stand.tyre_width_mm is None):
        raise DegenerateInputError(
            field="run_out",
            expected="the height of the wheel supports and the width of the tyre, by which a run-out rolls",
            seen="none",
            cure="State them, or hold the brakes while the steering is turned.",
        )


def _too_small(seen: SweepSeen, stand: SteeringStand, rules: SteeringRules) -> Refusal | None:
    toes = seen.state[:, 1] + SIGN[seen.side] * stand.heading
    angles = np.sort(steered(toes, seen.side, stand.straight_toe))
    left, right = (float(angles[-1]), float(-angles[0])) if len(angles) else (0.0, 0.0)
    if len(angles) and min(left, right) < rules.least_angle:
        return Refusal(
            RefusalCode.SWEEP_TOO_SMALL,
            f"the wheel was steered {math.degrees(left):.1f}° to the left and {math.degrees(right):.1f}° to "
            f"the right of straight ahead, at least {math.degrees(rules.least_angle):g}° to both sides are "
            "needed; turn the steering farther",
        )
    steps = np.diff(angles)
    different = int(np.count_nonzero(steps > _SAME_ANGLE)) + 1 if len(angles) else 0
    if different < rules.fewest:
        return Refusal(
            RefusalCode.TOO_FEW_POSITIONS,
            f"{count_of(different, 'different position')} of the steering, at least {rules.fewest} are "
            "needed; turn the steering more slowly, or take more exposures",
        )
    if steps.max() > rules.widest_gap:
        return Refusal(
            RefusalCode.TOO_FEW_POSITIONS,
            f"between two neighbouring positions of the steering lie {math.degrees(steps.max()):.1f}°, "
            f"at most {math.degrees(rules.widest_gap):g}° may; turn the steering evenly",
        )
    return None


def _no_axis(what: str) -> Refusal:
    return Refusal(
        RefusalCode.NO_STEERING_AXIS,
        f"the wheel does not turn about one steering axis: {what}; check that nobody moved the vehicle, that "
        "its wheels stand on turn plates, and that all positions are of one sweep",
    )


def _fitted(seen: SweepSeen, known: KnownBeside, direction: Array, spread: SweepSpread) -> _Fitted:
    weight = spread.weight
    for _ in range(_ROUNDS):
        here = turned(seen, known, direction)
        rows = np.column_stack([here.normals @ tangents(direction).T, np.ones(len(here.angles))])
        solve = np.linalg.solve(rows.T @ weight @ rows, rows.T @ weight)[:2]
        step = -solve @ here.residuals
        direction = upward(direction + step @ tangents(direction))
        if np.abs(step).max() < _SETTLED:
            break
    return _Fitted(turned(seen, known, direction), np.asarray(solve))


def _judged(here: TurnedWheel, spread: SweepSpread) -> _Judged:
    """Judge residuals: their size against what is stated, and whether they follow the steering angle."""
    weight = spread.weight
    u = here.angles / np.abs(here.angles).max()
    one_axis = np.column_stack([here.normals @ tangents(here.direction).T, np.ones(len(u))])
    bent = np.column_stack([one_axis, *(u**order for order in _PATTERN)])
    normal = bent.T @ weight @ bent
    found = np.linalg.solve(normal, bent.T @ weight @ here.residuals)
    left = here.residuals - bent @ found
    freedom = len(u) - bent.shape[1]
    scatter = math.sqrt(float(left @ weight @ left) / freedom)
    size = max(scatter, 1.0)
    part = found[3:]
    statistic = float(part @ np.linalg.solve(np.linalg.inv(normal)[3:, 3:], part)) / len(_PATTERN) / size**2
    chance = float(f_distribution.sf(statistic, len(_PATTERN), freedom))
    # What of the pattern no axis takes for itself.
    shape = bent[:, 3:] @ part
    shape = shape - one_axis @ np.linalg.lstsq(one_axis, shape, rcond=None)[0]
    pattern = float(np.abs(shape).max())
    if chance < _BY_CHANCE:
        return _Judged(
            scatter, pattern, chance, float(np.abs(part).max()),
            "the axis moves while the wheel turns: its angle to the wheel leaves that to a fixed axis by "
            f"{in_arcminutes(pattern)} in step with the steering; caster and kingpin inclination are less "
            "sure by what that may hide; check joints and bushings",
        )  # fmt: skip
    warning = None
    if scatter > _UNSTATED_SCATTER:
        warning = (
            f"the positions scatter {scatter:.1f} times as much as is stated of them; check that nothing "
            "moved while they were taken"
        )
    return _Judged(scatter, pattern, chance, 0.0, warning)


def _result(
    here: TurnedWheel,
    seen: SweepSeen,
    known: KnownBeside,
    covariance: Array,
    judged: _Judged,
    rules: SteeringRules,
) -> SteeringAxis:
    toes = seen.state[:, 1] + SIGN[seen.side] * known.heading
    turns = steered(toes, seen.side, known.straight_toe)
    return SteeringAxis(
        side=seen.side,
        direction=here.direction,
        point=here.point,
        values=quantities(here, seen.side, known.heading),
        covariance=covariance,
        angles=here.angles,
        toes=toes,
        straight_toe=known.straight_toe,
        residuals=here.residuals,
        scatter=judged.scatter,
        axial_mm=here.axial,
        pattern=judged.pattern,
        pattern_p=judged.pattern_p,
        warning=judged.warning,
        classic_caster=classic_caster(seen.state[:, 0], turns, seen.side),
        coverage_factor=rules.coverage_factor,
    )


def classic_caster(camber: Array, angles: Array, side: Side) -> float:
    """Caster by (γ₁ − γ₂) / (2 sin δ): camber at the same angle to both sides, and nothing else, radians.

    For comparison with other instruments only: it errs by minutes of arc, and knows no kingpin inclination.
    """
    order = np.argsort(angles)
    reach = float(min(angles.max(), -angles.min()))
    left, right = np.interp([reach, -reach], angles[order], camber[order])
    return SIGN[side] * float(left - right) / (2.0 * math.sin(reach))


def _not_sure(found: SteeringAxis, rules: SteeringRules) -> Refusal | None:
    for name, words, most in (
        ("caster", "caster", rules.caster_u95),
        ("kpi", "kingpin inclination", rules.kpi_u95),
    ):
        u95 = found.u95(name)
        if not u95 <= most:
            because = "" if found.warning is None else f" ({found.warning})"
            return Refusal(
                RefusalCode.SWEEP_TOO_SMALL,
                f"{words} would be known to ±{in_arcminutes(u95)}, asked are ±{in_arcminutes(most)}{because}"
                "; turn the steering farther, and take more positions",
            )
    return None
