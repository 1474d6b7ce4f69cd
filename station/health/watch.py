"""Watches the cameras beside the cycles: trends are kept, what drifts is told once, no cycle waits."""

from __future__ import annotations

import contextlib
import logging
import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from statistics import fmean
from typing import Protocol, Self
from uuid import UUID

from alignment.errors import LineError, StoreError
from alignment.values import Refusal, WheelMeasurement
from db.records import HOUR_S, CameraFigure, CameraSerial, Severity
from sensors.camera_health import CameraCounts, CameraStatistics
from sensors.shot import WheelShot
from station.configuration import HealthOptions
from station.health.figures import Figure, Figures, figures_of
from station.health.limits import COMPARED, LEAST_FIRST, HealthLimits
from station.threads import SupervisedThread

_LOG = logging.getLogger("truewheel.cameras")
_MOST_WAITING = 256
_MOST_PENDING = 20_000  # joined figures that the database did not take; about a day of it away
_LOOK_S = 0.1
_STORE_EVERY_S = 60.0
_FIRST_SHOTS = 50
_AVERAGED, _LEAST_AVERAGED = 20, 10
_WINDOW = 100


class WatchedCamera(Protocol):
    """What is asked of a camera; `sensors.guarded.GuardedCamera` is one."""

    @property
    def name(self) -> str:
        """Of the camera."""
        ...

    @property
    def place(self) -> str:
        """Where it stands, in words."""
        ...

    @property
    def counts(self) -> CameraCounts:
        """What happened with it."""
        ...

    @property
    def statistics(self) -> CameraStatistics:
        """What its driver says of it."""
        ...

    @property
    def serial(self) -> str | None:
        """Serial number that is expected; None where none was seen yet."""
        ...

    def expect(self, serial: str) -> None:
        """Believe in a serial number."""
        ...


class FigureStore(Protocol):
    """What is needed of the database."""

    def add_camera_figures(self, station: str, figures: tuple[CameraFigure, ...]) -> None:
        """Join figures with what is stored."""
        ...

    def add_camera_serials(self, station: str, added: tuple[CameraSerial, ...]) -> None:
        """Store serial numbers that are not known yet."""
        ...


Note = Callable[[Severity, str, str, UUID | None], object]


@dataclass(frozen=True)
class CalibrationUsed:
    """A calibration in force: its id, and when it was made, whole hours since 1970."""

    id: str
    hour: int


_UNCALIBRATED = CalibrationUsed("", 0)


@dataclass(frozen=True)
class Taken:
    """What a cycle says of the cameras; without images, for whoever keeps it."""

    utc: datetime
    figures: Figures
    retaken: tuple[str, ...] = ()
    cycle: UUID | None = None


@dataclass
class _State:
    """What is known of one figure of one camera."""

    last: deque[float]
    first: CameraFigure | None = None
    warned: bool = False


@dataclass
class _Seen:
    """What a camera had counted when it was looked at last."""

    failures: int = 0
    lost_frames: int = 0


@dataclass
class _Places:
    """Where cameras stand, and the calibrations that they belong to."""

    cameras: Mapping[str, WatchedCamera]
    calibrated: Mapping[str, CalibrationUsed]
    seen: dict[str, _Seen] = field(default_factory=dict)
    serials: set[str] = field(default_factory=set)

    def calibration_of(self, camera: str) -> CalibrationUsed:
        return self.calibrated.get(camera.partition("/")[0], _UNCALIBRATED)

    def expect(self, known: Iterable[CameraSerial]) -> None:
        """Let each camera be the one that its calibration was used with first."""
        for one in known:
            camera = self.cameras.get(one.camera)
            if camera is not None and one.calibration_id == self.calibration_of(one.camera).id:
                camera.expect(one.serial)
                self.serials.add(one.camera)

    def new_serials(self) -> tuple[CameraSerial, ...]:
        """Of cameras that were seen for the first time with their calibration."""
        return tuple(
            CameraSerial(name, self.calibration_of(name).id, camera.serial)
            for name, camera in self.cameras.items()
            if name not in self.serials and camera.serial and self.calibration_of(name).id
        )


class CameraWatch:
    """Takes the figures of every cycle, in a thread of its own once they are offered.

    Parameters
    ----------
    options
        When to warn and when to stop.
    station
        Name in the database.
    store
        Keeps trends.
    note
        Takes severity, code and text of an event, and its cycle.
    cameras
        Guarded ones; others have images to judge by, and no counts.
    calibrated
        The calibration of each rig.
    first
        Figures of the first shots after a calibration, as stored.
    serials
        Which camera was seen first with each calibration, as stored; another one is a camera fault.
    clock
        Monotonic seconds.
    """

    def __init__(
        self,
        options: HealthOptions,
        station: str,
        store: FigureStore,
        note: Note,
        cameras: Iterable[WatchedCamera],
        calibrated: Mapping[str, CalibrationUsed],
        first: Iterable[CameraFigure] = (),
        serials: Iterable[CameraSerial] = (),
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._warn, self._stop = HealthLimits(options), HealthLimits(options, stop=True)
        self._station, self._store, self._note = station, store, note
        self._places = _Places({camera.name: camera for camera in cameras}, dict(calibrated))
        self._places.expect(serials)
        self._clock = clock
        self._states: dict[tuple[str, str], _State] = {}
        for figure in first:
            if figure.start == self._places.calibration_of(figure.camera).hour:
                self._state(figure.camera, figure.figure).first = figure
        self._pending: dict[tuple[str, str, int, int], CameraFigure] = {}
        self._waiting: queue.Queue[Taken] = queue.Queue(_MOST_WAITING)
        self._stored_s = clock()
        self.thread = SupervisedThread("camera health", self._step)

    def __enter__(self) -> Self:
        self.thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self.thread.stop()
        except LineError:
            _LOG.error("the thread of the cameras' health is left behind")
            return
        with contextlib.suppress(queue.Empty):
            while True:
                self.take(self._waiting.get_nowait())
        self.keep()

    def stopped(self, shot: WheelShot, found: WheelMeasurement | Refusal) -> str | None:
        """Say why a shot is not to be believed by the limits that stop a wheel; None where it is.

        Called in the rig's thread, right after the measurement.
        """
        for camera, figures in figures_of(shot, found).items():
            for figure, value in figures.items():
                verdict = self._stop.judged(figure, value, self._first(camera, figure))
                if verdict is not None and verdict.beyond:
                    return f"{self._place(camera)}: {verdict.text}. {verdict.cure}"
        return None

    def offer(self, taken: Taken) -> None:
        """Take what a cycle says; returns at once. What finds no room is one shot of a trend."""
        with contextlib.suppress(queue.Full):
            self._waiting.put_nowait(taken)

    def counted(self, rig: str) -> Figures:
        """Return what the cameras of a rig counted since the last time."""
        out: Figures = {}
        for name, camera in self._places.cameras.items():
            if name.partition("/")[0] != rig:
                continue
            seen = self._places.seen.setdefault(name, _Seen())
            told = camera.statistics
            failures, lost = camera.counts.failures, (told.dropped or 0) + (told.incomplete or 0)
            # A camera that was reached anew counts from nought again.
            fresh = lost - seen.lost_frames if lost >= seen.lost_frames else lost
            out[name] = {Figure.FAILURES: float(max(failures - seen.failures, fresh))}
            if told.link_mbit is not None and 0.0 < told.link_mbit < 1e9:
                out[name][Figure.LINK] = float(told.link_mbit)
            self._places.seen[name] = _Seen(failures, lost)
        return out

    def take(self, taken: Taken) -> None:
        """Add what a cycle says to the trends, and tell what is worse or better than it was."""
        for text in taken.retaken:
            self._note(Severity.WARNING, "shot_retaken", text, taken.cycle)
        hour = int(taken.utc.timestamp() // HOUR_S)
        for camera, figures in taken.figures.items():
            for figure, value in figures.items():
                self._add(CameraFigure.of(camera, figure, 1, hour, value))
                self._add(CameraFigure.of(camera, figure, 24, hour - hour % 24, value))
                self._compare(camera, figure, value)

    def keep(self) -> None:
        """Store what was added; what the database does not take is kept for the next time."""
        self._stored_s = self._clock()
        figures, serials = tuple(self._pending.values()), self._places.new_serials()
        try:
            if figures:
                self._store.add_camera_figures(self._station, figures)
            if serials:
                self._store.add_camera_serials(self._station, serials)
        except StoreError as error:
            _LOG.warning("how the cameras are was not stored: %s", error)
            if len(self._pending) > _MOST_PENDING:
                self._pending.clear()
            return
        self._pending.clear()
        self._places.serials |= {one.camera for one in serials}

    def _step(self, stopping: threading.Event) -> None:
        with contextlib.suppress(queue.Empty):
            self.take(self._waiting.get(timeout=_LOOK_S))
        if self._clock() - self._stored_s >= _STORE_EVERY_S:
            self.keep()

    def _add(self, figure: CameraFigure) -> None:
        known = self._pending.get(figure.which)
        self._pending[figure.which] = figure if known is None else known.joined(figure)

    def _compare(self, camera: str, figure: Figure, value: float) -> None:
        state = self._state(camera, figure)
        state.last.append(value)
        if figure in COMPARED and (state.first is None or state.first.n < _FIRST_SHOTS):
            start = self._places.calibration_of(camera).hour
            one = CameraFigure.of(camera, figure, 0, start, value)
            state.first = one if state.first is None else state.first.joined(one)
            self._add(one)
        now = value
        if figure is Figure.FAILURES:
            now = sum(state.last)
        elif figure not in (Figure.TEMPERATURE, Figure.LINK):
            if len(state.last) < _LEAST_AVERAGED:
                return
            now = fmean(state.last)
        verdict = self._warn.judged(figure, now, self._first(camera, figure))
        if verdict is None or (state.warned and not verdict.good) or not (state.warned or verdict.beyond):
            return
        state.warned = not state.warned
        text = f"{self._place(camera)}: {verdict.text}"
        if state.warned:
            text = f"{text}. {verdict.cure}"
            _LOG.warning("%s", text)
            self._note(Severity.WARNING, f"camera_{figure.name.lower()}", text, None)
        else:
            _LOG.info("%s: well again", text)
            self._note(Severity.INFO, f"camera_{figure.name.lower()}_well", f"{text}: well again", None)

    def _first(self, camera: str, figure: Figure) -> float | None:
        state = self._states.get((camera, figure))
        first = None if state is None else state.first
        if first is None:
            return None
        if figure is Figure.LINK:
            return first.maximum
        return first.mean if first.n >= LEAST_FIRST else None

    def _state(self, camera: str, figure: str) -> _State:
        found = self._states.get((camera, figure))
        if found is None:
            window = _WINDOW if figure == Figure.FAILURES else _AVERAGED
            found = self._states[camera, figure] = _State(deque(maxlen=window))
        return found

    def _place(self, camera: str) -> str:
        known = self._places.cameras.get(camera)
        return f"camera {camera}" if known is None else f"camera {camera} ({known.place})"
