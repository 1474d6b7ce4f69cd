"""How vehicles were adjusted: how long it took, how often one correction was enough, what locking added."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence

import numpy as np

from db.queries import Adjusted, Filter, ResultReader, adjusted
from db.records import CycleOutcome
from station.quality.reports.report import Section, TableRow
from station.quality.reports.values import NEWEST


def adjusting_sections(reader: ResultReader, where: Filter) -> list[Section]:
    """Vehicles that were adjusted, all and by type; and by type, axle and adjuster what locking added."""
    found = adjusted(reader, where, NEWEST)
    return [_vehicles(found), _locking(found)]


def _vehicles(found: Sequence[Adjusted]) -> Section:
    rows: list[TableRow] = []
    if found:
        rows.append(_row("all", "", found))
    groups: tuple[tuple[str, Callable[[Adjusted], str]], ...] = (
        ("station", lambda each: each.station),
        ("type", lambda each: each.vehicle_type or "unknown"),
    )
    for by, name_of in groups:
        of_name: dict[str, list[Adjusted]] = defaultdict(list)
        for each in found:
            of_name[name_of(each)].append(each)
        rows += [_row(by, name, of_name[name]) for name in sorted(of_name)]
    whole = rows[0] if rows else {}
    figures = ("first_pass_percent", "time_median_s", "time_p95_s")
    return Section(
        "adjusting",
        "Vehicles that were adjusted",
        rows,
        {
            "vehicles_adjusted": len({each.cycle for each in found}),
            **{f"adjusting_{name}": _number(whole.get(name)) for name in figures},
        },
        f"Newest {NEWEST} adjusters that were turned; vehicles that needed no turn are not counted. First "
        "pass: good with one correction of each adjuster that was turned, of vehicles with a verdict. "
        "Time: from the first turn that was asked for until the last wheel was done with, of all vehicles.",
        brief=("by", "name", "vehicles", "ok", "nok", "first_pass_percent", "time_median_s", "time_p95_s"),
        empty="No vehicle was adjusted with guidance.",
    )


def _row(by: str, name: str, found: Sequence[Adjusted]) -> TableRow:
    of_cycle: dict[object, list[Adjusted]] = defaultdict(list)
    for each in found:
        of_cycle[each.cycle].append(each)
    outcomes = [turned[0].outcome for turned in of_cycle.values()]
    ok, nok = outcomes.count(CycleOutcome.OK), outcomes.count(CycleOutcome.NOK)
    first = sum(
        turned[0].outcome is CycleOutcome.OK and all(each.record.corrections == 1 for each in turned)
        for turned in of_cycle.values()
    )
    times = [
        max(each.record.ended_s for each in turned) - min(each.record.begun_s for each in turned)
        for turned in of_cycle.values()
    ]
    unreachable = sum(
        any(each.record.outcome == "unreachable" for each in turned) for turned in of_cycle.values()
    )
    return {
        "by": by,
        "name": name,
        "vehicles": len(of_cycle),
        "ok": ok,
        "nok": nok,
        "no_verdict": len(of_cycle) - ok - nok,
        "unreachable": unreachable,
        "first_pass_percent": 100.0 * first / (ok + nok) if ok + nok else None,
        "time_median_s": float(np.median(times)),
        "time_p95_s": float(np.quantile(times, 0.95)),
        "corrections_per_adjuster": float(np.mean([each.record.corrections for each in found])),
    }


def _locking(found: Sequence[Adjusted]) -> Section:
    groups: dict[tuple[str, str, str, str], list[Adjusted]] = defaultdict(list)
    for each in found:
        if each.record.drift is not None:
            axle = each.record.wheel.rpartition("_")[0]
            groups[each.vehicle_type or "unknown", each.station, axle, each.record.adjuster].append(each)
    rows: list[TableRow] = []
    for (vehicle_type, station, axle, adjuster), turned in sorted(groups.items()):
        drifts = np.degrees([each.record.drift for each in turned if each.record.drift is not None])
        nuts = np.array([each.record.nuts_locked for each in turned])
        rows.append(
            {
                "type": vehicle_type,
                "station": station,
                "axle": axle,
                "adjuster": adjuster,
                "nuts": int(nuts.sum()),
                "mean_deg": float(np.average(drifts, weights=nuts)),
                "deviation_deg": float(np.std(drifts, ddof=1)) if len(drifts) > 1 else None,
                "least_deg": float(drifts.min()),
                "most_deg": float(drifts.max()),
            }
        )
    return Section(
        "locking_drift",
        "What locking the nut adds",
        rows,
        {"nuts_locked": sum(each.record.nuts_locked for each in found)},
        "Angle after the nut was locked less the angle before, of toe at a tie rod and of camber at a camber "
        "bolt. Deviation, least and most are of adjusters; one that was locked several times on a vehicle "
        "counts in them with its mean.",
        empty="No nut was seen before and after it was locked.",
    )


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) else None
