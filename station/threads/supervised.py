"""A background thread that cannot die unseen: it repeats a step, keeps what failed, and ends when told."""

from __future__ import annotations

import threading
from collections.abc import Callable

from alignment.errors import LineError


def described(error: BaseException) -> str:
    """Return an error in words, by its type and its text."""
    return f"{type(error).__name__}: {error}"


class SupervisedThread:
    """Repeats `step` until it is stopped. A step that raises is counted, remembered, and tried again.

    Parameters
    ----------
    name
        Of the thread, for people who look at a stack.
    step
        One bounded piece of work: it returns within a fraction of a second, at the latest when `stopping`
        is set.
    pause_s
        Rest after a failed step, so that a lasting failure does not take the processor.
    """

    def __init__(self, name: str, step: Callable[[threading.Event], None], pause_s: float = 0.1) -> None:
        self.stopping = threading.Event()
        self._step = step
        self._pause_s = pause_s
        self._failures = 0
        self._last_error: str | None = None
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    @property
    def name(self) -> str:
        """Of the thread."""
        return self._thread.name

    @property
    def alive(self) -> bool:
        """True while the thread runs."""
        return self._thread.is_alive()

    @property
    def failures(self) -> int:
        """How many steps raised."""
        return self._failures

    @property
    def last_error(self) -> str | None:
        """What the last failed step raised, in words: the error itself would keep all that its step held."""
        return self._last_error

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self, timeout_s: float = 5.0) -> None:
        """End and join; harmless when it never began or has ended.

        Raises
        ------
        LineError
            When the current step does not end within the bound.
        """
        self.stopping.set()
        if self._thread.ident is not None:
            self._thread.join(timeout_s)
        if self._thread.is_alive():
            raise LineError(f"the thread '{self._thread.name}' did not end within {timeout_s:g} s")

    def _run(self) -> None:
        while not self.stopping.is_set():
            try:
                self._step(self.stopping)
            except Exception as error:  # noqa: BLE001  (whatever it is, it must be seen and survived)
                self._failures += 1
                self._last_error = described(error)
                self.stopping.wait(self._pause_s)
