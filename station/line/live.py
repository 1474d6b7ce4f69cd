"""Live angles as the controller sees them: sent when they are new and again and again, each with its age."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import can

from station.cycle import AxisKind, LiveAngles, LiveState
from station.line.wire import LineDatabase, LiveAge, frames_of_live


class LiveShown:
    """The last angles of every wheel that is adjusted.

    Parameters
    ----------
    database
        The checked DBC.
    clock
        Monotonic seconds.
    stale_s
        Angles older than this are shown as stale.
    send
        Takes each frame.
    """

    def __init__(
        self,
        database: LineDatabase,
        clock: Callable[[], float],
        stale_s: float,
        send: Callable[[can.Message], object],
    ) -> None:
        self._database = database
        self._clock = clock
        self._stale_s = stale_s
        self._send = send
        self._last: dict[str, tuple[LiveAngles, float]] = {}

    def show(self, angles: LiveAngles, measured_s: float) -> None:
        """Send new angles, of images taken at this time of the clock."""
        self._last[angles.wheel] = (angles, measured_s)
        self._send_wheel(angles.wheel)

    def repeat(self) -> None:
        """Send the last angles of every wheel again."""
        for wheel in self._last:
            self._send_wheel(wheel)

    def clear(self) -> None:
        """Adjusting is over."""
        self._last.clear()

    def _send_wheel(self, wheel: str) -> None:
        angles, measured_s = self._last[wheel]
        age_s = max(self._clock() - measured_s, 0.0)
        if age_s > self._stale_s:
            angles = replace(angles, state=LiveState.STALE, camber_deg=None, toe_deg=None, kind=AxisKind.NONE)
        for frame in frames_of_live(self._database, angles, LiveAge(wheel, angles.shot, age_s, angles.kind)):
            self._send(frame)
