"""Which reports there are; nothing heavy is loaded, so the command line can name them."""

from __future__ import annotations

import enum
from collections.abc import Mapping


class ReportKind(enum.StrEnum):
    """The reports."""

    ALL = "all"
    YIELD = "yield"
    PARETO = "pareto"
    CAPABILITY = "capability"
    CHART = "chart"
    COMPARE = "compare"
    DRIFT = "drift"
    ADJUSTING = "adjusting"
    REPAIRS = "repairs"
    VIN = "vin"
    SINCE_CHECK = "since-check"


class SplitBy(enum.StrEnum):
    """What capability is shown for, beside characteristic and vehicle type."""

    NOTHING = "nothing"
    STATION = "station"
    DAY = "day"


TITLES: Mapping[ReportKind, str] = {
    ReportKind.ALL: "Quality report",
    ReportKind.YIELD: "Yield",
    ReportKind.PARETO: "Pareto of reasons",
    ReportKind.CAPABILITY: "Distributions and capability",
    ReportKind.CHART: "Control charts",
    ReportKind.COMPARE: "Sides and stations compared",
    ReportKind.DRIFT: "Drift",
    ReportKind.ADJUSTING: "Adjusting",
    ReportKind.REPAIRS: "Repair loop",
    ReportKind.VIN: "One vehicle",
    ReportKind.SINCE_CHECK: "Vehicles since the last good master check",
}
