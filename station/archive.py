"""Keeps the images of wheels: written beside the cycles, as a ring of bounded size."""

from __future__ import annotations

import logging
import queue
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Literal, Self

from alignment.errors import TruewheelError
from db.quality_records import ArchivedShotRecord, RetentionClass
from db.records import CycleRecord, Verdict, WheelOutcome
from db.retention import Policy, enforce
from db.store import ResultStore
from sensors.formats.shot import write_shot
from sensors.shot import WheelShot
from station.line.messages import StationState
from station.ports import CycleReport, Observer
from station.wheels import WheelPosition, WheelResult, utc_now

_LOG = logging.getLogger("truewheel.archive")
# Images of so many cycles may wait; they take tens of megabytes each.
_MOST_WAITING = 4


@dataclass(frozen=True)
class _Job:
    record: CycleRecord
    shots: tuple[WheelShot, ...]


class ImageArchive:
    """Writes shots in a thread of its own; a disk that is too slow loses images, never a result.

    Parameters
    ----------
    store
        Open; takes the references.
    folder
        Of the archive.
    policy
        How much is kept.
    keep
        All images, or only those of wheels that were not OK.
    note
        Told in a sentence when images are not archived.
    now
        Aware UTC time.
    """

    def __init__(
        self,
        store: ResultStore,
        folder: Path,
        policy: Policy,
        keep: Literal["all", "evidence"],
        note: Callable[[str], None],
        now: Callable[[], datetime] = utc_now,
    ) -> None:
        self._store, self._folder, self._policy = store, folder, policy
        self._keep, self._note, self._now = keep, note, now
        self._waiting: queue.Queue[_Job | None] = queue.Queue(_MOST_WAITING)
        self._thread = threading.Thread(target=self._run, name="image archive")

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._waiting.put(None)
        self._thread.join()

    def offer(self, record: CycleRecord, shots: Sequence[WheelShot]) -> None:
        """Take the images of a committed cycle; returns at once."""
        kept = tuple(
            shot
            for shot in shots
            if self._keep == "all" or self._class(record, shot) is RetentionClass.EVIDENCE
        )
        if not kept:
            return
        try:
            self._waiting.put_nowait(_Job(record, kept))
        except queue.Full:
            self._note(f"images of cycle {record.uuid} are not archived: the disk is too slow")

    def _run(self) -> None:
        while (job := self._waiting.get()) is not None:
            try:
                for shot in job.shots:
                    self._write(job.record, shot)
                enforce(self._store, self._folder, self._policy, self._now())
            except (TruewheelError, OSError) as error:
                _LOG.error("images of cycle %s: %s", job.record.uuid, error)
                self._note(f"images of cycle {job.record.uuid} are not archived: {error}")

    def _write(self, record: CycleRecord, shot: WheelShot) -> None:
        path = Path(f"{record.received_utc:%Y-%m-%d}") / f"{record.uuid}-{shot.rig}"
        (self._folder / path).parent.mkdir(parents=True, exist_ok=True)
        write_shot(self._folder / path, shot)
        size = sum(file.stat().st_size for file in (self._folder / path).iterdir())
        self._store.record_shot(
            ArchivedShotRecord(
                record.uuid, shot.rig, path.as_posix(), size, self._now(), self._class(record, shot)
            )
        )

    @staticmethod
    def _class(record: CycleRecord, shot: WheelShot) -> RetentionClass:
        good = any(
            wheel.wheel == shot.rig
            and wheel.outcome is WheelOutcome.MEASURED
            and wheel.verdict is not Verdict.NOK
            for wheel in record.wheels
        )
        return RetentionClass.ORDINARY if good else RetentionClass.EVIDENCE


class ArchivingObserver(Observer):
    """Offers the images of every committed cycle to the archive; another observer watches as before."""

    def __init__(self, observer: Observer, positions: Sequence[WheelPosition], archive: ImageArchive) -> None:
        self._observer, self._positions, self._archive = observer, positions, archive

    def entered(self, state: StationState) -> None:
        """Pass on."""
        self._observer.entered(state)

    def wheel_done(self, result: WheelResult) -> None:
        """Pass on."""
        self._observer.wheel_done(result)

    def cycle_done(self, report: CycleReport) -> None:
        """Pass on, and keep the images that the stored results were measured in."""
        if report.committed_s is not None:
            times = {wheel.wheel: wheel.measured_utc for wheel in report.record.wheels}
            shots = [position.last_shot for position in self._positions]
            self._archive.offer(
                report.record, [s for s in shots if s is not None and times.get(s.rig) == s.time_utc]
            )
        self._observer.cycle_done(report)
