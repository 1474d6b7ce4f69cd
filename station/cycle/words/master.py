"""What the cycle shows of its master checks."""

from __future__ import annotations

from dataclasses import dataclass

from station.duty import MasterState


@dataclass(frozen=True)
class MasterShown:
    """Where the station stands with its master checks.

    Attributes
    ----------
    vehicles_left
        Until the next check; None where they are not counted.
    due_s
        When the next check is due, seconds of the line's monotonic clock; None where no time is asked for.
    doubted
        Vehicles in doubt that neither a good check nor a person has answered for.
    """

    state: MasterState
    vehicles_left: int | None = None
    due_s: float | None = None
    doubted: int = 0


NO_MASTER = MasterShown(MasterState.NOT_REQUIRED)
"""Of a station that asks for no master checks."""
