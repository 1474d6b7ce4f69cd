"""Uncertainty budget of a measuring system and of the measuring process: Q_MS and Q_MP.

Sources: VDA volume 5 (2010) and ISO 22514-7. Contributions that describe the same spread are not added: of
resolution, repeatability on the master and repeatability on parts the largest counts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from alignment.errors import DegenerateInputError
from alignment.statistics.choices import Contribution

LIMIT_MS, LIMIT_MP = 15.0, 30.0
"""What VDA 5 asks of Q_MS and Q_MP at most, percent."""


_SYSTEM = (
    Contribution.CALIBRATION,
    Contribution.BIAS,
    Contribution.LINEARITY,
    Contribution.SYSTEM_REST,
)
_SPREAD = (
    Contribution.RESOLUTION,
    Contribution.MASTER_REPEATABILITY,
    Contribution.PART_REPEATABILITY,
)
_PROCESS = (
    Contribution.APPRAISER,
    Contribution.SYSTEMS,
    Contribution.INTERACTION,
    Contribution.STABILITY,
    Contribution.TEMPERATURE,
    Contribution.OBJECT,
    Contribution.PROCESS_REST,
)


@dataclass(frozen=True)
class Component:
    """One standard uncertainty, in the unit of the tolerance, and where it comes from."""

    kind: Contribution
    u: float
    source: str = ""


@dataclass(frozen=True)
class BudgetLine:
    """A component in the budget: its share of the process variance; 0 where another stands for it."""

    component: Component
    share_percent: float
    counted: bool


@dataclass(frozen=True)
class UncertaintyBudget:
    """The budget.

    Attributes
    ----------
    u_ms, u_mp
        Combined standard uncertainty of the measuring system, and of the measuring process.
    q_ms, q_mp
        Expanded uncertainties, both sides, over the tolerance: 100 · 2 U / T, percent.
    least_tolerance_ms, least_tolerance_mp
        Narrowest tolerances for which both keep their limits.
    """

    lines: tuple[BudgetLine, ...]
    tolerance: float
    coverage_factor: float
    u_ms: float
    u_mp: float

    @property
    def q_ms(self) -> float:
        """Capability ratio of the system, percent."""
        return 200.0 * self.coverage_factor * self.u_ms / self.tolerance

    @property
    def q_mp(self) -> float:
        """Capability ratio of the process, percent."""
        return 200.0 * self.coverage_factor * self.u_mp / self.tolerance

    @property
    def least_tolerance_ms(self) -> float:
        """Narrowest tolerance for which Q_MS keeps its limit."""
        return 200.0 * self.coverage_factor * self.u_ms / LIMIT_MS

    @property
    def least_tolerance_mp(self) -> float:
        """Narrowest tolerance for which Q_MP keeps its limit."""
        return 200.0 * self.coverage_factor * self.u_mp / LIMIT_MP

    @property
    def spread_seen(self) -> bool:
        """Whether any contribution is greater than 0, and any of a repeated reading that has its line here.

        Repetitions that are all equal have no spread to contribute; the resolution, which hid it, has one.
        """
        repeated = [line.component for line in self.lines if line.component.kind in _SPREAD]
        return self.u_mp > 0.0 and (not repeated or any(component.u > 0.0 for component in repeated))

    @property
    def capable(self) -> bool | None:
        """Whether both ratios keep their limits; None when no spread was seen."""
        if not self.spread_seen:
            return None
        return self.q_ms <= LIMIT_MS and self.q_mp <= LIMIT_MP


def resolution_uncertainty(resolution: float) -> float:
    """Standard uncertainty of a resolution: rectangular, its full width."""
    return resolution / math.sqrt(12.0)


def bias_uncertainty(bias: float) -> float:
    """Standard uncertainty of an uncorrected bias: rectangular, the bias its half width."""
    return abs(bias) / math.sqrt(3.0)


def budget(
    components: Sequence[Component], tolerance: float, coverage_factor: float = 2.0
) -> UncertaintyBudget:
    """Combine standard uncertainties; several of one kind add as squares.

    Raises
    ------
    DegenerateInputError
        For a tolerance or factor that is not greater than 0, a negative uncertainty, or none at all.
    """
    for name, value in (("tolerance", tolerance), ("coverage_factor", coverage_factor)):
        if not value > 0.0:
            raise DegenerateInputError(field=name, expected="a number greater than 0", seen=str(value))
    if not components:
        raise DegenerateInputError(expected="at least one uncertainty", seen="none")
    for component in components:
        if not (component.u >= 0.0 and math.isfinite(component.u)):
            raise DegenerateInputError(
                field=f"u_{component.kind}", expected="a finite number, 0 or more", seen=str(component.u)
            )
    variance = {
        kind: math.fsum(component.u**2 for component in components if component.kind is kind)
        for kind in Contribution
    }
    spread_ms = _largest(variance, Contribution.RESOLUTION, Contribution.MASTER_REPEATABILITY)
    spread_mp = _largest(variance, *_SPREAD)
    system = math.fsum(variance[kind] for kind in _SYSTEM)
    u_ms = math.sqrt(system + variance[spread_ms])
    total = system + variance[spread_mp] + math.fsum(variance[kind] for kind in _PROCESS)
    counted = {*_SYSTEM, *_PROCESS, spread_mp}
    lines = tuple(
        BudgetLine(
            component,
            100.0 * component.u**2 / total if component.kind in counted and total > 0.0 else 0.0,
            component.kind in counted,
        )
        for component in components
    )
    return UncertaintyBudget(lines, tolerance, coverage_factor, u_ms, math.sqrt(total))


def _largest(variance: dict[Contribution, float], *kinds: Contribution) -> Contribution:
    return max(kinds, key=lambda kind: variance[kind])
