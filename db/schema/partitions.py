"""Partitions of the wheel results on PostgreSQL, made ahead of need."""

from __future__ import annotations

import re

from sqlalchemy import Connection, text

# About a month of a plant of 20 stations.
CYCLES_PER_PARTITION = 500_000
_BOUNDS = text(
    "SELECT pg_get_expr(relpartbound, oid) FROM pg_class"
    " WHERE oid IN (SELECT inhrelid FROM pg_inherits WHERE inhparent = 'wheel_results'::regclass)"
)


def detached_ranges(connection: Connection) -> tuple[tuple[int, int], ...]:
    """Ranges of cycles, the end not included, whose partition an administrator has taken away."""
    if connection.dialect.name != "postgresql":
        return ()
    bounds = [str(bound) for bound in connection.execute(_BOUNDS).scalars()]
    ends = sorted(
        (
            0 if "MINVALUE" in bound else int(re.findall(r"FROM \('?(\d+)'?\)", bound)[0]),
            int(re.findall(r"TO \('?(\d+)'?\)", bound)[0]),
        )
        for bound in bounds
        if bound != "DEFAULT"
    )
    gaps, covered = [], 0
    for start, end in ends:
        if start > covered:
            gaps.append((covered, start))
        covered = max(covered, end)
    return tuple(gaps)


def ensure_partitions(connection: Connection) -> int:
    """Make the partitions that the next half million cycles need; return how many were made.

    What no partition fits goes to ``wheel_results_default``, so a late call loses nothing. SQLite has none.
    """
    if connection.dialect.name != "postgresql":
        return 0
    bounds = connection.execute(_BOUNDS).scalars().all()
    ends = [int(found[1]) for bound in bounds if (found := re.search(r"TO \('?(\d+)'?\)", bound))]
    last = connection.execute(text("SELECT coalesce(max(id), 0) FROM cycles")).scalar_one()
    end = max(ends)
    if end <= last:
        # Rows above it are in the default partition already, and stay there.
        end = (last // CYCLES_PER_PARTITION + 1) * CYCLES_PER_PARTITION
    made = 0
    while end <= last + CYCLES_PER_PARTITION:
        name = f"wheel_results_{end}"
        connection.execute(
            text(
                f"CREATE TABLE {name} PARTITION OF wheel_results"
                f" FOR VALUES FROM ({end}) TO ({end + CYCLES_PER_PARTITION})"
            )
        )
        connection.execute(
            text(
                f"CREATE TRIGGER {name}_no_change BEFORE UPDATE OR DELETE OR TRUNCATE ON {name}"
                " FOR EACH STATEMENT EXECUTE FUNCTION refuse_change()"
            )
        )
        end += CYCLES_PER_PARTITION
        made += 1
    return made
