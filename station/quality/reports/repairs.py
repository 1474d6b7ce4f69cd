"""The repair loop: first pass, vehicles that came back, as found and as left, and how long that took."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from db.queries import Filter, FirstPass, Repaired, RepairLoop, ResultReader, repair_loop
from db.records import CycleOutcome
from station.quality.reports.report import Section, TableRow, shown_time
from station.quality.reports.values import NEWEST


def repair_sections(reader: ResultReader, where: Filter) -> list[Section]:
    """First pass by station and type; and the vehicles that were repaired, or have to be."""
    found = repair_loop(reader, where, NEWEST)
    return [_first_pass(found), _vehicles(found.repaired)]


def came_back(sections: Sequence[Section]) -> bool:
    """Whether the loop has anything to tell that the yield does not: a second look, or a concession."""
    return any(row["attempts"] != 1 or row["released_by"] for row in sections[-1].rows)


def _first_pass(found: RepairLoop) -> Section:
    rows = [_pass_row("all", "all", found.first)] if found.first else []
    rows += [_pass_row(each.station, each.vehicle_type, [each]) for each in found.first]
    share = rows[0]["first_pass_percent"] if rows else None
    return Section(
        "first_pass",
        "First pass",
        rows,
        {
            "vehicles_judged": sum(each.vehicles for each in found.first),
            "first_pass_percent": float(share) if isinstance(share, int | float) else None,
        },
        "Vehicles whose first verdict was good, of all that had one. Faults and aborts are no verdicts; a "
        "concession makes no vehicle good.",
        empty="No vehicle was judged.",
    )


def _pass_row(station: str, kind: str, counted: Sequence[FirstPass]) -> TableRow:
    vehicles, ok = sum(each.vehicles for each in counted), sum(each.ok for each in counted)
    return {
        "station": station,
        "type": kind,
        "vehicles": vehicles,
        "first_ok": ok,
        "first_nok": vehicles - ok,
        "first_pass_percent": 100.0 * ok / vehicles,
    }


def _vehicles(found: Sequence[Repaired]) -> Section:
    times = [each.repair_s / 60.0 for each in found if each.repair_s is not None]
    left_bad = [each for each in found if each.left is CycleOutcome.NOK]
    released = sum(each.concession is not None for each in left_bad)
    rows: list[TableRow] = [
        {
            "vin": each.vin,
            "type": each.vehicle_type,
            "station": each.station,
            "found": shown_time(each.found_utc),
            "as_found": str(each.found),
            "attempts": each.attempts,
            "left": shown_time(each.left_utc),
            "as_left": str(each.left),
            "repair_min": None if each.repair_s is None else each.repair_s / 60.0,
            "released_by": None if each.concession is None else each.concession.person,
            "left_station": each.left_station,
            "found_cycle": str(each.found_cycle),
            "left_cycle": str(each.left_cycle),
        }
        for each in found
    ]
    return Section(
        "repairs",
        "Vehicles that came back, or have to",
        rows,
        {
            "repaired": len(times),
            "released": released,
            "not_ok": len(left_bad) - released,
            "repair_median_min": float(np.median(times)) if times else None,
            "repair_p95_min": float(np.quantile(times, 0.95)) if times else None,
        },
        f"Newest {NEWEST} vehicles that were not ok at first or were judged more than once, by the trigger "
        "of their first verdict. Time to repair: from that one to the first that was good.",
        brief=("vin", "station", "found", "as_found", "attempts", "as_left", "repair_min", "released_by"),
        empty="Every vehicle was good at first, and none came back.",
    )
