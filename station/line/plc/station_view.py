"""What a controller knows of a station: the last good messages, and waiting for them within bounds."""

from __future__ import annotations

import threading
from collections.abc import Callable

import can

from alignment.errors import LineTimeoutError
from station.cycle import Guidance, LiveAngles, SweepProgress
from station.line.plc.orders import ReceivedMessage
from station.line.wire import (
    CommandAnswer,
    CommandCode,
    HandshakeState,
    LineMaster,
    LineStatus,
    LiveAge,
    ProtectedLink,
    StationInfo,
    Value,
    read_age,
    read_answer,
    read_guidance,
    read_info,
    read_live,
    read_master,
    read_progress,
    read_status,
)


class StationView:
    """Takes the station's frames in the receiving thread, and lets another thread wait for what they say.

    Parameters
    ----------
    link
        The controller's end of the line.
    clock
        Monotonic seconds.
    """

    def __init__(self, link: ProtectedLink, clock: Callable[[], float]) -> None:
        self._link = link
        self._clock = clock
        self._changed = threading.Condition()
        self._silent = False
        self._status: LineStatus | None = None
        self._last_status: LineStatus | None = None
        self._answer: CommandAnswer | None = None
        self._answers: dict[tuple[CommandCode, int], CommandAnswer] = {}
        self._info: StationInfo | None = None
        self._master: LineMaster | None = None
        self._received: list[ReceivedMessage] = []
        self._recording = False
        self._results: dict[str, dict[str, Value]] = {}
        self._live: dict[str, LiveAngles] = {}
        self._ages: dict[str, LiveAge] = {}
        endings = link.database.wheels.items()
        self._progress: tuple[int, SweepProgress] | None = None
        self._turnings = 0
        self._guided: dict[str, dict[str, Value]] = {}
        self._live_of = {f"LiveAngles{ending}": wheel for wheel, ending in endings}
        self._age_of = {f"LiveAge{ending}": wheel for wheel, ending in endings}
        self._guidance_of = {
            wheel: (f"Guidance{e}", f"GuidanceTarget{e}") for wheel, e in link.database.guided.items()
        }
        self._guidance = {name for pair in self._guidance_of.values() for name in pair}

    @property
    def status(self) -> LineStatus | None:
        """The last good Status; None before the first, and while the station is silent."""
        with self._changed:
            return self._status

    @property
    def answer(self) -> CommandAnswer | None:
        """The last good CommandAnswer."""
        with self._changed:
            return self._answer

    def answer_to(self, code: CommandCode, sequence: int) -> CommandAnswer | None:
        """The last good CommandAnswer to one command, also when another has been answered since."""
        with self._changed:
            return self._answers.get((code, sequence))

    def forget_answer(self, code: CommandCode, sequence: int) -> None:
        """Before a command is sent: what was answered to one of the same code and number is no answer to it.

        A station repeats its last answer, so that to the same command given twice running is heard again.
        """
        with self._changed:
            self._answers.pop((code, sequence), None)

    @property
    def info(self) -> StationInfo | None:
        """The last good StationInfo."""
        with self._changed:
            return self._info

    @property
    def master(self) -> LineMaster | None:
        """The last good MasterCheck; None of a station before 3.2."""
        with self._changed:
            return self._master

    @property
    def live(self) -> dict[str, LiveAngles]:
        """The last live angles of each wheel."""
        with self._changed:
            return dict(self._live)

    @property
    def live_ages(self) -> dict[str, LiveAge]:
        """How old the last live angles of each wheel were when they were sent."""
        with self._changed:
            return dict(self._ages)

    @property
    def progress(self) -> tuple[int, SweepProgress] | None:
        """How the last sweep goes, and the number of its start."""
        with self._changed:
            return self._progress

    @property
    def turnings(self) -> int:
        """How often a position of a sweep was wanted since `record`."""
        with self._changed:
            return self._turnings

    @property
    def guidance(self) -> dict[str, tuple[Guidance, float | None]]:
        """What to do at each wheel, and how old that was when it was sent; of wheels that were told of.

        Raises
        ------
        LineError
            When what is told of a wheel contradicts itself.
        """
        with self._changed:
            return {
                wheel: read_guidance(wheel, self._guided[name], self._guided[target])
                for wheel, (name, target) in self._guidance_of.items()
                if name in self._guided and target in self._guided
            }

    @property
    def results(self) -> dict[str, dict[str, Value]]:
        """The last good result messages, by name."""
        with self._changed:
            return dict(self._results)

    def record(self) -> None:
        """Forget results and live angles, and keep every message from now on."""
        with self._changed:
            self._received.clear()
            self._recording = True
            self._results.clear()
            self._forget_shown()

    def recorded(self) -> tuple[ReceivedMessage, ...]:
        """All messages since `record`; keeps none any more."""
        with self._changed:
            self._recording = False
            return tuple(self._received)

    def lose_when_silent(self, silence_s: float) -> bool:
        """Forget everything when no good Status came for so long; whether that is so now."""
        heard = self._link.heard_s("Status")
        if heard is None or self._clock() - heard <= silence_s:
            return False
        with self._changed:
            self._silent = True
            self._last_status, self._status, self._answer = self._status, None, None
            self._answers.clear()
            self._results.clear()
            self._forget_shown()
            self._link.forget()
            self._changed.notify_all()
        return True

    def _forget_shown(self) -> None:
        self._live.clear()
        self._ages.clear()
        self._guided.clear()
        self._progress, self._turnings = None, 0

    def receive(self, frame: can.Message) -> None:
        """Take one frame; the bus's receiving thread calls this."""
        with self._changed:
            read = self._link.read(frame)
            if read is None:
                return
            name, values = read
            if self._recording:
                self._received.append(ReceivedMessage(self._clock(), name, values))
            match name:
                case "Status":
                    before, self._status, self._silent = self._status, read_status(values), False
                    turning = HandshakeState.TURNING
                    if self._status.handshake is turning and (before is None or before.handshake != turning):
                        self._turnings += 1
                case "CommandAnswer":
                    self._answer = read_answer(values)
                    self._answers[self._answer.code, self._answer.sequence] = self._answer
                case "StationInfo":
                    self._info = read_info(values)
                case "MasterCheck":
                    self._master = read_master(values)
                case _ if wheel := self._live_of.get(name):
                    self._live[wheel] = read_live(wheel, values)
                case _ if wheel := self._age_of.get(name):
                    self._ages[wheel] = read_age(wheel, values)
                case "SweepProgress":
                    self._progress = read_progress(values)
                case _ if name in self._guidance:
                    self._guided[name] = values
                case _:
                    self._results[name] = values
            self._changed.notify_all()

    def wait(
        self, what: str, timeout_s: float, reached: Callable[[LineStatus], bool], patient: bool = False
    ) -> LineStatus:
        """Wait for a Status; one that is patient outlasts a silent station.

        Raises
        ------
        LineTimeoutError
            When it does not come in time, or the station is silent; with the last status.
        """
        deadline = self._clock() + timeout_s
        with self._changed:
            while self._silent or self._status is None or not reached(self._status):
                remaining = deadline - self._clock()
                if remaining <= 0 or (self._silent and not patient):
                    problem = "the station is silent" if self._silent else "time is over"
                    raise LineTimeoutError(
                        f"expected {what} within {timeout_s:g} s, but {problem}; "
                        f"last status: {self._status or self._last_status or 'none'}"
                    )
                self._changed.wait(remaining)
            return self._status

    def wait_until(self, timeout_s: float, reached: Callable[[], bool]) -> bool:
        """Wait until something is so, looked at with every good message; whether it came in time."""
        deadline = self._clock() + timeout_s
        with self._changed:
            while not reached():
                remaining = deadline - self._clock()
                if remaining <= 0:
                    return False
                self._changed.wait(remaining)
            return True
