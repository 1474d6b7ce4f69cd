"""The master checks as the line shows them, and whether they keep the station from being ready."""

from __future__ import annotations

import math
from collections.abc import Callable

import can

from station.cycle import NO_MASTER, ErrorCode, MasterShown
from station.duty import MasterState
from station.line.wire import LineDatabase, LineMaster, master_frame

_WHY = {
    MasterState.OVERDUE: ErrorCode.MASTER_CHECK_OVERDUE,
    MasterState.FAILED: ErrorCode.MASTER_CHECK_FAILED,
}


class MasterOnLine:
    """Where the station stands, with the minutes that are left when it is sent.

    Parameters
    ----------
    database
        The checked DBC; one before 3.2 has no such message.
    clock
        Monotonic seconds.
    send
        Takes each frame.
    """

    def __init__(
        self, database: LineDatabase, clock: Callable[[], float], send: Callable[[can.Message], object]
    ) -> None:
        self._database, self._clock, self._send = database, clock, send
        self._shown = NO_MASTER

    @property
    def why_not_ready(self) -> ErrorCode:
        """Why no vehicle is measured; NONE where the master checks do not forbid it."""
        return _WHY.get(self._shown.state, ErrorCode.NONE)

    def show(self, master: MasterShown) -> None:
        """Send what is new."""
        self._shown = master
        self.repeat()

    def repeat(self) -> None:
        """Send it again."""
        if self._database.has_master:
            self._send(master_frame(self._database, self._now()))

    def _now(self) -> LineMaster:
        shown = self._shown
        minutes = None if shown.due_s is None else math.ceil(max(shown.due_s - self._clock(), 0.0) / 60.0)
        return LineMaster(shown.state, shown.vehicles_left, minutes, shown.doubted)
