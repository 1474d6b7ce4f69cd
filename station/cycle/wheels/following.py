"""One wheel followed from shot to shot while it is adjusted, so that its angles come many times a second."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from alignment.follow import FollowedWheel, FollowResult, FollowRules
from alignment.kernels import on_one_core
from alignment.prepared import PreparedRig
from alignment.values import MeasureSettings, Refusal, StereoImages, WheelMeasurement

FollowFunction = Callable[
    [Sequence[StereoImages], PreparedRig, MeasureSettings, FollowedWheel | None, FollowRules], FollowResult
]
WHOLE_S = 1.0
"""Longest time between two whole measurements of a wheel that is followed, seconds."""


class Follower:
    """Measures one wheel again and again, in one thread at a time, by what it was measured by before.

    Parameters
    ----------
    follow
        `alignment.follow.follow_wheel`, or one like it.
    clock
        Monotonic seconds.
    rules
        How often the wheel is measured whole; after `WHOLE_S` it is in any case.

    Attributes
    ----------
    followed, whole
        How many results came of following, and how many of whole measurements.
    """

    def __init__(
        self, follow: FollowFunction, clock: Callable[[], float], rules: FollowRules | None = None
    ) -> None:
        self._follow, self._clock = follow, clock
        self._rules = FollowRules() if rules is None else rules
        self._wheel: FollowedWheel | None = None
        self._whole_s = clock()
        self.followed = self.whole = 0

    def forget(self) -> None:
        """Measure whole the next time: the wheel was out of sight."""
        self._wheel = None

    def measure(
        self, images: Sequence[StereoImages], rig: PreparedRig, settings: MeasureSettings
    ) -> WheelMeasurement | Refusal:
        """As `alignment.measure.measure_wheel`; other wheels need the other cores."""
        now = self._clock()
        wheel = self._wheel if now - self._whole_s < WHOLE_S else None
        self.forget()  # whatever is raised, nothing is followed by what was before
        with on_one_core():
            found = self._follow(images, rig, settings, wheel, self._rules)
        self._wheel = found.wheel
        if found.whole is None:
            self.followed += 1
        else:
            self.whole += 1
            self._whole_s = now
        return found.result
