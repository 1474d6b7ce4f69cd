"""A thread that makes the calls of one camera's driver, one by one, and can be left when one hangs."""

from __future__ import annotations

import threading
import weakref
from collections.abc import Callable
from queue import SimpleQueue
from typing import Any, TypeVar, TypeVarTuple

from alignment.errors import told

_A = TypeVarTuple("_A")
_T = TypeVar("_T")
Wait = Callable[[threading.Event, float], bool]
"""Waits for an event at most so many seconds; whether it came."""
_ENDING_S = 1.0


class DriverHungError(Exception):
    """A call did not come back within its bound."""


class _Call:
    """A call, and what came of it."""

    __slots__ = ("args", "done", "error", "function", "result")

    def __init__(self, function: Callable[..., Any], args: tuple[Any, ...]) -> None:
        self.function, self.args = function, args
        self.done = threading.Event()
        self.result: Any = None
        self.error: BaseException | None = None


class DriverThread:
    """Makes calls in a thread of its own, and waits for each within a bound.

    A thread cannot be killed. One whose call hangs is left: when the call comes back after all, it does what
    it was left with and ends. It is a daemon, so it does not keep the program from ending. Nobody who forgets
    it leaves it behind: it ends with the last reference to this object.

    Parameters
    ----------
    name
        Of the thread, for people who look at a stack.
    wait
        Waits for the end of a call.
    """

    def __init__(self, name: str, wait: Wait = threading.Event.wait) -> None:
        self._wait = wait
        self._calls: SimpleQueue[_Call | None] = SimpleQueue()
        self._thread = threading.Thread(target=_serve, args=(self._calls,), name=name, daemon=True)
        self._ending = weakref.finalize(self, self._calls.put, None)
        self._thread.start()

    @property
    def alive(self) -> bool:
        """Whether it runs, or hangs."""
        return self._thread.is_alive()

    def call(self, bound_s: float, function: Callable[[*_A], _T], *args: *_A) -> _T:
        """Make a call and return what it returns.

        Raises
        ------
        DriverHungError
            When it does not come back within the bound. Nothing may be called any more: `leave` it.
        """
        call = _Call(function, args)
        self._calls.put(call)
        if not self._wait(call.done, bound_s):
            raise DriverHungError
        try:
            if call.error is not None:
                raise call.error
            return call.result  # type: ignore[no-any-return]
        finally:
            # The error holds this frame, which would hold the error, and the images with it.
            call.error = call.result = None

    def leave(self, then: Callable[[], object]) -> None:
        """Give up waiting; when the call comes back, the thread does `then`, come what may, and ends."""
        self._calls.put(_Call(then, ()))
        self._ending()

    def end(self) -> None:
        """End it between two calls."""
        self._ending()
        self._thread.join(_ENDING_S)


def _serve(calls: SimpleQueue[_Call | None]) -> None:
    while (call := calls.get()) is not None:
        try:
            call.result = call.function(*call.args)
        except Exception as error:  # noqa: BLE001  (whatever a driver raises, the caller must learn of it)
            call.error = error
        except BaseException as error:  # noqa: BLE001  (a driver that ends a program ends this one not)
            call.error = RuntimeError(told(error))
        call.done.set()
        # While it waits for the next one it holds nothing of this one.
        del call
