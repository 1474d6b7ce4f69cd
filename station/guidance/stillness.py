"""Whether a wheel is at rest, and where: the last few results of it."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from station.guidance.plan import GuidanceSettings

_MOST = 256


@dataclass(frozen=True)
class Rest:
    """Where a wheel rests: the mean of the results that say so, radians."""

    camber: float
    toe: float


class Stillness:
    """The last results of a wheel.

    A wheel rests when enough results, over long enough a time, differ by no more than noise does.
    """

    def __init__(self, settings: GuidanceSettings) -> None:
        self._settings = settings
        self._last: deque[tuple[float, float, float]] = deque(maxlen=_MOST)

    def clear(self) -> None:
        """Forget all of them: the wheel was not seen, or is looked at anew."""
        self._last.clear()

    def take(self, time_s: float, camber: float, toe: float) -> None:
        """Add a result; forget what is older than needed."""
        settings, last = self._settings, self._last
        last.append((time_s, camber, toe))
        while len(last) > settings.readings and time_s - last[1][0] >= settings.rest_s:
            last.popleft()

    @property
    def rest(self) -> Rest | None:
        """Where it rests; None while it moves, or not enough is known."""
        settings, last = self._settings, self._last
        if len(last) < settings.readings or last[-1][0] - last[0][0] < settings.rest_s:
            return None
        cambers, toes = [each[1] for each in last], [each[2] for each in last]
        if max(max(cambers) - min(cambers), max(toes) - min(toes)) > settings.still:
            return None
        return Rest(sum(cambers) / len(last), sum(toes) / len(last))
