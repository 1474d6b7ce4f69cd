"""Looks through a whole database for what should be impossible."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, field
from datetime import timedelta
from typing import Any

from sqlalchemy import Connection, Table, func, select

from alignment.errors import Deed, Remedy
from db.connection import (
    check_revision,
    describe,
    head_revision,
    make_engine,
    parse_url,
    require_file,
    store_errors,
)
from db.rows import Head, load_records
from db.schema import arrivals, calibrations, cycles, outbox, shipments, sums_state, wheel_results
from db.sums import check_sums
from db.upkeep.cells import cell_findings, impossible_times
from db.upkeep.chain_check import ChainReport, check_chains

_PORTION = 5000


@dataclass(frozen=True)
class CheckReport:
    """What a check found.

    Attributes
    ----------
    findings
        Sentences; empty when all is well.
    heads
        End of each chain of hashes, by station; only when everything was checked.
    cycles, wheels
        How many there are.
    behind
        Cycles that are not in the sums yet; that slows answers and changes none.
    pending
        Records that wait to be shipped; None in a database without outbox.
    ships
        Whether any record was ever shipped from here; without a central database all of them wait for ever.
    remedies
        What can be done about the findings.
    """

    revision: str
    cycles: int
    wheels: int
    behind: int
    pending: int | None
    findings: tuple[str, ...]
    heads: Mapping[str, Head] = field(default_factory=dict)
    remedies: tuple[Remedy, ...] = ()
    ships: bool = False


def check_database(url: str, days: float | None = 7.0) -> CheckReport:
    """Check file, references, outbox, arrivals and sums; changes nothing.

    Parameters
    ----------
    days
        Sums are compared with the results of so many days before the newest. None: all of them, and every
        row with the chain of hashes.

    Raises
    ------
    StoreError
        When the database cannot be read or has another revision; a damaged file is a finding.
    """
    parsed = parse_url(url)
    require_file(parsed)
    engine = make_engine(parsed, timeout_s=3600.0, read_only=True)
    try:
        with store_errors(describe(parsed)), engine.connect() as connection, connection.begin():
            check_revision(connection, describe(parsed))
            return _check(connection, days)
    finally:
        engine.dispose()


def _check(connection: Connection, days: float | None) -> CheckReport:
    local = connection.dialect.name == "sqlite"
    findings: list[str] = []
    heads: Mapping[str, Head] = {}
    if local:
        findings += _told(connection, "the file", _file)
    findings += _told(connection, "the cells", cell_findings if local else impossible_times)
    findings += _told(connection, "the references", _references)
    differing: list[str] = []

    def sum_findings(found: Connection) -> Iterable[str]:
        differing.extend(_sums(found, days))
        return differing

    findings += _told(connection, "the sums", sum_findings)
    findings += _told(connection, *(("the outbox", _outbox) if local else ("the arrivals", _arrivals)))
    if days is None:
        chains = [ChainReport({}, 0, ())]

        def chain_findings(found: Connection) -> Iterable[str]:
            chains[0] = check_chains(found)
            return chains[0].findings

        findings += _told(connection, "the chain of hashes", chain_findings)
        heads = chains[0].heads
    counts: dict[str, Any] = dict.fromkeys(("cycles", "wheels", "behind", "pending", "ships"), 0)
    findings += _told(connection, "the number of records", lambda found: _counted(found, counts))
    remedies = (Remedy(Deed.REBUILD_SUMS),) if differing else ()
    return CheckReport(head_revision(), findings=tuple(findings), heads=heads, remedies=remedies, **counts)


def _told(connection: Connection, what: str, look: Callable[[Connection], Iterable[str]]) -> Iterator[str]:
    """The findings of one look; what keeps it from looking is a finding as well."""
    # On a server an error would end the transaction for all looks after it.
    with connection.begin_nested() if connection.dialect.name == "postgresql" else nullcontext() as inner:
        try:
            yield from look(connection)
        except Exception as error:  # noqa: BLE001
            if inner is not None:
                inner.rollback()
            text = " ".join(str(getattr(error, "orig", None) or error).split())
            yield f"{what} cannot be checked, something in it is damaged ({type(error).__name__}: {text})"


def _counted(connection: Connection, counts: dict[str, Any]) -> Iterator[str]:
    counts["cycles"], counts["wheels"] = _count(connection, cycles), _count(connection, wheel_results)
    last = connection.execute(select(sums_state.c.last_cycle_id)).scalar_one()
    newer = select(func.count()).select_from(cycles).where(cycles.c.id > last)
    counts["behind"] = connection.execute(newer).scalar_one()
    counts["pending"], counts["ships"] = None, False
    if connection.dialect.name == "sqlite":
        newest = connection.execute(select(func.coalesce(func.max(outbox.c.sequence), 0))).scalar_one()
        shipped, when = connection.execute(
            select(shipments.c.shipped_sequence, shipments.c.shipped_utc)
        ).one()
        counts["pending"], counts["ships"] = newest - shipped, when is not None
    yield from ()


def _count(connection: Connection, table: Table) -> int:
    found: int = connection.execute(select(func.count()).select_from(table)).scalar_one()
    return found


def _file(connection: Connection) -> Iterator[str]:
    for row in connection.exec_driver_sql("PRAGMA integrity_check(5)"):
        if row[0] != "ok":
            yield f"the file is damaged: {' '.join(str(row[0]).split())}"
    for row in connection.exec_driver_sql("PRAGMA foreign_key_check").fetchmany(5):
        yield f"table {row[0]}, row {row[1]} refers to a row of {row[2]} that is not there"


def _references(connection: Connection) -> Iterator[str]:
    """What foreign keys promise, looked at anyway: a server may have been loaded without them."""
    for column, target in (
        (wheel_results.c.cycle_id, cycles.c.id),
        (wheel_results.c.calibration_id, calibrations.c.id),
    ):
        query = (
            select(func.count())
            .select_from(column.table.outerjoin(target.table, column == target))
            .where(column.is_not(None), target.is_(None))
        )
        missing = connection.execute(query).scalar_one()
        if missing:
            yield f"{missing} rows of {column.table.name} name a row of {target.table.name} that is not there"


def _outbox(connection: Connection) -> Iterator[str]:
    """Every number once, and behind every entry a record; every cycle behind an entry."""
    number, last = connection.execute(select(func.count(), func.max(outbox.c.sequence))).one()
    if number and number != last:
        yield f"the outbox holds {number} entries and counts up to {last}: some are missing"
    shipped = connection.execute(select(shipments.c.shipped_sequence)).scalar_one()
    if shipped > (last or 0):
        yield f"{shipped} records are called shipped, the outbox has {last or 0}: the file is an older copy"
    kinds = connection.execute(select(outbox.c.kind).distinct()).scalars().all()
    for kind in kinds:
        if kind == "cycle":
            entries = select(func.count()).select_from(outbox).where(outbox.c.kind == kind)
            listed, stored = connection.execute(entries).scalar_one(), _count(connection, cycles)
            if listed != stored:
                yield f"{stored} cycles are stored, {listed} are in the outbox"
            continue
        of_kind = select(outbox.c.sequence, outbox.c.key).where(outbox.c.kind == kind)
        of_kind, after = of_kind.order_by(outbox.c.sequence).limit(_PORTION), 0
        while listing := connection.execute(of_kind.where(outbox.c.sequence > after)).all():
            after = listing[-1].sequence
            keys = [entry.key for entry in listing]
            lost = set(keys) - set(load_records(connection, kind, keys))
            if lost:
                yield f"the outbox names the {kind} {min(lost)}, which is not stored ({len(lost)} such)"


def _arrivals(connection: Connection) -> Iterator[str]:
    query = select(
        arrivals.c.origin,
        func.max(arrivals.c.station).label("station"),
        func.count().label("number"),
        func.max(arrivals.c.sequence).label("last"),
    ).group_by(arrivals.c.origin)
    for origin, station, number, last in connection.execute(query):
        if number != last:
            yield (
                f"of station '{station}' (origin {origin}) {number} records arrived, and they count up to"
                f" {last}: some are missing"
            )
    spans = (
        select(
            arrivals.c.station,
            arrivals.c.origin,
            func.min(arrivals.c.arrived_utc).label("first"),
            func.max(arrivals.c.arrived_utc).label("last"),
        )
        .group_by(arrivals.c.station, arrivals.c.origin)
        .order_by(arrivals.c.station, func.min(arrivals.c.arrived_utc))
    )
    before = None
    for span in connection.execute(spans):
        if before is not None and before.station == span.station and span.first < before.last:
            yield (
                f"two databases shipped as station '{span.station}' at the same time, from"
                f" {max(before.first, span.first):%Y-%m-%d %H:%M}: two stations have the same id"
            )
        before = span


def _sums(connection: Connection, days: float | None) -> Iterator[str]:
    newest = connection.execute(select(func.max(cycles.c.received_utc))).scalar_one_or_none()
    if newest is None:
        return
    first = None if days is None else int((newest - timedelta(days=days)).timestamp()) // 3600
    found = check_sums(connection, first)
    for difference in found.differences:
        yield f"sums disagree with the results: {difference}"
