"""The result store: a cycle is on disk when `ResultStore.write_cycle` returns, or it raised."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields
from datetime import UTC, datetime
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self, TypeVar
from uuid import UUID

from sqlalchemy import Connection, Engine, RowMapping, Select, Table, false, func, select
from sqlalchemy.dialects import postgresql, sqlite

from alignment.errors import StoreError
from db.engine import describe, make_engine, parse_url
from db.failures import store_errors
from db.migrate import check_revision, require_file, revision_of, upgrade
from db.records import (
    AxleRecord,
    CalibrationCheckRecord,
    CalibrationRecord,
    CycleRecord,
    EventRecord,
    StoredCycle,
    StoredWheel,
    StoredZero,
    VehicleAnglesRecord,
    VehicleRecord,
    WheelRecord,
    ZeroRecord,
    ZeroRevocation,
)
from db.schema import (
    axle_results,
    calibration_checks,
    calibrations,
    cycles,
    events,
    metadata,
    vehicle_results,
    vehicles,
    wheel_results,
    zero_measurements,
    zero_revocations,
)

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


def _utc_now() -> datetime:
    return datetime.now(UTC)


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
        now: Callable[[], datetime] = _utc_now,
    ) -> None:
        self._url = parse_url(url)
        self._where = describe(self._url)
        self._create = create
        self._timeout_s = timeout_s
        self._now = now
        self._engine: Engine | None = None

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
        with self._transaction(writes=True) as connection:
            values = _flat_values(record) | {"stored_utc": self._now()}
            if record.vehicle is not None:
                values["vehicle_id"] = _vehicle_id(connection, record.vehicle)
            cycle_id = _insert_once(connection, cycles, "uuid", values)
            if cycle_id is None:
                (stored,) = _read_cycles(connection, _CYCLES.where(cycles.c.uuid == record.uuid))
                self._require_same("cycle", record.uuid, stored.record == record)
                return
            angles = () if record.vehicle_angles is None else (record.vehicle_angles,)
            parts: tuple[tuple[Table, Sequence[Any]], ...] = (
                (wheel_results, record.wheels),
                (axle_results, record.axles),
                (vehicle_results, angles),
            )
            for table, results in parts:
                if results:
                    rows = [_flat_values(item) | {"cycle_id": cycle_id} for item in results]
                    connection.execute(table.insert(), rows)

    def record_calibration(self, record: CalibrationRecord) -> None:
        """Store a calibration; the same again changes nothing, another one of the same id is refused."""
        with self._transaction(writes=True) as connection:
            self._write_calibration(connection, record)

    def _write_calibration(self, connection: Connection, record: CalibrationRecord) -> None:
        values = _flat_values(record) | {"stored_utc": self._now()}
        if _insert_once(connection, calibrations, "id", values) is None:
            self._require_same("calibration", record.id, _read_calibration(connection, record.id) == record)

    def record_check(self, record: CalibrationCheckRecord) -> None:
        """Store a check; the same again changes nothing, another one of the same UUID is refused."""
        with self._transaction(writes=True) as connection:
            self._write_check(connection, record)

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
        with self._transaction(writes=True) as connection:
            self._write_calibration(connection, record)
            self._write_check(connection, check)

    def _write_check(self, connection: Connection, record: CalibrationCheckRecord) -> None:
        values = _flat_values(record) | {"stored_utc": self._now()}
        if _insert_once(connection, calibration_checks, "uuid", values) is None:
            query = select(calibration_checks).where(calibration_checks.c.uuid == record.uuid)
            row = connection.execute(query).mappings().one()
            self._require_same(
                "calibration check", record.uuid, _record(CalibrationCheckRecord, row) == record
            )

    def record_zero(self, record: ZeroRecord) -> None:
        """Store a zero measurement; the same again changes nothing, another one of the same id is refused."""
        values = _flat_values(record) | {"stored_utc": self._now()}
        with self._transaction(writes=True) as connection:
            if _insert_once(connection, zero_measurements, "id", values) is None:
                (stored,) = _read_zeros(connection, _ZEROS.where(zero_measurements.c.id == record.id))
                self._require_same("zero measurement", record.id, stored.record == record)

    def revoke_zero(self, record: ZeroRevocation) -> None:
        """End a zero measurement; it stays stored, as do the results that it corrected.

        Raises
        ------
        StoreError
            Also when there is none of that id, or when it was revoked before.
        """
        with self._transaction(writes=True) as connection:
            known = _read_zeros(connection, _ZEROS.where(zero_measurements.c.id == record.zero_id))
            if not known:
                raise StoreError(
                    f"database {self._where}: expected the id of a zero measurement, found"
                    f" '{record.zero_id}'. `truewheel zero list` shows them"
                )
            before = known[0].revocation
            if before is None:
                values = _flat_values(record) | {"stored_utc": self._now()}
                connection.execute(zero_revocations.insert().values(**values))
            elif before != record:
                raise StoreError(
                    f"database {self._where}: zero measurement {record.zero_id} was revoked on"
                    f" {before.utc:%Y-%m-%d} already: {before.reason}"
                )

    def record_event(self, record: EventRecord) -> None:
        """Store an event; the same again changes nothing, another one of the same UUID is refused."""
        with self._transaction(writes=True) as connection:
            if _insert_once(connection, events, "uuid", _flat_values(record)) is None:
                row = connection.execute(select(events).where(events.c.uuid == record.uuid)).mappings().one()
                self._require_same("event", record.uuid, _record(EventRecord, row) == record)

    def counts(self) -> dict[str, int]:
        """Number of rows of each table, by the table's name."""
        with self._transaction() as connection:
            return {
                name: connection.execute(select(func.count()).select_from(table)).scalar_one()
                for name, table in metadata.tables.items()
            }

    def cycle(self, uuid: UUID) -> StoredCycle | None:
        """The cycle of this UUID, or None."""
        with self._transaction() as connection:
            found = _read_cycles(connection, _CYCLES.where(cycles.c.uuid == uuid))
        return found[0] if found else None

    def recent_cycles(self, n: int) -> tuple[StoredCycle, ...]:
        """The last `n` cycles that were stored, newest first."""
        with self._transaction() as connection:
            return _read_cycles(connection, _CYCLES.order_by(cycles.c.id.desc()).limit(n))

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
                StoredWheel(row["uuid"], row["station"], row["received_utc"], _record(WheelRecord, row))
                for row in connection.execute(query).mappings()
            )

    def calibration(self, calibration_id: str) -> CalibrationRecord | None:
        """The calibration of this id, or None."""
        with self._transaction() as connection:
            return _read_calibration(connection, calibration_id)

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
        found = None if row is None else _record(CalibrationRecord, row)
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
            return tuple(_record(CalibrationCheckRecord, row) for row in rows)

    def zeros(self) -> tuple[StoredZero, ...]:
        """All zero measurements, revoked ones too, in the order of their times."""
        query = _ZEROS.order_by(zero_measurements.c.measured_utc, zero_measurements.c.stored_utc)
        with self._transaction() as connection:
            return _read_zeros(connection, query)

    def zeros_in_force(self) -> tuple[ZeroRecord, ...]:
        """For each rig and calibration the newest zero measurement that was not revoked."""
        newest = {
            (zero.record.rig, zero.record.calibration_id): zero.record
            for zero in self.zeros()
            if zero.revocation is None
        }
        return tuple(newest.values())

    def recent_events(self, n: int) -> tuple[EventRecord, ...]:
        """The last `n` events that were stored, newest first."""
        with self._transaction() as connection:
            rows = connection.execute(select(events).order_by(events.c.id.desc()).limit(n)).mappings()
            return tuple(_record(EventRecord, row) for row in rows)

    @contextmanager
    def _transaction(self, writes: bool = False) -> Iterator[Connection]:
        if self._engine is None:
            raise StoreError(f"database {self._where} is not open. Open the store first")
        with (
            store_errors(self._where),
            self._engine.connect().execution_options(writes=writes) as connection,
            connection.begin(),
        ):
            yield connection

    def _require_same(self, kind: str, identity: object, same: bool) -> None:
        if not same:
            raise StoreError(
                f"database {self._where} already holds another {kind} {identity}; what is stored stays. Give"
                f" the new {kind} an identity of its own"
            )


_Record = TypeVar("_Record", bound="DataclassInstance")
# Both databases bound the number of parameters of one statement.
_PORTION = 1000
# Parts of a cycle that have tables of their own.
_NESTED = ("vehicle", "wheels", "axles", "vehicle_angles")
_CYCLES = select(cycles, vehicles.c.vin, vehicles.c.vehicle_type).outerjoin(
    vehicles, cycles.c.vehicle_id == vehicles.c.id
)
_ZEROS = select(
    zero_measurements,
    zero_revocations.c.zero_id,
    zero_revocations.c.utc,
    zero_revocations.c.reason,
).outerjoin(zero_revocations, zero_revocations.c.zero_id == zero_measurements.c.id)


def _flat_values(record: Any) -> dict[str, Any]:
    # Fields of the records are named as the columns are.
    return {item.name: getattr(record, item.name) for item in fields(record) if item.name not in _NESTED}


def _record(kind: type[_Record], row: RowMapping, **nested: Any) -> _Record:
    names = [item.name for item in fields(kind) if item.name not in _NESTED]
    return kind(**{name: row[name] for name in names}, **nested)


def _insert_once(connection: Connection, table: Table, key: str, values: dict[str, Any]) -> Any:
    """Insert a row and return its primary key; None when a row of the same key is there already.

    The database decides, so two writers of one record cannot both believe that they were first.
    """
    insert = postgresql.insert if connection.dialect.name == "postgresql" else sqlite.insert
    statement = insert(table).values(**values).on_conflict_do_nothing(index_elements=[key])
    return connection.execute(statement.returning(*table.primary_key)).scalar_one_or_none()


def _vehicle_id(connection: Connection, record: VehicleRecord) -> int:
    same = (vehicles.c.vin == record.vin) & (vehicles.c.vehicle_type == record.vehicle_type)
    query = select(vehicles.c.id).where(same)
    known: int | None = connection.execute(query).scalar_one_or_none()
    if known is not None:
        return known
    insert = postgresql.insert if connection.dialect.name == "postgresql" else sqlite.insert
    connection.execute(insert(vehicles).values(**_flat_values(record)).on_conflict_do_nothing())
    added: int = connection.execute(query).scalar_one()
    return added


def _read_calibration(connection: Connection, calibration_id: str) -> CalibrationRecord | None:
    query = select(calibrations).where(calibrations.c.id == calibration_id)
    row = connection.execute(query).mappings().one_or_none()
    return None if row is None else _record(CalibrationRecord, row)


def _read_zeros(connection: Connection, query: Select[Any]) -> tuple[StoredZero, ...]:
    return tuple(
        StoredZero(
            _record(ZeroRecord, row),
            None if row["zero_id"] is None else _record(ZeroRevocation, row),
            row["stored_utc"],
        )
        for row in connection.execute(query).mappings()
    )


def _read_cycles(connection: Connection, query: Select[Any]) -> tuple[StoredCycle, ...]:
    rows = connection.execute(query).mappings().all()
    ids = [row["id"] for row in rows]
    wheels = _results(connection, wheel_results, WheelRecord, ids)
    axles = _results(connection, axle_results, AxleRecord, ids)
    angles = _results(connection, vehicle_results, VehicleAnglesRecord, ids)
    found = []
    for row in rows:
        vehicle = None if row["vin"] is None else _record(VehicleRecord, row)
        record = _record(
            CycleRecord,
            row,
            vehicle=vehicle,
            wheels=tuple(wheels[row["id"]]),
            axles=tuple(axles[row["id"]]),
            vehicle_angles=next(iter(angles[row["id"]]), None),
        )
        found.append(StoredCycle(record, row["stored_utc"]))
    return tuple(found)


def _results(
    connection: Connection, table: Table, kind: type[_Record], cycle_ids: list[int]
) -> dict[int, list[_Record]]:
    found: dict[int, list[_Record]] = defaultdict(list)
    for start in range(0, len(cycle_ids), _PORTION):
        query = select(table).where(table.c.cycle_id.in_(cycle_ids[start : start + _PORTION]))
        for row in connection.execute(query).mappings():
            found[row["cycle_id"]].append(_record(kind, row))
    return found
