"""The driver ``serial``: a projector, or the controller of its lamp, on a serial line.

Lines of ASCII in the manner of SCPI, ended by a line feed, as docs/how-to/light-the-wheel.md lists them.
Whatever is set is asked for again at once, so that a lost character is a fault and not another brightness.
Every answer has a bound in time and in length.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator
from typing import Protocol

from pydantic import Field

from alignment.errors import ProjectorError, ProjectorTimeoutError, told
from sensors.formats.validation import StrictModel
from sensors.projectors.driver import ProjectorDriver, ProjectorPlace
from sensors.projectors.projector import ProjectorState

_LONGEST = 200  # characters of an answer
_ROUNDED = 0.0051  # of the brightness: controllers keep whole or half per cent


class SerialOptions(StrictModel):
    """How the projector is reached."""

    port: str = Field(
        min_length=1, max_length=200, description="Serial device, such as /dev/ttyUSB0, or a URL of pyserial"
    )
    baud: int = Field(default=115_200, ge=300, le=4_000_000, description="Bits per second")
    timeout_s: float = Field(default=0.5, ge=0.01, le=5, description="Longest wait for one answer, seconds")


class SerialPort(Protocol):
    """What is used of ``serial.Serial``."""

    def write(self, data: bytes, /) -> int | None:
        """Send."""
        ...

    def read_until(self, expected: bytes = ..., size: int | None = ...) -> bytes:
        """Read a line, or what there is of it at the bound."""
        ...

    def reset_input_buffer(self) -> None:
        """Forget what waits."""
        ...

    def close(self) -> None:
        """Let go."""
        ...


def open_port(options: SerialOptions) -> SerialPort:
    """Open a serial line with bounded reads and writes.

    Raises
    ------
    OSError, ValueError
        When the port cannot be opened.
    """
    import serial

    opened: SerialPort = serial.serial_for_url(
        options.port, options.baud, timeout=options.timeout_s, write_timeout=options.timeout_s
    )
    return opened


class SerialProjector:
    """A projector on a serial line.

    Parameters
    ----------
    rig
        That it lights.
    options
        How it is reached.
    opened
        Opens the line; exchanged in tests.
    """

    can_be_dark = True

    def __init__(
        self, rig: str, options: SerialOptions, opened: Callable[[SerialOptions], SerialPort] = open_port
    ) -> None:
        self.rig = rig
        self._options = options
        self._open = opened
        self._port: SerialPort | None = None
        self._identity = ""

    def connect(self) -> None:
        """Open the line and ask who is there."""
        if self._port is not None:
            return
        try:
            self._port = self._open(self._options)
        except Exception as error:
            raise ProjectorError(
                self.rig,
                f"expected to open {self._options.port}: {told(error)}",
                "Check its cable and power, who else has the port open, and the port in [rigs.projector]",
            ) from error
        with self._asking():
            self._port.reset_input_buffer()
        self._identity = self._ask("*IDN?")

    def light(self, brightness: float) -> None:
        """Set the brightness, switch it on, and look whether both are so."""
        self._tell(f"LIGHT:LEVEL {100.0 * brightness:.1f}")
        level = self._number("LIGHT:LEVEL?") / 100.0
        if not abs(level - brightness) <= _ROUNDED:
            self._lost()
            raise ProjectorError(
                self.rig,
                f"expected a brightness of {brightness:.1%}, it says {level:.1%}",
                "Check its cable; if it stays, its controller limits the light",
            )
        self._switch(True)

    def dark(self) -> None:
        """Switch it off, and look whether it is."""
        self._switch(False)

    def state(self) -> ProjectorState:
        """Ask for everything; what it does not know it answers with NAN."""
        return ProjectorState(
            self._identity,
            self._number("LIGHT:STATE?") != 0.0,
            self._number("LIGHT:LEVEL?") / 100.0,
            *(
                None if math.isnan(value) else value
                for value in map(self._number, ("LIGHT:TEMP?", "LIGHT:HOURS?"))
            ),
        )

    def close(self) -> None:
        """Switch it off where it still listens, and let the line go."""
        if self._port is not None:
            with contextlib.suppress(ProjectorError):
                self._tell("LIGHT:STATE OFF")
        self._lost()

    def _switch(self, lit: bool) -> None:
        word = "ON" if lit else "OFF"
        self._tell(f"LIGHT:STATE {word}")
        if (self._number("LIGHT:STATE?") != 0.0) != lit:
            self._lost()
            raise ProjectorError(
                self.rig,
                f"expected it to be {word.lower()}, it says that it is not",
                "Look whether its controller shows a fault: lamp, temperature, interlock",
            )

    def _number(self, question: str) -> float:
        answer = self._ask(question)
        try:
            return float(answer)
        except ValueError:
            self._lost()
            raise ProjectorError(
                self.rig,
                f"expected a number in answer to {question}, it said '{answer}'",
                "Check baud rate and cable, and that the projector speaks this protocol",
            ) from None

    def _ask(self, question: str) -> str:
        self._tell(question)
        with self._asking() as port:
            answer = port.read_until(b"\n", _LONGEST)
        text = answer.decode("ascii", "replace").strip()
        if not answer.endswith(b"\n"):
            self._lost()
            if len(answer) >= _LONGEST:
                raise ProjectorError(
                    self.rig,
                    f"expected an answer of one line to {question}, it sends on and on: '{text[:40]}…'",
                    "Check baud rate and cable, and that the projector speaks this protocol",
                )
            last = f"last seen '{text}'" if text else "none came"
            raise ProjectorTimeoutError(
                self.rig,
                f"expected an answer to {question} within {self._options.timeout_s:g} s, {last}",
                "Check its cable, power and baud rate",
            )
        return text

    def _tell(self, line: str) -> None:
        with self._asking() as port:
            port.write(f"{line}\n".encode("ascii"))

    @contextlib.contextmanager
    def _asking(self) -> Iterator[SerialPort]:
        if self._port is None:
            raise ProjectorError(self.rig, "is not connected", "Connect it first")
        try:
            yield self._port
        except Exception as error:
            # Whatever the port raises: it was unplugged, or does not take what is written.
            self._lost()
            raise ProjectorError(
                self.rig,
                f"the line to it is lost: {told(error)}",
                "Check its cable and power, then connect it again",
            ) from error

    def _lost(self) -> None:
        port, self._port = self._port, None
        if port is not None:
            with contextlib.suppress(Exception):
                port.close()


def _make(options: SerialOptions, place: ProjectorPlace) -> SerialProjector:
    return SerialProjector(place.rig, options)


DRIVER = ProjectorDriver(SerialOptions, _make)
"""The driver ``serial``."""
