"""Single values: series of one angle for charts and distributions, and whole records for exports."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import (
    Connection,
    Double,
    Select,
    Text,
    cast,
    null,
    select,
)

from alignment.arrays import Array
from db.queries.columns import columns_of, objects, plain_time, plain_uuid, times
from db.queries.filters import EVERYTHING, Characteristic, Filter, about_cycles, known_stations
from db.queries.reader import ResultReader, question
from db.records import StoredCycle
from db.rows import CYCLES, read_cycles
from db.schema import cycles, part_column, results_of, vehicles, wheel_results


@dataclass(frozen=True, eq=False)
class ValueSeries:
    """Values of one characteristic in the order of storing; N values, all arrays (N,).

    Attributes
    ----------
    time
        When the trigger came, UTC, datetime64[us]; the clock may have been set back in between.
    value, u, low, high
        Radians, float64: value, standard uncertainty, limits; NaN where there is none.
    verdict, vin, vehicle_type, station, calibration_id, cycle
        Text, dtype object; None where there is none. Only wheels have a calibration of their own. `cycle` is
        text that `uuid.UUID` reads.
    """

    characteristic: Characteristic
    time: NDArray[np.datetime64]
    value: Array
    u: Array
    low: Array
    high: Array
    verdict: NDArray[np.object_]
    vin: NDArray[np.object_]
    vehicle_type: NDArray[np.object_]
    station: NDArray[np.object_]
    calibration_id: NDArray[np.object_]
    cycle: NDArray[np.object_]

    def __len__(self) -> int:
        return len(self.value)


@question
def value_series(
    reader: ResultReader,
    characteristic: Characteristic,
    where: Filter = EVERYTHING,
    newest: int | None = None,
    oldest: int | None = None,
) -> ValueSeries:
    """All values of a characteristic that a filter leaves; or only the `newest` or `oldest` so many of them.

    The newest are those that were stored last, in the order of storing; the oldest those whose triggers came
    first, in the order of their times.
    """
    with reader.transaction() as connection:
        query = _series(connection, characteristic, where)
        if oldest is not None:
            columns = columns_of(connection, query.order_by(cycles.c.received_utc, cycles.c.id).limit(oldest))
        elif newest is None:
            columns = columns_of(connection, query.order_by(cycles.c.id))
        else:
            backwards = columns_of(connection, query.order_by(cycles.c.id.desc()).limit(newest))
            columns = [column[::-1] for column in backwards]
    received, numbers, texts, uuids = columns[0], columns[1:5], columns[5:10], columns[10]
    value, u, low, high = (np.array(column, dtype=np.float64) for column in numbers)
    verdict, vin, vehicle_type, station, calibration = (objects(column) for column in texts)
    return ValueSeries(
        characteristic,
        times(received),
        value,
        u,
        low,
        high,
        verdict,
        vin,
        vehicle_type,
        station,
        calibration,
        objects(uuids),
    )


def cycle_records(
    reader: ResultReader, where: Filter = EVERYTHING, portion: int = 500
) -> Iterator[StoredCycle]:
    """Whole cycles in the order of storing, for exports; `portion` of them are in memory at a time.

    The filter's verdict is the cycle's outcome; `wheels` leaves cycles that have one of them.
    """
    conditions = about_cycles(where)
    if where.verdict is not None:
        conditions.append(cast(cycles.c.outcome, Text) == where.verdict.value)
    if where.wheels:
        of_cycle = (wheel_results.c.cycle_id == cycles.c.id) & wheel_results.c.wheel.in_(where.wheels)
        conditions.append(select(wheel_results.c.cycle_id).where(of_cycle).exists())
    last = 0
    with reader.transaction() as connection:
        while True:
            query = CYCLES.where(cycles.c.id > last, *conditions).order_by(cycles.c.id).limit(portion)
            ids = connection.execute(query.with_only_columns(cycles.c.id)).scalars().all()
            if not ids:
                return
            yield from read_cycles(connection, CYCLES.where(cycles.c.id.in_(ids)).order_by(cycles.c.id))
            last = ids[-1]


def _series(connection: Connection, characteristic: Characteristic, where: Filter) -> Select[Any]:
    quantity = characteristic.quantity
    table = results_of(quantity)
    nothing = cast(null(), Double)
    columns = [
        table.c.get(name, nothing)
        for name in (quantity.value, f"{quantity}_u", f"{quantity}_low", f"{quantity}_high")
    ]
    query = (
        select(
            plain_time(connection, cycles.c.received_utc),
            *columns,
            cast(table.c.verdict, Text),
            vehicles.c.vin,
            vehicles.c.vehicle_type,
            cycles.c.station,
            table.c.calibration_id if "calibration_id" in table.c else cast(null(), Text),
            plain_uuid(cycles.c.uuid),
        )
        .select_from(cycles)
        .join(table, table.c.cycle_id == cycles.c.id)
        .outerjoin(vehicles, cycles.c.vehicle_id == vehicles.c.id)
        .where(columns[0].is_not(None), *about_cycles(where))
    )
    part = part_column(table)
    if part is not None:
        query = query.where(part == characteristic.part)
    if where.verdict is not None:
        query = query.where(table.c.verdict == where.verdict)
    if not where.stations and not where.plants and (where.from_utc or where.until_utc):
        # Every station by name, so that the index on station and time is used.
        query = query.where(cycles.c.station.in_(known_stations(connection)))
    return query
