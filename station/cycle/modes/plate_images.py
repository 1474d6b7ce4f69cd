"""Images of the calibration plate, recorded when the line asks for them: one shot of each rig per start.

Each start makes a folder named after its time and number, with one recorded shot per rig in it, which
`truewheel calibrate` and every other reader of shots can take up. Nothing is judged. A shot that comes after
its start was told a fault is not kept.
"""

from __future__ import annotations

import shutil
import threading
from concurrent.futures import Future
from concurrent.futures import wait as wait_for
from pathlib import Path

from alignment.errors import TruewheelError
from sensors.formats import write_shot
from station.cycle.ports import Bounds
from station.cycle.under_way import NO_TROUBLE, CycleUnderWay, Trouble
from station.cycle.wheels import WheelPosition, WheelThreads
from station.cycle.words import ErrorCode, Outcome, WheelAnswer


class CalibrationImages:
    """Records shots.

    Parameters
    ----------
    folder
        Where the folders of the starts go; made when it is missing.
    threads
        Of the positions.
    bounds
        Of the waiting for all images.
    """

    def __init__(self, folder: Path, threads: WheelThreads, bounds: Bounds) -> None:
        self._folder = folder
        self._threads = threads
        self._measure_s = bounds.measure_s

    def record(self, cycle: CycleUnderWay) -> tuple[tuple[WheelAnswer, ...], str]:
        """Shoot and write; the answers, and what to put down of it. A failure is the cycle's trouble."""
        positions = cycle.positions
        start = _Start(self._folder / f"{cycle.received_utc:%Y-%m-%dT%H-%M-%S}-{cycle.sequence:03d}")
        folder = start.folder
        futures = {self._threads.submit(p.name, self._one, p, start): p for p in positions}
        wait_for(futures, self._measure_s)
        kept = start.give_up()
        late = [future for future, p in futures.items() if not future.done() and p.name not in kept]
        self._threads.leave(late)
        failures = [
            failure
            for future, position in futures.items()
            if future not in late and (failure := _failure(future, position)) is not None
        ]
        failures += [
            (ErrorCode.CYCLE_TIMEOUT, futures[future].name, "its images took too long") for future in late
        ]
        failed = {wheel for _, wheel, _ in failures}
        answers = tuple(
            WheelAnswer(p.name, Outcome.FAULT if p.name in failed else Outcome.RECORDED) for p in positions
        )
        text = "; ".join(f"{wheel}: {reason}" for _, wheel, reason in failures)
        cycle.trouble = Trouble(*failures[0][:2]) if failures else NO_TROUBLE
        return answers, f"images of {len(positions) - len(failed)} rigs in {folder}. {text}".strip()

    def _one(self, position: WheelPosition, start: _Start) -> None:
        position.arm()
        # A plate is seen in the light of the room: lines of the projector would cross its marks.
        shot = position.expose(self._measure_s, unlit=True)
        start.folder.mkdir(parents=True, exist_ok=True)
        part = start.folder / f".{position.name}.part"
        try:
            write_shot(part, shot)
            start.keep(part, position.name)
        finally:
            shutil.rmtree(part, ignore_errors=True)


class _Start:
    """The images of one start: under their own names only when whole, and only while somebody waits."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._lock = threading.Lock()
        self._kept: set[str] = set()
        self._given_up = False

    def keep(self, part: Path, name: str) -> None:
        """Keep what was written, unless it comes too late."""
        with self._lock:
            if not self._given_up:
                part.rename(self.folder / name)
                self._kept.add(name)

    def give_up(self) -> frozenset[str]:
        """Keep nothing more; what is kept."""
        with self._lock:
            self._given_up = True
            return frozenset(self._kept)


def _failure(future: Future[None], position: WheelPosition) -> tuple[ErrorCode, str, str] | None:
    error = future.exception()
    if error is None:
        return None
    if isinstance(error, TruewheelError) and not isinstance(error, ValueError):
        return ErrorCode.CAMERA_FAULT, position.name, str(error)
    if isinstance(error, (OSError, TruewheelError)):
        return ErrorCode.STORE_FAULT, position.name, str(error)
    return ErrorCode.INTERNAL_FAULT, position.name, f"{type(error).__name__}: {error}"
