"""A camera whose driver is not trusted: every call bounded from outside, a failed camera reached anew.

A driver is code of somebody else that talks to hardware: it may hang in any call, lose the device without
saying so, or give another device back. Nothing of that may take the thread that measures a wheel with it.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar, TypeVarTuple

import numpy as np

from alignment.errors import CameraConnectionError, CameraError, CameraTimeoutError
from sensors.bounded import BoundedDriver, CallBounds, DriverGoneError
from sensors.camera import Camera, CameraSettings, Frame
from sensors.camera_health import CameraCounts, CameraStatistics, CameraWithStatistics, place_in_words
from sensors.driver_calls import Wait
from sensors.known_camera import KnownCamera

_A = TypeVarTuple("_A")
_T = TypeVar("_T")
_LEAST_REST_S = 5.0  # between two questions for statistics


class GuardedCamera:
    """Another camera behind bounds; a `sensors.camera.Camera` itself.

    Every call of the driver is made in one thread of this camera, so never two at once. A call that does not
    come back within its bound is left behind: the camera is lost, whoever called goes on. When it comes back
    after all, the driver is closed and the thread ends. `connect` reaches a camera that failed anew: it
    closes it first; where its driver still hangs it asks for a new driver object, as often as `MOST_LEFT`.

    Serial number, settings and image size of every frame are compared with what was seen first.

    Parameters
    ----------
    camera
        Of a driver; not connected.
    make
        Makes another object of the same camera; without, a driver that hangs is waited for.
    bounds
        Of every call.
    wait
        Waits for a call to come back.
    clock
        Monotonic seconds.
    size
        (height, width) of its images, where its calibration says it.
    """

    def __init__(
        self,
        camera: Camera,
        make: Callable[[], Camera] | None = None,
        bounds: CallBounds | None = None,
        wait: Wait = threading.Event.wait,
        clock: Callable[[], float] = time.monotonic,
        size: tuple[int, int] | None = None,
    ) -> None:
        self.name = camera.name
        self.counts = CameraCounts()
        self._driver = BoundedDriver("camera", self.name, camera, make, wait)
        self._bounds = bounds or CallBounds()
        self._clock = clock
        self._lock = threading.Lock()
        self._known = KnownCamera(self.name, size)
        self._failed = False
        self._statistics = CameraStatistics()
        self._asked_s: float | None = None

    @property
    def place(self) -> str:
        """Where it stands, in plain words, with its serial number where that is known."""
        return place_in_words(self.name, self._known.serial)

    @property
    def serial(self) -> str | None:
        """Serial number that is expected: of the camera that was calibrated, or else was seen first."""
        return self._known.serial

    def expect(self, serial: str) -> None:
        """Believe in this serial number before anything is seen."""
        self._known.expect(serial)

    @property
    def statistics(self) -> CameraStatistics:
        """What the driver told last beside frames."""
        return self._statistics

    @property
    def left_behind(self) -> int:
        """Threads whose call never came back so far."""
        return self._driver.left_behind

    def note_failure(self, error: CameraError) -> None:
        """Take note of what went wrong with it; the next `connect` reaches it anew."""
        self.counts.count(error)
        self._failed = True

    def connect(self) -> None:
        """Reach the camera, anew when anything failed since; see `Camera.connect`."""
        with self._turn():
            call_s = self._bounds.call_s
            if self._driver.begun and self._failed:
                self._driver.let_go(call_s)
                self.counts.reconnected += 1
            if not self._driver.begun:
                with self._named():
                    again = self._driver.begin(call_s)
                if again:
                    self.counts.reconnected += 1
                    self._asked_s = None
            try:
                self._call("connect", call_s, self._camera.connect)
            except BaseException:
                self._driver.let_go(call_s)
                raise
            self._failed = False

    def arm(self, settings: CameraSettings) -> None:
        """Take over settings; see `Camera.arm`."""
        with self._turn():
            self._known.told(settings)
            self._call("arm", self._bounds.call_s, self._camera.arm, settings)
            self._ask_statistics()

    def trigger(self) -> int:
        """Expose one image; see `Camera.trigger`."""
        with self._turn():
            return self._call("trigger", self._bounds.trigger_s, self._camera.trigger)

    def fetch(self, timeout_s: float) -> Frame:
        """Return the next frame; see `Camera.fetch`."""
        with self._turn():
            bound_s = max(0.0, timeout_s) + self._bounds.late_s
            frame = self._call("fetch", bound_s, self._camera.fetch, timeout_s)
        # What is no frame at all is told by who takes it.
        seen: Any = frame
        if isinstance(seen, Frame) and isinstance(getattr(seen, "image", None), np.ndarray):
            self._known.check(frame)
            self.counts.frames += 1
        return frame

    @property
    def leads(self) -> bool:
        """As of the driver's own camera; see `Camera`."""
        return bool(getattr(self._camera, "leads", False))

    def ask(self, what: str, question: Callable[[Camera], _T]) -> _T:
        """Make another call of the driver than those of every camera, in its thread and within its bound.

        Parameters
        ----------
        what
            For the message, where it does not come back.
        question
            Is given the driver's own camera object; what it returns or raises comes back.

        Raises
        ------
        CameraConnectionError
            When it does not come back, or the camera is not connected.
        """
        with self._turn():
            return self._call(what, self._bounds.call_s, question, self._camera)

    def close(self) -> None:
        """Let the camera go; see `Camera.close`. One whose driver hangs is let go by its thread, if ever."""
        with self._turn(), self._named():
            self._driver.close(self._bounds.call_s)

    @contextmanager
    def _turn(self) -> Iterator[None]:
        """Let one thread at a time use it; a second one waits no longer than the longest call."""
        if not self._lock.acquire(timeout=self._bounds.call_s + self._bounds.trigger_s):
            raise CameraError(self.name, "is in use: another thread waits for its driver", "Try again later")
        try:
            yield
        finally:
            self.counts.hung = self._driver.hung
            self._lock.release()

    @property
    def _camera(self) -> Camera:
        return self._driver.device

    def _call(self, what: str, bound_s: float, function: Callable[[*_A], _T], *args: *_A) -> _T:
        with self._named():
            return self._driver.call(what, bound_s, function, *args)

    @contextmanager
    def _named(self) -> Iterator[None]:
        """Let what goes wrong be an error of this camera."""
        try:
            yield
        except DriverGoneError as error:
            raise CameraConnectionError(self.name, error.problem, error.cure) from None
        except CameraError as error:
            if error.camera == self.name:
                raise
            kinds = (CameraConnectionError, CameraTimeoutError)
            kind = next((kind for kind in kinds if isinstance(error, kind)), CameraError)
            raise kind(self.name, error.problem, error.cure) from error

    def _ask_statistics(self) -> None:
        """Ask the driver for more than frames, once in a while; what it cannot say is no failure."""
        now_s = self._clock()
        if not isinstance(self._camera, CameraWithStatistics):
            return
        if self._asked_s is not None and now_s - self._asked_s < _LEAST_REST_S:
            return
        self._asked_s = now_s
        try:
            found = self._call("statistics", self._bounds.trigger_s, self._camera.statistics)
        except Exception:
            if not self._driver.begun:
                raise
            return
        if isinstance(found, CameraStatistics):
            self._statistics = found
