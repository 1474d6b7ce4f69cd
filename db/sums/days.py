"""Holds the sums of days against the sums of their hours."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import Connection, select

from db.schema import result_counts, sums_state, value_sums
from db.sums.partial import SUMS, counted, merged_sums

DAY = 24


def day_differences(connection: Connection, from_hour: int | None) -> Iterator[str]:
    """Sentences for each day that is not the sum of its hours, or is missing, or is there too early.

    Parameters
    ----------
    from_hour
        Only days that begin since then (whole hours since 1970); all without.
    """
    until = connection.execute(select(sums_state.c.whole_days_until)).scalar_one()
    first = 0 if from_hour is None else -DAY * (-from_hour // DAY)
    for table, key, columns in (
        (value_sums, "characteristic_id", SUMS),
        (result_counts, "category_id", ("n",)),
    ):
        keys = (key, "station_id", "day")
        of_hours = (
            select(table, (table.c.start - table.c.start % DAY).label("day"))
            .where(table.c.hours == 1, table.c.start >= first, table.c.start < until)
            .subquery("of_hours")
        )
        summed = merged_sums(of_hours, keys) if table is value_sums else counted(of_hours, keys)
        true = {tuple(row[:3]): tuple(row[3:]) for row in connection.execute(summed)}
        kept_rows = select(
            table.c[key], table.c.station_id, table.c.start, *(table.c[name] for name in columns)
        ).where(table.c.hours == DAY, table.c.start >= first)
        kept = {tuple(row[:3]): tuple(row[3:]) for row in connection.execute(kept_rows)}
        for one in sorted({*kept, *true}, key=lambda found: (found[2], found)):
            if not sums_agree(kept.get(one), true.get(one)):
                day = datetime.fromtimestamp(3600 * one[2], UTC)
                yield (
                    f"{table.name} of the day {day:%Y-%m-%d}, {key.removesuffix('_id')} {one[0]}, station"
                    f" {one[1]}: {kept.get(one)}, from its hours {true.get(one)}"
                )


def sums_agree(kept: tuple[Any, ...] | None, true: tuple[Any, ...] | None) -> bool:
    """Whether two rows of `SUMS`, or two counts, say the same but for rounding."""
    if kept is None or true is None:
        return False
    if len(true) == 1:
        return bool(kept == true)
    scale = max(abs(true[3]), abs(true[4]), 1e-9)
    return bool(
        (kept[0], kept[3], kept[4], kept[5], kept[6], kept[8])
        == (true[0], true[3], true[4], true[5], true[6], true[8])
        and abs(kept[1] - true[1]) <= 1e-12 * scale
        and all(abs(kept[k] - true[k]) <= 1e-9 * true[k] + 1e-20 * true[0] for k in (2, 7))
    )
