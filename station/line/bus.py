"""One end of the bus: opened by configuration, received by a supervised thread, logged if wanted."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import can
from can.io.generic import MessageWriter

from alignment.errors import ConfigurationError, LineConnectionError
from station.line.supervised import SupervisedThread

RECEIVE_WAIT_S = 0.05
SEND_TIMEOUT_S = 0.2
LOG_ENDINGS = (".log", ".asc", ".blf")
Listener = Callable[[can.Message], None]


@dataclass(frozen=True)
class BusSettings:
    """How to reach the bus.

    Attributes
    ----------
    interface
        Name of a python-can interface: ``virtual`` (one process), ``socketcan``, ``pcan``, ``vector``, …
    channel
        Its channel; for ``virtual`` any name that both ends share.
    bitrate
        Bits per second, for interfaces that set it.
    log
        File that takes all traffic: ``.log`` (candump), ``.asc`` or ``.blf``; None writes none.
    options
        Further arguments of the interface.
    """

    interface: str = "virtual"
    channel: str = "truewheel"
    bitrate: int = 500_000
    log: Path | None = None
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class BusHealth:
    """Counters of one end of the bus.

    Attributes
    ----------
    receiving
        True while the receiving thread runs.
    received, sent
        Frames.
    receive_failures, send_failures, log_failures
        Failures; each is survived and tried again, except that a log that failed is written no further.
    last_error
        The latest failure as text.
    """

    receiving: bool
    received: int
    sent: int
    receive_failures: int
    send_failures: int
    log_failures: int
    last_error: str | None


class LineBus:
    """An open bus with its receiving thread. Use `open_bus`; close it, or use it in a `with`.

    Parameters
    ----------
    bus
        The python-can bus; this object owns it and shuts it down.
    writer
        Takes every frame sent and received, in the order cause before effect.
    now
        Wall clock, seconds, for the log alone.
    """

    def __init__(
        self, bus: can.BusABC, writer: MessageWriter | None = None, now: Callable[[], float] = time.time
    ) -> None:
        self._bus = bus
        self._writer = writer
        self._now = now
        self._listeners: list[Listener] = []
        # Held over send and log together: the answer to a frame can then not be logged before the frame.
        self._lock = threading.Lock()
        self._received = self._sent = self._send_failures = self._log_failures = 0
        self._last_error: str | None = None
        self._closed = False
        self._receiver = SupervisedThread(f"line receive {bus.channel_info}", self._receive_one)
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
                raise LineConnectionError(f"{self._bus.channel_info} is closed, expected an open bus")
            frame.timestamp = self._now()
            frame.is_rx = False
            try:
                self._bus.send(frame, timeout=SEND_TIMEOUT_S)
            except (can.CanError, OSError) as error:
                self._send_failures += 1
                self._last_error = f"send: {error}"
                raise LineConnectionError(
                    f"{self._bus.channel_info} did not take frame 0x{frame.arbitration_id:X} within "
                    f"{SEND_TIMEOUT_S:g} s: {error}. Check the adapter, the cable and the other end."
                ) from error
            self._sent += 1
            self._log(frame)

    @property
    def health(self) -> BusHealth:
        """Counters up to now."""
        receive_error = self._receiver.last_error
        return BusHealth(
            receiving=self._receiver.alive,
            received=self._received,
            sent=self._sent,
            receive_failures=self._receiver.failures,
            send_failures=self._send_failures,
            log_failures=self._log_failures,
            last_error=self._last_error or (f"receive: {receive_error!r}" if receive_error else None),
        )

    def close(self) -> None:
        """Join the receiving thread, finish the log, shut the bus down; harmless when closed."""
        self._receiver.stop()
        with self._lock:
            if self._closed:
                return
            self._closed = True
            self._bus.shutdown()
            self._finish_log()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _receive_one(self, stopping: threading.Event) -> None:
        frame = self._bus.recv(RECEIVE_WAIT_S)
        if frame is None:
            return
        self._received += 1
        with self._lock:
            self._log(frame)
        failed: Exception | None = None
        for listener in self._listeners:
            try:
                listener(frame)
            except Exception as error:  # noqa: BLE001  (one listener's failure must not keep a frame from others)
                failed = error
        if failed is not None:
            raise failed

    def _log(self, frame: can.Message) -> None:
        if self._writer is None:
            return
        try:
            self._writer.on_message_received(frame)
        except (OSError, ValueError) as error:
            self._log_failures += 1
            self._last_error = f"log: {error}"
            self._finish_log()

    def _finish_log(self) -> None:
        writer, self._writer = self._writer, None
        if writer is None:
            return
        try:
            writer.stop()
        except (OSError, ValueError) as error:
            self._log_failures += 1
            self._last_error = f"log: {error}"


def open_bus(settings: BusSettings, now: Callable[[], float] = time.time) -> LineBus:
    """Open one end of the bus, and its log where one is configured.

    Raises
    ------
    LineConnectionError
        When the interface is unknown or not installed, or the channel cannot be opened.
    ConfigurationError
        When the log cannot be written.
    """
    writer = None if settings.log is None else _open_log(settings.log)
    try:
        bus = can.Bus(
            interface=settings.interface,
            channel=settings.channel,
            bitrate=settings.bitrate,
            ignore_config=True,
            **dict(settings.options),
        )
    except (can.CanError, OSError, ValueError, TypeError, ImportError, NotImplementedError) as error:
        if writer is not None:
            writer.stop()
        known = settings.interface in can.VALID_INTERFACES
        cure = (
            "Check that the adapter is plugged in, its driver installed and the channel free."
            if known
            else f"Choose one of {', '.join(sorted(can.VALID_INTERFACES))}."
        )
        raise LineConnectionError(
            f"line interface '{settings.interface}', channel '{settings.channel}': expected a bus that "
            f"opens, found: {error}. {cure}"
        ) from error
    return LineBus(bus, writer, now)


def _open_log(path: Path) -> MessageWriter:
    if path.suffix.lower() not in LOG_ENDINGS:
        raise ConfigurationError(
            file=path,
            field="log",
            expected=f"a file ending in {', '.join(LOG_ENDINGS)}",
            seen=path.suffix or "none",
        )
    try:
        return can.Logger(path)
    except OSError as error:
        raise ConfigurationError(
            file=path, field="log", expected="a file that can be written", seen=str(error.strerror)
        ) from error
