"""The geometry of vehicles: their lengths and how they stood, one row for a vehicle."""

from __future__ import annotations

from sqlalchemy import Boolean, Column, Double, ForeignKey, Table, Text

from db.records import GEOMETRY_LIMITED, OF_GEOMETRY, QUANTITIES, Quantity, Unit, Verdict
from db.schema.base import (
    angle,
    check,
    choice,
    explained,
    length,
    metadata,
    ordered,
    uncertainty,
    uncertainty_mm,
    within_limits,
)
from db.schema.results import cycles

_ANGLES = [quantity for quantity in OF_GEOMETRY if QUANTITIES[quantity].unit is Unit.DEGREES]
_LENGTHS = [quantity for quantity in OF_GEOMETRY if QUANTITIES[quantity].unit is Unit.MILLIMETRES]


def _columns(quantity: Quantity, *ends: str) -> list[str]:
    limits = ("_low", "_high") if quantity in GEOMETRY_LIMITED else ()
    return [f"{quantity}{end}" for end in ("", *ends, *limits)]


geometry_results = Table(
    "geometry_results",
    metadata,
    Column("cycle_id", ForeignKey(cycles.c.id), primary_key=True),
    # What toes and thrust angle of the cycle refer to.
    Column("reference", Text, nullable=False),
    Column("end_points", Text),
    choice("verdict", Verdict),
    Column("guard_band", Boolean),
    Column("coverage_factor", Double),
    Column("thrust_angle_tyre_u", Double),
    *(Column(name, Double) for quantity in OF_GEOMETRY for name in _columns(quantity, "_u")),
    check("reference", "reference IN ('vehicle', 'stand')"),
    check("end_points", "end_points IN ('contact_centres', 'wheel_centres', 'sidewalls')"),
    # All values or none: they come from the same four wheels.
    check(
        "values_are_complete",
        *(f"({quantity} IS NULL) = (end_points IS NULL)" for quantity in OF_GEOMETRY),
        *(f"({quantity}_u IS NULL) = (end_points IS NULL)" for quantity in OF_GEOMETRY),
    ),
    check("unmeasured_has_no_verdict", "end_points IS NOT NULL OR verdict = 'none'"),
    check("verdict_is_explained", explained(*GEOMETRY_LIMITED)),
    check("ok_is_within_limits", within_limits(*GEOMETRY_LIMITED)),
    check("limits_in_order", *ordered(*GEOMETRY_LIMITED)),
    check("possible_angles", *(angle(name) for quantity in _ANGLES for name in _columns(quantity))),
    check("possible_lengths", *(length(name) for quantity in _LENGTHS for name in _columns(quantity))),
    check(
        "possible_uncertainties",
        *(uncertainty(f"{quantity}_u") for quantity in _ANGLES),
        *(uncertainty_mm(f"{quantity}_u") for quantity in _LENGTHS),
        "thrust_angle_tyre_u BETWEEN 0 AND 3.2",
    ),
    check("coverage_factor_positive", "coverage_factor > 0"),
)
