"""Holds every stored row against the chain of hashes: what was changed, taken out or put in is named."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any, NamedTuple
from uuid import UUID

from sqlalchemy import Connection, Row, String, Table, cast, func, select

from db.rows import (
    FILLED,
    NOTHING_BEFORE,
    PARTS,
    RECORD_OF_KIND,
    START,
    Head,
    as_before,
    content_names,
    digest,
    link_hash,
    query_of,
    row_name,
    rows_text,
)
from db.schema import (
    archived_shots,
    chain_links,
    concessions,
    metadata,
)
from db.schema.partitions import detached_ranges

_PORTION = 500
# Findings of one kind that are told one by one.
_MOST = 20
_UNREADABLE = "unreadable"
# Kinds without a UUID of their own: the label of the other record's, and where that is.
_JOINED = {"removal": ("shot", archived_shots), "withdrawal": ("concession", concessions)}
# The table of each kind's own row.
TABLES = {
    "station": "station_versions",
    "limits": "vehicle_type_limits",
    "calibration": "calibrations",
    "installation": "installations",
    "check": "calibration_checks",
    "zero": "zero_measurements",
    "revocation": "zero_revocations",
    "event": "events",
    "cycle": "cycles",
    "study": "gauge_studies",
    "study_value": "gauge_values",
    "shot": "archived_shots",
    "removal": "archive_removals",
    "concession": "concessions",
    "withdrawal": "concession_withdrawals",
    "doubt": "doubts",
    "doubt_closing": "doubt_closings",
}


class _Finding(NamedTuple):
    """What is wrong, and in which table."""

    table: str
    text: str


@dataclass(frozen=True)
class ChainReport:
    """What the chains say.

    Attributes
    ----------
    heads
        End of each chain by its name: whoever keeps them elsewhere can prove later that nothing before them
        was written anew.
    links
        How many there are.
    findings
        Sentences; empty when every row is as it was stored.
    """

    heads: Mapping[str, Head]
    links: int
    findings: tuple[str, ...]


def check_chains(connection: Connection) -> ChainReport:
    """Hash every stored row again and compare it with its link, and each link with the one before."""
    heads: dict[str, Head] = {}
    findings: list[_Finding] = []
    links = 0
    filled = _filled(connection)
    away = dict.fromkeys(detached_ranges(connection), 0)
    names = connection.execute(select(chain_links.c.chain).distinct().order_by(chain_links.c.chain)).scalars()
    for chain in names.all():
        end = Head(0, NOTHING_BEFORE)
        for portion in _portions(connection, chain):
            links += len(portion)
            for link in portion:
                findings += _place(link, end)
                end = Head(link.number, link.hash)
            findings += _contents(connection, portion, away, filled.get(chain, {}))
        heads[str(chain)] = end
    findings += _beside(connection)
    findings += [
        _Finding(
            "wheel_results",
            f"wheel_results: the partition of the cycles {start} to {end - 1} is not attached, {number} rows"
            " of it are known by their hashes alone",
        )
        for (start, end), number in away.items()
        if number
    ]
    return ChainReport(heads, links, tuple(_shortened(findings)))


def _portions(connection: Connection, chain: str) -> Iterator[Sequence[Row[Any]]]:
    last = -(2**63)
    query = select(chain_links).where(chain_links.c.chain == chain).order_by(chain_links.c.number)
    while portion := connection.execute(query.where(chain_links.c.number > last).limit(_PORTION)).all():
        yield portion
        last = portion[-1].number


def _filled(connection: Connection) -> dict[str, dict[str, int]]:
    """Of each chain the last link before each revision that filled columns of stored rows."""
    marked = select(chain_links.c.key, chain_links.c.rows).where(chain_links.c.kind == FILLED).limit(_MOST)
    found: dict[str, dict[str, int]] = {}
    for revision, rows in connection.execute(marked):
        try:
            ends = {str(chain): int(number) for chain, number in json.loads(rows).items()}
            for chain, number in ends.items():
                found.setdefault(chain, {})[str(revision)] = number
        except (ValueError, TypeError, AttributeError):
            # Told with the link: it does not have its hash.
            continue
    return found


def _place(link: Row[Any], end: Head) -> Iterator[_Finding]:
    """What is wrong with a link itself, behind the end of the chain before it."""
    name = f"chain_links, link {link.number} of {_whose(link.chain)}"
    if link.number != end.number + 1:
        missing = link.number - end.number - 1
        yield _Finding("chain_links", f"{name}: {missing} links before it are missing: records were removed")
    elif link.previous != end.hash:
        text = f"{name} does not continue link {end.number}: one of them was altered or put in"
        yield _Finding("chain_links", text)
    if link.hash != link_hash(link.previous, link.chain, link.number, link.kind, link.key, link.rows):
        yield _Finding("chain_links", f"{name} ({link.kind} {link.key}) was altered")


def _whose(chain: str) -> str:
    return f"station '{chain}'" if chain else "no station"


def _contents(
    connection: Connection,
    portion: Sequence[Row[Any]],
    away: dict[tuple[int, int], int],
    filled: Mapping[str, int],
) -> Iterator[_Finding]:
    """Compare the records of links with what is stored; `filled` names the last link before each revision."""
    of_records = (link for link in portion if link.kind not in (START, FILLED))
    by_kind = sorted(of_records, key=lambda link: str(link.kind))
    for kind, group in groupby(by_kind, key=lambda link: link.kind):
        links = list(group)
        if kind not in RECORD_OF_KIND:
            for link in links:
                name = f"chain_links, link {link.number} of {_whose(link.chain)}"
                yield _Finding("chain_links", f"{name}: no record is a '{kind}'")
            continue
        earlier = {
            link.key: frozenset(revision for revision, last in filled.items() if link.number <= last)
            for link in links
        }
        stored = _stored(connection, kind, [link.key for link in links], earlier)
        for link in links:
            yield from _differences(link, stored.get(link.key), away)


def _differences(
    link: Row[Any], found: tuple[Any, dict[str, str]] | None, away: dict[tuple[int, int], int]
) -> Iterator[_Finding]:
    own = TABLES[link.kind]
    of = f"{link.kind} {_shown(link.key)} of {_whose(link.chain)}"
    if found is None:
        yield _Finding(own, f"{own}: {of} was removed")
        return
    identity, digests = found
    name = f"{of} (row {identity})" if identity is not None else of
    if _UNREADABLE in digests:
        yield _Finding(own, f"{own}: {name} was altered: {digests[_UNREADABLE]}")
        return
    if rows_text(digests) == link.rows:
        return
    try:
        expected = dict(json.loads(link.rows))
    except (ValueError, TypeError):
        # Told already: the link does not have its hash.
        return
    for row in sorted({*expected, *digests}):
        if expected.get(row) == digests.get(row):
            continue
        what = "was removed" if row not in digests else "was put in" if row not in expected else "was altered"
        table, _, part = row.partition("/")
        if table == "wheel_results" and row not in digests:
            gap = next((gap for gap in away if gap[0] <= identity < gap[1]), None)
            if gap is not None:
                away[gap] += 1
                continue
        if table in PARTS:
            yield _Finding(table, f"{table}: {f'{part} of ' if part else ''}{name} {what}")
        else:
            yield _Finding(own, f"{own}: {name} {what}")


def _shown(key: str) -> str:
    try:
        return str(UUID(key))
    except (ValueError, AttributeError, TypeError):
        return str(key)


def _stored(
    connection: Connection, kind: str, keys: Sequence[str], earlier: Mapping[str, frozenset[str]]
) -> dict[str, Any]:
    """By key the row's own id and the digests of all rows; what cannot be read has a sentence instead.

    They are of the rows as they were before the revisions that `earlier` names of their keys.
    """
    try:
        return _digests(connection, kind, keys, earlier)
    except Exception as error:  # noqa: BLE001
        # Any type of a row may fail with any error: it is looked for, and told.
        if len(keys) == 1:
            text = " ".join(str(getattr(error, "orig", None) or error).split())
            return {keys[0]: (None, {_UNREADABLE: f"it cannot be read ({type(error).__name__}: {text})"})}
        half = len(keys) // 2
        return _stored(connection, kind, keys[:half], earlier) | _stored(
            connection, kind, keys[half:], earlier
        )


def _digests(
    connection: Connection, kind: str, keys: Sequence[str], earlier: Mapping[str, frozenset[str]]
) -> dict[str, Any]:
    query, column, by_uuid = query_of(kind)
    wanted = [UUID(key) for key in keys] if by_uuid else list(keys)
    rows = connection.execute(query.where(column.in_(wanted))).mappings().all()
    names = content_names(RECORD_OF_KIND[kind])
    found: dict[str, Any] = {}
    by_id: dict[Any, tuple[frozenset[str], dict[str, str]]] = {}
    for row in rows:
        values = {name: row.get(name) for name in (*names, "stored_utc")}
        given = row[_JOINED[kind][0] if kind in _JOINED else column.name]
        key = given.hex if isinstance(given, UUID) else str(given)
        identity = row.get("id") if kind not in ("calibration", "zero") else None
        since = earlier.get(key, frozenset())
        digests = {kind: digest(as_before(TABLES[kind], values, since))}
        found[key] = (identity, digests)
        by_id[identity] = (since, digests)
    if kind == "cycle":
        for name, part in PARTS.items():
            table = metadata.tables[name]
            of_these = select(table).where(table.c.cycle_id.in_(list(by_id)))
            for row in connection.execute(of_these).mappings():
                values = {item: row[item] for item in content_names(part)}
                since, digests = by_id[row["cycle_id"]]
                digests[row_name(name, values)] = digest(as_before(name, values, since))
    return found


def _beside(connection: Connection) -> Iterator[_Finding]:
    """Rows without a link: no more than were stored before there was a chain."""
    start = connection.execute(
        select(chain_links.c.rows).where(chain_links.c.kind == START, chain_links.c.number == 1)
    ).scalar_one_or_none()
    if start is None:
        yield _Finding("chain_links", "chain_links: the start of the chain was removed")
        return
    try:
        before = dict(json.loads(start))
    except (ValueError, TypeError):
        return
    for kind, name in TABLES.items():
        table = metadata.tables[name]
        keys, rows = _keys(kind, table)
        linked = select(chain_links.c.key).where(chain_links.c.kind == kind)
        unlinked = select(keys.label("key")).select_from(rows).where(keys.not_in(linked))
        number = connection.execute(select(func.count()).select_from(unlinked.subquery())).scalar_one()
        expected = before.get(kind, 0)
        if number > expected:
            newest = unlinked.order_by(*_newest_first(table)).limit(min(number - expected, _MOST))
            for key in connection.execute(newest).scalars():
                yield _Finding(name, f"{name}: {kind} {_shown(key)} was put in past the program")
        elif number < expected:
            yield _Finding(name, f"{name}: {expected - number} rows from before the chain were removed")


def _keys(kind: str, table: Table) -> tuple[Any, Any]:
    """The key of a row as links name it, and where the rows are."""
    _, column, by_uuid = query_of(kind)
    rows: Any = table.join(_JOINED[kind][1]) if kind in _JOINED else table
    # Not as a UUID: what is none is to be told, and not to end the search.
    return (func.replace(cast(column, String), "-", "") if by_uuid else column), rows


def _newest_first(table: Table) -> list[Any]:
    if "id" in table.c and table.c.id.type.python_type is int:
        return [table.c.id.desc()]
    return [column.desc() for column in (table.c.get("stored_utc"), table.c.get("utc")) if column is not None]


def _shortened(findings: Sequence[_Finding]) -> Iterator[str]:
    """The findings, those of one table only so many times."""
    told: dict[str, int] = {}
    for table, text in findings:
        told[table] = told.get(table, 0) + 1
        if told[table] <= _MOST:
            yield text
    for table, number in told.items():
        if number > _MOST:
            yield f"{table}: {number - _MOST} more of this kind"
