"""Keeps the images of wheels: written beside the cycles, as a ring of bounded size."""

from __future__ import annotations

import contextlib
import logging
import queue
import shutil
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Self
from uuid import UUID

from alignment.errors import LineError, StoreUnavailableError, TruewheelError
from db.records import ArchivedShotRecord, CycleRecord, RetentionClass
from db.store import ResultStore
from db.upkeep import Policy, enforce
from station.configuration import VehicleType
from station.cycle import CycleReport, Observer, StationState, WheelResult, utc_now
from station.store.archived import write_wheel
from station.store.keeping import Keeping
from station.threads import SupervisedThread

_LOG = logging.getLogger("truewheel.archive")
# Images of so many cycles may wait; they take tens of megabytes each.
_MOST_WAITING = 4
_LOOK_S = 0.05


@dataclass(frozen=True)
class _Job:
    record: CycleRecord
    wheels: tuple[tuple[WheelResult, RetentionClass], ...]


class ImageArchive:
    """Writes shots in a thread of its own; a disk that is too slow loses images, never a result.

    Whatever goes wrong with the images of one cycle, the next ones are written. What is lost is told once by
    the thread itself, so that nobody waits for the telling either.

    Parameters
    ----------
    store
        Open; takes the references.
    folder
        Of the archive.
    policy
        How much is kept.
    keeping
        Which images are kept.
    note
        Told in a sentence when images are not archived, and of which cycle where it is of one.
    now
        Aware UTC time.
    closing_s
        Longest wait at the end for what was taken and is not written yet; what is left then is told by name.
    kinds
        The vehicle types, by their names.
    """

    def __init__(
        self,
        store: ResultStore,
        folder: Path,
        policy: Policy,
        keeping: Keeping,
        note: Callable[[str, UUID | None], object],
        now: Callable[[], datetime] = utc_now,
        closing_s: float = 120.0,
        kinds: Mapping[str, VehicleType] | None = None,
    ) -> None:
        self._store, self._folder, self._policy = store, folder, policy
        self._keeping, self._note, self._now = keeping, note, now
        self._kinds = kinds or {}
        self.closing_s = closing_s
        self._waiting: queue.Queue[_Job] = queue.Queue(_MOST_WAITING)
        self._refused: queue.SimpleQueue[UUID] = queue.SimpleQueue()
        # What was taken and is neither written nor told of, by cycle, in the order of their coming.
        self._unwritten: dict[UUID, list[str]] = {}
        self._lock = threading.Lock()
        self.thread = SupervisedThread("image archive", self._step)

    def __enter__(self) -> Self:
        self.thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Write what waits, within the bound; what is left then is told, by cycle and wheel."""
        if self._unwritten:
            _LOG.info(
                "the images of %d cycles are still to be written; the end waits %g s at most",
                len(self._unwritten),
                self.closing_s,
            )
        self.wait()
        try:
            self.thread.stop(4 * _LOOK_S)
        except LineError:
            _LOG.error("the archive still writes, or its disk hangs; its thread is left behind")
        self._tell_refused()
        with self._lock:
            left, self._unwritten = self._unwritten, {}
        for cycle, wheels in left.items():
            text = f"images of cycle {cycle} are not archived: the station ended before those of"
            self._tell(f"{text} {', '.join(wheels)} were written", cycle)

    def wait(self) -> bool:
        """Wait until all that was offered is written or lost; false when that takes longer than the bound."""
        deadline = time.monotonic() + self.closing_s
        while self._waiting.unfinished_tasks and self.thread.alive and time.monotonic() < deadline:
            self.thread.stopping.wait(_LOOK_S / 5)
        return not self._waiting.unfinished_tasks

    def offer(self, record: CycleRecord, wheels: Sequence[WheelResult]) -> None:
        """Take the wheels of a committed cycle with their images; returns at once."""
        classes = self._keeping.of(record)
        kept = tuple(
            (wheel, classes[wheel.wheel])
            for wheel in wheels
            if wheel.shot is not None and wheel.measured_with is not None and wheel.wheel in classes
        )
        if not kept:
            return
        with self._lock:
            self._unwritten[record.uuid] = [wheel.wheel for wheel, _ in kept]
        try:
            self._waiting.put_nowait(_Job(record, kept))
        except queue.Full:
            self._done(record.uuid)
            self._refused.put(record.uuid)
            _LOG.error("images of cycle %s are not archived: the disk is too slow", record.uuid)

    def _step(self, stopping: threading.Event) -> None:
        self._tell_refused()
        try:
            job = self._waiting.get(timeout=_LOOK_S)
        except queue.Empty:
            return
        try:
            for wheel, retention in job.wheels:
                if stopping.is_set():
                    # The end has waited long enough, and tells what is left.
                    return
                self._write(job.record, wheel, retention)
                self._done(job.record.uuid, wheel.wheel)
            self._tell_incomplete(job)
            enforce(self._store, self._folder, self._policy, self._now())
        except (TruewheelError, OSError) as error:
            self._lost(job, str(error))
        except Exception as error:
            self._lost(job, f"{type(error).__name__}: {error}")
            # A defect: the thread counts it and goes on with the next cycle.
            raise
        finally:
            self._waiting.task_done()

    def _lost(self, job: _Job, why: str) -> None:
        self._done(job.record.uuid)
        self._tell(f"images of cycle {job.record.uuid} are not archived: {why}", job.record.uuid)

    def _tell(self, text: str, cycle: UUID) -> None:
        _LOG.error("%s", text)
        self._note(text, cycle)

    def _done(self, cycle: UUID, wheel: str | None = None) -> None:
        """Forget a wheel, or all of a cycle: it is written, or was told of."""
        with self._lock:
            left = [] if wheel is None else self._unwritten.get(cycle, [])
            if wheel in left:
                left.remove(wheel)
            if not left:
                self._unwritten.pop(cycle, None)

    def _tell_refused(self) -> None:
        """Tell of all that found no room since the last time, in one sentence."""
        refused = []
        with contextlib.suppress(queue.Empty):
            while True:
                refused.append(self._refused.get_nowait())
        if refused:
            cycles = f"cycle {refused[0]}" + (f" and {len(refused) - 1} more" if refused[1:] else "")
            text = f"images of {cycles} are not archived: the disk is too slow"
            self._note(text, None if refused[1:] else refused[0])

    def _tell_incomplete(self, job: _Job) -> None:
        """Tell of series of which the exposures found no room in memory; their last one is archived."""
        rules = ((w.wheel, w.measured_with, w.exposures) for w, _ in job.wheels)
        short = [name for name, known, kept in rules if known and known.rules is not None and kept is None]
        if short:
            text = f"images of cycle {job.record.uuid} are not archived but for the last exposure of "
            text += f"{', '.join(short)}: no memory was left for the others. Allow more series_mb"
            self._note(text, job.record.uuid)

    def _write(self, record: CycleRecord, wheel: WheelResult, retention: RetentionClass) -> None:
        path = Path(f"{record.received_utc:%Y-%m-%d}") / f"{record.uuid}-{wheel.wheel}"
        folder = self._folder / path
        folder.parent.mkdir(parents=True, exist_ok=True)
        mine = not folder.exists()
        kind = None if record.vehicle is None else self._kinds.get(record.vehicle.vehicle_type)
        try:
            digest = write_wheel(folder, record, wheel, kind)
            size = sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())
            self._store.record_shot(
                ArchivedShotRecord(
                    record.uuid, wheel.wheel, path.as_posix(), size, self._now(), retention, digest
                )
            )
        except StoreUnavailableError:
            # The record may have been stored all the same, and promises them.
            raise
        except BaseException:
            # No record counts what is left of them, so no retention would ever make room again.
            if mine:
                shutil.rmtree(folder, ignore_errors=True)
            raise


class ArchivingObserver(Observer):
    """Offers the images of every committed cycle to the archive; another observer watches as before."""

    def __init__(self, observer: Observer, archive: ImageArchive) -> None:
        self._observer, self._archive = observer, archive

    def entered(self, state: StationState) -> None:
        """Pass on."""
        self._observer.entered(state)

    def wheel_done(self, result: WheelResult) -> None:
        """Pass on."""
        self._observer.wheel_done(result)

    def cycle_done(self, report: CycleReport) -> None:
        """Pass on, and keep the images that the stored results were measured in."""
        if report.committed_s is not None:
            results = (wheel.result for wheel in report.evaluation.wheels)
            self._archive.offer(report.record, [each for each in results if each.shot is not None])
        self._observer.cycle_done(report)
