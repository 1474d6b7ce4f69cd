"""Stereo heads, and the rig: the heads that look at one wheel, triggered together."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from typing import Any

import numpy as np

from alignment.counting import listed
from alignment.errors import (
    CameraConnectionError,
    CameraError,
    CameraTimeoutError,
    ConfigurationError,
    SeveralErrors,
    TruewheelError,
    told,
)
from sensors.camera import Camera, CameraSettings, Frame
from sensors.frames import FrameComparison, FrameTolerance
from sensors.guarded import GuardedCamera
from sensors.shot import HeadFrames, WheelShot

_NOW = partial(datetime.now, UTC)


@dataclass(frozen=True)
class StereoHead:
    """Two cameras that look at the same part of the tyre."""

    name: str
    left: Camera
    right: Camera


class Rig:
    """The heads of one wheel.

    After any error of `shoot` the cameras may be out of step; `arm` puts them in step again.

    Parameters
    ----------
    name
        Name of the rig, such as ``front_left``.
    heads
        In the order of the calibration.
    settings
        Given to every camera by `arm`.
    clock
        Monotonic clock, seconds, on which the timeout of `shoot` runs.
    now
        Aware UTC time for the record.
    tolerance
        What the frames of one shot may differ by.

    Raises
    ------
    ConfigurationError
        When there is no head, or two heads or two cameras share a name.
    """

    def __init__(
        self,
        name: str,
        heads: Sequence[StereoHead],
        settings: CameraSettings | None = None,
        clock: Callable[[], float] = time.monotonic,
        now: Callable[[], datetime] = _NOW,
        tolerance: FrameTolerance | None = None,
    ) -> None:
        self.name = name
        self.heads = tuple(heads)
        self.settings = settings or CameraSettings()
        self._clock = clock
        self._now = now
        self._triggers = 0
        self._delivered: dict[str, int] = {}
        self._comparison = FrameComparison(tolerance)
        for field, names in (
            ("heads", [head.name for head in self.heads]),
            ("cameras", [camera.name for camera in self.cameras]),
        ):
            if not names or len(set(names)) < len(names):
                raise ConfigurationError(
                    field=f"{name}.{field}", expected="one or more, with different names", seen=listed(names)
                )

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """All cameras: left and right of the first head, then of the next."""
        return tuple(camera for head in self.heads for camera in (head.left, head.right))

    def guard(self, guarded: Callable[[Camera], Camera]) -> None:
        """Put another camera in the place of each, which hands on to it; before they are connected."""
        self.heads = tuple(replace(h, left=guarded(h.left), right=guarded(h.right)) for h in self.heads)

    def connect(self) -> None:
        """Connect all cameras; guarded ones that failed since are let go first, and reached anew.

        Raises
        ------
        SeveralErrors
            Names every camera that failed; those that did connect are closed again.
        """
        try:
            live = any(isinstance(camera, GuardedCamera) for camera in self.cameras)
            self._comparison.forget(images=not live)
            self._each("connect", lambda camera: camera.connect())
        except SeveralErrors:
            # The failure to connect is the news; a failure to close after it adds nothing.
            with contextlib.suppress(SeveralErrors):
                self.close()
            raise

    def arm(self) -> None:
        """Arm all cameras; their trigger counters start again together.

        Raises
        ------
        SeveralErrors
            Names every camera that failed.
        """
        self._triggers = 0
        self._delivered.clear()
        self._each("take their settings", lambda camera: camera.arm(self.settings))

    def shoot(self, timeout_s: float) -> WheelShot:
        """Trigger all cameras, then collect the frame of this trigger from each.

        Cameras whose trigger makes others expose (`sensors.camera.Camera`) are triggered last. Frames that
        are left over from earlier triggers are dropped, unless they were delivered before.

        Parameters
        ----------
        timeout_s
            Bound of the waiting for all frames together, seconds.

        Raises
        ------
        SeveralErrors
            Names every camera that failed, did not answer in time, counted otherwise than the rig, sent a
            frame twice or one of another moment: its clock went otherwise than the others' since the shot
            before, or its image is that of the shot before, byte by byte.
        """
        time_utc = self._now()
        deadline = self._clock() + timeout_s
        self._triggers += 1
        failures: list[TruewheelError] = []
        triggered: list[Camera] = []
        for camera in self._trigger_order():
            try:
                self._trigger(camera)
                triggered.append(camera)
            except TruewheelError as error:
                failures.append(error)
        frames: dict[str, Frame] = {}
        for camera in triggered:
            try:
                frames[camera.name] = self._frame_of_this_trigger(camera, deadline, timeout_s)
            except TruewheelError as error:
                failures.append(error)
        self._report(failures, "deliver their frame")
        taken = [frames[camera.name] for camera in self.cameras]
        self._report(self._comparison.problems(taken), "deliver a frame of this shot")
        return WheelShot(
            self.name,
            time_utc,
            tuple(HeadFrames(h.name, frames[h.left.name], frames[h.right.name]) for h in self.heads),
        )

    def close(self) -> None:
        """Close all cameras, whatever state they are in.

        Raises
        ------
        SeveralErrors
            Names every camera that failed to close.
        """
        self._each("close", lambda camera: camera.close())

    def _trigger_order(self) -> tuple[Camera, ...]:
        """Whose trigger makes others expose comes after these, which count it and are ready for it."""
        return tuple(sorted(self.cameras, key=lambda camera: bool(getattr(camera, "leads", False))))

    def _trigger(self, camera: Camera) -> None:
        with _asked(camera, "trigger"):
            counter = camera.trigger()
        if counter != self._triggers:
            raise CameraError(
                camera.name,
                f"out of step: expected to count trigger {self._triggers}, it counted {counter}",
                "Arm the rig again",
            )

    def _frame_of_this_trigger(self, camera: Camera, deadline: float, timeout_s: float) -> Frame:
        seen: int | None = None
        twice: int | None = None
        # Of each trigger before this one a frame may be left over, and no more.
        for _ in range(self._triggers):
            try:
                with _asked(camera, "fetch"):
                    frame = camera.fetch(max(0.0, deadline - self._clock()))
                    _require_frame(camera, frame)
            except CameraTimeoutError as error:
                last = "none at all" if seen is None else f"last seen one of trigger {seen}"
                last += "" if twice is None else " for the second time"
                raise CameraTimeoutError(
                    camera.name,
                    f"expected a frame of trigger {self._triggers} within {timeout_s:g} s, {last}",
                    "Check the camera's cable and power, or allow a longer timeout",
                ) from error
            if frame.trigger_counter == self._triggers:
                if twice is not None:
                    raise CameraError(
                        camera.name,
                        f"out of step: before the frame of trigger {self._triggers} it sent that of trigger "
                        f"{twice} a second time",
                        "Arm the rig again; if it stays, connect the camera again",
                    )
                self._delivered[camera.name] = self._triggers
                return frame
            if frame.trigger_counter > self._triggers:
                raise CameraError(
                    camera.name,
                    f"out of step: expected a frame of trigger {self._triggers}, "
                    f"it sent one of trigger {frame.trigger_counter}",
                    "Arm the rig again",
                )
            seen = frame.trigger_counter
            if seen == self._delivered.get(camera.name):
                twice = seen
        raise CameraError(
            camera.name,
            f"out of step: expected a frame of trigger {self._triggers} after those of the triggers before, "
            f"it sent one more of trigger {seen}",
            "Arm the rig again; if it stays, tell the makers of its driver",
        )

    def _each(self, verb: str, action: Callable[[Camera], None]) -> None:
        failures: list[TruewheelError] = []
        for camera in self.cameras:
            try:
                with _asked(camera, verb):
                    action(camera)
            except TruewheelError as error:
                failures.append(error)
        self._report(failures, verb)

    def _report(self, failures: Iterable[TruewheelError], verb: str) -> None:
        listed = list(failures)
        self._note(listed)
        if listed:
            count = f"{len(listed)} of {len(self.cameras)} cameras"
            raise SeveralErrors(f"rig {self.name}: {count} did not {verb}", listed)

    def _note(self, failures: Iterable[TruewheelError]) -> None:
        """Let guarded cameras know what went wrong with them, and the errors where these stand."""
        guarded = {camera.name: camera for camera in self.cameras if isinstance(camera, GuardedCamera)}
        for error in failures:
            if isinstance(error, CameraError) and error.camera in guarded:
                error.stands_at(guarded[error.camera].place)
                guarded[error.camera].note_failure(error)


@contextlib.contextmanager
def _asked(camera: Camera, what: str) -> Iterator[None]:
    """Let whatever the camera's driver raises be an error of this camera."""
    try:
        yield
    except TruewheelError:
        raise
    except Exception as error:
        kind = CameraError
        if isinstance(error, TimeoutError):
            kind = CameraTimeoutError
        elif isinstance(error, ConnectionError):
            kind = CameraConnectionError
        raise kind(
            camera.name,
            f"its driver failed ({what}): {told(error)}",
            "Check its power and its cable; if it stays, tell the makers of its driver",
        ) from error


def _require_frame(camera: Camera, frame: Any) -> None:
    """Raise unless a driver gave a frame that is what `Frame` says."""
    image: Any = getattr(frame, "image", None)
    if not isinstance(frame, Frame):
        seen = "nothing" if frame is None else f"a {type(frame).__name__}"
    elif frame.camera != camera.name:
        seen = f"a frame of camera {frame.camera}"
    elif not isinstance(image, np.ndarray):
        seen = f"a {type(image).__name__} in place of an image"
    elif image.ndim != 2 or not image.size:
        seen = f"an image of shape {image.shape}"
    elif image.dtype not in (np.uint8, np.uint16):
        seen = f"an image of type {image.dtype}"
    elif isinstance(frame.trigger_counter, bool) or not isinstance(frame.trigger_counter, int | np.integer):
        seen = f"a trigger counter {frame.trigger_counter!r}"
    elif not np.isfinite([frame.device_time_s, frame.host_time_s, frame.exposure_ms]).all():
        seen = f"times {frame.device_time_s}, {frame.host_time_s} s, exposure {frame.exposure_ms} ms"
    else:
        return
    raise CameraError(
        camera.name,
        "expected a frame of its own from its driver, with an image (height, width) of 8 or 16 bit,"
        f" found {seen}",
        "Tell the makers of its driver",
    )
