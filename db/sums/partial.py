"""Statements that turn results into sums, and sums into sums over more.

The same few columns everywhere (`SUMS`): a single value is a sum with n = 1. Sums merge as Chan, Golub and
LeVeque describe (1979): squared deviations are kept about each part's own mean, so nothing cancels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

from sqlalchemy import (
    BigInteger,
    ColumnElement,
    Double,
    Integer,
    Select,
    Text,
    and_,
    case,
    cast,
    func,
    literal,
    null,
    select,
    union_all,
)
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.sql.compiler import SQLCompiler
from sqlalchemy.sql.functions import FunctionElement
from sqlalchemy.sql.selectable import CompoundSelect

from db.records import VEHICLE, Quantity
from db.schema import (
    axle_results,
    cycles,
    part_column,
    results_of,
    vehicle_results,
    vehicles,
    wheel_results,
)

SUMS = ("n", "mean", "m2", "minimum", "maximum", "n_low", "n_high", "m2_within", "dof_within")
CHARACTERISTIC = ("part", "quantity", "vehicle_type", "low", "high")
CATEGORY = ("level", "part", "vehicle_type", "outcome", "verdict", "reason_code")


@dataclass(frozen=True)
class Selection:
    """Which cycles: conditions on `cycles` and `vehicles`, and a range of ids, the first excluded."""

    conditions: tuple[ColumnElement[bool], ...] = ()
    after_id: int | None = None
    last_id: int | None = None

    def of(self, column: Any) -> list[ColumnElement[bool]]:
        """The range of ids, on a column that holds them; said of every table, so each reads only its part."""
        bounds = []
        if self.after_id is not None:
            bounds.append(column > self.after_id)
        if self.last_id is not None:
            bounds.append(column <= self.last_id)
        return bounds

    def also(self, condition: ColumnElement[bool]) -> Selection:
        """The same with one condition more, on any table that is asked."""
        return replace(self, conditions=(*self.conditions, condition))

    @property
    def of_cycles(self) -> list[ColumnElement[bool]]:
        """Everything that is said of cycles."""
        return [*self.conditions, *self.of(cycles.c.id)]


class epoch_hour(FunctionElement[int]):  # noqa: N801  (named as SQL functions are)
    """Whole hours since 1970 (UTC) of a time."""

    type = Integer()
    inherit_cache = True


@compiles(epoch_hour, "sqlite")
def _sqlite_hour(element: Any, compiler: SQLCompiler, **options: Any) -> str:
    return f"(CAST(strftime('%s', {compiler.process(element.clauses, **options)}) AS INTEGER) / 3600)"


@compiles(epoch_hour)
def _postgresql_hour(element: Any, compiler: SQLCompiler, **options: Any) -> str:
    time = compiler.process(element.clauses, **options)
    return f"CAST(floor(extract(epoch FROM {time}) / 3600) AS INTEGER)"


@cache
def _all_values(quantity: str) -> Select[Any]:
    """Every stored value of a quantity; kept, for making it takes longer than many an answer."""
    table = results_of(quantity)
    part = part_column(table)
    value, nothing = table.c[quantity], cast(null(), Double)
    low, high = (table.c.get(f"{quantity}_{end}", nothing) for end in ("low", "high"))
    margin: Any = literal(0.0)
    if low is not nothing or high is not nothing:
        margin = case((table.c.guard_band, table.c.coverage_factor * table.c[f"{quantity}_u"]), else_=0.0)
    return (
        select(
            (literal(VEHICLE, Text) if part is None else part).label("part"),
            literal(quantity, Text).label("quantity"),
            vehicles.c.vehicle_type.label("vehicle_type"),
            low.label("low"),
            high.label("high"),
            cycles.c.station.label("station"),
            epoch_hour(cycles.c.received_utc).label("start"),
            literal(1, Integer).label("n"),
            value.label("mean"),
            literal(0.0, Double).label("m2"),
            value.label("minimum"),
            value.label("maximum"),
            case((value < low + margin, 1), else_=0).label("n_low"),
            case((value > high - margin, 1), else_=0).label("n_high"),
            literal(0.0, Double).label("m2_within"),
            literal(0, Integer).label("dof_within"),
        )
        .select_from(cycles)
        .join(table, table.c.cycle_id == cycles.c.id)
        .outerjoin(vehicles, cycles.c.vehicle_id == vehicles.c.id)
        .where(value.is_not(None))
    )


def _values_of(quantity: str, selection: Selection, parts: Sequence[str]) -> Select[Any]:
    table = results_of(quantity)
    part = part_column(table)
    query = _all_values(quantity).where(*selection.of_cycles, *selection.of(table.c.cycle_id))
    return query.where(part.in_(parts)) if part is not None and parts else query


def raw_values(
    selection: Selection,
    quantities: Sequence[str] = tuple(Quantity),
    parts: Sequence[str] = (),
) -> list[Select[Any]]:
    """Every stored value as a sum of one: `CHARACTERISTIC`, ``station``, ``start`` (its hour), `SUMS`.

    A statement for each quantity, to be taken together by `hourly`.

    Parameters
    ----------
    parts
        Wheels and axles wanted; all without.
    """
    return [_values_of(quantity, selection, parts) for quantity in quantities]


@cache
def _all_outcomes(level: str) -> Select[Any]:
    """Every stored outcome of a level; kept as `_all_values`."""
    nothing = cast(null(), Text)
    measured = literal("measured", Text)
    shapes: dict[str, tuple[Any, ...]] = {
        "cycle": (literal("", Text), cast(cycles.c.outcome, Text), nothing, cycles.c.reason_code),
        "wheel": (
            wheel_results.c.wheel,
            cast(wheel_results.c.outcome, Text),
            cast(wheel_results.c.verdict, Text),
            wheel_results.c.reason_code,
        ),
        "axle": (axle_results.c.axle, measured, cast(axle_results.c.verdict, Text), nothing),
        "vehicle": (
            literal(VEHICLE, Text),
            measured,
            cast(vehicle_results.c.verdict, Text),
            nothing,
        ),
    }
    part, outcome, verdict, reason_code = shapes[level]
    table = _RESULTS_OF.get(level)
    source = cycles if table is None else cycles.join(table, table.c.cycle_id == cycles.c.id)
    return select(
        literal(level, Text).label("level"),
        part.label("part"),
        vehicles.c.vehicle_type.label("vehicle_type"),
        outcome.label("outcome"),
        verdict.label("verdict"),
        reason_code.label("reason_code"),
        cycles.c.station.label("station"),
        epoch_hour(cycles.c.received_utc).label("start"),
        literal(1, Integer).label("n"),
    ).select_from(source.outerjoin(vehicles, cycles.c.vehicle_id == vehicles.c.id))


_RESULTS_OF = {"wheel": wheel_results, "axle": axle_results, "vehicle": vehicle_results}


def raw_outcomes(
    selection: Selection, levels: Sequence[str] = ("cycle", "wheel", "axle", "vehicle")
) -> CompoundSelect[Any]:
    """Every outcome: `CATEGORY`, ``station``, ``start``, ``n`` = 1."""
    selects = []
    for level in levels:
        of_level = selection.of(_RESULTS_OF[level].c.cycle_id) if level in _RESULTS_OF else []
        selects.append(_all_outcomes(level).where(*selection.of_cycles, *of_level))
    return union_all(*selects)


def merged_sums(rows: Any, keys: Sequence[str]) -> Select[Any]:
    """Sums over all rows of the same keys.

    Parameters
    ----------
    rows
        A subquery with the keys and `SUMS`.
    """
    by = [rows.c[key] for key in keys]
    total = func.sum(rows.c.n).over(partition_by=by)
    centre = (func.sum(rows.c.n * rows.c.mean).over(partition_by=by) / total).label("centre")
    centred = select(*by, *(rows.c[name] for name in SUMS), centre).subquery("centred")
    c = centred.c
    return select(
        *(c[key] for key in keys),
        _whole_sum(c.n).label("n"),
        func.min(c.centre).label("mean"),
        func.sum(c.m2 + c.n * (c.mean - c.centre) * (c.mean - c.centre)).label("m2"),
        func.min(c.minimum).label("minimum"),
        func.max(c.maximum).label("maximum"),
        _whole_sum(c.n_low).label("n_low"),
        _whole_sum(c.n_high).label("n_high"),
        func.sum(c.m2_within).label("m2_within"),
        _whole_sum(c.dof_within).label("dof_within"),
    ).group_by(*(c[key] for key in keys))


def _whole_sum(column: Any) -> ColumnElement[int]:
    # PostgreSQL adds up big integers to a decimal number.
    return cast(func.sum(column), BigInteger)


class squared_deviations(FunctionElement[float]):  # noqa: N801  (named as SQL functions are)
    """Sum of the squared deviations of single values from their mean."""

    type = Double()
    inherit_cache = True


@compiles(squared_deviations, "sqlite")
def _sqlite_deviations(element: Any, compiler: SQLCompiler, **options: Any) -> str:
    return f"squared_deviations({compiler.process(element.clauses, **options)})"


@compiles(squared_deviations)
def _postgresql_deviations(element: Any, compiler: SQLCompiler, **options: Any) -> str:
    # By the algorithm of Youngs and Cramer: nothing cancels.
    value = compiler.process(element.clauses, **options)
    return f"(var_pop({value}) * count({value}))"


def hourly(values: Sequence[Select[Any]]) -> Select[Any]:
    """Sums of `raw_values` per characteristic, station and hour, the group of the short-term spread."""
    raw = union_all(*values).subquery("raw")
    by = [raw.c[name] for name in (*CHARACTERISTIC, "station", "start")]
    m2 = squared_deviations(raw.c.mean)
    return select(
        *by,
        func.count().label("n"),
        func.avg(raw.c.mean, type_=Double()).label("mean"),
        m2.label("m2"),
        func.min(raw.c.minimum).label("minimum"),
        func.max(raw.c.maximum).label("maximum"),
        _whole_sum(raw.c.n_low).label("n_low"),
        _whole_sum(raw.c.n_high).label("n_high"),
        m2.label("m2_within"),
        (func.count() - 1).label("dof_within"),
    ).group_by(*by)


def hours_of(rows: Sequence[Select[Any]]) -> Select[Any]:
    """As `hourly`, of single values and of sums of parts of hours together."""
    sums = merged_sums(union_all(*rows).subquery("raw"), (*CHARACTERISTIC, "station", "start")).subquery(
        "hours"
    )
    columns = {name: sums.c[name] for name in (*CHARACTERISTIC, "station", "start", *SUMS)}
    columns["m2_within"] = sums.c.m2.label("m2_within")
    columns["dof_within"] = (sums.c.n - 1).label("dof_within")
    return select(*columns.values())


def counted(rows: Any, keys: Sequence[str]) -> Select[Any]:
    """Numbers of rows of the same keys; `rows` is a subquery with the keys and ``n``."""
    by = [rows.c[key] for key in keys]
    return select(*by, _whole_sum(rows.c.n).label("n")).group_by(*by)


def same(left: Any, right: Any, keys: Sequence[str]) -> ColumnElement[bool]:
    """Condition: equal keys, two missing ones being equal too."""
    return and_(*(left.c[key].is_not_distinct_from(right.c[key]) for key in keys))
