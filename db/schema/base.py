"""What every table uses: names of constraints, UTC times, choices, checks."""

from __future__ import annotations

import enum
from datetime import UTC, datetime

from sqlalchemy import (
    JSON,
    BigInteger,
    CheckConstraint,
    Column,
    DateTime,
    Dialect,
    Enum,
    Integer,
    MetaData,
    TypeDecorator,
)
from sqlalchemy.dialects.postgresql import JSONB

NAMING_CONVENTION = {
    "pk": "pk_%(table_name)s",
    "fk": "fk_%(table_name)s_%(column_0_name)s",
    "uq": "uq_%(table_name)s_%(column_0_N_name)s",
    "ix": "ix_%(table_name)s_%(column_0_N_name)s",
    "ck": "ck_%(table_name)s_%(constraint_name)s",
}


class UtcDateTime(TypeDecorator[datetime]):
    """An aware time, kept as UTC; SQLite knows no zones, so it gets the bare UTC time."""

    impl = DateTime(timezone=True)
    cache_ok = True

    def process_bind_param(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        """To the database: converted to UTC."""
        if value is None:
            return None
        utc = value.astimezone(UTC)
        return utc.replace(tzinfo=None) if dialect.name == "sqlite" else utc

    def process_result_value(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        """From the database: always aware, always UTC."""
        if value is None:
            return None
        return value.replace(tzinfo=UTC) if dialect.name == "sqlite" else value.astimezone(UTC)


def id_column() -> Column[int]:
    """A counter as primary key."""
    # SQLite counts up only in a column that is exactly INTEGER PRIMARY KEY.
    return Column("id", BigInteger().with_variant(Integer, "sqlite"), primary_key=True)


def choice(name: str, values: type[enum.StrEnum]) -> Column[str]:
    """One of the values of an enumeration, kept as text and checked by the database."""
    kind = Enum(
        values, name=name, native_enum=False, create_constraint=True, length=16,
        values_callable=lambda members: [member.value for member in members],
    )  # fmt: skip
    return Column(name, kind, nullable=False)


def check(name: str, *conditions: str) -> CheckConstraint:
    """A named condition on one row."""
    return CheckConstraint(" AND ".join(conditions), name=name)


def angle(name: str) -> str:
    """Condition: a possible angle."""
    # A range also keeps out NaN, which PostgreSQL sorts above every number, and infinity.
    return f"{name} BETWEEN -3.2 AND 3.2"


def uncertainty(name: str) -> str:
    """Condition: a possible standard uncertainty of an angle."""
    return f"({name} > 0 AND {name} <= 3.2)"


def length(name: str) -> str:
    """Condition: a possible length of a vehicle, millimetres."""
    return f"{name} BETWEEN -100000 AND 100000"


def uncertainty_mm(name: str) -> str:
    """Condition: a possible standard uncertainty of a length, millimetres."""
    return f"({name} > 0 AND {name} <= 10000)"


def ordered(*names: str) -> list[str]:
    """Conditions: the lower limit first."""
    return [f"{name}_low <= {name}_high" for name in names]


def within_limits(*names: str) -> str:
    """Condition: OK only inside the limits."""
    bounds = " AND ".join(
        f"({name}_low IS NULL OR {name} >= {name}_low) AND ({name}_high IS NULL OR {name} <= {name}_high)"
        for name in names
    )
    return f"verdict <> 'ok' OR ({bounds})"


def explained(*names: str) -> str:
    """Condition: a verdict comes with what decided it."""
    any_limit = " OR ".join(f"{name}_{end} IS NOT NULL" for name in names for end in ("low", "high"))
    return f"verdict = 'none' OR (guard_band IS NOT NULL AND coverage_factor IS NOT NULL AND ({any_limit}))"


# Kept to the letter: JSONB would rewrite large numbers.
EVIDENCE = JSON(none_as_null=True)
# What is searched for by its content.
JSON_DOCUMENT = JSON(none_as_null=True).with_variant(JSONB(none_as_null=True), "postgresql")

metadata = MetaData(naming_convention=NAMING_CONVENTION)
