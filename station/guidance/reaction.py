"""What one turn of an adjuster does, learned within one adjusting from what the last turns did.

The change by one turn is a Gaussian of two numbers: that of the adjuster's own angle, and of the other one. A
movement from rest to rest is a Kalman update (Kalman 1960): change = turns × reaction, where the turns are
known no better than who turns obeys. That error is common to both angles, so their ratio is learned far
sooner than their size. Turns that moved nothing were lost in the backlash and say nothing of a turn.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from alignment.arrays import Array
from station.guidance.plan import AdjusterPlan

_SIGMAS = 2.0
"""Of the stated errors, which are bounds, in one of their Gaussians."""


@dataclass(frozen=True, eq=False)
class Reaction:
    """What one positive turn does, radians.

    Attributes
    ----------
    plan
        The adjuster as stated.
    mean
        Change of its own angle and of the other one (2,).
    covariance
        Of them (2, 2).
    """

    plan: AdjusterPlan
    mean: Array
    covariance: Array

    @classmethod
    def stated(cls, plan: AdjusterPlan) -> Reaction:
        """Return what is known before the first turn."""
        mean = np.array([plan.main, plan.across])
        size, ratio = plan.error / _SIGMAS, plan.main * plan.coupling_error / _SIGMAS
        covariance = size**2 * np.outer(mean, mean) + np.diag([0.0, ratio**2])
        return cls(plan, mean, covariance)

    @property
    def main(self) -> float:
        """Change of its own angle, never beyond what is believed of a sound vehicle: so of its sign."""
        shares = 1.0 - self.plan.error, 1.0 + self.plan.error
        return float(self.plan.main * min(max(self.mean[0] / self.plan.main, shares[0]), shares[1]))

    @property
    def most(self) -> float:
        """Largest believable change of its own angle by one turn, without sign, whatever was learned."""
        return abs(self.plan.main) * (1.0 + self.plan.error)

    @property
    def ratio(self) -> float:
        """Change of the other angle by that of its own."""
        return float(self.mean[1] / self.mean[0])

    def believable(self, turns: float, moved: Array) -> bool:
        """Whether so many turns, or some of them, can have moved its own angle so."""
        return bool(0.5 <= moved[0] / (turns * self.plan.main) <= 1.0 + 2.0 * self.plan.error)

    def after(self, turns: float, turns_u: float, moved: Array, moved_u: float) -> Reaction:
        """Return what is known after a movement.

        Parameters
        ----------
        turns, turns_u
            Told, and how well whoever turns does as told, one standard deviation; a large one where the
            movement says nothing of the size of a turn, and of the ratio alone.
        moved
            Change of its own angle and of the other one (2,), from rest to rest.
        moved_u
            Standard deviation of each of the two.
        """
        mean, known = self.mean, self.covariance
        noise = moved_u**2 * np.eye(2) + turns_u**2 * np.outer(mean, mean)
        gain = turns * known @ np.linalg.inv(turns**2 * known + noise)
        updated = mean + gain @ (moved - turns * mean)
        covariance = (np.eye(2) - turns * gain) @ known
        return replace(self, mean=updated, covariance=0.5 * (covariance + covariance.T))
