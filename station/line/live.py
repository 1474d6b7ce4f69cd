"""What the controller sees of a cycle that runs: live angles and guidance, each with its age; a sweep.

They are sent when they are new and again and again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import can

from station.cycle import NO_SWEEP, AxisKind, Guidance, LiveAngles, LiveState, SweepProgress
from station.guidance import GuidanceState
from station.line.wire import (
    LineDatabase,
    LiveAge,
    blank_guidance,
    frames_of_live,
    guidance_frames,
    progress_frame,
)


class LiveShown:
    """The last angles and guidance of every wheel that is adjusted.

    Parameters
    ----------
    database
        The checked DBC.
    clock
        Monotonic seconds.
    stale_s
        Angles older than this are shown as stale, and guidance as lost.
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
        self._guided: dict[str, tuple[Guidance, float]] = {}

    def show(self, angles: LiveAngles, measured_s: float) -> None:
        """Send new angles, of images taken at this time of the clock."""
        self._last[angles.wheel] = (angles, measured_s)
        self._send_wheel(angles.wheel)

    def guide(self, guidance: Guidance, measured_s: float) -> None:
        """Send new guidance, of images taken at this time; of a wheel that the line guides."""
        if guidance.wheel in self._database.guided:
            self._guided[guidance.wheel] = (guidance, measured_s)
            self._send_guidance(guidance.wheel)

    def repeat(self) -> None:
        """Send the last angles and guidance of every wheel again."""
        for wheel in self._last:
            self._send_wheel(wheel)
        for wheel in self._guided:
            self._send_guidance(wheel)

    def clear(self) -> None:
        """Adjusting is over; what turns by itself is told to stop."""
        for wheel in self._guided:
            for frame in blank_guidance(self._database, wheel):
                self._send(frame)
        self._last.clear()
        self._guided.clear()

    def _send_wheel(self, wheel: str) -> None:
        angles, measured_s = self._last[wheel]
        age_s = max(self._clock() - measured_s, 0.0)
        if age_s > self._stale_s:
            angles = replace(angles, state=LiveState.STALE, camber_deg=None, toe_deg=None, kind=AxisKind.NONE)
        for frame in frames_of_live(self._database, angles, LiveAge(wheel, angles.shot, age_s, angles.kind)):
            self._send(frame)

    def _send_guidance(self, wheel: str) -> None:
        guidance, measured_s = self._guided[wheel]
        age_s = max(self._clock() - measured_s, 0.0)
        if age_s > self._stale_s:
            # Where to turn is not known any more.
            guidance = Guidance(wheel, GuidanceState.LOST, guidance.shot)
        for frame in guidance_frames(self._database, guidance, age_s):
            self._send(frame)


class SweepShown:
    """How the sweep goes; shown from its beginning to its end.

    Parameters
    ----------
    database
        The checked DBC.
    send
        Takes each frame.
    """

    def __init__(self, database: LineDatabase, send: Callable[[can.Message], object]) -> None:
        self._database = database
        self._send = send
        self._sequence, self._progress = 0, NO_SWEEP

    def show(self, sequence: int, progress: SweepProgress) -> None:
        """Send what is new of the sweep of this start."""
        self._sequence, self._progress = sequence, progress
        self.repeat()

    def repeat(self) -> None:
        """Send it again."""
        if self._progress != NO_SWEEP and self._database.has_steering:
            self._send(progress_frame(self._database, self._sequence, self._progress))

    def clear(self) -> None:
        """The cycle is over."""
        self._progress = NO_SWEEP
