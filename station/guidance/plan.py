"""What is known before a wheel is adjusted, and what each result says of it; radians and turns."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from alignment.units import ARCMIN
from station.configuration import AdjusterOptions, AxleAdjusters, Limits
from station.guidance.words import AdjusterKind


@dataclass(frozen=True)
class AdjusterPlan:
    """One adjuster of a wheel.

    Attributes
    ----------
    kind
        What it is: a camber bolt sets camber, a tie rod sets toe.
    main, across
        What one positive turn adds to the angle that it sets, and to the other one, as stated.
    error
        How wrong these may be on a sound vehicle, as a share of `main`.
    coupling_error
        How far `across` over `main` may be from what is stated.
    range_turns, backlash_turns
        To either side from where it was found; that move nothing when the direction changes.
    """

    kind: AdjusterKind
    main: float
    across: float
    error: float
    coupling_error: float
    range_turns: float
    backlash_turns: float

    @classmethod
    def of(cls, kind: AdjusterKind, options: AdjusterOptions) -> AdjusterPlan:
        """Return what a vehicle type says of an adjuster."""
        toe, camber = math.radians(options.toe_deg_per_turn), math.radians(options.camber_deg_per_turn)
        main, across = (toe, camber) if kind is AdjusterKind.TIE_ROD else (camber, toe)
        return cls(
            kind,
            main,
            across,
            options.deg_per_turn_error,
            options.coupling_error,
            options.range_turns,
            options.backlash_turns,
        )


@dataclass(frozen=True)
class WheelPlan:
    """One wheel: its limits, and what can be turned.

    Attributes
    ----------
    wheel
        Its name.
    camber, toe
        Their limits; the middle is the target.
    rod, bolt
        None where there is none.
    """

    wheel: str
    camber: Limits
    toe: Limits
    rod: AdjusterPlan | None = None
    bolt: AdjusterPlan | None = None

    @classmethod
    def of(cls, wheel: str, camber: Limits, toe: Limits, options: AxleAdjusters) -> WheelPlan:
        """Return what a vehicle type says of a wheel."""
        rod, bolt = options.tie_rod, options.camber_bolt
        return cls(
            wheel,
            camber,
            toe,
            None if rod is None else AdjusterPlan.of(AdjusterKind.TIE_ROD, rod),
            None if bolt is None else AdjusterPlan.of(AdjusterKind.CAMBER_BOLT, bolt),
        )

    def adjuster(self, kind: AdjusterKind) -> AdjusterPlan | None:
        """Return the adjuster of a kind."""
        return {AdjusterKind.TIE_ROD: self.rod, AdjusterKind.CAMBER_BOLT: self.bolt}.get(kind)


@dataclass(frozen=True)
class WheelReading:
    """What one result says of a wheel.

    Attributes
    ----------
    wheel
        Its name.
    time_s
        When its images were taken; never goes back.
    camber, toe
        Radians; None where it was not measured.
    camber_u95, toe_u95
        By which the limits are narrowed in the verdict; 0 where a vehicle type switches that off.
    verdicts
        The station's own, by the names of the angles that this wheel is part of: its own camber and toe,
        total toe and camber difference of its axle, the thrust angle of a rear wheel. Only those that are
        known of this very result; true is inside.
    whole
        Whether these are all that will be judged. A wheel is not done before they are.
    """

    wheel: str
    time_s: float
    camber: float | None = None
    toe: float | None = None
    camber_u95: float = 0.0
    toe_u95: float = 0.0
    verdicts: Mapping[str, bool] = field(default_factory=dict)
    whole: bool = True


@dataclass(frozen=True)
class GuidanceSettings:
    """When a wheel counts as at rest, on its aim, and locked.

    Attributes
    ----------
    readings
        Results in a row that decide.
    rest_s
        That they must span, seconds.
    still
        Most that they may differ at rest; more is a movement.
    margin
        Expanded uncertainties by which a wheel that was turned must be inside its limits before it is done:
        more than the verdict asks, so that a new measurement will not say otherwise.
    window
        How near the aim is near enough to stop turning, as a share of what the limits leave to either side.
    lock_s
        Seconds after which a nut counts as locked though nothing moved.
    stuck_s
        Seconds of rest, far from where it was found, after which an adjuster counts as at its end.
    turning_error
        Share by which who turns may depart from what was told.
    """

    readings: int = 4
    rest_s: float = 0.6
    still: float = 0.8 * ARCMIN
    margin: float = 1.1
    window: float = 0.07
    lock_s: float = 8.0
    stuck_s: float = 12.0
    turning_error: float = 0.15
