"""Calls to the database in a thread of their own, so that a database that hangs does not hang the station."""

from __future__ import annotations

import logging
from collections.abc import Callable
from concurrent.futures import Future
from typing import ParamSpec, TypeVar

from alignment.errors import StoreError, StoreUnavailableError, TruewheelError
from station.threads import Worker, WorkerError

_P = ParamSpec("_P")
_T = TypeVar("_T")
_LOG = logging.getLogger("truewheel.station")


class StoreThread:
    """Makes one call after the other, each within a bound.

    A call that outlasts its bound goes on all the same, and what it writes may land later: `owed` and
    `ledger` see to it that the database then says what the line was told.

    Parameters
    ----------
    timeout_s
        Longest wait for one call, seconds.
    """

    def __init__(self, timeout_s: float) -> None:
        self.timeout_s = timeout_s
        self.worker = Worker("store")

    def call(self, call: Callable[_P, _T], *args: _P.args, **kwargs: _P.kwargs) -> _T:
        """Make a call and return its result; one that did not begin within the bound is not made.

        Raises
        ------
        StoreUnavailableError
            When it takes too long, or the thread takes no more calls.
        StoreError
            Also for whatever the call raises that is no error of the product.
        TruewheelError
            As the call raises it.
        """
        try:
            future = self.submit(call, *args, **kwargs)
        except WorkerError as error:
            raise StoreUnavailableError(f"the database cannot be asked: {error}") from error
        try:
            return future.result(self.timeout_s)
        except TruewheelError:
            raise
        except TimeoutError as error:
            if not future.done():
                future.cancel()
                raise StoreUnavailableError(
                    f"the database did not answer within {self.timeout_s:g} s. Check its load and its disk"
                ) from error
            raise _unforeseen(error) from error
        except Exception as error:
            raise _unforeseen(error) from error

    def submit(self, call: Callable[_P, _T], *args: _P.args, **kwargs: _P.kwargs) -> Future[_T]:
        """Let a call be made after those before it; returns at once.

        Raises
        ------
        WorkerError
            When the thread takes no more calls.
        """
        return self.worker.submit(call, *args, **kwargs)

    def close(self) -> bool:
        """End the thread; false when a call that is under way outlasts the bound, and is left to itself."""
        ended = self.worker.close(self.timeout_s)
        if not ended:
            _LOG.error("a call to the database did not end within %g s and is left behind", self.timeout_s)
        return ended


def _unforeseen(error: Exception) -> StoreError:
    return StoreError(f"the database failed: {type(error).__name__}: {error}. Report this as a defect")
