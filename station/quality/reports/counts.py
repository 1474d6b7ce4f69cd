"""How many were good, and what the others failed on."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime

from db.queries import Filter, GroupBy, ResultReader, YieldCounts, reasons, wheel_counts, yield_counts
from station.quality.pictures import Picture, Trace
from station.quality.reports.report import Section, TableRow

_LONGEST_PARETO = 20


def yield_section(reader: ResultReader, where: Filter) -> Section:
    """Vehicles by outcome: all, by station, by type, by day."""
    whole = yield_counts(reader, where)
    total = whole[0] if whole else YieldCounts({}, 0, 0, 0, 0)
    rows: list[TableRow] = [_row("all", "", total)]
    by_day: Sequence[YieldCounts] = ()
    for name, by in (("station", GroupBy.STATION), ("type", GroupBy.VEHICLE_TYPE), ("day", GroupBy.DAY)):
        found = yield_counts(reader, where, (by,))
        rows += [_row(name, _shown(counts.group[by]), counts) for counts in found]
        by_day = found
    wheels = wheel_counts(reader, where)
    counted = sum(w.ok + w.nok + w.unjudged + w.refused + w.fault for w in wheels)
    refused = sum(w.refused for w in wheels)
    days = [_shown(counts.group[GroupBy.DAY]) for counts in by_day]
    outcomes = ("ok", "nok", "fault", "aborted")
    picture = Picture(
        "Vehicles by day", "day (UTC)", "vehicles",
        tuple(
            Trace(name, "bar", days, [getattr(counts, name) for counts in by_day], colour=name)
            for name in outcomes
        ),
        stacked=True, counted=True,
    )  # fmt: skip
    return Section(
        "yield", "Yield", rows,
        {
            "cycles": total.total,
            **{name: getattr(total, name) for name in outcomes},
            "yield_percent": _percent(total),
            "wheels": counted,
            "wheels_refused_percent": 100.0 * refused / counted if counted else None,
        },
        "Yield is good vehicles of those that got a verdict; faults and aborts are counted apart.",
        # One bar says nothing that the table does not.
        (picture,) if len(days) > 1 else (),
    )  # fmt: skip


def pareto_section(reader: ResultReader, where: Filter) -> Section:
    """What went wrong, most frequent first."""
    found = reasons(reader, where)
    total = sum(reason.count for reason in found)
    rows: list[TableRow] = []
    cumulative = 0
    for reason in found:
        cumulative += reason.count
        rows.append(
            {
                "kind": reason.kind, "reason": reason.code, "part": reason.part, "count": reason.count,
                "percent": 100.0 * reason.count / total, "cumulative_percent": 100.0 * cumulative / total,
            }
        )  # fmt: skip
    shown = rows[:_LONGEST_PARETO]
    names = [f"{row['reason']} {row['part']}".strip() for row in shown]
    counts = [float(str(row["count"])) for row in shown]
    shares = [float(str(row["cumulative_percent"])) for row in shown]
    picture = Picture(
        "Pareto of reasons",
        "reason",
        "count",
        (
            Trace("count", "bar", names, counts),
            Trace("cumulative", "line", names, shares, colour="second", right=True),
        ),
        counted=True,
        right_label="cumulative",
    )
    return Section(
        "pareto",
        "Pareto of reasons",
        rows,
        {"reasons": len(rows), "occurrences": total},
        "An angle out of limits counts once for every limit it missed, guard band included.",
        (picture,) if rows else (),
        empty="No angle out of limits, no refusal, no fault, no abort.",
    )


def _row(group: str, name: str, counts: YieldCounts) -> TableRow:
    return {
        "by": group, "name": name, "vehicles": counts.total, "ok": counts.ok, "nok": counts.nok,
        "fault": counts.fault, "aborted": counts.aborted, "yield_percent": _percent(counts),
    }  # fmt: skip


def _percent(counts: YieldCounts) -> float | None:
    ratio = counts.yield_ratio
    return None if ratio is None else 100.0 * ratio


def _shown(value: str | datetime | None) -> str:
    return f"{value:%Y-%m-%d}" if isinstance(value, datetime) else str(value or "unknown")
