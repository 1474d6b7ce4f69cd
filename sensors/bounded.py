"""The object of a driver whose calls are bounded; another one is made where it hangs."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar, TypeVarTuple

from alignment.counting import count_of
from alignment.errors import ConfigurationError, TruewheelError
from sensors.driver_calls import DriverHungError, DriverThread, Wait

MOST_LEFT = 3
"""Hung calls of one device that may be left behind; with more it is refused until the program starts anew."""


class Closable(Protocol):
    """What can be let go."""

    def close(self) -> None:
        """Let it go."""
        ...


_A = TypeVarTuple("_A")
_T = TypeVar("_T")
_D = TypeVar("_D", bound=Closable)


@dataclass(frozen=True)
class CallBounds:
    """How long a driver may take.

    Attributes
    ----------
    call_s
        For connecting, arming and closing, seconds.
    trigger_s
        For a trigger.
    late_s
        By how much `fetch` may miss its own timeout.
    """

    call_s: float = 10.0
    trigger_s: float = 4.0
    late_s: float = 2.0

    def __post_init__(self) -> None:
        for field in ("call_s", "trigger_s", "late_s"):
            if not 0 < getattr(self, field) <= 3600:
                raise ConfigurationError(
                    field=field, expected="above 0, at most 3600", seen=str(getattr(self, field))
                )


class DriverGoneError(Exception):
    """A call hung, or nothing may be called because one did.

    Attributes
    ----------
    problem, cure
        For the error of the device.
    """

    def __init__(self, problem: str, cure: str) -> None:
        super().__init__(problem)
        self.problem, self.cure = problem, cure


class BoundedDriver(Generic[_D]):
    """Makes the calls of one driver object in a thread of its own, each within a bound.

    A call that does not come back is left behind: when it does after all, the driver is closed and the
    thread ends. `begin` takes another driver object then, as often as `MOST_LEFT`, or waits for this one
    where no other can be made. Used by one thread at a time.

    Parameters
    ----------
    kind, name
        Such as ``camera``, and the name of this one.
    device
        The driver object, not connected.
    make
        Makes another object of the same device; without, a driver that hangs is waited for.
    wait
        Waits for a call to come back.
    """

    def __init__(self, kind: str, name: str, device: _D, make: Callable[[], _D] | None, wait: Wait) -> None:
        self.kind, self.name, self.device = kind, name, device
        self.hung = 0
        self._make, self._wait = make, wait
        self._thread: DriverThread | None = None
        self._left: list[DriverThread] = []
        # Why nothing may be asked of it before it is begun again.
        self._lost: str | None = None
        # The object whose driver hangs is not to be touched.
        self._stuck: DriverThread | None = None

    @property
    def begun(self) -> bool:
        """Whether calls can be made."""
        return self._thread is not None

    @property
    def lost(self) -> str | None:
        """Which call was left behind, since it was begun; None where none was."""
        return self._lost

    @property
    def left_behind(self) -> int:
        """Threads whose call never came back so far."""
        self._left = [thread for thread in self._left if thread.alive]
        return len(self._left)

    def begin(self, bound_s: float) -> bool:
        """Have a thread, and a driver object in which no call hangs; whether one was left before.

        Raises
        ------
        DriverGoneError
            When too many calls hang, or one that cannot be done without.
        """
        hung = self.left_behind
        if hung >= MOST_LEFT:
            raise DriverGoneError(
                f"its driver did not come back from {count_of(hung, 'call')}",
                f"Start the station anew, check the {self.kind}'s power, and tell the makers of its driver",
            )
        stuck = self._stuck is not None and self._stuck.alive
        if stuck and self._make is None:
            raise DriverGoneError(
                f"{self._lost}, and still has not",
                f"Cut the {self.kind}'s power for a moment; if that does not help, start the station anew",
            )
        self._thread = DriverThread(f"{self.kind} {self.name}", self._wait)
        if stuck:
            assert self._make is not None
            self.device = self._made(self._make, bound_s)
        before, self._lost, self._stuck = self._lost, None, None
        return before is not None

    def call(self, what: str, bound_s: float, function: Callable[[*_A], _T], *args: *_A) -> _T:
        """Make a call and return what it returns, or raise what it raises.

        Raises
        ------
        DriverGoneError
            When it does not come back within the bound, or nothing may be called.
        """
        if self._thread is None:
            raise DriverGoneError(
                "is not connected" if self._lost is None else self._lost, "Connect it first"
            )
        return self._called(what, bound_s, function, *args, then=self.device.close)

    def end(self) -> None:
        """End its thread between two calls."""
        if self._thread is not None:
            self._thread.end()
            self._thread = None

    def close(self, bound_s: float) -> None:
        """Close the driver object and end the thread; one that hangs is let go by its thread, if ever."""
        if self._thread is None:
            return
        try:
            self.call("close", bound_s, self.device.close)
        finally:
            self.end()

    def let_go(self, bound_s: float) -> None:
        """Close what failed; what it says at parting is no news."""
        with suppress(TruewheelError, Exception):
            self.close(bound_s)

    def _made(self, make: Callable[[], _D], bound_s: float) -> _D:
        """Another driver object; where it cannot be had the one before is not touched."""
        try:
            return self._called(f"the making of its {self.kind}s", bound_s, make, then=None)
        except BaseException:
            self.end()
            raise

    def _called(
        self,
        what: str,
        bound_s: float,
        function: Callable[[*_A], _T],
        *args: *_A,
        then: Callable[[], object] | None,
    ) -> _T:
        assert self._thread is not None
        try:
            return self._thread.call(bound_s, function, *args)
        except DriverHungError:
            self._leave(then)
            self.hung += 1
            self._lost = f"its driver did not come back from {what} within {bound_s:g} s"
            raise DriverGoneError(
                self._lost,
                f"Check the {self.kind}'s power and cable; it is connected anew at a reset",
            ) from None

    def _leave(self, then: Callable[[], object] | None) -> None:
        """Leave a thread that hangs; in the making of an object the one before is not touched by it."""
        thread, self._thread = self._thread, None
        assert thread is not None
        self._left.append(thread)
        thread.leave(then or _nothing)
        if then is not None:
            self._stuck = thread


def _nothing() -> None:
    """What is to be done after a call in which nothing was made."""
