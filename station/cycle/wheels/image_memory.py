"""Memory for exposures that are kept until they are archived: a series of one wheel is over 100 megabytes."""

from __future__ import annotations

import threading
import weakref

from sensors.shot import WheelShot


class ImageMemory:
    """Says of each exposure whether there is room to keep it; room comes back when the exposure is let go.

    Whoever lets it go, and why, makes no difference: what counts is what is in memory. Threads may share it.

    Parameters
    ----------
    most_bytes
        Of all exposures that are kept at once.
    """

    def __init__(self, most_bytes: int) -> None:
        self._most_bytes = most_bytes
        # A finalizer may run inside of `take`, in the same thread.
        self._lock = threading.RLock()
        self._bytes = 0

    @property
    def bytes(self) -> int:
        """Of the exposures that are kept now."""
        return self._bytes

    def take(self, shot: WheelShot) -> bool:
        """Count an exposure in; false when there is no room for it, and it is not to be kept."""
        size = sum(frame.image.nbytes for frame in shot.frames)
        size += sum(side.image.nbytes for head in shot.dark for side in (head.left, head.right))
        with self._lock:
            if self._bytes + size > self._most_bytes:
                return False
            self._bytes += size
        weakref.finalize(shot, self._let_go, size).atexit = False
        return True

    def _let_go(self, size: int) -> None:
        with self._lock:
            self._bytes -= size
