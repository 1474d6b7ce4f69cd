"""A series: exposures of one wheel that rollers turn, which wanders slowly meanwhile, and why it is none.

The mean spin axis over the exposures, the run-out and where it stands out. What is not a series of one
wheel is told apart, each with its own reason: exposures that are missing or came twice, another wheel among
them, a turn too short, something that is not slow.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array, Mask
from alignment.counting import count_of
from alignment.errors import DegenerateInputError
from alignment.units import ARCMIN
from alignment.values import Refusal, RefusalCode, Side, WheelMeasurement
from alignment.vehicle.angles import camber_toe, camber_toe_jacobian
from alignment.wheel.normals import Scatter, normals_of
from alignment.wheel.places import jump_of_place
from alignment.wheel.spin import SHORTEST_TURN, SpinMeasurement, covered_by
from alignment.wheel.wander import WanderingCone, fit_wandering_cone

FEWEST_EXPOSURES, MOST_EXPOSURES = 12, 64
"""Of a series; fewer cannot tell a wander from a run-out."""
LEAST_TURN = math.radians(600.0)
"""From the first exposure to the last, unless somebody says otherwise: a wander of ±3′ then costs the mean
axis 0.1′ (95 %), and twice that when they go round once."""
_LEAST_PART = math.radians(270.0)
_MOST_STEP = math.radians(170.0)
_LARGEST_REST = 0.15 * ARCMIN  # of normals that are neither cone nor slow way
_HEALED = 0.25  # of the rest, that may be left without the one exposure that is to blame
_UNEVEN = 0.12  # radians by which a turn may be uneven where it is taken for steady, root mean square
_FARTHEST_WAY = math.radians(0.15)
_CLEAR = 3.5  # run-out in its standard uncertainties, above which it is real
_HIDDEN = 0.5  # of the way, that a run-out may have and stay unseen
_LEFT = 0.1  # of a hidden run-out, that is left in the mean of a full turn
_RECENTRED, _FLAT = 3, 1e-3 * ARCMIN


@dataclass(frozen=True)
class SeriesRules:
    """What a series must be.

    Attributes
    ----------
    exposures
        How many it has, from 12 to 64.
    least_turn
        Least turn of the wheel from the first of them to the last, radians. They must also cover as much of
        the circle, a full turn less the largest gap, but no more of it than 270°.

    Raises
    ------
    DegenerateInputError
        When one of them is out of its bounds.
    """

    exposures: int = 16
    least_turn: float = LEAST_TURN

    def __post_init__(self) -> None:
        if not FEWEST_EXPOSURES <= self.exposures <= MOST_EXPOSURES:
            raise DegenerateInputError(
                field="exposures",
                expected=f"{FEWEST_EXPOSURES} to {MOST_EXPOSURES}",
                seen=f"{self.exposures}",
            )
        most = most_turn(self.exposures)
        if not SHORTEST_TURN <= self.least_turn <= most:
            raise DegenerateInputError(
                field="least_turn",
                expected=f"{math.degrees(SHORTEST_TURN):.0f} to the {math.degrees(most):.0f}° that "
                f"{self.exposures} exposures can tell of",
                seen=f"{math.degrees(self.least_turn):g}°",
            )


def most_turn(exposures: int) -> float:
    """Longest turn that so many exposures tell of, radians: beyond half a turn from each to the next it looks
    like one the other way round."""
    return _MOST_STEP * (exposures - 1)


def fit_series(
    measurements: Sequence[WheelMeasurement],
    side: Side,
    rules: SeriesRules,
    common_covariance: Array | None = None,
    numbers: Sequence[int] | None = None,
    turned: Callable[[], bool] | None = None,
    heads: Array | None = None,
) -> SpinMeasurement | Refusal:
    """Fit the mean spin axis of a wheel to tyre planes taken while it turned and wandered.

    Parameters
    ----------
    measurements
        Tyre planes of one rig, in the order in which they were taken.
    side
        Side of the vehicle.
    rules
        What is asked of the series.
    common_covariance
        (2, 2) part of every exposure's `angle_covariance` that all share, radians². What they do not know of
        a load is shared too, since it does not turn, and is added here.
    numbers
        Of the exposures, as the cameras counted them; None: 1, 2, 3, …
    turned
        Tells whether the images show that the wheel turned; asked only where there is no run-out to show it.
        None where nothing can tell.
    heads
        (H,) where the heads look at the wheel, radians, counted as the phases; None: three evenly.

    Returns
    -------
    SpinMeasurement or Refusal
        A refusal says which exposure is to blame, where one is.
    """
    counted = list(range(1, len(measurements) + 1)) if numbers is None else list(numbers)
    wrong = miscounted(counted, rules.exposures)
    if wrong is not None:
        return wrong
    off, onto = shared(measurements, common_covariance)
    at = np.array(counted, dtype=np.float64)
    scatter, cone = _recentred(Scatter.of(measurements, side, off), at, heads)
    wrong = jump_of_place(np.array([m.centre for m in measurements]), at, counted)
    if wrong is None:
        wrong = _astray(scatter, cone, at, counted, heads)
    if wrong is not None:
        return wrong
    found = spin_of(scatter, cone, side, onto, measurements)
    if found.run_out is None:
        return found if turned is not None and turned() else _no_turn(turned is not None)
    short = _short_of(rules, found)
    return found if short is None else short


def fit_turning_axis(
    measurements: Sequence[WheelMeasurement],
    side: Side,
    common_covariance: Array | None = None,
    heads: Array | None = None,
) -> SpinMeasurement | None:
    """As `fit_series`, without rules; None where a slow wander does not explain these planes.

    For shots of which nothing is known but their order, at least twelve.
    """
    if len(measurements) < FEWEST_EXPOSURES:
        return None
    off, onto = shared(measurements, common_covariance)
    at = np.arange(len(measurements), dtype=np.float64)
    scatter, cone = _recentred(Scatter.of(measurements, side, off), at, heads)
    if _rests(cone) or cone.farthest > _FARTHEST_WAY or not cone.free:
        return None
    return spin_of(scatter, cone, side, onto, measurements)


def miscounted(numbers: Sequence[int], exposures: int) -> Refusal | None:
    """Refuse a series of which exposures are missing, came twice or in another order."""
    seen: set[int] = set()
    for number in numbers:
        if number in seen:
            return Refusal(
                RefusalCode.EXPOSURE_DOUBLED,
                f"exposure {number} came twice; check the trigger of the cameras, and measure again",
            )
        seen.add(number)
    missing = sorted(set(range(min(numbers, default=1), max(numbers, default=0) + 1)) - seen)
    if missing:
        return Refusal(
            RefusalCode.EXPOSURE_MISSING,
            f"exposure {', '.join(map(str, missing[:5]))}{' …' if missing[5:] else ''} is missing between "
            f"{min(numbers)} and {max(numbers)}; check the cameras, and measure again",
        )
    if len(numbers) != exposures:
        return Refusal(
            RefusalCode.EXPOSURE_MISSING if len(numbers) < exposures else RefusalCode.EXPOSURE_DOUBLED,
            f"{count_of(len(numbers), 'exposure')} of the turning wheel, {exposures} were asked for; check "
            "the cameras, and measure again",
        )
    if list(numbers) != sorted(numbers):
        return Refusal(
            RefusalCode.INCONSISTENT_SHOTS,
            f"the exposures came in the order {', '.join(map(str, numbers[:5]))} …; a wander that is slow "
            "needs them as they were taken",
        )
    return None


def shared(measurements: Sequence[WheelMeasurement], common: Array | None) -> tuple[Array, Array]:
    """What all exposures do not know alike: what is taken off the noise of each, and put onto the axis.

    Both (2, 2), radians²: that of the calibration, and of a load, which does not turn and so does not average
    out. Off the noise goes only so much of it that each exposure keeps a noise of its own.
    """
    own = np.zeros((2, 2)) if common is None else common
    known = [m.load_covariance for m in measurements if m.load_covariance is not None]
    if not known:
        return own, own
    onto = own + np.mean(known, axis=0)
    if len(known) < len(measurements):
        return own, onto
    least = min(known, key=lambda share: float(np.trace(share)))
    largest = max(
        float(np.linalg.eigvals(np.linalg.solve(m.angle_covariance - own, least)).real.max())
        for m in measurements
    )
    return own + min(1.0, 0.98 / largest) * least, onto


def spin_of(
    scatter: Scatter, cone: WanderingCone, side: Side, common: Array, measurements: Sequence[WheelMeasurement]
) -> SpinMeasurement:
    """Return the spin axis that a cone about the frame of a scatter stands for."""
    turn = camber_toe_jacobian(scatter.frame[2], side) @ scatter.frame[:2].T
    camber, toe = camber_toe(scatter.frame[2], side)
    run_out, run_out_u = cone.radius, math.sqrt(cone.covariance[2, 2])
    clear = run_out > _CLEAR * max(run_out_u, scatter.sigma)
    tilts = cone.covariance[:2, :2]
    phases: tuple[float, ...] | None = None
    if clear:
        phases = tuple(math.remainder(float(phase), 2.0 * math.pi) for phase in cone.phases)
    else:
        # As large as it may be and not be seen; over a whole turn its mean is small.
        run_out_u = max(scatter.sigma, _HIDDEN * cone.farthest, run_out)
        tilts = tilts + (_LEFT * run_out_u) ** 2 * np.eye(2)
    twice = float(np.linalg.norm(cone.twice, axis=1).max())
    across = np.sqrt(np.maximum(cone.across, 0.0) + scatter.sigma**2 + cone.rest**2)
    return SpinMeasurement(
        camber=camber,
        toe=toe,
        angle_covariance=turn @ tilts @ turn.T + common,
        run_out=run_out if clear else None,
        run_out_u=run_out_u,
        phases=phases,
        covered_turn=None if phases is None else covered_by(np.array(phases)),
        used=(True,) * len(measurements),
        coverage_factor=measurements[0].coverage_factor,
        degraded=any(m.degraded for m in measurements),
        phases_u=None if phases is None else tuple(map(float, across / run_out)),
        wander=cone.farthest,
        turned=float(cone.phases[-1] - cone.phases[0]) if clear else None,
        scatter=cone.rest,
        twice=twice if twice > 0.0 else None,
    )


def _recentred(scatter: Scatter, at: Array, heads: Array | None) -> tuple[Scatter, WanderingCone]:
    """Fit, and look again from the axis found, from where distances are exact."""
    cone = fit_wandering_cone(scatter.points, scatter.noise, at, heads)
    for _ in range(_RECENTRED):
        # By so much a plane shortens the arcs of the sphere.
        if float(np.abs(cone.centre).max()) * cone.radius**2 / 6.0 < _FLAT:
            break
        scatter = scatter.about(_axis(scatter, cone.centre))
        cone = fit_wandering_cone(scatter.points, scatter.noise, at, heads)
    return scatter.about(_axis(scatter, cone.centre)), cone


def _axis(scatter: Scatter, centre: Array) -> Array:
    out: Array = normals_of(centre[None], scatter.frame)[0]
    return out


def _rests(cone: WanderingCone) -> bool:
    """Tell whether something is left that neither cone nor slow way explains."""
    uneven = 0.0 if cone.free else _UNEVEN * cone.radius
    return cone.rest > math.hypot(_LARGEST_REST, uneven)


def _astray(
    scatter: Scatter, cone: WanderingCone, at: Array, counted: Sequence[int], heads: Array | None
) -> Refusal | None:
    """Refuse normals that are not on one slowly wandering cone; name the exposure that is to blame."""
    if not _rests(cone) and cone.farthest <= _FARTHEST_WAY:
        return None
    for k in range(len(at)):
        others: Mask = np.arange(len(at)) != k
        without = fit_wandering_cone(scatter.points[others], scatter.noise[others], at[others], heads)
        # A step that one gap nearly hides is no single exposure.
        if without.rest <= _HEALED * cone.rest and not _rests(without) and without.farthest <= _FARTHEST_WAY:
            return Refusal(
                RefusalCode.ANOTHER_WHEEL,
                f"exposure {counted[k]} does not lie on the cone of the others; another wheel or something "
                "before the heads was in view, or the wheel was pushed; measure again",
            )
    return Refusal(
        RefusalCode.NOT_SLOW,
        f"the tyre planes scatter by {cone.rest / ARCMIN:.2f}′ about a cone whose axis wanders by "
        f"{cone.farthest / ARCMIN:.1f}′; something moves that is not slow against a turn of the wheel (at "
        f"most {_LARGEST_REST / ARCMIN:.2g}′ and {_FARTHEST_WAY / ARCMIN:.0f}′): check that steering and "
        "vehicle are held, and that all exposures are of one wheel",
    )


def _short_of(rules: SeriesRules, found: SpinMeasurement) -> Refusal | None:
    """Refuse a turn that is too short."""
    assert found.covered_turn is not None
    assert found.turned is not None
    turned, part = abs(found.turned), min(rules.least_turn, _LEAST_PART)
    if turned >= rules.least_turn and found.covered_turn >= part:
        return None
    return Refusal(
        RefusalCode.TURN_TOO_SHORT,
        f"the wheel turned by {math.degrees(turned):.0f}° and its exposures cover "
        f"{math.degrees(found.covered_turn):.0f}° of a turn, at least "
        f"{math.degrees(rules.least_turn):.0f}° and {math.degrees(part):.0f}° are needed; let the rollers "
        "turn the wheel further, best twice round, and the exposures be out of step with it",
    )


def _no_turn(asked: bool) -> Refusal:
    seen = "nothing else tells that it turned"
    if asked:
        seen = "their images do not differ as those of a turning wheel do"
    return Refusal(
        RefusalCode.TURN_TOO_SHORT,
        f"the tyre planes show no run-out, and {seen}: of a wheel that stands still its run-out is not seen, "
        "and is no spin axis; check that the rollers turn it",
    )
