"""Traffic in readable form, live or from a log, with errors marked; and the order of events in a cycle."""

from __future__ import annotations

import queue
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path

import can

from alignment.errors import ConfigurationError, InputError
from station.line.tools.logs.reading import read_log
from station.line.wire import Guard, LineBus, LineDatabase, Value, error_in_words, open_log

_LARGEST_TIME_S = 32_503_680_000.0
# How the names of result messages begin: those of wheels, axles, the vehicle and its steering.
_RESULTS = (
    "Wheel", "Axle", "Vehicle", "Geometry", "RideHeightUsed", "SteeringWheelResult",
    *(f"Sweep{what}" for what in ("Caster", "Kpi", "Included", "ToeOut", "Trail", "Scrub")),
)  # fmt: skip


@dataclass(frozen=True)
class DecodedFrame:
    """One frame.

    Attributes
    ----------
    time_s
        Of the frame, seconds since 1970 where the log or the adapter gives that.
    identifier
        CAN identifier.
    name
        Of its message; None when the DBC has none.
    values
        Signals, empty when the frame could not be decoded.
    error
        Why it could not be decoded, or what its CRC or counter is; None when it is good.
    """

    time_s: float
    identifier: int
    name: str | None
    values: dict[str, Value]
    error: str | None = None

    def __str__(self) -> str:
        signals = " ".join(
            f"{name}={value:g}" if isinstance(value, float) else f"{name}={value}"
            for name, value in self.values.items()
        )
        mark = f"!! {self.error}  {signals}".rstrip() if self.error else signals
        return f"{self.time_s:.6f}  {self.identifier:03X}  {self.name or '?'}  {mark}"


def decode_frame(frame: can.Message, database: LineDatabase, guard: Guard | None = None) -> DecodedFrame:
    """One frame in readable form; never raises, errors are marked.

    A guard looks at CRC and counter too; it must see all frames, in their order.
    """
    name = None if frame.is_error_frame else database.name_of(frame)
    try:
        values = database.decode(frame)
    except InputError as error:
        text = (
            error_in_words(frame)
            if frame.is_error_frame
            else f"expected {error.expected}, found {error.seen}"
        )
        return DecodedFrame(frame.timestamp, frame.arbitration_id, name, {}, text)
    problem = None
    if guard is not None and name in database.protected:
        check = guard.check(name, frame.data)
        problem = f"end-to-end protection: {check}" if check.is_error else None
    return DecodedFrame(frame.timestamp, frame.arbitration_id, name, values, problem)


def decoded(frames: Iterable[can.Message], database: LineDatabase) -> Iterator[DecodedFrame]:
    """Frames in readable form, with their CRCs and counters looked at."""
    guard = Guard(database.protected)
    for frame in frames:
        yield decode_frame(frame, database, guard)


def decode_log(path: str | PathLike[str], database: LineDatabase) -> Iterator[DecodedFrame]:
    """All frames of a log in readable form; raises as `read_log`."""
    return decoded(read_log(path), database)


def live_frames(
    bus: LineBus, duration_s: float, clock: Callable[[], float] = time.monotonic
) -> Iterator[can.Message]:
    """Frames as they arrive, for the given time."""
    frames: queue.SimpleQueue[can.Message] = queue.SimpleQueue()
    bus.listen(frames.put)
    deadline = clock() + duration_s
    try:
        while (remaining := deadline - clock()) > 0:
            try:
                yield frames.get(timeout=remaining)
            except queue.Empty:
                return
    finally:
        bus.unlisten(frames.put)


def watch(
    bus: LineBus,
    database: LineDatabase,
    duration_s: float,
    clock: Callable[[], float] = time.monotonic,
) -> Iterator[DecodedFrame]:
    """Frames as they arrive, in readable form, for the given time."""
    return decoded(live_frames(bus, duration_s, clock), database)


def recorded(frames: Iterable[can.Message], path: Path) -> Iterator[can.Message]:
    """Pass frames on and write them to a candump, ASC or BLF file.

    Raises
    ------
    ConfigurationError
        When the file has another ending, cannot be written, or a frame has a time that no log can hold.
    """
    writer = open_log(path)
    try:
        for frame in frames:
            # python-can fails on such a time with an error of its own, for BLF only when the file is closed.
            if not abs(frame.timestamp) < _LARGEST_TIME_S:
                raise ConfigurationError(
                    file=path,
                    field="log",
                    expected="frames of a time that a log can hold, before the year 3000",
                    seen=f"{frame.timestamp:g} s",
                )
            writer.on_message_received(frame)
            yield frame
    finally:
        writer.stop()


@dataclass
class CycleTrace:
    """What the bus showed of one start command; times as in the frames, None for what did not come.

    Attributes
    ----------
    sequence, start_s, busy_s, done_s, acknowledged_s
        First start command, first Status that shows busy and done, first acknowledgement.
    result_times_s
        Of every result and uncertainty of this sequence.
    out_of_order
        What came before its turn, one sentence each.
    """

    sequence: int
    start_s: float
    busy_s: float | None = None
    done_s: float | None = None
    acknowledged_s: float | None = None
    result_times_s: list[float] = field(default_factory=list)
    out_of_order: list[str] = field(default_factory=list)

    @property
    def in_order(self) -> bool:
        """True when start, busy, results, done all came, in this order."""
        complete = self.busy_s is not None and self.done_s is not None and bool(self.result_times_s)
        return complete and not self.out_of_order


class CycleFollower:
    """Follows the newest start command through its frames; their order counts, not their times.

    Attributes
    ----------
    current
        The newest start; None before the first.
    """

    def __init__(self) -> None:
        self.current: CycleTrace | None = None

    def take(self, frame: DecodedFrame) -> bool:
        """Take the next frame; true when another start begins with it."""
        current = self.current
        same = current is not None and current.sequence == frame.values.get("Sequence")
        if frame.name == "Command" and frame.values.get("Code") == "start":
            if current is None or not same or current.acknowledged_s is not None:
                self.current = CycleTrace(int(frame.values["Sequence"]), frame.time_s)
                return True
        elif current is not None and same:
            _follow(current, frame)
        return False


def trace_cycles(frames: Iterable[DecodedFrame]) -> list[CycleTrace]:
    """Follow every start command through its frames, as `CycleFollower` does."""
    cycles: list[CycleTrace] = []
    follower = CycleFollower()
    for frame in frames:
        if follower.take(frame) and follower.current is not None:
            cycles.append(follower.current)
    return cycles


def _follow(cycle: CycleTrace, frame: DecodedFrame) -> None:
    if frame.name == "Status":
        if frame.values["Busy"] and cycle.busy_s is None:
            cycle.busy_s = frame.time_s
        if frame.values["ResultValid"] and cycle.done_s is None:
            cycle.done_s = frame.time_s
            if not cycle.result_times_s:
                cycle.out_of_order.append("done came before any result")
    elif frame.name == "Command":
        if frame.values["Code"] == "acknowledge" and cycle.acknowledged_s is None:
            cycle.acknowledged_s = frame.time_s
            if cycle.done_s is None:
                cycle.out_of_order.append("acknowledge came before done")
    elif frame.name is not None and frame.name.startswith(_RESULTS):
        # After done they are repetitions of what is held.
        if cycle.done_s is None:
            cycle.result_times_s.append(frame.time_s)
        if cycle.busy_s is None:
            cycle.out_of_order.append(f"{frame.name} came before busy")
