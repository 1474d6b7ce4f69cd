"""Steering wheel, straight ahead and steering axes; of wheels the ride height and the angles as measured."""

from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0014"
down_revision = "0013"

REFUSAL = "stored results are never changed or deleted: write a new record"
WHEEL, AXIS = "steering_results", "steering_axis_results"
_OF_WHEELS: tuple[tuple[str, str, dict[str, str]], ...] = (
    ("camber_raw", "DOUBLE", {}),
    (
        "toe_raw",
        "DOUBLE",
        {"possible_raw_angles": "camber_raw BETWEEN -3.2 AND 3.2 AND toe_raw BETWEEN -3.2 AND 3.2"},
    ),
    ("camber_raw_u", "DOUBLE", {}),
    (
        "toe_raw_u",
        "DOUBLE",
        {
            "raw_is_complete": "(toe_raw IS NULL) = (camber_raw IS NULL) AND (camber_raw_u IS NULL) ="
            " (camber_raw IS NULL) AND (toe_raw_u IS NULL) = (camber_raw IS NULL) AND"
            " (camber_raw IS NULL OR outcome = 'measured')",
            "possible_raw_uncertainties": "(camber_raw_u > 0 AND camber_raw_u <= 3.2) AND"
            " (toe_raw_u > 0 AND toe_raw_u <= 3.2)",
        },
    ),
    (
        "ride_height",
        "TEXT",
        {"refused_height_has_no_verdict": "ride_height NOT IN ('missing', 'refused') OR verdict = 'none'"},
    ),
    ("ride_height_mm", "DOUBLE", {}),
    ("ride_height_u_mm", "DOUBLE", {}),
    (
        "design_height_mm",
        "DOUBLE",
        {
            "possible_ride_height": "ride_height IN ('corrected', 'not_known', 'missing', 'refused') AND"
            " ride_height_mm BETWEEN 0 AND 10000 AND ride_height_u_mm BETWEEN 0 AND 1000 AND"
            " design_height_mm BETWEEN 0 AND 10000",
            "corrected_height_is_explained": "ride_height <> 'corrected' OR (ride_height_mm IS NOT NULL AND"
            " ride_height_u_mm IS NOT NULL AND design_height_mm IS NOT NULL)",
        },
    ),
)
_OFFSETS = ("steering_wheel_offset", "caster_difference", "kpi_difference")
_ANGLES = ("caster", "kpi", "included_angle", "toe_out")
_LENGTHS = ("trail", "scrub")
_LOCKS = ("lock_left", "lock_right")
_ENDS, _LIMITS = ("", "_u", "_low", "_high"), ("", "_low", "_high")
_FACTOR = {"coverage_factor_positive": "coverage_factor > 0"}


def upgrade() -> None:
    """Make the tables and add the columns; results of earlier programs were judged as they stood."""
    local = op.get_bind().dialect.name == "sqlite"
    op.create_table(WHEEL, *_wheel_columns(), *_constraints(WHEEL, _wheel_conditions(), "cycle_id"))
    op.create_table(AXIS, *_axis_columns(), *_constraints(AXIS, _axis_conditions(), "cycle_id", "wheel"))
    _keep(local, WHEEL, "cycle_id")
    _keep(local, AXIS, "cycle_id", "wheel")
    for name, kind, conditions in _OF_WHEELS:
        # SQLite adds a CHECK with a column or never.
        checked = "".join(
            f" CONSTRAINT ck_wheel_results_{constraint} CHECK ({condition})"
            for constraint, condition in conditions.items()
        )
        typed = "DOUBLE PRECISION" if kind == "DOUBLE" and not local else kind
        op.execute(f"ALTER TABLE wheel_results ADD COLUMN {name} {typed}{checked}")


def _own(*first: sa.Column[Any]) -> list[sa.Column[Any]]:
    number = sa.BigInteger().with_variant(sa.Integer, "sqlite")
    verdict = sa.Enum(
        "ok", "nok", "none", name="verdict", native_enum=False, create_constraint=False, length=16
    )
    return [
        sa.Column("cycle_id", number, nullable=False),
        *first,
        sa.Column("verdict", verdict, nullable=False),
        sa.Column("guard_band", sa.Boolean()),
        sa.Column("coverage_factor", sa.Double()),
    ]


def _numbers(*names: str) -> list[sa.Column[Any]]:
    return [sa.Column(name, sa.Double()) for name in names]


def _wheel_columns() -> list[sa.Column[Any]]:
    return [
        *_own(sa.Column("straight_ahead", sa.Text(), nullable=False), sa.Column("reason_text", sa.Text())),
        *_numbers("steering_wheel_age_s", "steer", "steer_u", "steering_wheel", "steering_wheel_u"),
        *_numbers(*(f"{name}{end}" for name in _OFFSETS for end in _ENDS)),
    ]


def _axis_columns() -> list[sa.Column[Any]]:
    return [
        *_own(sa.Column("wheel", sa.Text(), nullable=False)),
        sa.Column("method", sa.Text()),
        sa.Column("positions", sa.Integer()),
        sa.Column("residual", sa.Double()),
        sa.Column("warning", sa.Text()),
        sa.Column("reason_code", sa.Text()),
        sa.Column("reason_text", sa.Text()),
        *_numbers(*(f"{name}{end}" for name in (*_ANGLES, *_LENGTHS) for end in _ENDS)),
        *_numbers(*(f"{name}{end}" for name in _LOCKS for end in ("", "_u"))),
    ]


def _judged(*names: str) -> dict[str, str]:
    """What holds of values with limits and one verdict."""
    limits = " OR ".join(f"{name}_{end} IS NOT NULL" for name in names for end in ("low", "high"))
    inside = " AND ".join(
        f"({name}_low IS NULL OR {name} >= {name}_low) AND ({name}_high IS NULL OR {name} <= {name}_high)"
        for name in names
    )
    return {
        "verdict": "verdict IN ('ok', 'nok', 'none')",
        "verdict_is_explained": "verdict = 'none' OR (guard_band IS NOT NULL AND coverage_factor IS NOT NULL"
        f" AND ({limits}))",
        "ok_is_within_limits": f"verdict <> 'ok' OR ({inside})",
        "limits_in_order": " AND ".join(f"{name}_low <= {name}_high" for name in names),
    }


def _with_uncertainty(*names: str) -> str:
    return " AND ".join(f"({name} IS NULL) = ({name}_u IS NULL)" for name in names)


def _angles(*names: str) -> str:
    return " AND ".join(f"{name} BETWEEN -3.2 AND 3.2" for name in names)


def _uncertainties(most: str, *names: str) -> str:
    return " AND ".join(f"({name}_u > 0 AND {name}_u <= {most})" for name in names)


def _wheel_conditions() -> dict[str, str]:
    return _judged(*_OFFSETS) | {
        "straight_ahead": "straight_ahead IN ('checked', 'not_checked', 'refused', 'not_asked')",
        "reason_in_words": "(straight_ahead IN ('not_checked', 'refused')) = (reason_text IS NOT NULL)",
        "checked_has_angles": "(straight_ahead = 'checked') = (steer IS NOT NULL)",
        "checked_has_wheel": "steer IS NULL OR steering_wheel IS NOT NULL",
        "values_have_uncertainties": _with_uncertainty("steer", "steering_wheel", *_OFFSETS),
        "refused_has_no_verdict": "straight_ahead <> 'refused' OR verdict <> 'ok'",
        "possible_wheel": "steering_wheel BETWEEN -20 AND 20 AND steering_wheel_age_s BETWEEN 0 AND 100000",
        "possible_angles": _angles("steer", *(f"{name}{end}" for name in _OFFSETS for end in _LIMITS)),
        "possible_uncertainties": _uncertainties("3.2", "steer", "steering_wheel", *_OFFSETS),
        **_FACTOR,
    }


def _axis_conditions() -> dict[str, str]:
    limited = [f"{name}{end}" for name in _ANGLES for end in _LIMITS]
    lengths = " AND ".join(f"{name}{end} BETWEEN -100000 AND 100000" for name in _LENGTHS for end in _LIMITS)
    uncertainties = (_uncertainties("3.2", *_ANGLES, *_LOCKS), _uncertainties("10000", *_LENGTHS))
    return _judged(*_ANGLES, *_LENGTHS) | {
        "wheel_not_empty": "wheel <> ''",
        "reason_in_words": "(reason_code IS NULL) = (reason_text IS NULL)",
        "unmeasured_has_reason": "caster IS NOT NULL OR reason_code IS NOT NULL",
        "unmeasured_has_no_verdict": "caster IS NOT NULL OR verdict = 'none'",
        "measured_is_explained": "caster IS NULL OR (method IS NOT NULL AND positions IS NOT NULL)",
        "values_have_uncertainties": _with_uncertainty(*_ANGLES, *_LENGTHS, *_LOCKS),
        "possible_angles": _angles(*limited, *_LOCKS),
        "possible_lengths": lengths,
        "possible_uncertainties": " AND ".join(uncertainties),
        "possible_quality": "positions >= 0 AND residual >= 0",
        **_FACTOR,
    }


def _constraints(table: str, conditions: dict[str, str], *keys: str) -> list[sa.Constraint]:
    return [
        *(sa.CheckConstraint(text, name=op.f(f"ck_{table}_{name}")) for name, text in conditions.items()),
        sa.ForeignKeyConstraint(["cycle_id"], ["cycles.id"], name=op.f(f"fk_{table}_cycle_id")),
        sa.PrimaryKeyConstraint(*keys, name=op.f(f"pk_{table}")),
    ]


def _keep(local: bool, table: str, *keys: str) -> None:
    """Refuse changes of its rows, and on SQLite inserts that replace one."""
    if not local:
        op.execute(
            f"CREATE TRIGGER {table}_no_change BEFORE UPDATE OR DELETE OR TRUNCATE ON {table}"
            " FOR EACH STATEMENT EXECUTE FUNCTION refuse_change()"
        )
        return
    refuse = f"BEGIN SELECT RAISE(ABORT, '{REFUSAL}'); END"
    for change in ("UPDATE", "DELETE"):
        op.execute(f"CREATE TRIGGER {table}_no_{change.lower()} BEFORE {change} ON {table} {refuse}")
    same = " AND ".join(f"{key} = NEW.{key}" for key in keys)
    known = f"EXISTS (SELECT 1 FROM {table} WHERE {same})"
    op.execute(f"CREATE TRIGGER {table}_no_replace BEFORE INSERT ON {table} WHEN {known} {refuse}")
