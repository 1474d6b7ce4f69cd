"""Doubts and their ends, written many at a time: a failed check may speak against thousands of vehicles."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime

from sqlalchemy import Connection

from db.records import DoubtClosing, DoubtRecord
from db.rows.chain import new_links
from db.rows.reading import flat_values
from db.rows.writing import insert_rows
from db.schema import chain_links, doubt_closings, doubts


def write_doubts(
    connection: Connection, records: Sequence[DoubtRecord | DoubtClosing], stored_utc: datetime
) -> None:
    """Store doubts, or ends of them, that are known to be new in this transaction."""
    of_kind = {DoubtRecord: doubts, DoubtClosing: doubt_closings}
    for kind, table in of_kind.items():
        rows = [
            flat_values(record) | {"stored_utc": stored_utc} for record in records if type(record) is kind
        ]
        insert_rows(connection, {table: rows})
    links = new_links(connection, [(record, stored_utc) for record in records])
    insert_rows(connection, {chain_links: links})
