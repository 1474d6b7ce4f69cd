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

from alignment.errors import StoreError
from db.engine import make_engine, parse_url
from db.failures import store_errors
from db.partitions import ensure_partitions
from db.records import EventRecord, Severity
from db.shipping import Shipper, StationTakenError
from db.store import ResultStore
from db.sums import update_sums

_LOG = logging.getLogger("truewheel.store")
_FIRST_RETRY_S, _LONGEST_RETRY_S = 1.0, 60.0


@dataclass(frozen=True)
class StoreHealth:
    """How the store of a station is.

    Attributes
    ----------
    pending
        Records that wait to be shipped; None without a central database.
    shipped_utc
        When the central database took records, or had none to take, last; None when it never did.
    central_error
        Why it does not at present; None when it does.
    name_taken
        Whether that is because another station of the same name is running.
    free_bytes
        Room on the disk of the station's own database; None for a server.
    disk_nearly_full
        Whether that is less than the configuration asks for.
    maintenance_error
        Why the sums are not kept up to date; answers get slower, not wrong.
    """

    pending: int | None = None
    shipped_utc: datetime | None = None
    central_error: str | None = None
    name_taken: bool = False
    free_bytes: int | None = None
    disk_nearly_full: bool = False
    maintenance_error: str | None = None

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
    free_bytes
        Room on the disk of a folder.
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
        free_bytes: Callable[[Path], int] = lambda folder: shutil.disk_usage(folder).free,
    ) -> None:
        self._store, self._station, self._shipper = store, station, shipper
        parsed = parse_url(url)
        local = parsed.get_backend_name() == "sqlite"
        self._folder = Path(parsed.database or "").resolve().parent if local else None
        self._engine = make_engine(parsed, timeout_s=5.0)
        self._minimum_free_bytes = minimum_free_bytes
        self._period_s = period_s
        self._free_bytes = free_bytes
        self._health = StoreHealth()
        self._retry_s = _FIRST_RETRY_S
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="store background")

    @property
    def health(self) -> StoreHealth:
        """The newest state."""
        return self._health

    def __enter__(self) -> Self:
        if self._shipper is not None:
            self._shipper.open()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopping.set()
        self._thread.join()
        self._engine.dispose()
        if self._shipper is not None:
            self._shipper.close()

    def _run(self) -> None:
        while not self._stopping.is_set():
            try:
                wait_s = self.step()
            except Exception as error:  # noqa: BLE001
                # A mistake in the program must be seen, and must not end the shipping for good.
                _LOG.exception("background work failed")
                self._health = replace(self._health, maintenance_error=f"{type(error).__name__}: {error}")
                wait_s = _LONGEST_RETRY_S
            self._stopping.wait(wait_s)

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
        try:
            done = self._shipper.ship()
        except StoreError as error:
            taken = isinstance(error, StationTakenError)
            if self._health.central_error is None or taken != self._health.name_taken:
                self.note(Severity.ERROR, "station_name_taken" if taken else "central_away", str(error))
            pending = self._health.pending
            try:
                pending = self._shipper.pending()
            except StoreError as own:
                _LOG.error("the outbox cannot be read: %s", own)
            self._health = replace(self._health, pending=pending, central_error=str(error), name_taken=taken)
            wait_s, self._retry_s = self._retry_s, min(2 * self._retry_s, _LONGEST_RETRY_S)
            return wait_s
        self._retry_s = _FIRST_RETRY_S
        if done.renewed_origin:
            text = "this database is a copy of another; everything is shipped again under a new identity"
            self.note(Severity.WARNING, "database_copied", text)
        if self._health.central_error is not None:
            self.note(Severity.INFO, "central_back", f"{self._shipper.central} takes records again")
        self._health = replace(
            self._health,
            pending=done.pending,
            shipped_utc=datetime.now(UTC),
            central_error=None,
            name_taken=False,
        )
        return 0.0 if done.pending else self._period_s

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

    def note(self, severity: Severity, code: str, text: str) -> None:
        """Record an event of the station; a database that does not take it is logged."""
        record = EventRecord(
            datetime.now(UTC), self._station, severity, "station.store", code, text, time.monotonic()
        )
        try:
            self._store.record_event(record)
        except StoreError as error:
            _LOG.error("event %s was not stored: %s (%s)", code, text, error)
