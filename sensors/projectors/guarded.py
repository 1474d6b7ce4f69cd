"""A projector whose driver is not trusted: every call bounded from outside, one that failed reached anew."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar, TypeVarTuple

from alignment.errors import (
    ProjectorConnectionError,
    ProjectorError,
    ProjectorTimeoutError,
    TruewheelError,
    told,
)
from sensors.bounded import BoundedDriver, CallBounds, DriverGoneError
from sensors.driver_calls import Wait
from sensors.projectors.projector import ProjectorDevice, ProjectorState

_A = TypeVarTuple("_A")
_T = TypeVar("_T")


class GuardedProjector:
    """Another projector behind bounds; a `sensors.projectors.ProjectorDevice` itself.

    As `sensors.guarded.GuardedCamera` of a camera: each call is made in one thread of this projector and left
    behind when it does not come back, and `connect` reaches anew what failed since, by another driver object
    where this one hangs. Whatever the driver raises is an error of this projector.

    Parameters
    ----------
    projector
        Of a driver; not connected.
    rig
        That it lights.
    make
        Makes another object of the same projector.
    bounds
        `call_s` of connecting, asking and closing, `trigger_s` of switching its light.
    wait
        Waits for a call to come back.
    """

    def __init__(
        self,
        projector: ProjectorDevice,
        rig: str,
        make: Callable[[], ProjectorDevice] | None = None,
        bounds: CallBounds | None = None,
        wait: Wait = threading.Event.wait,
    ) -> None:
        self.rig = rig
        self.can_be_dark = bool(projector.can_be_dark)
        self._driver = BoundedDriver("projector", rig, projector, make, wait)
        self._bounds = bounds or CallBounds()
        self._lock = threading.Lock()
        self._failed = False

    @property
    def left_behind(self) -> int:
        """Threads whose call never came back so far."""
        return self._driver.left_behind

    def connect(self) -> None:
        """Reach it, anew when anything failed since; see `ProjectorDevice.connect`."""
        call_s = self._bounds.call_s
        with self._asked("connect"):
            if self._failed:
                self._driver.let_go(call_s)
            if not self._driver.begun:
                self._driver.begin(call_s)
            try:
                self._driver.call("connect", call_s, self._device.connect)
            except BaseException:
                self._driver.let_go(call_s)
                raise
            self._failed = False

    def light(self, brightness: float) -> None:
        """Light it; see `ProjectorDevice.light`."""
        self._call("light", self._bounds.trigger_s, self._device.light, brightness)

    def dark(self) -> None:
        """Leave it dark; see `ProjectorDevice.dark`."""
        self._call("dark", self._bounds.trigger_s, self._device.dark)

    def state(self) -> ProjectorState:
        """Ask it how it is; see `ProjectorDevice.state`."""
        found: Any = self._call("state", self._bounds.call_s, self._device.state)
        if not isinstance(found, ProjectorState):
            raise ProjectorError(
                self.rig,
                f"expected a ProjectorState from its driver, found a {type(found).__name__}",
                "Tell the makers of its driver",
            )
        return found

    def close(self) -> None:
        """Let it go; one whose driver hangs is let go by its thread, if ever."""
        with self._asked("close"):
            self._driver.close(self._bounds.call_s)

    @property
    def _device(self) -> ProjectorDevice:
        return self._driver.device

    def _call(self, what: str, bound_s: float, function: Callable[[*_A], _T], *args: *_A) -> _T:
        with self._asked(what):
            return self._driver.call(what, bound_s, function, *args)

    @contextmanager
    def _asked(self, what: str) -> Iterator[None]:
        """Let one thread at a time use it, and whatever goes wrong be an error of this projector."""
        if not self._lock.acquire(timeout=self._bounds.call_s + self._bounds.trigger_s):
            raise ProjectorError(
                self.rig, "is in use: another thread waits for its driver", "Try again later"
            )
        try:
            yield
        except DriverGoneError as error:
            self._failed = True
            raise ProjectorConnectionError(self.rig, error.problem, error.cure) from None
        except ProjectorError as error:
            self._failed = True
            if error.rig == self.rig:
                raise
            kinds = (ProjectorConnectionError, ProjectorTimeoutError)
            kind = next((kind for kind in kinds if isinstance(error, kind)), ProjectorError)
            raise kind(self.rig, error.problem, error.cure) from error
        except Exception as error:
            self._failed = True
            if isinstance(error, TruewheelError):
                raise
            raise driver_failed(self.rig, what, error) from error
        finally:
            self._lock.release()


def driver_failed(rig: str, what: str, error: Exception) -> ProjectorError:
    """Return what somebody is told of a driver that raised something of its own in a call."""
    kind = ProjectorError
    if isinstance(error, TimeoutError):
        kind = ProjectorTimeoutError
    elif isinstance(error, ConnectionError):
        kind = ProjectorConnectionError
    return kind(
        rig,
        f"its driver failed ({what}): {told(error)}",
        "Check its power and its cable; if it stays, tell the makers of its driver",
    )
