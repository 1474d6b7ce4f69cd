"""One end of the bus: opened by configuration, received by a supervised thread, logged if wanted."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import Self

import can
from can.io.generic import MessageWriter

from alignment.counting import count_of
from alignment.errors import ConfigurationError, LineConnectionError
from station.cycle import Coalesced
from station.line.wire.adapters import FOREIGN, said
from station.line.wire.bus_log import open_log
from station.line.wire.channel import BusSettings, Channel
from station.threads import SupervisedThread

RECEIVE_WAIT_S = 0.05
SEND_TIMEOUT_S = 0.2
SEND_PATIENCE_S = 2.0
REOPEN_FIRST_S, REOPEN_LAST_S = 0.1, 5.0
_SOCKETCAN_BUS_OFF = 0x40
Listener = Callable[[can.Message], None]
_LOG = logging.getLogger("truewheel.line")


@dataclass(frozen=True)
class BusHealth:
    """State and counters of one end of the bus.

    Attributes
    ----------
    connected
        False while the adapter is away or off the bus; it is opened again until it answers.
    receiving
        True while the receiving thread runs.
    received, sent
        Frames.
    receive_failures, send_failures, log_failures
        Failures; each is survived and tried again, except that a log that failed is written no further.
    error_frames
        Error frames that the adapter reported.
    losses
        How often the adapter was lost.
    last_error
        The latest failure as text.
    """

    connected: bool
    receiving: bool
    received: int
    sent: int
    receive_failures: int
    send_failures: int
    log_failures: int
    error_frames: int
    losses: int
    last_error: str | None

    def __str__(self) -> str:
        said = [f"{self.received} frames received", f"{self.sent} sent"]
        counts = {
            "failure": self.receive_failures + self.send_failures + self.log_failures,
            "error frame": self.error_frames,
            "loss": self.losses,
        }
        said += [
            count_of(count, name, "losses" if name == "loss" else None)
            for name, count in counts.items()
            if count
        ]
        return ", ".join(said) + (f", the last: {self.last_error}" if self.last_error else "")


class LineBus:
    """An open bus with its receiving thread. Use `open_bus`; close it, or use it in a `with`.

    An adapter that fails while receiving, that went off the bus, or that takes no frame for two seconds is
    closed and opened again, at growing intervals, until it answers.

    Parameters
    ----------
    opened
        Opens the python-can bus, now and after each loss; this object owns what it returns.
    writer
        Takes every frame sent and received, in the order cause before effect.
    now, clock
        Wall clock for the log alone, and monotonic seconds.
    released
        Called when the bus is closed for good.
    name
        For messages; what the adapter calls itself without.

    Raises
    ------
    ConfigurationError, or whatever `opened` raises
        When the bus does not open at first.
    """

    def __init__(
        self,
        opened: Callable[[], can.BusABC],
        writer: MessageWriter | None = None,
        now: Callable[[], float] = time.time,
        clock: Callable[[], float] = time.monotonic,
        released: Callable[[], None] = lambda: None,
        name: str | None = None,
    ) -> None:
        self._opened = opened
        self._released = released
        self._bus: can.BusABC | None = opened()
        self._name = name or str(self._bus.channel_info)
        self._writer = writer
        self._now = now
        self._clock = clock
        self._listeners: list[Listener] = []
        # Held over send and log together: the answer to a frame can then not be logged before the frame.
        self._lock = threading.Lock()
        self._received = self._sent = self._send_failures = self._log_failures = 0
        self._receive_failures = self._error_frames = self._losses = 0
        self._refusing_since: float | None = None
        self._pause_s = REOPEN_FIRST_S
        self._last_error: str | None = None
        self._closed = False
        # An adapter that fails as soon as it is open would fill the program's log.
        self._said = Coalesced[int](lambda level, text: _LOG.log(level, "%s %s", self._name, text), clock)
        self._receiver = SupervisedThread(f"line receive {self._name}", self._receive_one)
        self._receiver.start()

    def listen(self, listener: Listener) -> None:
        """Call `listener` with every frame received from now on, in the receiving thread."""
        self._listeners = [*self._listeners, listener]

    def unlisten(self, listener: Listener) -> None:
        """End `listen`; harmless when it does not listen."""
        self._listeners = [other for other in self._listeners if other != listener]

    def send(self, frame: can.Message) -> None:
        """Send one frame within a bounded time.

        Raises
        ------
        LineConnectionError
            When the bus is closed or does not take the frame in time.
        """
        with self._lock:
            if self._closed:
                raise LineConnectionError(f"{self._name} is closed, expected an open bus")
            if self._bus is None:
                self._send_failures += 1
                raise LineConnectionError(
                    f"{self._name} is away and is being opened again: {self._last_error}. Check the adapter "
                    "and the cable."
                )
            frame.timestamp = self._now()
            frame.is_rx = False
            try:
                self._bus.send(frame, timeout=SEND_TIMEOUT_S)
            except FOREIGN as error:
                self._send_failures += 1
                self._last_error = f"send: {said(error)}"
                self._refusing_since = self._refusing_since or self._clock()
                raise LineConnectionError(
                    f"{self._name} did not take frame 0x{frame.arbitration_id:X} within "
                    f"{SEND_TIMEOUT_S:g} s: {said(error)}. Check the adapter, the cable and the other end."
                ) from error
            self._refusing_since = None
            self._sent += 1
            self._log(frame)

    def log_to(self, writer: MessageWriter) -> None:
        """Write every frame from now on; `close` ends the writer."""
        with self._lock:
            self._writer = writer

    @property
    def health(self) -> BusHealth:
        """State and counters up to now."""
        receive_error = self._receiver.last_error
        return BusHealth(
            connected=self._bus is not None,
            receiving=self._receiver.alive,
            received=self._received,
            sent=self._sent,
            receive_failures=self._receive_failures + self._receiver.failures,
            send_failures=self._send_failures,
            log_failures=self._log_failures,
            error_frames=self._error_frames,
            losses=self._losses,
            last_error=self._last_error or (f"receive: {receive_error}" if receive_error else None),
        )

    @property
    def thread(self) -> SupervisedThread:
        """The receiving thread, for who looks after threads."""
        return self._receiver

    def close(self) -> None:
        """Join the receiving thread, finish the log, shut the bus down; harmless when closed."""
        self._receiver.stop()
        with self._lock:
            if self._closed:
                return
            self._closed = True
            self._said.flush()
            self._shut_down()
            self._released()
            self._finish_log()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _receive_one(self, stopping: threading.Event) -> None:
        self._said.flush_due()
        bus = self._bus
        if bus is None:
            self._reopen(stopping)
            return
        try:
            frame = bus.recv(RECEIVE_WAIT_S)
            off = _is_off(bus, frame)
        except FOREIGN as error:  # (pyserial raises TypeError when its device goes away amid a read)
            self._receive_failures += 1
            self._lose(f"receive: {said(error)}")
            return
        since = self._refusing_since
        if off:
            self._lose("bus off")
        elif since is not None and self._clock() - since > SEND_PATIENCE_S:
            self._lose(f"{self._last_error}; no frame was taken for {SEND_PATIENCE_S:g} s")
        if frame is None:
            return
        if frame.is_error_frame:
            self._error_frames += 1
        self._received += 1
        with self._lock:
            self._log(frame)
        self._hand_over(frame)

    def _hand_over(self, frame: can.Message) -> None:
        failed: Exception | None = None
        for listener in self._listeners:
            try:
                listener(frame)
            except Exception as error:  # noqa: BLE001  (one listener's failure must not keep a frame from others)
                failed = error
        if failed is not None:
            raise failed

    def _lose(self, why: str) -> None:
        with self._lock:
            self._last_error = why
            self._losses += 1
            self._refusing_since = None
            self._shut_down()
        self._said.say(logging.ERROR, f"is lost: {why}")

    def _reopen(self, stopping: threading.Event) -> None:
        if stopping.wait(self._pause_s):
            return
        try:
            bus = self._opened()
        except FOREIGN as error:
            self._last_error = f"open: {error if isinstance(error, ConfigurationError) else said(error)}"
            self._pause_s = min(2.0 * self._pause_s, REOPEN_LAST_S)
            return
        self._pause_s = REOPEN_FIRST_S
        with self._lock:
            self._bus = bus
        self._said.say(logging.WARNING, "is open again")

    def _shut_down(self) -> None:
        bus, self._bus = self._bus, None
        if bus is None:
            return
        try:
            bus.shutdown()
        except FOREIGN as error:
            # What is gone cannot be closed properly.
            self._last_error = self._last_error or f"close: {said(error)}"

    def _log(self, frame: can.Message) -> None:
        if self._writer is None:
            return
        try:
            self._writer.on_message_received(frame)
        except FOREIGN as error:
            self._log_failures += 1
            self._last_error = f"log: {said(error)}"
            self._finish_log()

    def _finish_log(self) -> None:
        writer, self._writer = self._writer, None
        if writer is None:
            return
        try:
            writer.stop()
        except FOREIGN as error:
            self._log_failures += 1
            self._last_error = f"log: {said(error)}"


def open_bus(settings: BusSettings, now: Callable[[], float] = time.time) -> LineBus:
    """Open one end of the bus, and its log where one is configured.

    Raises
    ------
    ConfigurationError
        When the interface is unknown or not installed, the channel cannot be opened, or the log cannot be
        written.
    """
    channel = Channel(settings)
    bus = LineBus(channel, now=now, released=channel.release, name=str(channel))
    if settings.log is not None:
        # After the bus: a start that fails puts no log aside.
        try:
            bus.log_to(open_log(settings.log, settings.log_bytes, settings.log_files))
        except BaseException:
            bus.close()
            raise
    return bus


def _is_off(bus: can.BusABC, frame: can.Message | None) -> bool:
    """Whether the adapter says that it is off the bus: by its state, or by an error frame of socketcan."""
    if frame is not None:
        return frame.is_error_frame and bool(frame.arbitration_id & _SOCKETCAN_BUS_OFF)
    try:
        return bus.state is can.BusState.ERROR
    except NotImplementedError:
        return False
