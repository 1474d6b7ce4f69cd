"""What a station does beside its cycles: it ships, keeps sums up to date, watches the disk."""

from __future__ import annotations

import logging
import shutil
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Self
from uuid import UUID

from alignment.errors import StoreError
from db.connection import make_engine, parse_url, store_errors
from db.records import EventRecord, Severity
from db.schema.partitions import ensure_partitions
from db.store import ResultStore
from db.sums import update_sums
from db.upkeep.shipping import Shipper, StationTakenError

_LOG = logging.getLogger("truewheel.store")
_FIRST_RETRY_S, _LONGEST_RETRY_S = 1.0, 60.0
# An answer of the central database that takes longer is none, whatever comes of it.
_NO_ANSWER_S = 5.0
# Each call is bounded by the database's timeout; what still goes on then is left to the end of the program.
_LONGEST_STOP_S = 30.0


@dataclass(frozen=True)
class StoreHealth:
    """How the store of a station is.

    Attributes
    ----------
    pending
        Records that wait to be shipped; None without a central database.
    shipped_utc
        When the central database took records, or had none to take, last; None when it never did since the
        start.
    central_error
        Why it does not at present, and since when nothing was shipped; None when it does. A database that
        gives no answer at all counts as away before the wait for it has ended.
    name_taken
        Whether that is because another station of the same name is running.
    free_bytes
        Room on the disk of the station's own database; None for a server.
    disk_nearly_full
        Whether that is less than the configuration asks for.
    maintenance_error
        Why the sums are not kept up to date; answers get slower, not wrong.
    failures
        How often the work beside the cycles met what nobody foresaw; it goes on each time.
    """

    pending: int | None = None
    shipped_utc: datetime | None = None
    central_error: str | None = None
    name_taken: bool = False
    free_bytes: int | None = None
    disk_nearly_full: bool = False
    maintenance_error: str | None = None
    failures: int = 0

    @property
    def good(self) -> bool:
        """Whether nobody needs to look."""
        return self.central_error is None and self.maintenance_error is None and not self.disk_nearly_full


class BackgroundWork:
    """One thread beside the station; a cycle never waits for it.

    Each change for the worse and back is an event of the station.

    Parameters
    ----------
    store
        Open; takes the events.
    url
        Of the same database.
    shipper
        To the central database; None without one.
    station
        Name in events.
    minimum_free_bytes
        Less room on the disk than this is nearly full.
    period_s
        Between two looks when nothing waits.
    stop_s
        Longest wait for the end of what is under way when it is told to stop.
    free_bytes
        Room on the disk of a folder.
    now, clock
        Aware UTC time, and monotonic seconds.
    """

    def __init__(
        self,
        store: ResultStore,
        url: str,
        station: str,
        shipper: Shipper | None = None,
        *,
        minimum_free_bytes: int = 500_000_000,
        period_s: float = 5.0,
        stop_s: float = _LONGEST_STOP_S,
        free_bytes: Callable[[Path], int] = lambda folder: shutil.disk_usage(folder).free,
        now: Callable[[], datetime] = lambda: datetime.now(UTC),
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._store, self._station, self._shipper = store, station, shipper
        parsed = parse_url(url)
        local = parsed.get_backend_name() == "sqlite"
        self._folder = Path(parsed.database or "").resolve().parent if local else None
        self._engine = make_engine(parsed, timeout_s=5.0)
        self._minimum_free_bytes = minimum_free_bytes
        self._period_s = period_s
        self._stop_s = stop_s
        self._free_bytes = free_bytes
        self._now, self._clock = now, clock
        self._health = StoreHealth()
        self._started_utc = now()
        self._asked_s: float | None = None
        self._retry_s = _FIRST_RETRY_S
        self._stopping = threading.Event()
        # A daemon: what hangs in a system call must not keep the program from ending.
        self._thread = threading.Thread(target=self._run, name="store background", daemon=True)

    @property
    def health(self) -> StoreHealth:
        """The newest state; never waits for the central database."""
        health, asked_s = self._health, self._asked_s
        if asked_s is None or health.central_error is not None or self._shipper is None:
            return health
        waited_s = self._clock() - asked_s
        if waited_s < _NO_ANSWER_S:
            return health
        error = self._since(f"{self._shipper.central} has not answered for {waited_s:.0f} s")
        return replace(health, pending=self._count_pending(), central_error=error)

    def __enter__(self) -> Self:
        if self._shipper is not None:
            self._shipper.open()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopping.set()
        self._thread.join(self._stop_s)
        if self._thread.is_alive():
            # Its connections are in use; they end with the program.
            _LOG.error("work beside the cycles did not end within %g s and is left behind", self._stop_s)
            return
        self._engine.dispose()
        if self._shipper is not None:
            self._shipper.close()

    def _run(self) -> None:
        while not self._stopping.is_set():
            try:
                wait_s = self.step()
            except Exception as error:  # noqa: BLE001
                wait_s = self._failed(error)
            self._stopping.wait(wait_s)

    def _failed(self, error: Exception) -> float:
        # A mistake in the program must be seen, and must not end the shipping for good.
        _LOG.error("work beside the cycles failed", exc_info=error)
        text = f"{type(error).__name__}: {error}"
        if self._health.maintenance_error != text:
            self.note(Severity.ERROR, "background_failed", text)
        self._health = replace(self._health, maintenance_error=text, failures=self._health.failures + 1)
        return _LONGEST_RETRY_S

    def step(self) -> float:
        """Do all of it once; return after how many seconds to do it again."""
        self._watch_disk()
        wait_s = self._ship()
        self._maintain()
        return wait_s

    def _watch_disk(self) -> None:
        if self._folder is None:
            return
        free = self._free_bytes(self._folder)
        nearly_full = free < self._minimum_free_bytes
        if nearly_full != self._health.disk_nearly_full:
            self.note(
                Severity.ERROR if nearly_full else Severity.INFO,
                "disk_nearly_full" if nearly_full else "disk_has_room",
                f"{free / 1e6:.0f} MB are free in {self._folder}, at least"
                f" {self._minimum_free_bytes / 1e6:.0f} MB should be"
                + (". Free some space, or production stops when it is full" if nearly_full else ""),
            )
        self._health = replace(self._health, free_bytes=free, disk_nearly_full=nearly_full)

    def _ship(self) -> float:
        if self._shipper is None:
            return self._period_s
        self._asked_s = self._clock()
        try:
            done = self._shipper.ship()
        except StoreError as error:
            taken = isinstance(error, StationTakenError)
            if self._health.central_error is None or taken != self._health.name_taken:
                self.note(Severity.ERROR, "station_name_taken" if taken else "central_away", str(error))
            self._health = replace(
                self._health,
                pending=self._count_pending(),
                central_error=self._since(str(error)),
                name_taken=taken,
            )
            wait_s, self._retry_s = self._retry_s, min(2 * self._retry_s, _LONGEST_RETRY_S)
            return wait_s
        finally:
            self._asked_s = None
        self._retry_s = _FIRST_RETRY_S
        if done.renewed_origin:
            text = "this database is a copy of another; everything is shipped again under a new identity"
            self.note(Severity.WARNING, "database_copied", text)
        if self._health.central_error is not None:
            self.note(Severity.INFO, "central_back", f"{self._shipper.central} takes records again")
        self._health = replace(
            self._health,
            pending=done.pending,
            shipped_utc=self._now(),
            central_error=None,
            name_taken=False,
        )
        return 0.0 if done.pending else self._period_s

    def _count_pending(self) -> int | None:
        assert self._shipper is not None
        try:
            return self._shipper.pending()
        except StoreError as error:
            _LOG.error("the outbox cannot be read: %s", error)
            return self._health.pending

    def _since(self, text: str) -> str:
        last = self._health.shipped_utc
        since = "since the start at" if last is None else "since"
        return f"{text}. Nothing was shipped {since} {last or self._started_utc:%Y-%m-%d %H:%M:%S} UTC"

    def _maintain(self) -> None:
        engines = [self._engine]
        if self._shipper is not None and self._health.central_error is None:
            engines.append(self._shipper.engines[1])
        error: str | None = None
        for engine in engines:
            try:
                with store_errors("for sums"):
                    # A few cycles at a time: SQLite has one writer, and the next cycle is to be it.
                    update_sums(engine, most=200 if engine.dialect.name == "sqlite" else 20_000)
                    if engine.dialect.name == "postgresql":
                        with engine.begin() as connection:
                            ensure_partitions(connection)
            except StoreError as found:
                error = str(found)
        if error is not None and self._health.maintenance_error is None:
            _LOG.warning("sums are not up to date: %s", error)
        self._health = replace(self._health, maintenance_error=error)

    def note(self, severity: Severity, code: str, text: str, cycle: UUID | None = None) -> None:
        """Record an event of the station, or of a cycle; a database that does not take it is logged."""
        record = EventRecord(
            self._now(),
            self._station,
            severity,
            "station.store",
            code,
            text,
            self._clock(),
            cycle_uuid=cycle,
        )
        try:
            self._store.record_event(record)
        except StoreError as error:
            _LOG.error("event %s was not stored: %s (%s)", code, text, error)
