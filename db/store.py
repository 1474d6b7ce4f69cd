"""The result store: a cycle is on disk when `ResultStore.write_cycle` returns, or it raised."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from datetime import UTC, datetime
from functools import partial
from types import TracebackType
from typing import Any, Self
from uuid import UUID

from sqlalchemy import Connection, Engine, false, func, select

from alignment.errors import Deed, Remedy, StoreError
from db.connection import (
    check_revision,
    describe,
    look_at_files,
    make_engine,
    parse_url,
    require_file,
    revision_of,
    store_errors,
    upgrade,
)
from db.records import (
    AdjustingRecord,
    ArchivedShotRecord,
    ArchiveRemoval,
    CalibrationCheckRecord,
    CalibrationRecord,
    CameraFigure,
    CameraSerial,
    ConcessionRecord,
    ConcessionWithdrawal,
    CycleRecord,
    DoubtClosing,
    DoubtRecord,
    EventRecord,
    GaugeStudyRecord,
    GaugeValueRecord,
    InstallationRecord,
    StationRecord,
    StoredConcession,
    StoredCycle,
    StoredWheel,
    StoredZero,
    VehicleTypeRecord,
    WheelRecord,
    ZeroRecord,
    ZeroRevocation,
)
from db.rows import (
    CYCLES,
    KIND_OF,
    ZEROS,
    Head,
    add_figures,
    add_serials,
    changed,
    first_figures,
    key_of,
    last_adjustings,
    load_records,
    newest_zeros,
    newest_zeros_of,
    read_concessions,
    read_cycles,
    read_zeros,
    record_of,
    refuse_concession,
    refuse_withdrawal,
    serials,
    write_doubts,
    write_record,
)
from db.schema import (
    BOOKKEEPING,
    calibration_checks,
    calibrations,
    cycles,
    events,
    metadata,
    outbox,
    vehicles,
    wheel_results,
    zero_measurements,
)

_NOW = partial(datetime.now, UTC)


class ResultStore:
    """The result database of a station: records go in once and stay.

    Use as a context manager, or call `open` and `close`. One thread writes while others read; every call
    takes its own connection and is bounded in time.

    Parameters
    ----------
    url
        ``sqlite:///results.db`` or ``postgresql://user@host/database``.
    create
        Build the schema in a missing file or an empty database; without it both are refused.
    timeout_s
        Longest wait for a connection and for another program's lock; a statement on a server may take twice
        as long.
    now
        The UTC clock of `stored_utc`.

    Raises
    ------
    ConfigurationError
        For a URL of another kind.
    StoreError
        From every method: `StoreUnavailableError` when the database cannot be reached or is locked (writing
        the same record again is safe), `StoreSchemaError` for another schema revision, and `StoreError`
        itself for a full disk, a damaged file, or a record that contradicts a stored one.
    """

    def __init__(
        self,
        url: str,
        *,
        create: bool = False,
        timeout_s: float = 5.0,
        now: Callable[[], datetime] = _NOW,
    ) -> None:
        self._url = parse_url(url)
        self._where = describe(self._url)
        self._create = create
        self._timeout_s = timeout_s
        self._now = now
        self._engine: Engine | None = None
        # Ends of the chains as this program wrote them: a database that comes back without is another one.
        self._ends: dict[str, Head] = {}

    def open(self) -> None:
        """Connect and check the schema revision; the error's text holds the command that cures it."""
        if self._engine is not None:
            raise StoreError(f"database {self._where} is open already. Close it first")
        if not self._create:
            require_file(self._url)
        self._engine = make_engine(self._url, timeout_s=self._timeout_s, create=self._create)
        try:
            with self._transaction(writes=True) as connection:
                if self._create and revision_of(connection, self._where) is None:
                    upgrade(connection, self._where)
                check_revision(connection, self._where)
                # Adds no row; a database that cannot be written is found now and not at a vehicle.
                nothing = select(events).where(false())
                connection.execute(events.insert().from_select(events.c.keys(), nothing))
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close all connections; closing twice is fine."""
        if self._engine is not None:
            self._engine.dispose()
            self._engine = None

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def write_cycle(self, record: CycleRecord) -> None:
        """Store a cycle with its vehicle and all its results: in one transaction, durable on return.

        The same record again changes nothing, so a write whose end was not seen is simply repeated. A record
        of the same UUID that differs is refused.
        """
        self._write(record)

    def record_calibration(self, record: CalibrationRecord) -> None:
        """Store a calibration; the same again changes nothing, another one of the same id is refused."""
        self._write(record)

    def record_check(self, record: CalibrationCheckRecord) -> None:
        """Store a check; the same again changes nothing, another one of the same UUID is refused."""
        self._write(record)

    def write_master_check(
        self,
        record: CycleRecord,
        checks: Sequence[CalibrationCheckRecord],
        outcomes: Sequence[EventRecord],
    ) -> None:
        """Store a cycle of a master wheel with what it says of the calibrations: all of it, or nothing."""
        self._write(record, *checks, *outcomes)

    def accept_calibration(self, record: CalibrationRecord, check: CalibrationCheckRecord) -> None:
        """Store a calibration together with its figures as found and as left: both or neither.

        Raises
        ------
        StoreError
            Also when the check is of another calibration.
        """
        if check.calibration_id != record.id:
            raise StoreError(
                f"database {self._where}: expected a check of calibration {record.id}, found one of"
                f" {check.calibration_id}"
            )
        self._write(record, check)

    def record_zero(self, record: ZeroRecord) -> None:
        """Store a zero measurement; the same again changes nothing, another one of the same id is refused."""
        self._write(record)

    def record_zeros(self, records: Sequence[ZeroRecord]) -> None:
        """Store the zero measurements of a whole vehicle: all of them, or none."""
        self._write(*records)

    def revoke_zero(self, record: ZeroRevocation) -> None:
        """End a zero measurement; it stays stored, as do the results that it corrected.

        Raises
        ------
        StoreError
            Also when there is none of that id, or when it was revoked before.
        """
        with self._transaction(writes=True) as connection:
            known = read_zeros(connection, ZEROS.where(zero_measurements.c.id == record.zero_id))
            if not known:
                raise StoreError(
                    f"database {self._where}: expected the id of a zero measurement, found"
                    f" '{record.zero_id}'",
                    Remedy(Deed.LIST_ZEROS),
                )
            before = known[0].revocation
            if before is None:
                self._store(connection, (record,))
            elif before != record:
                raise StoreError(
                    f"database {self._where}: zero measurement {record.zero_id} was revoked on"
                    f" {before.utc:%Y-%m-%d} already: {before.reason}"
                )

    def grant_concession(self, record: ConcessionRecord) -> None:
        """Release a vehicle that is not ok; its verdict stays. Errors as of `refuse_concession`."""
        with self._transaction(writes=True) as connection:
            refuse_concession(connection, self._where, record)
            self._store(connection, (record,))

    def withdraw_concession(self, record: ConcessionWithdrawal) -> None:
        """End a concession; it stays stored. Errors as of `refuse_withdrawal`."""
        with self._transaction(writes=True) as connection:
            refuse_withdrawal(connection, self._where, record)
            self._store(connection, (record,))

    def concessions(self, cycles: Sequence[UUID]) -> tuple[StoredConcession, ...]:
        """The concessions of these cycles, withdrawn ones too, in the order of storing."""
        with self._transaction() as connection:
            return read_concessions(connection, cycles)

    def record_event(self, record: EventRecord) -> None:
        """Store an event; the same again changes nothing, another one of the same UUID is refused."""
        self._write(record)

    def describe_station(
        self,
        station: StationRecord,
        limits: Sequence[VehicleTypeRecord] = (),
        installations: Sequence[InstallationRecord] = (),
    ) -> None:
        """Store what a station is, judges by and rests on, as far as it differs from what was stored last."""
        with self._transaction(writes=True) as connection:
            self._store(connection, changed(connection, station, limits, installations))

    def add_camera_figures(self, station: str, figures: Sequence[CameraFigure]) -> None:
        """Join how cameras were with what is stored of the same hours and days; old ones go."""
        with self._transaction(writes=True) as connection:
            add_figures(connection, station, figures)

    def first_camera_figures(self, station: str) -> tuple[CameraFigure, ...]:
        """Figures of the first shots after each calibration, with which the others are compared."""
        with self._transaction() as connection:
            return first_figures(connection, station)

    def add_camera_serials(self, station: str, added: Sequence[CameraSerial]) -> None:
        """Store which camera was seen first with each calibration; what is stored stays."""
        with self._transaction(writes=True) as connection:
            add_serials(connection, station, added)

    def camera_serials(self, station: str) -> tuple[CameraSerial, ...]:
        """Which cameras were seen first with each calibration of a station."""
        with self._transaction() as connection:
            return serials(connection, station)

    def plan_study(self, record: GaugeStudyRecord) -> None:
        """Store a gauge study as planned; its values follow with `record_study_values`."""
        self._write(record)

    def record_study_values(self, values: Sequence[GaugeValueRecord]) -> None:
        """Store values of gauge studies that are planned: all or none."""
        self._write(*values)

    def record_shot(self, record: ArchivedShotRecord) -> None:
        """Store where images of a wheel are kept; the cycle is stored before."""
        self._write(record)

    def remove_shot(self, record: ArchiveRemoval) -> None:
        """Store that archived images are gone, before they are deleted."""
        self._write(record)

    def _write(self, *records: Any) -> None:
        with self._transaction(writes=True) as connection:
            self._store(connection, records)

    def _store(self, connection: Connection, records: Iterable[Any]) -> None:
        """Store records; an SQLite database lists the new ones in its outbox, in the same transaction."""
        try:
            added = [record for record in records if write_record(connection, record, self._now())]
        except StoreError as error:
            raise type(error)(f"database {self._where} {error}") from error
        self._list_for_shipping(connection, added)

    def _list_for_shipping(self, connection: Connection, added: Sequence[Any]) -> None:
        if added and connection.dialect.name == "sqlite":
            rows = [{"kind": KIND_OF[type(record)], "key": key_of(record)} for record in added]
            connection.execute(outbox.insert(), rows)

    def record_found(
        self,
        find: Callable[[Connection], Sequence[DoubtRecord | DoubtClosing]],
        *beside: EventRecord,
    ) -> Sequence[DoubtRecord | DoubtClosing]:
        """Store doubts, or ends of doubts, that `find` makes of what is stored: in one transaction with it.

        The events beside are stored with them, and only where something was found. For `db.upkeep.doubting`.
        """
        with self._transaction(writes=True) as connection:
            found = find(connection)
            if found:
                write_doubts(connection, found, self._now())
                self._list_for_shipping(connection, found)
                self._store(connection, beside)
        return found

    def counts(self) -> dict[str, int]:
        """Number of rows of each table of records, by the table's name; bookkeeping is not counted."""
        with self._transaction() as connection:
            return {
                name: connection.execute(select(func.count()).select_from(table)).scalar_one()
                for name, table in metadata.tables.items()
                if table not in BOOKKEEPING
            }

    def cycle(self, uuid: UUID) -> StoredCycle | None:
        """The cycle of this UUID, or None."""
        with self._transaction() as connection:
            found = read_cycles(connection, CYCLES.where(cycles.c.uuid == uuid))
        return found[0] if found else None

    def recent_cycles(self, n: int, station: str | None = None) -> tuple[StoredCycle, ...]:
        """The last `n` cycles that were stored, newest first; only those of a station when it is named."""
        query = CYCLES if station is None else CYCLES.where(cycles.c.station == station)
        with self._transaction() as connection:
            return read_cycles(connection, query.order_by(cycles.c.id.desc()).limit(n))

    def wheel_results(self, vin: str) -> tuple[StoredWheel, ...]:
        """All wheel results of a VIN, of every vehicle type and cycle, in the order they were stored."""
        query = (
            select(cycles.c.uuid, cycles.c.station, cycles.c.received_utc, wheel_results)
            .join(cycles, wheel_results.c.cycle_id == cycles.c.id)
            .join(vehicles, cycles.c.vehicle_id == vehicles.c.id)
            .where(vehicles.c.vin == vin)
            .order_by(cycles.c.id, wheel_results.c.wheel)
        )
        with self._transaction() as connection:
            return tuple(
                StoredWheel(row["uuid"], row["station"], row["received_utc"], record_of(WheelRecord, row))
                for row in connection.execute(query).mappings()
            )

    def calibration(self, calibration_id: str) -> CalibrationRecord | None:
        """The calibration of this id, or None."""
        with self._transaction() as connection:
            return load_records(connection, "calibration", [calibration_id]).get(calibration_id)

    def calibration_in_force(self, rig: str, at_utc: datetime) -> CalibrationRecord | None:
        """The newest calibration of a rig that is valid at a time, or None.

        A newer one ends the validity of all before it, so when the newest has ended there is none.
        """
        query = (
            select(calibrations)
            .where(calibrations.c.rig == rig, calibrations.c.valid_from_utc <= at_utc)
            .order_by(calibrations.c.valid_from_utc.desc(), calibrations.c.stored_utc.desc())
            .limit(1)
        )
        with self._transaction() as connection:
            row = connection.execute(query).mappings().one_or_none()
        found = None if row is None else record_of(CalibrationRecord, row)
        ended = found is not None and found.valid_until_utc is not None and found.valid_until_utc <= at_utc
        return None if ended else found

    def calibration_checks(self, calibration_id: str) -> tuple[CalibrationCheckRecord, ...]:
        """All checks of a calibration, in the order of their times."""
        query = (
            select(calibration_checks)
            .where(calibration_checks.c.calibration_id == calibration_id)
            .order_by(calibration_checks.c.utc, calibration_checks.c.id)
        )
        with self._transaction() as connection:
            rows = connection.execute(query).mappings()
            return tuple(record_of(CalibrationCheckRecord, row) for row in rows)

    def zeros(self) -> tuple[StoredZero, ...]:
        """All zero measurements, revoked ones too, in the order of their times."""
        query = ZEROS.order_by(zero_measurements.c.measured_utc, zero_measurements.c.stored_utc)
        with self._transaction() as connection:
            return read_zeros(connection, query)

    def zero(self, zero_id: str) -> StoredZero | None:
        """The zero measurement of this id, or None."""
        with self._transaction() as connection:
            found = read_zeros(connection, ZEROS.where(zero_measurements.c.id == zero_id))
        return found[0] if found else None

    def zeros_in_force(self, installed: Sequence[tuple[str, str]] | None = None) -> tuple[ZeroRecord, ...]:
        """For each rig and calibration the newest zero measurement that was not revoked; one question.

        Parameters
        ----------
        installed
            Only of these rigs and ids of calibrations; then an index leads to each of them, however many zero
            measurements there are.
        """
        query = newest_zeros() if installed is None else newest_zeros_of(installed)
        with self._transaction() as connection:
            return tuple(zero.record for zero in read_zeros(connection, query))

    def recent_adjustings(self, station: str, vehicle_type: str, n: int) -> tuple[AdjustingRecord, ...]:
        """The last adjusters whose nuts were locked on vehicles of a type, newest first.

        At most `n`, of the last two thousand of all types.
        """
        with self._transaction() as connection:
            return last_adjustings(connection, station, vehicle_type, n)

    def cycle_events(self, cycle: UUID, codes: Sequence[str]) -> tuple[EventRecord, ...]:
        """The newest event of each of these codes that is of this cycle; the cycle need not be stored."""
        of_cycle = (events.c.cycle_uuid == cycle) & events.c.code.in_(codes)
        newest = select(func.max(events.c.id)).where(of_cycle).group_by(events.c.code)
        with self._transaction() as connection:
            rows = connection.execute(select(events).where(events.c.id.in_(newest))).mappings()
            return tuple(record_of(EventRecord, row) for row in rows)

    def recent_events(
        self, n: int, station: str | None = None, codes: Sequence[str] = ()
    ) -> tuple[EventRecord, ...]:
        """The last `n` events that were stored, newest first.

        Parameters
        ----------
        station
            Only events of this station.
        codes
            Only with these codes, of each the last `n`; needs a station.
        """
        query = select(events).order_by(events.c.id.desc()).limit(n)
        if station is not None:
            query = query.where(events.c.station == station)
        # One by one each code is found by an index, however many events there are.
        queries = [query.where(events.c.code == code) for code in codes] or [query]
        with self._transaction() as connection:
            rows = [row for one in queries for row in connection.execute(one).mappings()]
        rows.sort(key=lambda row: row["id"], reverse=True)
        return tuple(record_of(EventRecord, row) for row in rows)

    def reading(self) -> AbstractContextManager[Connection]:
        """One state of the database, for `db.upkeep.retention` and others of this package."""
        return self._transaction()

    @contextmanager
    def _transaction(self, writes: bool = False) -> Iterator[Connection]:
        if self._engine is None:
            raise StoreError(f"database {self._where} is not open. Open the store first")
        written: dict[str, Head] = {}
        options = {"writes": writes, "chain_known": self._ends, "chain_written": written}
        with store_errors(self._where), self._engine.connect().execution_options(**options) as connection:
            with connection.begin():
                yield connection
            if writes:
                # Who is told that it is stored must find it at the path.
                look_at_files(connection, self._where)
                self._ends.update(written)
