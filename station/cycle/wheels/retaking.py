"""One transient error is not a lost device: what failed is done again once, within the time of the cycle."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Protocol, TypeVar

from alignment.errors import (
    CameraConnectionError,
    CameraError,
    ProjectorError,
    SeveralErrors,
    TruewheelError,
)

_LOG = logging.getLogger("truewheel.station")
_T = TypeVar("_T")


class Reached(Protocol):
    """What is needed of a rig."""

    @property
    def name(self) -> str:
        """Of the wheel."""
        ...

    def connect(self) -> None:
        """Reach all cameras; those that failed anew."""
        ...

    def arm(self) -> None:
        """Prepare all cameras, and put them in step."""
        ...


class Retaking:
    """Does what cameras failed at a second time, after they were armed, or reached anew where one was lost.

    A projector that failed is always reached anew: its driver may have let go of it.

    Not after half of the time: what failed once may take as long again.

    Parameters
    ----------
    within_s
        Time of the cycle, seconds; 0 does nothing again, as where a recording would go on with another wheel.
    clock
        Monotonic seconds.
    """

    def __init__(self, within_s: float, clock: Callable[[], float]) -> None:
        self._within_s, self._clock = within_s, clock
        self._begun_s = clock()
        self._used: str | None = None
        self._said: str | None = None

    def begin(self) -> None:
        """Count the time from now on, and allow one repetition."""
        self._begun_s = self._clock()
        self._used = None

    @property
    def told(self) -> str | None:
        """What went wrong before it was done again, since `begin`; None where nothing was."""
        return self._used

    def arm(self, rig: Reached) -> None:
        """Arm a rig; raises what it does the second time."""
        try:
            rig.arm()
        except TruewheelError as error:
            self._ready_again(rig, error)
        else:
            self._said = None

    def done(self, rig: Reached, action: Callable[[], _T]) -> _T:
        """Do something with an armed rig; raises what it does the second time."""
        try:
            done = action()
        except TruewheelError as error:
            self._ready_again(rig, error)
            return action()
        self._said = None
        return done

    def _ready_again(self, rig: Reached, error: TruewheelError) -> None:
        """Make the rig ready for another attempt, or raise the error where there is none."""
        failures = of_devices(error)
        late = self._clock() - self._begun_s >= 0.5 * self._within_s
        if not failures or late or self._used is not None:
            raise error
        self._used = f"{rig.name}: done again after {error}"
        if self._used != self._said:
            # While a wheel is adjusted the same may fail for minutes.
            _LOG.warning("%s", self._used)
        self._said = self._used
        if any(isinstance(failure, CameraConnectionError | ProjectorError) for failure in failures):
            rig.connect()
        rig.arm()


def of_devices(error: BaseException) -> list[CameraError | ProjectorError]:
    """The failures of cameras and projector that an error, or its cause, is made of; none when of more."""
    devices = (CameraError, ProjectorError)
    if isinstance(error.__cause__, TruewheelError) and not isinstance(error, (*devices, SeveralErrors)):
        return of_devices(error.__cause__)
    parts = error.exceptions if isinstance(error, SeveralErrors) else (error,)
    found = [part for part in parts if isinstance(part, devices)]
    return found if len(found) == len(parts) else []
