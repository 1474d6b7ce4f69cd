"""Yield, Pareto and moments: from the sums per hour and day, and from the results that they do not cover."""

from __future__ import annotations

import enum
import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import ColumnElement, Connection, Table, Text, and_, bindparam, cast, or_, select

from db.queries.filters import (
    EVERYTHING,
    Characteristic,
    Filter,
    Interval,
    about_cycles,
    at_stations,
    known_stations,
    within,
)
from db.queries.reader import ResultReader, question
from db.records import OF_STEERING_AXIS, OF_WHEEL, CycleOutcome, Quantity, Verdict, WheelOutcome
from db.schema import (
    counted_categories,
    cycles,
    result_counts,
    results_of,
    stations,
    summed_characteristics,
    sums_state,
    value_sums,
    wheel_results,
)
from db.sums import (
    CATEGORY,
    CHARACTERISTIC,
    SUMS,
    Selection,
    counted,
    epoch_hour,
    hourly,
    hours_of,
    merged_sums,
    raw_outcomes,
    raw_values,
)

_HOUR_S = 3600
_DAY = 24
_NEVER = 2**31 - 8  # a whole number of days


class GroupBy(enum.StrEnum):
    """What an answer may be split by; days and hours are UTC."""

    STATION = "station"
    VEHICLE_TYPE = "vehicle_type"
    PART = "part"
    DAY = "day"
    HOUR = "hour"


Group = Mapping[GroupBy, str | datetime | None]


@dataclass(frozen=True)
class YieldCounts:
    """Cycles by their outcome."""

    group: Group
    ok: int
    nok: int
    fault: int
    aborted: int

    @property
    def total(self) -> int:
        """All cycles."""
        return self.ok + self.nok + self.fault + self.aborted

    @property
    def yield_ratio(self) -> float | None:
        """Good vehicles of those that got a verdict; None when none got one."""
        judged = self.ok + self.nok
        return self.ok / judged if judged else None


@dataclass(frozen=True)
class WheelCounts:
    """Wheels by their verdict, or by why they have none."""

    group: Group
    ok: int
    nok: int
    unjudged: int
    refused: int
    fault: int


@dataclass(frozen=True)
class ReasonCount:
    """One bar of a Pareto.

    Attributes
    ----------
    kind
        ``out_of_limits`` (an angle of a part), ``refused`` and ``fault`` (a wheel), ``station_fault`` and
        ``aborted`` (a whole cycle).
    code
        ``toe_low``, ``camber_high``, … for angles out of limits; else the reason code that was stored.
    part
        Wheel or axle; ``vehicle`` for its own angles; empty for a whole cycle.
    """

    group: Group
    kind: str
    code: str
    part: str
    count: int


@dataclass(frozen=True)
class CharacteristicMoments:
    """Sums over the values of one characteristic, against one pair of limits.

    Attributes
    ----------
    n, mean, m2, minimum, maximum
        Number, mean, sum of squared deviations from the mean (rad²), extremes (rad).
    low, high
        The limits, rad; None where there is none.
    n_low, n_high
        How many missed the limit, guard band included.
    m2_within, dof_within
        Squared deviations from the mean of their own hour and station, and their degrees of freedom: the
        short-term spread.
    """

    characteristic: Characteristic
    low: float | None
    high: float | None
    group: Group
    n: int
    mean: float
    m2: float
    minimum: float
    maximum: float
    n_low: int
    n_high: int
    m2_within: float
    dof_within: int

    @property
    def std(self) -> float | None:
        """Overall standard deviation, rad; None for less than two values."""
        return math.sqrt(self.m2 / (self.n - 1)) if self.n > 1 else None

    @property
    def std_within(self) -> float | None:
        """Short-term standard deviation, rad; None without two values in one hour."""
        return math.sqrt(self.m2_within / self.dof_within) if self.dof_within else None


@question
def yield_counts(
    reader: ResultReader, where: Filter = EVERYTHING, by: Sequence[GroupBy] = ()
) -> tuple[YieldCounts, ...]:
    """Cycles by outcome; of the filter, the verdict is the cycle's outcome and wheels say nothing."""
    found: dict[tuple[Any, ...], dict[str, int]] = defaultdict(lambda: defaultdict(int))
    with reader.transaction() as connection:
        for key, row in _outcomes(connection, _state(connection), where, "cycle", by):
            found[key][row.outcome] += int(row.n)
    return tuple(
        YieldCounts(_group(by, key), *(counts[outcome] for outcome in CycleOutcome))
        for key, counts in sorted(found.items(), key=str)
    )


@question
def wheel_counts(
    reader: ResultReader, where: Filter = EVERYTHING, by: Sequence[GroupBy] = ()
) -> tuple[WheelCounts, ...]:
    """Wheels by verdict, or by why they have none."""
    found: dict[tuple[Any, ...], dict[str, int]] = defaultdict(lambda: defaultdict(int))
    with reader.transaction() as connection:
        for key, row in _outcomes(connection, _state(connection), where, "wheel", by):
            measured = row.outcome == WheelOutcome.MEASURED
            found[key][row.verdict if measured else row.outcome] += int(row.n)
    names = (Verdict.OK, Verdict.NOK, Verdict.NONE, WheelOutcome.REFUSED, WheelOutcome.FAULT)
    return tuple(
        WheelCounts(_group(by, key), *(counts[name] for name in names))
        for key, counts in sorted(found.items(), key=str)
    )


@question
def reasons(
    reader: ResultReader, where: Filter = EVERYTHING, by: Sequence[GroupBy] = ()
) -> tuple[ReasonCount, ...]:
    """The Pareto of what went wrong, most frequent first.

    A wheel out of two limits counts at both; a cycle that ended in a fault counts beside its refused wheels.
    """
    found: dict[tuple[Any, ...], int] = defaultdict(int)
    kinds = {CycleOutcome.FAULT: "station_fault", CycleOutcome.ABORTED: "aborted"}
    with reader.transaction() as connection:
        state = _state(connection)
        if not where.wheels:
            for key, row in _outcomes(connection, state, where, "cycle", by):
                if row.outcome in kinds:
                    found[key, kinds[CycleOutcome(row.outcome)], row.reason_code, ""] += int(row.n)
        for key, row in _outcomes(connection, state, where, "wheel", by):
            if row.outcome != WheelOutcome.MEASURED:
                found[key, row.outcome, row.reason_code, row.part] += int(row.n)
        for (characteristic, _, _, key), sums in _sums(connection, state, where, (), by).items():
            for side in ("low", "high"):
                count = int(sum(getattr(row, f"n_{side}") for row in sums))
                if count:
                    code = f"{characteristic.quantity}_{side}"
                    found[key, "out_of_limits", code, characteristic.part] += count
    return tuple(
        ReasonCount(_group(by, key), kind, code, part, count)
        for (key, kind, code, part), count in sorted(found.items(), key=lambda item: (-item[1], str(item[0])))
    )


@question
def characteristic_moments(
    reader: ResultReader,
    where: Filter = EVERYTHING,
    characteristics: Sequence[Characteristic] = (),
    by: Sequence[GroupBy] = (),
) -> tuple[CharacteristicMoments, ...]:
    """Moments of each characteristic, pair of limits and group; of all characteristics when none is named."""
    with reader.transaction() as connection:
        found = _sums(connection, _state(connection), where, characteristics, by)
    return tuple(
        CharacteristicMoments(characteristic, low, high, _group(by, key), *_merge(rows))
        for (characteristic, low, high, key), rows in sorted(found.items(), key=lambda item: str(item[0]))
    )


@dataclass(frozen=True)
class _State:
    """How far the sums are, the same for all parts of a question.

    Attributes
    ----------
    last_cycle_id, whole_days_until
        As in `sums_state`.
    fresh_hours
        Hours that have results which are not in the sums yet.
    stations
        All names.
    """

    last_cycle_id: int
    whole_days_until: int
    fresh_hours: tuple[int, ...]
    stations: tuple[str, ...]


def _state(connection: Connection) -> _State:
    last, whole_days_until = connection.execute(_SUMMED).one()
    fresh = connection.execute(_FRESH_HOURS, {"last": last}).scalars()
    return _State(last, whole_days_until, tuple(sorted(fresh)), tuple(known_stations(connection)))


_SUMMED = select(sums_state.c.last_cycle_id, sums_state.c.whole_days_until)
_FRESH_HOURS = select(epoch_hour(cycles.c.received_utc)).where(cycles.c.id > bindparam("last")).distinct()


@dataclass(frozen=True)
class _Plan:
    """Which part of a question the sums answer, and which the results themselves.

    Attributes
    ----------
    spans
        Condition on a table of sums; None when they answer nothing.
    fresh
        Results that belong to these hours and are not in the sums yet.
    fresh_hours
        Those of these hours that have such results.
    others
        Results of which the sums say nothing: of a part of an hour, or of what they do not tell apart.
    """

    spans: ColumnElement[bool] | None
    fresh: Selection | None
    fresh_hours: tuple[int, ...]
    others: Selection | None


def _plan(state: _State, where: Filter, table: Table, by: Sequence[GroupBy]) -> _Plan:
    if where.needs_raw_results:
        return _Plan(None, None, (), Selection(tuple(about_cycles(where))))
    days_until = 0 if GroupBy.HOUR in by else state.whole_days_until
    if state.fresh_hours:
        days_until = min(days_until, state.fresh_hours[0] // _DAY * _DAY)
    fresh_hours: set[int] = set()
    spans: list[ColumnElement[bool]] = []
    whole: list[Interval] = []
    edges: list[Interval] = []
    for start, end in where.intervals():
        first = 0 if start is None else math.ceil(start.timestamp() / _HOUR_S)
        last = _NEVER if end is None else math.floor(end.timestamp() / _HOUR_S)
        if first >= last:
            edges.append((start, end))
            continue
        whole.append((start and _time(first), end and _time(last)))
        fresh_hours |= {hour for hour in state.fresh_hours if first <= hour < last}
        if start is not None and start.timestamp() < first * _HOUR_S:
            edges.append((start, _time(first)))
        if end is not None and end.timestamp() > last * _HOUR_S:
            edges.append((_time(last), end))
        day = -(-first // _DAY) * _DAY
        last_day = min(last // _DAY * _DAY, days_until)
        if day >= last_day:
            spans.append(_span(table, 1, first, last))
            continue
        spans.append(_span(table, _DAY, day, last_day))
        spans += [_span(table, 1, *ends) for ends in ((first, day), (last_day, last)) if ends[0] < ends[1]]
    about = about_cycles(replace(where, from_utc=None, until_utc=None, shift=None))
    # The stations by name, so that their index on the time is used.
    named = () if where.stations or where.plants else (cycles.c.station.in_(state.stations),)
    return _Plan(
        or_(*spans) if spans else None,
        Selection((*about, within(whole)), after_id=state.last_cycle_id) if fresh_hours else None,
        tuple(sorted(fresh_hours)),
        Selection((*about, within(edges), *named)) if edges else None,
    )


def _span(table: Table, hours: int, first: int, last: int) -> ColumnElement[bool]:
    return and_(table.c.hours == hours, table.c.start >= first, table.c.start < last)


def _time(hour: int) -> datetime:
    return datetime.fromtimestamp(hour * _HOUR_S, UTC)


_KEPT_SUMS = (
    select(
        *(summed_characteristics.c[name] for name in CHARACTERISTIC),
        stations.c.name.label("station"),
        value_sums.c.start,
        *(value_sums.c[name] for name in SUMS),
    )
    .join(summed_characteristics, value_sums.c.characteristic_id == summed_characteristics.c.id)
    .join(stations, value_sums.c.station_id == stations.c.id)
)
_KEPT_COUNTS = (
    select(
        *(counted_categories.c[name] for name in CATEGORY),
        stations.c.name.label("station"),
        result_counts.c.start,
        result_counts.c.n,
    )
    .join(counted_categories, result_counts.c.category_id == counted_categories.c.id)
    .join(stations, result_counts.c.station_id == stations.c.id)
)
_Sums = dict[tuple[Characteristic, float | None, float | None, tuple[Any, ...]], list[Any]]


def _sums(
    connection: Connection,
    state: _State,
    where: Filter,
    characteristics: Sequence[Characteristic],
    by: Sequence[GroupBy],
) -> _Sums:
    """Sums by characteristic, limits and group, one or several of each."""
    plan = _plan(state, where, value_sums, by)
    quantities = sorted({c.quantity for c in characteristics}) or (
        (*OF_WHEEL, *OF_STEERING_AXIS) if where.wheels else tuple(Quantity)
    )
    parts = sorted({c.part for c in characteristics} or set(where.wheels))
    keys = ("part", "quantity", "low", "high")
    rows: list[Any] = []

    def collect(sums: Any) -> None:
        labelled = _labelled(sums, by, (*keys, *SUMS))
        rows.extend(connection.execute(merged_sums(labelled, (*_labels(by), *keys))))

    if plan.spans is not None:
        conditions = [summed_characteristics.c.quantity.in_(quantities)]
        if parts:
            conditions.append(summed_characteristics.c.part.in_(parts))
        if where.vehicle_types:
            conditions.append(summed_characteristics.c.vehicle_type.in_(where.vehicle_types))
        # By number, so that each leads into the primary key.
        ids = connection.execute(select(summed_characteristics.c.id).where(*conditions)).scalars().all()
        of_ids = value_sums.c.characteristic_id.in_(ids)
        kept = _KEPT_SUMS.where(plan.spans, of_ids, *at_stations(where, stations.c.name))
        in_fresh_hours = (value_sums.c.hours == 1) & value_sums.c.start.in_(plan.fresh_hours)
        collect(kept.where(~in_fresh_hours) if plan.fresh else kept)
        if plan.fresh is not None:
            # An hour is one group of the short-term spread, however much of it is in the sums.
            values = raw_values(plan.fresh, quantities, parts)
            collect(hours_of([kept.where(in_fresh_hours), *values]))
    if plan.others is not None:
        for quantity in quantities:
            chosen = plan.others
            if where.verdict is not None:
                chosen = chosen.also(results_of(quantity).c.verdict == where.verdict)
            collect(hourly(raw_values(chosen, (quantity,), parts)))
    found: _Sums = defaultdict(list)
    wanted = set(characteristics)
    for row in rows:
        characteristic = Characteristic(row.part, Quantity(row.quantity))
        if not wanted or characteristic in wanted:
            found[characteristic, row.low, row.high, tuple(row[: len(by)])].append(row)
    return found


def _merge(rows: Sequence[Any]) -> tuple[Any, ...]:
    n = sum(row.n for row in rows)
    mean = math.fsum(row.n * row.mean for row in rows) / float(n)
    return (
        int(n),
        mean,
        math.fsum(row.m2 + row.n * (row.mean - mean) ** 2 for row in rows),
        min(row.minimum for row in rows),
        max(row.maximum for row in rows),
        int(sum(row.n_low for row in rows)),
        int(sum(row.n_high for row in rows)),
        math.fsum(row.m2_within for row in rows),
        int(sum(row.dof_within for row in rows)),
    )


def _outcomes(
    connection: Connection, state: _State, where: Filter, level: str, by: Sequence[GroupBy]
) -> list[tuple[tuple[Any, ...], Any]]:
    """Groups with rows of ``part``, ``outcome``, ``verdict``, ``reason_code``, ``n``, one or more of each."""
    plan = _plan(state, where, result_counts, by)
    keys = ("part", "outcome", "verdict", "reason_code")
    of_wheels = where.wheels if level == "wheel" else ()
    rows: list[Any] = []
    if plan.spans is not None:
        conditions = [counted_categories.c.level == level]
        if where.vehicle_types:
            conditions.append(counted_categories.c.vehicle_type.in_(where.vehicle_types))
        if of_wheels:
            conditions.append(counted_categories.c.part.in_(of_wheels))
        ids = connection.execute(select(counted_categories.c.id).where(*conditions)).scalars().all()
        of_ids = result_counts.c.category_id.in_(ids)
        kept = _KEPT_COUNTS.where(plan.spans, of_ids, *at_stations(where, stations.c.name))
        rows += connection.execute(counted(_labelled(kept, by, (*keys, "n")), (*_labels(by), *keys)))
    for selection in (plan.fresh, plan.others):
        if selection is None:
            continue
        chosen = selection.also(wheel_results.c.wheel.in_(of_wheels)) if of_wheels else selection
        if where.verdict is not None:
            column = cycles.c.outcome if level == "cycle" else wheel_results.c.verdict
            chosen = chosen.also(cast(column, Text) == where.verdict.value)
        outcomes = raw_outcomes(chosen, (level,))
        rows += connection.execute(counted(_labelled(outcomes, by, (*keys, "n")), (*_labels(by), *keys)))
    return [(tuple(row[: len(by)]), row) for row in rows]


def _labels(by: Sequence[GroupBy]) -> list[str]:
    return [f"by_{kind}" for kind in by]


def _labelled(rows: Any, by: Sequence[GroupBy], others: Sequence[str]) -> Any:
    """The rows with what they are grouped by beside the others."""
    rows = rows.subquery("rows")
    of = {
        GroupBy.STATION: rows.c.station,
        GroupBy.VEHICLE_TYPE: rows.c.vehicle_type,
        GroupBy.PART: rows.c.part,
        GroupBy.DAY: rows.c.start // _DAY,
        GroupBy.HOUR: rows.c.start,
    }
    labelled = [of[kind].label(f"by_{kind}") for kind in by]
    return select(*labelled, *(rows.c[name] for name in others)).subquery("labelled")


def _group(by: Sequence[GroupBy], key: Sequence[Any]) -> Group:
    hours = {GroupBy.DAY: _DAY, GroupBy.HOUR: 1}
    return {
        kind: _time(hours[kind] * value) if kind in hours else value
        for kind, value in zip(by, key, strict=True)
    }
