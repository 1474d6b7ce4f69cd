"""Facts that were texts are columns: the cycle of an event, its number, a wheel that lost a head."""

from collections.abc import Iterator
from contextlib import contextmanager

import sqlalchemy as sa
from alembic import op

from db.rows.chain import FILLED, link_hash, rows_text
from db.rows.filled import CODES, told_by_event

revision = "0010"
down_revision = "0009"

REFUSAL = "stored results are never changed or deleted: write a new record"
_PORTION = 5000
_EVENTS = sa.table(
    "events",
    sa.column("id", sa.BigInteger),
    sa.column("code", sa.Text),
    sa.column("text", sa.Text),
    sa.column("cycle_uuid", sa.Uuid),
    sa.column("value", sa.Double),
)
_WHEELS = sa.table("wheel_results", sa.column("method", sa.Text), sa.column("degraded", sa.Boolean))
_LINKS = sa.table(
    "chain_links", *map(sa.column, ("chain", "number", "kind", "key", "rows", "previous", "hash"))
)


def upgrade() -> None:
    """Add the columns and fill them where what is stored tells them; what it does not tell stays empty.

    The chain of hashes does not cover what is filled in now, so a link says up to where rows were filled.
    """
    op.add_column("events", sa.Column("cycle_uuid", sa.Uuid()))
    op.add_column("events", sa.Column("value", sa.Double()))
    op.add_column("wheel_results", sa.Column("degraded", sa.Boolean()))
    op.create_index(op.f("ix_gauge_studies_name"), "gauge_studies", ["name"])
    connection = op.get_bind()
    if connection.dialect.name == "postgresql":
        op.execute("LOCK TABLE chain_links IN EXCLUSIVE MODE")
    with _changeable(connection, "wheel_results"):
        filled = _fill_wheels(connection)
    with _changeable(connection, "events"):
        filled += _fill_events(connection)
    op.create_index(op.f("ix_events_cycle_uuid"), "events", ["cycle_uuid"])
    if filled:
        _mark(connection)


@contextmanager
def _changeable(connection: sa.Connection, table: str) -> Iterator[None]:
    """Let the rows of a table be changed, in this transaction alone."""
    if connection.dialect.name == "sqlite":
        connection.exec_driver_sql(f"DROP TRIGGER IF EXISTS {table}_no_update")
        yield
        connection.exec_driver_sql(
            f"CREATE TRIGGER {table}_no_update BEFORE UPDATE ON {table}"
            f" BEGIN SELECT RAISE(ABORT, '{REFUSAL}'); END"
        )
    else:
        # The trigger of a partitioned table stands for its partitions.
        connection.exec_driver_sql(f"ALTER TABLE ONLY {table} DISABLE TRIGGER {table}_no_change")
        yield
        connection.exec_driver_sql(f"ALTER TABLE ONLY {table} ENABLE TRIGGER {table}_no_change")


def _fill_wheels(connection: sa.Connection) -> int:
    """Wheels that were measured with one head lost: their method ended so."""
    method, end = _WHEELS.c.method, "/degraded"
    lost = sa.func.substr(method, sa.func.length(method) - (len(end) - 1)) == end
    return connection.execute(sa.update(_WHEELS).where(lost).values(degraded=True)).rowcount


def _fill_events(connection: sa.Connection) -> int:
    """Events whose text names a cycle, or a temperature."""
    update = (
        sa.update(_EVENTS)
        .where(_EVENTS.c.id == sa.bindparam("of_id"))
        .values(cycle_uuid=sa.bindparam("of_cycle"), value=sa.bindparam("of_value"))
    )
    query = sa.select(_EVENTS.c.id, _EVENTS.c.code, _EVENTS.c.text).where(_EVENTS.c.code.in_(CODES))
    query = query.order_by(_EVENTS.c.id).limit(_PORTION)
    last = filled = 0
    while rows := connection.execute(query.where(_EVENTS.c.id > last)).all():
        last = rows[-1].id
        told = [(row.id, told_by_event({"code": row.code, "text": row.text})) for row in rows]
        found = [
            {"of_id": number, "of_cycle": one["cycle_uuid"], "of_value": one["value"]}
            for number, one in told
            if set(one.values()) != {None}
        ]
        if found:
            connection.execute(update, found)
        filled += len(found)
    return filled


def _mark(connection: sa.Connection) -> None:
    """A link in the chain without station: the last link of each chain before the columns were filled."""
    chain, number = _LINKS.c.chain, _LINKS.c.number
    ends = {
        row[0]: row[1] for row in connection.execute(sa.select(chain, sa.func.max(number)).group_by(chain))
    }
    before = connection.execute(sa.select(_LINKS.c.hash).where(chain == "", number == ends[""])).scalar_one()
    link = ("", ends[""] + 1, FILLED, revision, rows_text(ends))
    names = ("chain", "number", "kind", "key", "rows")
    values = dict(zip(names, link, strict=True)) | {"previous": before, "hash": link_hash(before, *link)}
    connection.execute(sa.insert(_LINKS).values(**values))
