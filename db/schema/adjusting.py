"""What was turned on vehicles: one row for each adjuster of a wheel that was turned in a cycle."""

from __future__ import annotations

from sqlalchemy import Column, Double, ForeignKey, Integer, Table, Text

from db.schema.base import angle, check, metadata
from db.schema.results import cycles

adjusting_results = Table(
    "adjusting_results",
    metadata,
    Column("cycle_id", ForeignKey(cycles.c.id), primary_key=True),
    Column("wheel", Text, primary_key=True),
    Column("adjuster", Text, primary_key=True),
    # How the adjusting of the wheel ended, and why it could not end well.
    Column("outcome", Text, nullable=False),
    Column("reason", Text),
    Column("corrections", Integer, nullable=False),
    Column("turns", Double, nullable=False),
    Column("turns_made", Double, nullable=False),
    Column("found_camber", Double, nullable=False),
    Column("found_toe", Double, nullable=False),
    Column("left_camber", Double),
    Column("left_toe", Double),
    # Seconds after the trigger.
    Column("begun_s", Double, nullable=False),
    Column("ended_s", Double, nullable=False),
    Column("nuts_locked", Integer, nullable=False),
    # Mean of what locking added to the adjuster's own angle.
    Column("drift", Double),
    Column("operator", Text),
    check("wheel_not_empty", "wheel <> ''"),
    check("adjuster", "adjuster IN ('tie_rod', 'camber_bolt')"),
    check("outcome", "outcome IN ('done', 'unreachable', 'unfinished')"),
    check(
        "reason",
        "(outcome = 'unreachable') = (reason IS NOT NULL)",
        "(reason IS NULL OR reason IN ('no_adjuster', 'range', 'reaction'))",
    ),
    check("was_turned", "corrections > 0", "nuts_locked BETWEEN 0 AND corrections"),
    check("drift_of_locked_nuts", "(nuts_locked > 0) = (drift IS NOT NULL)"),
    check("left_is_complete", "(left_camber IS NULL) = (left_toe IS NULL)"),
    check("possible_angles", *map(angle, ("found_camber", "found_toe", "left_camber", "left_toe", "drift"))),
    check("possible_turns", "turns BETWEEN -1000000 AND 1000000", "turns_made BETWEEN 0 AND 1000000"),
    check("possible_times", "begun_s BETWEEN 0 AND 1000000", "ended_s BETWEEN begun_s AND 1000000"),
    check("operator_not_empty", "operator <> ''"),
)
