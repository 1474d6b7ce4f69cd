"""The duty of a station: that of all its rigs, of which the worst counts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import datetime

from station.duty.plan import DutyPlan
from station.duty.rig import RigDuty
from station.duty.table import DoubtDeed
from station.duty.words import DutyEvent, MasterState

_WORST_FIRST = tuple(reversed(MasterState))


@dataclass(frozen=True)
class Due:
    """How near the next check is; None where that is not counted."""

    vehicles: int | None
    utc: datetime | None


@dataclass(frozen=True)
class StationDuty:
    """The duty of each rig, by its wheel."""

    plan: DutyPlan
    rigs: Mapping[str, RigDuty]

    @property
    def state(self) -> MasterState:
        """The worst of the rigs."""
        found = {rig.state for rig in self.rigs.values()}
        return next((state for state in _WORST_FIRST if state in found), MasterState.NOT_REQUIRED)

    @property
    def due(self) -> Due:
        """The nearest of the rigs; nothing is left once a check is overdue or failed."""
        if not self.plan.required:
            return Due(None, None)
        if not self.state.ready:
            return Due(0 if self.plan.vehicles else None, None)
        left = [rig.vehicles_left(self.plan) for rig in self.rigs.values()]
        times = [rig.due_utc(self.plan) for rig in self.rigs.values()]
        return Due(
            min((each for each in left if each is not None), default=None),
            min((each for each in times if each is not None), default=None),
        )

    def wheels_in(self, state: MasterState) -> tuple[str, ...]:
        """The wheels whose rigs stand so, by name."""
        return tuple(sorted(wheel for wheel, rig in self.rigs.items() if rig.state is state))

    def happened(
        self, event: DutyEvent, wheels: Iterable[str], utc: datetime
    ) -> tuple[StationDuty, dict[str, DoubtDeed]]:
        """The duty after something happened to these rigs, and what becomes of the vehicles of each."""
        rigs, deeds = dict(self.rigs), dict[str, DoubtDeed]()
        for wheel in wheels:
            if wheel in rigs:
                rigs[wheel], deeds[wheel] = rigs[wheel].happened(self.plan, event, utc)
        return StationDuty(self.plan, rigs), deeds

    def passed(self, utc: datetime) -> StationDuty:
        """The duty when it has become so late."""
        return StationDuty(self.plan, {wheel: rig.passed(self.plan, utc) for wheel, rig in self.rigs.items()})
