"""Tie rods and camber bolts of a simulated vehicle: backlash, ends, a nut whose locking moves the wheel.

Numbers alone: what a hand turns, and what the wheel's axis makes of it. `on_vehicle` puts that on a vehicle
that is rendered. Left out: that a loosened nut lets go some of what its locking added.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from alignment.errors import DegenerateInputError
from sensors.simulation.vehicle import Adjuster, Vehicle


@dataclass(frozen=True)
class SimulatedAdjuster:
    """A rod or a bolt of one wheel, radians and turns.

    Attributes
    ----------
    per_turn
        What a turn does in truth.
    backlash_turns
        By which the hand turns in vain when it changes its direction.
    range_turns
        To either side from where it was found; then it is at its end, whatever the hand does.
    drift, drift_spread
        What locking the nut adds to its own angle, and the standard deviation from one locking to the next.
    sets_toe
        Its own angle is toe; else camber.
    hand, moved
        Where the hand has turned it, and how much of it has come to the wheel, turns.
    drifted
        What its lockings have added, radians.
    """

    per_turn: Adjuster
    backlash_turns: float
    range_turns: float
    drift: float
    drift_spread: float
    sets_toe: bool
    hand: float = 0.0
    moved: float = 0.0
    drifted: float = 0.0

    def __post_init__(self) -> None:
        if not (self.backlash_turns >= 0.0 and self.range_turns > 0.0):
            raise DegenerateInputError(
                field="adjuster",
                expected="a backlash of 0 turns or more, and a range above 0",
                seen=f"{self.backlash_turns}, {self.range_turns}",
            )

    def turned(self, turns: float) -> SimulatedAdjuster:
        """Return it after so many turns of the hand; at its end the hand is stopped."""
        half = 0.5 * self.backlash_turns
        most = self.range_turns + half
        hand = min(max(self.hand + turns, -most), most)
        # The wheel follows once the slack to that side is used up.
        moved = min(max(self.moved, hand - half), hand + half)
        return replace(self, hand=hand, moved=moved)

    def locked(self, rng: np.random.Generator) -> SimulatedAdjuster:
        """Return it with the nut locked."""
        return replace(self, drifted=self.drifted + self.drift + self.drift_spread * rng.standard_normal())

    @property
    def effect(self) -> tuple[float, float]:
        """What it has added to camber and toe since it was found, radians."""
        camber, toe = self.moved * self.per_turn.camber, self.moved * self.per_turn.toe
        return (camber, toe + self.drifted) if self.sets_toe else (camber + self.drifted, toe)


@dataclass(frozen=True)
class AdjustedWheel:
    """Camber and toe of a wheel as it was found, radians, and what can be turned of it, by name."""

    camber: float
    toe: float
    adjusters: Mapping[str, SimulatedAdjuster]

    @property
    def angles(self) -> tuple[float, float]:
        """Camber and toe as they are now."""
        effects = [each.effect for each in self.adjusters.values()]
        return self.camber + sum(e[0] for e in effects), self.toe + sum(e[1] for e in effects)

    def turned(self, name: str, turns: float) -> AdjustedWheel:
        """Return it after one adjuster was turned."""
        return self._with(name, self.adjusters[name].turned(turns))

    def locked(self, name: str, rng: np.random.Generator) -> AdjustedWheel:
        """Return it after one nut was locked."""
        return self._with(name, self.adjusters[name].locked(rng))

    def on_vehicle(self, vehicle: Vehicle, wheel: str) -> Vehicle:
        """Return a vehicle whose wheel stands so."""
        camber, toe = self.angles
        corner = replace(vehicle.corners[wheel], camber=camber, toe=toe, rod_turns=0.0, bolt_turns=0.0)
        return replace(vehicle, corners={**vehicle.corners, wheel: corner})

    def _with(self, name: str, adjuster: SimulatedAdjuster) -> AdjustedWheel:
        return replace(self, adjusters={**self.adjusters, name: adjuster})


@dataclass(frozen=True)
class Fitter:
    """How somebody turns who does as told.

    Attributes
    ----------
    speed
        Turns per second.
    error
        Share by which a turn misses what was told, one standard deviation.
    rest_s
        Between two turns of the wrench, and before the nut is locked.
    watches
        Whether the turn is ended as soon as the screen says so; a nutrunner turns as told and looks then.
    """

    speed: float = 0.4
    error: float = 0.1
    rest_s: float = 1.2
    watches: bool = True


BY_HAND = Fitter()
NUTRUNNER = Fitter(speed=1.0, error=0.02, rest_s=1.0, watches=False)


class FitterAtWork:
    """One who turns, holds and locks at one wheel as told, step by step of the time.

    Parameters
    ----------
    wheel
        As it was found.
    fitter
        How he turns.
    rng
        Draws his errors, and what the nuts do.

    Attributes
    ----------
    wheel
        As it is now.
    locked
        How often each adjuster's nut was locked.
    """

    def __init__(self, wheel: AdjustedWheel, fitter: Fitter, rng: np.random.Generator) -> None:
        self.wheel = wheel
        self.locked = dict.fromkeys(wheel.adjusters, 0)
        self._fitter, self._rng = fitter, rng
        self._left = 0.0
        self._turning: str | None = None
        self._loose: set[str] = set()
        self._locking: str | None = None
        self._rested_s = 0.0

    def turn(self, name: str, turns: float, dt_s: float) -> None:
        """Turn for a while: `turns` are to go, by what is shown now."""
        self._locking = None
        if self._turning != name or self._left == 0.0:
            self._rested_s += dt_s
            if self._turning == name and self._rested_s < self._fitter.rest_s:
                return
            self._turning = name
            self._loose.add(name)
            self._left = turns * (1.0 + self._fitter.error * self._rng.standard_normal())
        self._rested_s = 0.0
        step = math.copysign(min(abs(self._left), self._fitter.speed * dt_s), self._left)
        self._left -= step
        self.wheel = self.wheel.turned(name, step)

    def hold(self, dt_s: float) -> None:
        """Stop turning, if he watches; a nutrunner ends its turn."""
        if self._fitter.watches or self._turning is None:
            self._left = 0.0
        elif self._left != 0.0:
            self.turn(self._turning, self._left, dt_s)

    def lock(self, name: str, dt_s: float) -> None:
        """Begin to lock a nut that is loose; others may stay so."""
        self._left, self._locking = 0.0, name if name in self._loose else None
        self.wait(dt_s)

    def wait(self, dt_s: float) -> None:
        """Turn nothing; end the locking that was begun, after a moment."""
        self._left = 0.0
        self._rested_s += dt_s
        if self._locking is not None and self._rested_s >= self._fitter.rest_s:
            self.wheel = self.wheel.locked(self._locking, self._rng)
            self.locked[self._locking] += 1
            self._loose.discard(self._locking)
            self._turning = self._locking = None
            self._rested_s = 0.0
