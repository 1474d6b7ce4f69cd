"""What is stored is chained: each record's link holds the hash of its content and of the link before.

The content of a row is a JSON object of its columns: names sorted, no spaces, everything that is not ASCII
escaped. Columns without a value are left out, so that a column that a later revision adds changes no hash;
`db.rows.filled` knows what one has filled.
Times are UTC with six decimals, UUIDs have hyphens, numbers that are whole are written without a point, and
keys that only number rows are replaced by what they stand for. The same on SQLite and PostgreSQL.

One chain per station, and one, without name, for what belongs to no station. Each database has its own.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from datetime import UTC, datetime
from functools import cache
from typing import Any, cast
from uuid import UUID

from sqlalchemy import Connection, bindparam, select, text

from alignment.errors import StoreUnavailableError
from db.records import (
    AdjustingRecord,
    ArchivedShotRecord,
    AxleRecord,
    ConcessionRecord,
    CycleRecord,
    GeometryRecord,
    SteeringAxisRecord,
    SteeringRecord,
    VehicleAnglesRecord,
    WheelRecord,
)
from db.rows.reading import KIND_OF, key_of
from db.schema import chain_links, cycles

# What the first link of a chain holds in place of the one before.
NOTHING_BEFORE = 64 * "0"
# Kind of the link that counts what was stored before there was a chain.
START = "start"
# Kind of a link of a revision that filled columns of stored rows: it holds the end of each chain before that.
FILLED = "filled"
# Rows of a cycle beside its own.
PARTS: dict[str, type] = {
    "wheel_results": WheelRecord,
    "axle_results": AxleRecord,
    "vehicle_results": VehicleAnglesRecord,
    "geometry_results": GeometryRecord,
    "steering_results": SteeringRecord,
    "steering_axis_results": SteeringAxisRecord,
    "adjusting_results": AdjustingRecord,
}
_PART_NAMES = {
    "wheel_results": ("wheel",),
    "axle_results": ("axle",),
    "steering_axis_results": ("wheel",),
    "adjusting_results": ("wheel", "adjuster"),
}
# Names of vehicles are in a table of their own.
_VEHICLE = ("vin", "vehicle_type")
_CYCLE_PARTS = frozenset(
    ("vehicle", "wheels", "axles", "vehicle_angles", "geometry", "steering", "steering_axes", "adjustings")
)
_EXACT = 2**53


@dataclass(frozen=True)
class Head:
    """The end of a chain: number and hash of its last link."""

    number: int
    hash: str


def content_names(kind: type[Any]) -> tuple[str, ...]:
    """The columns of a record's own row that are hashed, `stored_utc` aside."""
    return _content_names(cast(Hashable, kind))


@cache
def _content_names(kind: Any) -> tuple[str, ...]:
    names = [item.name for item in fields(kind) if item.compare and item.name not in _CYCLE_PARTS]
    return (*names, *_VEHICLE) if kind is CycleRecord else tuple(names)


def row_name(table: str, row: Mapping[str, Any]) -> str:
    """The name of one row among those of its record: ``wheel_results/front_left``."""
    return "/".join((table, *(str(row[part]) for part in _PART_NAMES.get(table, ()))))


def digest(values: Mapping[str, Any]) -> str:
    """The first half of the SHA-256 of a row's content."""
    given = {name: _plain(value) for name, value in values.items() if value is not None}
    return hashlib.sha256(_json(given).encode()).hexdigest()[:32]


def link_hash(previous: str, chain: str, number: int, kind: str, key: str, rows: str) -> str:
    """The SHA-256 of a link: of the hash before, its place, and the digests of its rows."""
    return hashlib.sha256(_json([previous, chain, number, kind, key, rows]).encode()).hexdigest()


def rows_text(digests: Mapping[str, str]) -> str:
    """The digests of a record's rows as `chain_links.rows` holds them."""
    return _json(digests)


def parts_of(record: CycleRecord) -> tuple[Sequence[Any], ...]:
    """The records of a cycle that have rows of their own, in the order of `PARTS`."""
    parts = (record.vehicle_angles, record.geometry, record.steering)
    single = [() if part is None else (part,) for part in parts]
    return record.wheels, record.axles, *single, record.steering_axes, record.adjustings


def record_rows(record: Any, stored_utc: datetime | None) -> str:
    """The digests of all rows of a record that is written now."""
    own = {name: getattr(record, name, None) for name in content_names(type(record))}
    if not isinstance(record, CycleRecord):
        return rows_text({KIND_OF[type(record)]: digest(own | {"stored_utc": stored_utc})})
    if record.vehicle is not None:
        own |= {"vin": record.vehicle.vin, "vehicle_type": record.vehicle.vehicle_type}
    digests = {"cycle": digest(own | {"stored_utc": stored_utc})}
    for table, parts in zip(PARTS, parts_of(record), strict=True):
        for part in parts:
            values = {name: getattr(part, name) for name in content_names(type(part))}
            digests[row_name(table, values)] = digest(values)
    return rows_text(digests)


def new_links(connection: Connection, added: Iterable[tuple[Any, datetime | None]]) -> list[dict[str, Any]]:
    """The links of records that were added now, to be inserted in the same transaction.

    Parameters
    ----------
    added
        Records in their order, each with its `stored_utc`; None where its table has none.

    Raises
    ------
    StoreUnavailableError
        When the database has lost what this program stored before: it was restored, or is another one.
    """
    ends: dict[str, Head] = {}
    links = []
    for record, stored_utc in added:
        chain = _chain_of(connection, record)
        if chain not in ends:
            ends[chain] = _end(connection, chain)
        before = ends[chain]
        number, kind, key = before.number + 1, KIND_OF[type(record)], key_of(record)
        rows = record_rows(record, stored_utc)
        after = Head(number, link_hash(before.hash, chain, number, kind, key, rows))
        ends[chain] = after
        links.append(
            {
                "chain": chain, "number": number, "kind": kind, "key": key, "rows": rows,
                "previous": before.hash, "hash": after.hash,
            }
        )  # fmt: skip
    _options(connection, "written").update(ends)
    return links


def _end(connection: Connection, chain: str) -> Head:
    """The end of a chain, which nobody else makes longer until this transaction ends."""
    if connection.dialect.name == "postgresql":
        connection.execute(_LOCK, {"key": _lock_key(chain)})
    row = connection.execute(_END, {"of": chain}).one_or_none()
    end = Head(0, NOTHING_BEFORE) if row is None else Head(row.number, row.hash)
    known: Head | None = _options(connection, "known").get(chain)
    if known is not None:
        seen: Head | None = end
        if end.number > known.number:
            older = connection.execute(_LINK, {"of": chain, "at": known.number}).one_or_none()
            seen = None if older is None else Head(older.number, older.hash)
        if seen != known:
            raise StoreUnavailableError(
                f"has lost what was stored: link {known.number} of the chain"
                f" {f'of station {chain!r}' if chain else 'without station'} is not there any more, so it was"
                " restored from a copy or is another database. Find out which; a station that is started"
                " again goes on with what is there"
            )
    return end


# Built once: they are asked at every write.
_OF_CHAIN = select(chain_links.c.number, chain_links.c.hash).where(chain_links.c.chain == bindparam("of"))
_END = _OF_CHAIN.order_by(chain_links.c.number.desc()).limit(1)
_LINK = _OF_CHAIN.where(chain_links.c.number == bindparam("at"))
_LOCK = text("SELECT pg_advisory_xact_lock(:key)")


def _options(connection: Connection, name: str) -> dict[str, Head]:
    given: dict[str, Head] = connection.get_execution_options().get(f"chain_{name}", {})
    return given


def _lock_key(chain: str) -> int:
    return int.from_bytes(hashlib.sha256(f"truewheel chain {chain}".encode()).digest()[:8], signed=True)


def _chain_of(connection: Connection, record: Any) -> str:
    if isinstance(record, ArchivedShotRecord | ConcessionRecord):
        query = select(cycles.c.station).where(cycles.c.uuid == record.cycle)
        return str(connection.execute(query).scalar_one())
    return getattr(record, "station", None) or ""


_ENCODER = json.JSONEncoder(sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)


def _json(value: Any) -> str:
    return _ENCODER.encode(value)


def _plain(value: Any) -> Any:
    """A value as JSON has it, the same whatever database gave it back."""
    if type(value) is float:
        return _number(value)
    if type(value) is str:
        return value
    if isinstance(value, datetime):
        return value.astimezone(UTC).isoformat(timespec="microseconds")
    if isinstance(value, UUID):
        return str(value)
    if isinstance(value, bool) or value is None:
        return value
    if isinstance(value, int | float):
        return _number(value)
    if isinstance(value, Mapping):
        return {str(name): _plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return str(value)


def _number(value: float) -> float | str:
    # PostgreSQL gives back 1e22 of a document as a whole number, and SQLite a whole number for 2.0.
    if abs(value) <= _EXACT:
        return int(value) if value == int(value) else value
    try:
        return float(value)
    except OverflowError:
        return str(value)
