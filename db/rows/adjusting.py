"""What was turned lately on vehicles of one type."""

from __future__ import annotations

from sqlalchemy import Connection, select

from db.records import AdjustingRecord
from db.rows.reading import record_of
from db.schema import adjusting_results, cycles, vehicles

LOOKED_AT = 2000
"""Rows of all types that are looked at; what is older than these has nothing to say any more."""


def last_adjustings(
    connection: Connection, station: str, vehicle_type: str, n: int
) -> tuple[AdjustingRecord, ...]:
    """At most the last `n` adjusters whose nuts were locked on vehicles of a type, newest first."""
    turned = adjusting_results
    # By the primary key, so that a type that never comes is not looked for in all that was ever turned.
    newest = [column.desc() for column in turned.primary_key]
    last = select(turned).order_by(*newest).limit(LOOKED_AT).subquery("last")
    query = (
        select(last)
        .join(cycles, cycles.c.id == last.c.cycle_id)
        .join(vehicles, vehicles.c.id == cycles.c.vehicle_id)
        .where(cycles.c.station == station, vehicles.c.vehicle_type == vehicle_type, last.c.nuts_locked > 0)
        .order_by(*(last.c[column.name].desc() for column in turned.primary_key))
        .limit(n)
    )
    return tuple(record_of(AdjustingRecord, row) for row in connection.execute(query).mappings())
