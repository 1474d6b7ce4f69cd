"""The steering of vehicles: one row for a vehicle, and one for each steering axis of a sweep."""

from __future__ import annotations

from sqlalchemy import Boolean, Column, Double, ForeignKey, Integer, Table, Text

from db.records import OF_STEERING, OF_STEERING_AXIS, QUANTITIES, Quantity, Unit, Verdict
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

_WHEEL = Quantity.STEERING_WHEEL
_LIMITED = [quantity for quantity in OF_STEERING if QUANTITIES[quantity].limited]
_AXIS_LIMITED = [quantity for quantity in OF_STEERING_AXIS if QUANTITIES[quantity].limited]
_AXIS_ANGLES = [quantity for quantity in OF_STEERING_AXIS if QUANTITIES[quantity].unit is Unit.DEGREES]
_AXIS_LENGTHS = [quantity for quantity in OF_STEERING_AXIS if QUANTITIES[quantity].unit is Unit.MILLIMETRES]


def _columns(quantity: Quantity, *ends: str) -> list[str]:
    limits = ("_low", "_high") if QUANTITIES[quantity].limited else ()
    return [f"{quantity}{end}" for end in ("", *ends, *limits)]


def _with_uncertainty(*names: str) -> list[str]:
    return [f"({name} IS NULL) = ({name}_u IS NULL)" for name in names]


steering_results = Table(
    "steering_results",
    metadata,
    Column("cycle_id", ForeignKey(cycles.c.id), primary_key=True),
    # Whether front toe of the cycle is that of straight ahead, and why it is not.
    Column("straight_ahead", Text, nullable=False),
    Column("reason_text", Text),
    choice("verdict", Verdict),
    Column("guard_band", Boolean),
    Column("coverage_factor", Double),
    Column("steering_wheel_age_s", Double),
    # Turn of the front wheels that was taken off their toe.
    Column("steer", Double),
    Column("steer_u", Double),
    *(Column(name, Double) for quantity in OF_STEERING for name in _columns(quantity, "_u")),
    check("straight_ahead", "straight_ahead IN ('checked', 'not_checked', 'refused', 'not_asked')"),
    check("reason_in_words", "(straight_ahead IN ('not_checked', 'refused')) = (reason_text IS NOT NULL)"),
    check("checked_has_angles", "(straight_ahead = 'checked') = (steer IS NOT NULL)"),
    check("checked_has_wheel", f"steer IS NULL OR {_WHEEL} IS NOT NULL"),
    check("values_have_uncertainties", *_with_uncertainty("steer", *OF_STEERING)),
    check("refused_has_no_verdict", "straight_ahead <> 'refused' OR verdict <> 'ok'"),
    check("verdict_is_explained", explained(*_LIMITED)),
    check("ok_is_within_limits", within_limits(*_LIMITED)),
    check("limits_in_order", *ordered(*_LIMITED)),
    # A steering wheel turns three times to each side.
    check("possible_wheel", f"{_WHEEL} BETWEEN -20 AND 20", "steering_wheel_age_s BETWEEN 0 AND 100000"),
    check(
        "possible_angles",
        angle("steer"),
        *(angle(name) for quantity in _LIMITED for name in _columns(quantity)),
    ),
    check(
        "possible_uncertainties",
        uncertainty("steer_u"),
        *(uncertainty(f"{quantity}_u") for quantity in OF_STEERING),
    ),
    check("coverage_factor_positive", "coverage_factor > 0"),
)

steering_axis_results = Table(
    "steering_axis_results",
    metadata,
    Column("cycle_id", ForeignKey(cycles.c.id), primary_key=True),
    Column("wheel", Text, primary_key=True),
    choice("verdict", Verdict),
    Column("guard_band", Boolean),
    Column("coverage_factor", Double),
    Column("method", Text),
    Column("positions", Integer),
    # Scatter about one axis that stands still, over what uncertainties say.
    Column("residual", Double),
    Column("warning", Text),
    Column("reason_code", Text),
    Column("reason_text", Text),
    *(Column(name, Double) for quantity in OF_STEERING_AXIS for name in _columns(quantity, "_u")),
    check("wheel_not_empty", "wheel <> ''"),
    check("reason_in_words", "(reason_code IS NULL) = (reason_text IS NULL)"),
    check("unmeasured_has_reason", "caster IS NOT NULL OR reason_code IS NOT NULL"),
    check("unmeasured_has_no_verdict", "caster IS NOT NULL OR verdict = 'none'"),
    check("measured_is_explained", "caster IS NULL OR (method IS NOT NULL AND positions IS NOT NULL)"),
    check("values_have_uncertainties", *_with_uncertainty(*OF_STEERING_AXIS)),
    check("verdict_is_explained", explained(*_AXIS_LIMITED)),
    check("ok_is_within_limits", within_limits(*_AXIS_LIMITED)),
    check("limits_in_order", *ordered(*_AXIS_LIMITED)),
    check("possible_angles", *(angle(name) for quantity in _AXIS_ANGLES for name in _columns(quantity))),
    check("possible_lengths", *(length(name) for quantity in _AXIS_LENGTHS for name in _columns(quantity))),
    check(
        "possible_uncertainties",
        *(uncertainty(f"{quantity}_u") for quantity in _AXIS_ANGLES),
        *(uncertainty_mm(f"{quantity}_u") for quantity in _AXIS_LENGTHS),
    ),
    check("possible_quality", "positions >= 0", "residual >= 0"),
    check("coverage_factor_positive", "coverage_factor > 0"),
)
