"""Ships what a station stored to the central database: in order, each record once, resumed where it stopped.

The central database decides what is next: it knows the last number that arrived from each station's database
(its `origin`). So a central database that was restored from a backup gets again what it lost, and a station's
file that was restored or copied is noticed, because its numbers say something else; it then takes a new
origin and ships everything anew, of which only what is missing is stored.
"""

from __future__ import annotations

import socket
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from itertools import groupby
from typing import Any, Self
from uuid import UUID, uuid4

from sqlalchemy import Connection, Engine, Row, func, select, update
from sqlalchemy.dialects import postgresql, sqlite

from alignment.errors import ConfigurationError, Deed, Remedy, StoreError, StoreUnavailableError
from db.connection import check_revision, describe, make_engine, parse_url, require_file, store_errors
from db.rows import insert_rows, load_records, write_cycles, write_record
from db.schema import arrivals, outbox, shipments, station_leases

_PORTION = 200


class StationTakenError(StoreError):
    """Another running station ships under the same name."""


@dataclass(frozen=True)
class Shipment:
    """What one call of `Shipper.ship` did.

    Attributes
    ----------
    shipped
        Records that the central database has taken now.
    pending
        Records that wait.
    renewed_origin
        Whether this database turned out to be a copy of another, and ships everything again.
    """

    shipped: int
    pending: int
    renewed_origin: bool = False


class Shipper:
    """Ships the outbox of one station's database.

    Parameters
    ----------
    local_url
        The station's own SQLite database.
    central_url
        The central database, at the same schema revision.
    station
        Name under which it ships; only one running program at a time may.
    timeout_s
        Of each wait for the central database.
    lease_s
        How long after its last sign of life a station that vanished keeps its name.
    host
        Named to whoever else wants the name.

    Raises
    ------
    ConfigurationError
        For a URL of another kind, or a local database that is not SQLite.
    StationTakenError
        From `ship`: another station of the same name is running.
    StoreError
        From `ship`: a database cannot be used; nothing is lost, the next call goes on.
    """

    def __init__(
        self,
        local_url: str,
        central_url: str,
        station: str,
        *,
        timeout_s: float = 5.0,
        lease_s: float = 60.0,
        host: str | None = None,
    ) -> None:
        self._local_url, self._central_url = parse_url(local_url), parse_url(central_url)
        if self._local_url.get_backend_name() != "sqlite":
            raise ConfigurationError(
                field="database.url",
                expected="'sqlite:///FILE', the station's own file, beside a central database",
                seen=f"'{describe(self._local_url)}'",
                cure="Name the file in `url` and the server in `central_url`",
            )
        self._station = station
        self._timeout_s = timeout_s
        self._lease_s = lease_s
        self._host = socket.gethostname() if host is None else host
        self._instance = uuid4()
        self._local: Engine | None = None
        self._central: Engine | None = None
        self._checked = False

    def open(self) -> None:
        """Prepare both connections; the central database may be away."""
        require_file(self._local_url)
        self._local = make_engine(self._local_url, timeout_s=self._timeout_s)
        self._central = make_engine(self._central_url, timeout_s=self._timeout_s)

    def close(self) -> None:
        """Give the station's name back if possible, and close all connections."""
        if self._central is not None and self._checked:
            try:
                with store_errors(describe(self._central_url)), self._central.begin() as central:
                    mine = station_leases.c.instance == self._instance
                    central.execute(update(station_leases).where(mine).values(lasts_s=0.0))
            except StoreError:
                # It runs out by itself.
                self._checked = False
        for engine in (self._local, self._central):
            if engine is not None:
                engine.dispose()
        self._local = self._central = None

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def central(self) -> str:
        """The central database, without password."""
        return describe(self._central_url)

    @property
    def engines(self) -> tuple[Engine, Engine]:
        """The connections to the local and to the central database."""
        if self._local is None or self._central is None:
            raise StoreError("the shipper is not open. Open it first")
        return self._local, self._central

    def pending(self) -> int:
        """How many records wait, as far as this database knows."""
        local, _ = self.engines
        with store_errors(describe(self._local_url)), local.connect() as connection:
            return _pending(connection)

    def ship(self, most: int = _PORTION) -> Shipment:
        """Ship at most `most` records, in one transaction of the central database."""
        local, central = self.engines
        with store_errors(self.central):
            try:
                with central.begin() as connection:
                    if not self._checked:
                        check_revision(connection, self.central)
                    self._take_name(connection)
                    shipped = self._ship(connection, most)
                self._checked = True
            except StoreUnavailableError:
                self._checked = False
                raise
        with (
            store_errors(describe(self._local_url)),
            local.connect().execution_options(writes=True) as connection,
            connection.begin(),
        ):
            if shipped is None:
                connection.execute(update(shipments).values(origin=uuid4(), shipped_sequence=0))
                return Shipment(0, _pending(connection), renewed_origin=True)
            first, number = shipped
            values = {"shipped_sequence": first + number, "shipped_utc": datetime.now(UTC)}
            connection.execute(update(shipments).values(**values))
            return Shipment(number, _pending(connection))

    def _ship(self, central: Connection, most: int) -> tuple[int, int] | None:
        """Last number that was there, and how many came; None when the numbers are those of another file."""
        local, _ = self.engines
        with store_errors(describe(self._local_url)), local.begin() as connection:
            origin = connection.execute(select(shipments.c.origin)).scalar_one()
            newest = (
                select(arrivals.c.sequence, arrivals.c.kind, arrivals.c.key)
                .where(arrivals.c.origin == origin)
                .order_by(arrivals.c.sequence.desc())
                .limit(1)
            )
            last = central.execute(newest).one_or_none()
            done = 0 if last is None else last.sequence
            if last is not None:
                same = connection.execute(select(outbox).where(outbox.c.sequence == done)).one_or_none()
                if same is None or (same.kind, same.key) != (last.kind, last.key):
                    return None
            entries = connection.execute(
                select(outbox).where(outbox.c.sequence > done).order_by(outbox.c.sequence).limit(most)
            ).all()
            records = self._load(connection, entries)
        if [entry.sequence for entry in entries] != list(range(done + 1, done + 1 + len(entries))):
            raise StoreError(
                f"database {describe(self._local_url)} has gaps in its outbox after number {done}. Keep a"
                " copy of the file",
                Remedy(Deed.CHECK_DATABASE),
            )
        now = datetime.now(UTC)
        try:
            for kind, group in groupby(zip(entries, records, strict=True), key=lambda pair: pair[0].kind):
                if kind == "cycle":
                    write_cycles(central, [record for _, record in group], now)
                else:
                    for _, record in group:
                        write_record(central, record, now)
        except StoreError as error:
            raise type(error)(f"database {self.central} {error}") from error
        if entries:
            common = {"origin": origin, "station": self._station, "arrived_utc": now}
            rows = [{"sequence": e.sequence, "kind": e.kind, "key": e.key} | common for e in entries]
            insert_rows(central, {arrivals: rows})
        return done, len(entries)

    def _load(self, connection: Connection, entries: Sequence[Row[Any]]) -> list[Any]:
        keys: dict[str, list[str]] = {}
        for entry in entries:
            keys.setdefault(entry.kind, []).append(entry.key)
        found = {kind: load_records(connection, kind, wanted) for kind, wanted in keys.items()}
        missing = [e for e in entries if e.key not in found[e.kind]]
        if missing:
            raise StoreError(
                f"database {describe(self._local_url)} lacks the {missing[0].kind} {missing[0].key} that its"
                " outbox names. Keep a copy of the file, then restore the last backup"
            )
        return [found[entry.kind][entry.key] for entry in entries]

    def _take_name(self, central: Connection) -> None:
        """Take or keep the name of the station, by the clock of the central database."""
        now = _server_time(central)
        with self.engines[0].connect() as connection:
            origin: UUID = connection.execute(select(shipments.c.origin)).scalar_one()
        values = {
            "origin": origin,
            "instance": self._instance,
            "host": self._host,
            "renewed_utc": now,
            "lasts_s": self._lease_s,
        }
        insert = postgresql.insert if central.dialect.name == "postgresql" else sqlite.insert
        central.execute(
            insert(station_leases).values(station=self._station, **values).on_conflict_do_nothing()
        )
        query = select(station_leases).where(station_leases.c.station == self._station).with_for_update()
        holder = central.execute(query).one()
        free = now >= holder.renewed_utc + timedelta(seconds=holder.lasts_s)
        if holder.instance != self._instance and not free:
            raise StationTakenError(
                f"station '{self._station}' is running on {holder.host} too, and ships to {self.central}."
                " Give one of them another station id; what this one stored stays in its own database"
            )
        mine = station_leases.c.station == self._station
        central.execute(update(station_leases).where(mine).values(**values))


def _pending(connection: Connection) -> int:
    newest = select(func.coalesce(func.max(outbox.c.sequence), 0)).scalar_subquery()
    return int(connection.execute(select(newest - shipments.c.shipped_sequence)).scalar_one())


def _server_time(connection: Connection) -> datetime:
    now: datetime = connection.execute(select(func.current_timestamp())).scalar_one()
    return now.replace(tzinfo=UTC) if now.tzinfo is None else now.astimezone(UTC)
