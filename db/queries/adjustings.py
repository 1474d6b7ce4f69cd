"""What was turned on vehicles, adjuster by adjuster."""

from __future__ import annotations

from dataclasses import dataclass
from uuid import UUID

from sqlalchemy import Text, cast, select

from db.queries.filters import EVERYTHING, Filter, about_cycles
from db.queries.reader import ResultReader, question
from db.records import AdjustingRecord, CycleOutcome
from db.rows import record_of
from db.schema import adjusting_results, cycles, vehicles


@dataclass(frozen=True)
class Adjusted:
    """One adjuster that was turned, and of which vehicle.

    Attributes
    ----------
    cycle, station, vehicle_type
        Of the vehicle that was adjusted.
    outcome
        Of the measurement after it.
    """

    cycle: UUID
    station: str
    vehicle_type: str | None
    outcome: CycleOutcome
    record: AdjustingRecord


@question
def adjusted(reader: ResultReader, where: Filter = EVERYTHING, newest: int = 20_000) -> tuple[Adjusted, ...]:
    """The adjusters that were turned last, at most `newest` of them, newest vehicle first.

    The filter's verdict is the cycle's outcome; `wheels` leaves adjusters of these.
    """
    turned = adjusting_results
    conditions = about_cycles(where)
    if where.verdict is not None:
        conditions.append(cast(cycles.c.outcome, Text) == where.verdict.value)
    if where.wheels:
        conditions.append(turned.c.wheel.in_(where.wheels))
    query = (
        select(
            turned,
            cycles.c.uuid,
            cycles.c.station,
            vehicles.c.vehicle_type,
            cycles.c.outcome.label("of_cycle"),
        )
        .join(cycles, cycles.c.id == turned.c.cycle_id)
        .outerjoin(vehicles, vehicles.c.id == cycles.c.vehicle_id)
        .where(*conditions)
        .order_by(*(column.desc() for column in turned.primary_key))
        .limit(newest)
    )
    with reader.transaction() as connection:
        return tuple(
            Adjusted(
                row["uuid"],
                row["station"],
                row["vehicle_type"],
                CycleOutcome(row["of_cycle"]),
                record_of(AdjustingRecord, row),
            )
            for row in connection.execute(query).mappings()
        )
