"""Vehicles have lengths of their own; a wheel says of what its angles are, its load and its run-out."""

from typing import Any

import sqlalchemy as sa
from alembic import op

from db.rows.chain import FILLED, link_hash, rows_text

revision = "0011"
down_revision = "0010"

REFUSAL = "stored results are never changed or deleted: write a new record"
TABLE = "geometry_results"
_ENDS = ("", "_low", "_high")
_LIMITED_MM = (
    "wheelbase_left", "wheelbase_right", "wheelbase_difference", "track_front", "track_rear",
)  # fmt: skip
_SIDEWALLS_MM = ("sidewall_track_front", "sidewall_track_rear")
_MORE_LIMITED_MM = ("setback_front", "setback_rear", "axle_offset", "offset_front", "offset_rear")
_PLACE_MM = ("place_x", "place_y")
_LIMITED = ("yaw", *_LIMITED_MM, *_MORE_LIMITED_MM)
_LENGTHS = (*_LIMITED_MM, *_SIDEWALLS_MM, *_MORE_LIMITED_MM, *_PLACE_MM)
_ALL = ("yaw", *_LENGTHS)
_OF_WHEELS = (
    ("kind", "TEXT", "possible_kind", "kind IN ('tyre_plane', 'spin_axis')"),
    ("load_mm", "DOUBLE", "possible_load", "load_mm BETWEEN 0 AND 1000"),
    ("run_out", "DOUBLE", "", ""),
    (
        "run_out_u", "DOUBLE", "possible_run_out",
        "run_out BETWEEN 0 AND 1000 AND run_out_u BETWEEN 0 AND 1000",
    ),
    ("run_out_high", "DOUBLE", "run_out_is_explained", "run_out IS NULL OR run_out_u IS NOT NULL"),
    ("run_out_phase", "DOUBLE", "", ""),
    (
        "run_out_phase_u", "DOUBLE", "possible_phase",
        "run_out_phase BETWEEN -3.2 AND 3.2 AND run_out_phase_u BETWEEN 0 AND 3.2",
    ),
    ("toe_tyre_u", "DOUBLE", "possible_tyre_share", "toe_tyre_u BETWEEN 0 AND 3.2"),
)  # fmt: skip
_KINDS = ("tyre_plane", "spin_axis")
_WHEELS = sa.table("wheel_results", sa.column("method", sa.Text), sa.column("kind", sa.Text))
_LINKS = sa.table(
    "chain_links", *map(sa.column, ("chain", "number", "kind", "key", "rows", "previous", "hash"))
)


def upgrade() -> None:
    """Make the table, add the columns, and fill the kind of wheels where their method tells it.

    The chain of hashes does not cover what is filled in now, so a link says up to where rows were filled.
    """
    connection = op.get_bind()
    local = connection.dialect.name == "sqlite"
    op.create_table(TABLE, *_columns(), *_constraints())
    _keep(local)
    for name, kind, constraint, condition in _OF_WHEELS:
        # SQLite adds a CHECK with a column or never.
        checked = f" CONSTRAINT ck_wheel_results_{constraint} CHECK ({condition})" if constraint else ""
        op.execute(f"ALTER TABLE wheel_results ADD COLUMN {name} {_type(kind, local)}{checked}")
    if not local:
        op.execute("LOCK TABLE chain_links IN EXCLUSIVE MODE")
    if _fill(connection, local):
        _mark(connection)


def _type(kind: str, local: bool) -> str:
    return "DOUBLE PRECISION" if kind == "DOUBLE" and not local else kind


def _columns() -> list[sa.Column[Any]]:
    ends = {name: ("", "_u", *(_ENDS[1:] if name in _LIMITED else ())) for name in _ALL}
    return [
        sa.Column("cycle_id", sa.BigInteger().with_variant(sa.Integer, "sqlite"), nullable=False),
        sa.Column("reference", sa.Text(), nullable=False),
        sa.Column("end_points", sa.Text()),
        sa.Column(
            "verdict",
            sa.Enum(
                "ok", "nok", "none", name="verdict", native_enum=False, create_constraint=False, length=16
            ),
            nullable=False,
        ),
        sa.Column("guard_band", sa.Boolean()),
        sa.Column("coverage_factor", sa.Double()),
        sa.Column("thrust_angle_tyre_u", sa.Double()),
        *(sa.Column(f"{name}{end}", sa.Double()) for name in _ALL for end in ends[name]),
    ]


def _constraints() -> list[sa.Constraint]:
    limits = " OR ".join(f"{name}_{end} IS NOT NULL" for name in _LIMITED for end in ("low", "high"))
    inside = " AND ".join(
        f"({name}_low IS NULL OR {name} >= {name}_low) AND ({name}_high IS NULL OR {name} <= {name}_high)"
        for name in _LIMITED
    )
    of_lengths = [f"{name}{end}" for name in _LENGTHS for end in (_ENDS if name in _LIMITED else ("",))]
    conditions = {
        "verdict": "verdict IN ('ok', 'nok', 'none')",
        "reference": "reference IN ('vehicle', 'stand')",
        "end_points": "end_points IN ('contact_centres', 'wheel_centres', 'sidewalls')",
        "values_are_complete": " AND ".join(
            f"({name}{end} IS NULL) = (end_points IS NULL)" for end in ("", "_u") for name in _ALL
        ),
        "unmeasured_has_no_verdict": "end_points IS NOT NULL OR verdict = 'none'",
        "verdict_is_explained": "verdict = 'none' OR (guard_band IS NOT NULL AND coverage_factor IS NOT NULL"
        f" AND ({limits}))",
        "ok_is_within_limits": f"verdict <> 'ok' OR ({inside})",
        "limits_in_order": " AND ".join(f"{name}_low <= {name}_high" for name in _LIMITED),
        "possible_angles": " AND ".join(f"yaw{end} BETWEEN -3.2 AND 3.2" for end in _ENDS),
        "possible_lengths": " AND ".join(f"{name} BETWEEN -100000 AND 100000" for name in of_lengths),
        "possible_uncertainties": " AND ".join(
            [
                "(yaw_u > 0 AND yaw_u <= 3.2)",
                *(f"({name}_u > 0 AND {name}_u <= 10000)" for name in _LENGTHS),
                "thrust_angle_tyre_u BETWEEN 0 AND 3.2",
            ]
        ),
        "coverage_factor_positive": "coverage_factor > 0",
    }
    return [
        *(sa.CheckConstraint(text, name=op.f(f"ck_{TABLE}_{name}")) for name, text in conditions.items()),
        sa.ForeignKeyConstraint(["cycle_id"], ["cycles.id"], name=op.f(f"fk_{TABLE}_cycle_id")),
        sa.PrimaryKeyConstraint("cycle_id", name=op.f(f"pk_{TABLE}")),
    ]


def _keep(local: bool) -> None:
    """Refuse changes of its rows, and on SQLite inserts that replace one."""
    if not local:
        op.execute(
            f"CREATE TRIGGER {TABLE}_no_change BEFORE UPDATE OR DELETE OR TRUNCATE ON {TABLE}"
            " FOR EACH STATEMENT EXECUTE FUNCTION refuse_change()"
        )
        return
    refuse = f"BEGIN SELECT RAISE(ABORT, '{REFUSAL}'); END"
    for change in ("UPDATE", "DELETE"):
        op.execute(f"CREATE TRIGGER {TABLE}_no_{change.lower()} BEFORE {change} ON {TABLE} {refuse}")
    known = f"EXISTS (SELECT 1 FROM {TABLE} WHERE cycle_id = NEW.cycle_id)"
    op.execute(f"CREATE TRIGGER {TABLE}_no_replace BEFORE INSERT ON {TABLE} WHEN {known} {refuse}")


def _fill(connection: sa.Connection, local: bool) -> int:
    """Kinds of wheels, by the beginning of their methods; the triggers stand aside in this transaction."""
    if local:
        connection.exec_driver_sql("DROP TRIGGER IF EXISTS wheel_results_no_update")
    else:
        # The trigger of a partitioned table stands for its partitions.
        connection.exec_driver_sql("ALTER TABLE ONLY wheel_results DISABLE TRIGGER wheel_results_no_change")
    method, filled = _WHEELS.c.method, 0
    for kind in _KINDS:
        told = (method == kind) | (sa.func.substr(method, 1, len(kind) + 1) == f"{kind}/")
        filled += connection.execute(sa.update(_WHEELS).where(told).values(kind=kind)).rowcount
    if local:
        connection.exec_driver_sql(
            "CREATE TRIGGER wheel_results_no_update BEFORE UPDATE ON wheel_results"
            f" BEGIN SELECT RAISE(ABORT, '{REFUSAL}'); END"
        )
    else:
        connection.exec_driver_sql("ALTER TABLE ONLY wheel_results ENABLE TRIGGER wheel_results_no_change")
    return filled


def _mark(connection: sa.Connection) -> None:
    """A link in the chain without station: the last link of each chain before the columns were filled."""
    chain, number = _LINKS.c.chain, _LINKS.c.number
    ends = {
        row[0]: row[1] for row in connection.execute(sa.select(chain, sa.func.max(number)).group_by(chain))
    }
    before = connection.execute(sa.select(_LINKS.c.hash).where(chain == "", number == ends[""])).scalar_one()
    link = ("", ends[""] + 1, FILLED, revision, rows_text(ends))
    names = ("chain", "number", "kind", "key", "rows")
    values = dict(zip(names, link, strict=True)) | {"previous": before, "hash": link_hash(before, *link)}
    connection.execute(sa.insert(_LINKS).values(**values))
