"""The line's traffic as a person reads it: what changes, or one line for each start.

On a quiet line both sides say the same ten times a second, with another counter and another CRC each time. A
person looks for what became different.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from fnmatch import fnmatchcase

from alignment.errors import ConfigurationError
from station.line.tools.monitor import CycleFollower, CycleTrace, DecodedFrame
from station.line.wire import Value, VinAssembly

COUNTING = frozenset({"E2eCrc", "E2eCounter", "AliveCounter", "Heartbeat", "HeartbeatEcho", "Age", "Sample"})
"""Signals that are another number in every frame, and say nothing but that it is another frame, later."""
_OLDEST_DATE_S = 1e9  # Earlier times of a log count from its beginning.


class ChangeView:
    """Frames to lines: of each message what differs from its frame before.

    Parameters
    ----------
    vin_messages
        Messages that carry parts of the VIN, and the signals of its characters.
    every
        Every frame with all its signals, not only what changed.
    counting
        With CRCs, counters and signs of life.
    width
        Of the column of names.
    """

    def __init__(
        self,
        vin_messages: Mapping[str, Sequence[str]],
        *,
        every: bool = False,
        counting: bool = False,
        width: int = 0,
    ) -> None:
        self._vin_messages = vin_messages
        self._every = every
        self._counting = counting
        self._width = width
        self._last: dict[int, dict[str, Value]] = {}
        self._errors: dict[int, str] = {}

    def line(self, frame: DecodedFrame) -> str | None:
        """Return the frame's line; None when it says nothing new."""
        values = self._shown(frame)
        known = self._last.get(frame.identifier)
        if frame.error is not None:
            if not self._every and self._errors.get(frame.identifier) == frame.error:
                return None
            self._errors[frame.identifier] = frame.error
            return self._told(frame, values, f"!! {frame.error}")
        recovered = self._errors.pop(frame.identifier, None) is not None
        self._last[frame.identifier] = values
        if self._every or known is None or recovered:
            return self._told(frame, values)
        changed = {name: value for name, value in values.items() if known.get(name) != value}
        return self._told(frame, changed) if changed else None

    def _shown(self, frame: DecodedFrame) -> dict[str, Value]:
        values = {
            name: value for name, value in frame.values.items() if self._counting or name not in COUNTING
        }
        characters = self._vin_messages.get(frame.name or "", ())
        if values and characters:
            codes = [int(values.pop(name)) for name in characters]
            values["Text"] = "".join(chr(code) for code in codes if 32 < code < 127) or "-"
        return values

    def _told(self, frame: DecodedFrame, values: Mapping[str, Value], mark: str = "") -> str:
        signals = " ".join(
            f"{name}={value:g}" if isinstance(value, float) else f"{name}={value}"
            for name, value in values.items()
        )
        said = "  ".join(part for part in (mark, signals) if part)
        name = f"{frame.identifier:03X}  {frame.name or '?':<{self._width}}"
        return f"{clock_time(frame.time_s)}  {name}  {said}".rstrip()


def chosen_messages(patterns: Sequence[str], names: Iterable[str]) -> frozenset[str]:
    """Return the messages that are asked for; none without a pattern.

    Parameters
    ----------
    patterns
        Names of messages; * stands for anything, capitals count as small letters.
    names
        Of the messages that there are.

    Raises
    ------
    ConfigurationError
        When a pattern is of no message.
    """
    names = sorted(names)
    wanted: set[str] = set()
    for pattern in patterns:
        found = {name for name in names if fnmatchcase(name.lower(), pattern.lower())}
        if not found:
            raise ConfigurationError(
                choice="message",
                expected=f"a message of the line: {', '.join(names)}",
                seen=f"'{pattern}'",
                cure="* stands for anything: 'WheelResult*'",
            )
        wanted |= found
    return frozenset(wanted)


class VehicleView:
    """Frames to lines: one for each start, when its end is known."""

    def __init__(self, vin_messages: Mapping[str, tuple[str, ...]]) -> None:
        self._vin_messages = vin_messages
        self._follower = CycleFollower()
        self._assembly = VinAssembly(vin_messages)
        self._forget()

    def lines(self, frame: DecodedFrame) -> Iterator[str]:
        """Take the next frame; yields the starts that it ended."""
        if frame.error is not None:
            return
        before = self._follower.current
        if frame.name is not None and frame.name in self._vin_messages:
            self._assembly.add(frame.name, frame.values, frame.time_s)
        began = self._follower.take(frame)
        if began:
            yield from self._ended(before)
            self._forget()
        cycle = self._follower.current
        if cycle is None:
            return
        vin = self._assembly.read(cycle.sequence, frame.time_s)
        if isinstance(vin, str) and cycle.done_s is None:
            self._vin = vin
        self._judge(cycle, frame)
        if cycle.acknowledged_s is not None and cycle.done_s is not None:
            yield from self._ended(cycle)

    def end(self) -> Iterator[str]:
        """Yield the start whose end did not come."""
        yield from self._ended(self._follower.current)

    def _forget(self) -> None:
        self._told, self._vin, self._outcome = False, "no whole VIN", ""

    def _judge(self, cycle: CycleTrace, frame: DecodedFrame) -> None:
        values = frame.values
        if values.get("Sequence") != cycle.sequence:
            return
        if frame.name == "VehicleResult" and cycle.acknowledged_s is None:
            self._outcome = str(values["Outcome"])
        elif frame.name == "CommandAnswer" and values.get("Code") == "start" and cycle.done_s is None:
            refused = values.get("Answer") == "refused"
            self._outcome = f"refused: {values['ErrorCode']}" if refused else ""

    def _ended(self, cycle: CycleTrace | None) -> Iterator[str]:
        if cycle is None or self._told:
            return
        self._told = True
        times = {"busy": cycle.busy_s, "done": cycle.done_s, "taken": cycle.acknowledged_s}
        passed = [f"{what} {when - cycle.start_s:.3f}" for what, when in times.items() if when is not None]
        # Eighty columns hold the line of a good vehicle.
        head = f"{clock_time(cycle.start_s)} {cycle.sequence:3d} {self._vin} {self._outcome or 'no result'}"
        seconds = [f"{' '.join(passed)} s"] if passed else []
        yield "  ".join([head, *seconds, *(f"!! {problem}" for problem in cycle.out_of_order)])


def clock_time(time_s: float) -> str:
    """Return the time of day (UTC) of a frame, or seconds where its log counts from its beginning."""
    if time_s < _OLDEST_DATE_S:
        return f"{time_s:12.3f}"
    try:
        return f"{datetime.fromtimestamp(time_s, UTC):%H:%M:%S.%f}"[:-3]
    except (OverflowError, OSError, ValueError):
        return f"{time_s:12.3f}"
