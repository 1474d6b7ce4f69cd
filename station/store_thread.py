"""Calls to the database in a thread of their own, so that a database that hangs does not hang the station."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import ParamSpec, TypeVar

from alignment.errors import StoreUnavailableError

_P = ParamSpec("_P")
_T = TypeVar("_T")


class StoreThread:
    """Makes one call after the other, each within a bound.

    Parameters
    ----------
    timeout_s
        Longest wait for one call, seconds.
    """

    def __init__(self, timeout_s: float) -> None:
        self._timeout_s = timeout_s
        self._thread = ThreadPoolExecutor(1, "store")

    def call(self, call: Callable[_P, _T], *args: _P.args, **kwargs: _P.kwargs) -> _T:
        """Make a call and return its result.

        Raises
        ------
        StoreUnavailableError
            When it takes too long; and whatever the call raises.
        """
        future = self._thread.submit(call, *args, **kwargs)
        try:
            return future.result(self._timeout_s)
        except TimeoutError as error:
            future.cancel()
            raise StoreUnavailableError(
                f"the database did not answer within {self._timeout_s:g} s. Check its load and its disk"
            ) from error

    def close(self) -> None:
        """End the thread; a call that is under way is waited for."""
        self._thread.shutdown()
