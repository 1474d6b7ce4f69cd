"""Sums over results, kept per hour and day so that a month is read in milliseconds.

They hold nothing of their own: `db.sums.update` builds them from the results, adds what is new, can build
them again, and checks them against the results. Unlike results they change.
"""

from __future__ import annotations

from sqlalchemy import (
    BigInteger,
    Column,
    Double,
    ForeignKey,
    Integer,
    PrimaryKeyConstraint,
    SmallInteger,
    Table,
    Text,
)

from db.schema.base import UtcDateTime, check, id_column, metadata
from db.schema.plant import stations

# An angle of one part of one vehicle type, against one pair of limits.
summed_characteristics = Table(
    "summed_characteristics",
    metadata,
    id_column(),
    Column("part", Text, nullable=False),
    Column("quantity", Text, nullable=False),
    Column("vehicle_type", Text),
    Column("low", Double),
    Column("high", Double),
)

# How a cycle, wheel, axle or vehicle ended, which is its `level`.
counted_categories = Table(
    "counted_categories",
    metadata,
    id_column(),
    Column("level", Text, nullable=False),
    Column("part", Text, nullable=False),
    Column("vehicle_type", Text),
    Column("outcome", Text, nullable=False),
    Column("verdict", Text),
    Column("reason_code", Text),
)

value_sums = Table(
    "value_sums",
    metadata,
    Column("characteristic_id", ForeignKey(summed_characteristics.c.id), nullable=False),
    # 1 or 24 hours.
    Column("hours", SmallInteger, nullable=False),
    # Whole hours since 1970 (UTC).
    Column("start", Integer, nullable=False),
    Column("station_id", ForeignKey(stations.c.id), nullable=False),
    Column("n", Integer, nullable=False),
    Column("mean", Double, nullable=False),
    # Sum of squared deviations from the mean.
    Column("m2", Double, nullable=False),
    Column("minimum", Double, nullable=False),
    Column("maximum", Double, nullable=False),
    # How many missed the limit, guard band included.
    Column("n_low", Integer, nullable=False),
    Column("n_high", Integer, nullable=False),
    # Squared deviations from the mean of their own hour, and their degrees of freedom.
    Column("m2_within", Double, nullable=False),
    Column("dof_within", Integer, nullable=False),
    # Serves capability and charts: one characteristic over a period.
    PrimaryKeyConstraint("characteristic_id", "hours", "start", "station_id"),
    check("possible_span", "hours IN (1, 24)"),
    check("possible_sums", "n > 0", "m2 >= 0", "minimum <= maximum", "n_low >= 0", "n_high >= 0"),
    sqlite_with_rowid=False,
)

result_counts = Table(
    "result_counts",
    metadata,
    Column("category_id", ForeignKey(counted_categories.c.id), nullable=False),
    Column("hours", SmallInteger, nullable=False),
    Column("start", Integer, nullable=False),
    Column("station_id", ForeignKey(stations.c.id), nullable=False),
    Column("n", Integer, nullable=False),
    # Serves yield and Pareto over a period.
    PrimaryKeyConstraint("category_id", "hours", "start", "station_id"),
    check("possible_span", "hours IN (1, 24)"),
    check("possible_count", "n > 0"),
    sqlite_with_rowid=False,
)

sums_state = Table(
    "sums_state",
    metadata,
    Column("id", Integer, primary_key=True, autoincrement=False),
    # Every cycle up to this one is in the sums, and no other.
    Column("last_cycle_id", BigInteger, nullable=False),
    # Before this hour, a whole number of days, the sums of 24 hours are complete.
    Column("whole_days_until", Integer, nullable=False),
    Column("summed_utc", UtcDateTime),
    check("one_row", "id = 1"),
)
