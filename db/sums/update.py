"""Keeps the sums of `db.schema.sums` beside the results: adds what is new, builds them again, checks them.

Sums are a copy: losing them loses nothing. Questions add the results that are not in them yet, so how often
`update_sums` runs decides how fast an answer is, never what it says.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import Connection, Engine, delete, func, literal, select, text, union_all, update
from sqlalchemy.dialects import postgresql, sqlite

from db.schema import (
    counted_categories,
    cycles,
    result_counts,
    stations,
    summed_characteristics,
    sums_state,
    value_sums,
)
from db.sums.days import day_differences, sums_agree
from db.sums.partial import (
    CATEGORY,
    CHARACTERISTIC,
    SUMS,
    Selection,
    counted,
    epoch_hour,
    hourly,
    merged_sums,
    raw_outcomes,
    raw_values,
    same,
)

# A day is closed when results of two hours after it have come.
_SLACK_HOURS = 2
_SUM_KEY = ("characteristic_id", "hours", "start", "station_id")
_COUNT_KEY = ("category_id", "hours", "start", "station_id")
# One program at a time: an arbitrary number that all Truewheel programs share.
_SUMS_LOCK = 7_206_155_015
# An INSERT holds this lock from before it takes its ids until its transaction ends.
_WRITING = text(
    "SELECT virtualtransaction FROM pg_locks WHERE relation = 'cycles'::regclass"
    " AND database = (SELECT oid FROM pg_database WHERE datname = current_database())"
    " AND mode = 'RowExclusiveLock' AND granted"
)
_LOOK_S, _LONGEST_WAIT_S = 0.005, 0.5


def update_sums(engine: Engine, most: int = 20_000) -> int:
    """Add the results of at most `most` new cycles, in a transaction of its own; return how many were added.

    Another program that does so at the same time is left to it: then nothing happens here.
    """
    committed = _last_committed(engine)
    if not committed:
        return 0
    with engine.connect().execution_options(writes=True) as connection, connection.begin():
        if connection.dialect.name == "postgresql":
            mine = connection.execute(select(func.pg_try_advisory_xact_lock(_SUMS_LOCK))).scalar_one()
            if not mine:
                return 0
        done, whole_days_until = connection.execute(
            select(sums_state.c.last_cycle_id, sums_state.c.whole_days_until)
        ).one()
        # Numbers may have gaps, so the cycles themselves are counted.
        next_ones = select(cycles.c.id).where(cycles.c.id > done, cycles.c.id <= committed)
        portion = next_ones.order_by(cycles.c.id).limit(most).subquery("portion")
        added, last = connection.execute(select(func.count(), func.max(portion.c.id))).one()
        if not added:
            return 0
        new = Selection(after_id=done, last_id=last)
        _add(connection, new)
        whole_days_until = _sum_days(connection, new, whole_days_until)
        connection.execute(
            update(sums_state).values(
                last_cycle_id=last, whole_days_until=whole_days_until, summed_utc=datetime.now(UTC)
            )
        )
        return int(added)


def bring_up_to_date(engine: Engine) -> int:
    """Add all results that are not in the sums yet; return of how many cycles."""
    total = 0
    # In large steps: each looks up its vehicles in one pass over all of them.
    while added := update_sums(engine, most=200_000):
        total += added
    return total


def forget_sums(engine: Engine) -> None:
    """Empty the sums; `bring_up_to_date` builds them again from the results."""
    with engine.connect().execution_options(writes=True) as connection, connection.begin():
        for table in (value_sums, result_counts):
            connection.execute(delete(table))
        connection.execute(update(sums_state).values(last_cycle_id=0, whole_days_until=0))


@dataclass(frozen=True)
class SumsCheck:
    """What comparing the sums with the results found.

    Attributes
    ----------
    cycles
        How many cycles the sums cover.
    sums, counts
        Compared rows of hours.
    differences
        Sentences, at most ten; empty when all agree.
    """

    cycles: int
    sums: int
    counts: int
    differences: tuple[str, ...]


def check_sums(connection: Connection, from_hour: int | None = None) -> SumsCheck:
    """Compare the sums of every hour with the results they were made of, and days with their hours.

    Parameters
    ----------
    from_hour
        Only results received since then (whole hours since 1970); all without.
    """
    last = connection.execute(select(sums_state.c.last_cycle_id)).scalar_one()
    conditions = (
        () if from_hour is None else (cycles.c.received_utc >= datetime.fromtimestamp(from_hour * 3600, UTC),)
    )
    covered = Selection(conditions, last_id=last)
    later = literal(True) if from_hour is None else value_sums.c.start >= from_hour
    kept = {
        tuple(row[:7]): tuple(row[7:])
        for row in connection.execute(
            select(
                *(summed_characteristics.c[key] for key in CHARACTERISTIC),
                stations.c.name,
                value_sums.c.start,
                *(value_sums.c[name] for name in SUMS),
            )
            .join(summed_characteristics, value_sums.c.characteristic_id == summed_characteristics.c.id)
            .join(stations, value_sums.c.station_id == stations.c.id)
            .where(value_sums.c.hours == 1, later)
        )
    }
    true = {tuple(row[:7]): tuple(row[7:]) for row in connection.execute(hourly(raw_values(covered)))}
    differences = [
        f"value_sums of {key}: {kept.get(key)}, from the results {true.get(key)}"
        for key in {*kept, *true}
        if not sums_agree(kept.get(key), true.get(key))
    ]
    later = literal(True) if from_hour is None else result_counts.c.start >= from_hour
    counts_kept = {
        tuple(row[:-1]): row[-1]
        for row in connection.execute(
            select(
                *(counted_categories.c[key] for key in CATEGORY),
                stations.c.name,
                result_counts.c.start,
                result_counts.c.n,
            )
            .join(counted_categories, result_counts.c.category_id == counted_categories.c.id)
            .join(stations, result_counts.c.station_id == stations.c.id)
            .where(result_counts.c.hours == 1, later)
        )
    }
    counts_true = {
        tuple(row[:-1]): row[-1]
        for row in connection.execute(
            counted(raw_outcomes(covered).subquery("raw"), (*CATEGORY, "station", "start"))
        )
    }
    differences += [
        f"result_counts of {key}: {counts_kept.get(key)}, from the results {counts_true.get(key)}"
        for key in {*counts_kept, *counts_true}
        if counts_kept.get(key) != counts_true.get(key)
    ]
    differences += day_differences(connection, from_hour)
    number = connection.execute(
        select(func.count()).select_from(cycles).where(*covered.of_cycles)
    ).scalar_one()
    return SumsCheck(number, len(true), len(counts_true), tuple(differences[:10]))


def _last_committed(engine: Engine) -> int:
    """The highest id of a cycle below which no other can appear; 0 when there is nothing to do now."""
    newest = select(func.coalesce(func.max(cycles.c.id), 0)).scalar_subquery()
    with engine.connect() as connection, connection.begin():
        if not connection.execute(select(newest > sums_state.c.last_cycle_id)).scalar_one():
            return 0
        last: int = connection.execute(select(newest)).scalar_one()
        return last if connection.dialect.name == "sqlite" or _settled(connection) else 0


def _settled(connection: Connection) -> bool:
    """Wait until every transaction that writes cycles now has ended; false when that takes long.

    Ids are given before the commit, so one of these may still bring an id below the highest. They are waited
    for and not shut out: nobody who writes notices.
    """
    writing = set(connection.execute(_WRITING).scalars())
    until = time.monotonic() + _LONGEST_WAIT_S
    while writing:
        if time.monotonic() > until:
            return False
        time.sleep(_LOOK_S)
        writing &= set(connection.execute(_WRITING).scalars())
    return True


def _add(connection: Connection, new: Selection) -> None:
    # Looked up first: SQLite refuses what is there already before it could be left alone.
    known = select(stations.c.id).where(stations.c.name == cycles.c.station).exists()
    named = select(cycles.c.station).where(*new.of_cycles, ~known).distinct()
    insert = _insert(connection)
    connection.execute(insert(stations).from_select(["name"], named).on_conflict_do_nothing())
    values = union_all(*raw_values(new)).subquery("raw")
    _add_missing(connection, summed_characteristics, values, CHARACTERISTIC)
    sums = hourly(raw_values(new)).subquery("sums")
    rows = select(
        summed_characteristics.c.id,
        literal(1),
        sums.c.start,
        stations.c.id,
        *(sums.c[name] for name in SUMS),
    ).where(same(sums, summed_characteristics, CHARACTERISTIC), stations.c.name == sums.c.station)
    statement = insert(value_sums).from_select([*_SUM_KEY, *SUMS], rows)
    old, more = value_sums.c, statement.excluded
    n = old.n + more.n
    shift = more.mean - old.mean
    m2 = old.m2 + more.m2 + shift * shift * old.n * more.n / n
    connection.execute(
        statement.on_conflict_do_update(
            index_elements=_SUM_KEY,
            set_={
                "n": n,
                "mean": old.mean + shift * more.n / n,
                "m2": m2,
                "minimum": _extreme(connection, "least", old.minimum, more.minimum),
                "maximum": _extreme(connection, "greatest", old.maximum, more.maximum),
                "n_low": old.n_low + more.n_low,
                "n_high": old.n_high + more.n_high,
                # The hour is the group: its own spread.
                "m2_within": m2,
                "dof_within": n - 1,
            },
        )
    )
    _add_missing(connection, counted_categories, raw_outcomes(new).subquery("raw"), CATEGORY)
    outcomes = counted(raw_outcomes(new).subquery("raw"), (*CATEGORY, "station", "start")).subquery("counts")
    count_rows = select(
        counted_categories.c.id, literal(1), outcomes.c.start, stations.c.id, outcomes.c.n
    ).where(same(outcomes, counted_categories, CATEGORY), stations.c.name == outcomes.c.station)
    counts = insert(result_counts).from_select([*_COUNT_KEY, "n"], count_rows)
    connection.execute(
        counts.on_conflict_do_update(
            index_elements=_COUNT_KEY, set_={"n": result_counts.c.n + counts.excluded.n}
        )
    )


def _add_missing(connection: Connection, table: Any, rows: Any, keys: tuple[str, ...]) -> None:
    wanted = select(*(rows.c[key] for key in keys)).distinct().subquery("wanted")
    known = select(table.c.id).where(same(wanted, table, keys)).exists()
    connection.execute(table.insert().from_select(keys, select(wanted).where(~known)))


def _sum_days(connection: Connection, new: Selection, whole_until: int) -> int:
    """Sum the days that are over, and again those that results came late for; return the first open hour."""
    hour = epoch_hour(cycles.c.received_utc)
    hours = connection.execute(select(hour).where(*new.of_cycles).distinct()).scalars().all()
    newest = min(max(hours), int(time.time()) // 3600)
    late = {24 * (hour // 24) for hour in hours if hour < whole_until}
    until = max(whole_until, 24 * ((newest - _SLACK_HOURS) // 24))
    if until > whole_until:
        # Days without any result cost nothing: the hours below are found by index.
        between = connection.execute(
            select(value_sums.c.start)
            .where(value_sums.c.hours == 1, value_sums.c.start >= whole_until, value_sums.c.start < until)
            .union(
                select(result_counts.c.start).where(
                    result_counts.c.hours == 1,
                    result_counts.c.start >= whole_until,
                    result_counts.c.start < until,
                )
            )
        ).scalars()
        late |= {24 * (hour // 24) for hour in between}
    for day in sorted(late):
        _sum_day(connection, day)
    return until


def _sum_day(connection: Connection, day: int) -> None:
    for table, key, names, columns in (
        (value_sums, summed_characteristics, _SUM_KEY, SUMS),
        (result_counts, counted_categories, _COUNT_KEY, ("n",)),
    ):
        # Named one by one, the characteristics lead into the primary key.
        of_all = table.c[names[0]].in_(select(key.c.id))
        connection.execute(delete(table).where(of_all, table.c.hours == 24, table.c.start == day))
        rows = (
            select(table)
            .where(of_all, table.c.hours == 1, table.c.start >= day, table.c.start < day + 24)
            .subquery("hours_of_day")
        )
        keys = (names[0], "station_id")
        sums = (merged_sums(rows, keys) if table is value_sums else counted(rows, keys)).subquery("day")
        connection.execute(
            table.insert().from_select(
                [*names, *columns],
                select(
                    sums.c[names[0]],
                    literal(24),
                    literal(day),
                    sums.c.station_id,
                    *(sums.c[name] for name in columns),
                ),
            )
        )


def _insert(connection: Connection) -> Any:
    return postgresql.insert if connection.dialect.name == "postgresql" else sqlite.insert


def _extreme(connection: Connection, name: str, *values: Any) -> Any:
    # SQLite calls the scalar functions min and max.
    if connection.dialect.name == "sqlite":
        name = {"least": "min", "greatest": "max"}[name]
    return getattr(func, name)(*values)
