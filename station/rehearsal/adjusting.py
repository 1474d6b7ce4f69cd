"""A simulated vehicle is adjusted by simulated fitters, who do what the station's own guidance tells them.

Numbers stand for the images: each result is the true angle with an error that stays on this vehicle, and one
that is new each time. All else is the product's: verdict, guidance, learned drift.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime

import numpy as np

from alignment.values import WheelMeasurement
from sensors.simulation import FitterAtWork
from station.configuration import VehicleType
from station.cycle import Drifts, Guidance, Guiding, Outcome, Status, WheelResult, combined, evaluate
from station.guidance import AdjusterKind, GuidanceState

STEP_S = 0.2
"""Between two results of a wheel."""
MOST_S = 900.0
_QUIET_S = 4.0
"""Of all wheels done or out of reach, before the fitters step back."""
_EPOCH = datetime(2026, 1, 1, tzinfo=UTC)


@dataclass(frozen=True)
class AngleErrors:
    """How wrong measured angles are, standard deviations in radians: camber, toe.

    Attributes
    ----------
    camber_u, toe_u
        As the station states them, all told.
    each_u
        What of it is new with each result; the rest stays with the vehicle.
    """

    camber_u: float
    toe_u: float
    each_u: float


class MeasuredByNumbers:
    """Measures wheels that fitters adjust."""

    def __init__(
        self,
        kind: VehicleType,
        fitters: Mapping[str, FitterAtWork],
        errors: AngleErrors,
        rng: np.random.Generator,
    ) -> None:
        self._kind, self._fitters, self._errors, self._rng = kind, fitters, errors, rng
        kept = [np.sqrt(max(u**2 - errors.each_u**2, 0.0)) for u in (errors.camber_u, errors.toe_u)]
        self._kept = {wheel: rng.normal(0.0, kept) for wheel in fitters}

    def result(self, wheel: str) -> WheelResult:
        """Return what a measurement of a wheel tells now."""
        errors = self._kept[wheel] + self._rng.normal(0.0, self._errors.each_u, 2)
        camber, toe = np.array(self._fitters[wheel].wheel.angles) + errors
        found = WheelMeasurement(
            camber=float(camber),
            toe=float(toe),
            angle_covariance=np.diag([self._errors.camber_u**2, self._errors.toe_u**2]),
            normal=np.array([0.0, 0.0, 1.0]),
            centre=np.zeros(3),
            offset_mm=0.0,
            points_used=9000,
            residual_rms_mm=0.03,
            heads=(),
            method="tyre_plane/numbers",
        )
        return WheelResult(wheel, "numbers", True, found, None, _EPOCH, None, 0.0)


@dataclass(frozen=True)
class AdjustedVehicle:
    """How the adjusting of one vehicle ended.

    Attributes
    ----------
    outcome
        The station's verdict on the measurement after it.
    inside
        Whether in truth camber and toe of all wheels are inside their limits.
    states
        Last state of the guidance of each wheel.
    locked
        How often each nut was locked, by wheel and adjuster.
    seconds
        It took.
    wrongly_done
        Wheels of which guidance said done while in truth an angle was outside of its limits.
    guiding
        What guided.
    """

    outcome: Outcome
    inside: bool
    states: Mapping[str, GuidanceState]
    locked: Mapping[tuple[str, AdjusterKind], int]
    seconds: float
    wrongly_done: tuple[str, ...]
    guiding: Guiding
    history: Sequence[Guidance] = field(default=(), repr=False)


def adjust_vehicle(
    kind: VehicleType,
    fitters: Mapping[str, FitterAtWork],
    drifts: Drifts,
    errors: AngleErrors,
    rng: np.random.Generator,
    *,
    keep: bool = False,
) -> AdjustedVehicle:
    """Adjust a vehicle until the guidance needs nothing more of anybody, or for a quarter of an hour.

    Parameters
    ----------
    kind
        Its type.
    fitters
        One at each wheel, with what he turns.
    drifts
        What locking usually adds, as learned so far.
    errors, rng
        Of the measurement.
    keep
        Whether all that was told is kept.
    """
    measured = MeasuredByNumbers(kind, fitters, errors, rng)
    guiding = Guiding(kind, tuple(fitters), drifts)
    seen: dict[str, WheelResult] = {}
    told: dict[str, Guidance] = {}
    history: list[Guidance] = []
    wrong: set[str] = set()
    time_s = quiet_s = 0.0
    while time_s < MOST_S and quiet_s < _QUIET_S:
        time_s += STEP_S
        for wheel, fitter in fitters.items():
            seen[wheel] = measured.result(wheel)
            evaluation = evaluate(kind, [*seen.values()], 2.0)
            told[wheel] = guiding.take(evaluation, wheel, time_s, 0)
            if keep:
                history.append(told[wheel])
            if told[wheel].done and not _inside(kind, wheel, fitter):
                wrong.add(wheel)
            _obey(fitter, told[wheel])
        ended = all(
            each.state in (GuidanceState.DONE, GuidanceState.UNREACHABLE)
            or each.state is GuidanceState.WAITING
            for each in told.values()
        )
        busy = any(each.state is GuidanceState.WAITING for each in told.values()) and not any(
            each.state is GuidanceState.UNREACHABLE for each in told.values()
        )
        quiet_s = quiet_s + STEP_S if ended and not busy else 0.0
    results = [measured.result(wheel) for wheel in fitters]
    evaluation = evaluate(kind, results, 2.0)
    status = combined(evaluation.angles)
    return AdjustedVehicle(
        Outcome.OK if status is Status.OK else Outcome.NOK,
        all(_inside(kind, wheel, fitter) for wheel, fitter in fitters.items()),
        {wheel: each.state for wheel, each in told.items()},
        {(w, AdjusterKind(name)): n for w, fitter in fitters.items() for name, n in fitter.locked.items()},
        time_s,
        tuple(sorted(wrong)),
        guiding,
        history,
    )


def _obey(fitter: FitterAtWork, told: Guidance) -> None:
    match told.state:
        case GuidanceState.TURN:
            assert told.turns_to_go is not None
            fitter.turn(told.adjuster, told.turns_to_go, STEP_S)
        case GuidanceState.HOLD:
            fitter.hold(STEP_S)
        case GuidanceState.LOCK_NUT:
            fitter.lock(told.adjuster, STEP_S)
        case _:
            fitter.wait(STEP_S)


def _inside(kind: VehicleType, wheel: str, fitter: FitterAtWork) -> bool:
    limits = kind.axles[wheel.rpartition("_")[0]]
    return all(
        limit.low <= angle <= limit.high
        for limit, angle in zip(
            (limits.camber.limits(), limits.toe.limits()), fitter.wheel.angles, strict=True
        )
    )
