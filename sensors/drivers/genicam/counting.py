"""From the number that a camera gives a frame to the trigger it belongs to."""

from __future__ import annotations

_SIXTEEN_BITS = 0xFFFF
_HALF = _SIXTEEN_BITS // 2


class FrameIds:
    """Counts the exposures of one acquisition by the camera's own numbers, never by arrival.

    A frame that was lost on the way leaves a gap in the numbers, one that comes twice has the same number.
    GigE Vision 1.x has numbers of 16 bits, which go on with 1 after 65535; 0 means none.

    Parameters
    ----------
    first
        Number of the first frame of an acquisition: 1 with GigE Vision, 0 with USB3 Vision.
    """

    def __init__(self, first: int) -> None:
        self._first = first
        self._highest = first - 1

    def counter(self, frame_id: int) -> int:
        """Return which exposure of the acquisition a frame is, from 1; below 1 is one of an earlier one."""
        unwrapped = frame_id
        if self._first == 1 and frame_id <= _SIXTEEN_BITS and self._highest > _HALF:
            rounds = (self._highest - frame_id + _HALF) // _SIXTEEN_BITS
            unwrapped += rounds * _SIXTEEN_BITS
        self._highest = max(self._highest, unwrapped)
        return unwrapped - self._first + 1
