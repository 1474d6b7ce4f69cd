"""Distributions with capability, and control charts."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from datetime import UTC, datetime

import numpy as np

from alignment.arrays import Array
from alignment.statistics import (
    LEAST_CPK,
    Baseline,
    CapabilityIndex,
    ChartKind,
    Conclusion,
    ControlChart,
    RuleSet,
    Track,
    capability,
    control_chart,
    judged,
    moving_range_sigma,
    normality_p,
    quantile_performance,
    rule_source,
    rule_texts,
)
from db.queries import (
    Characteristic,
    CharacteristicMoments,
    Filter,
    GroupBy,
    ResultReader,
    ValueSeries,
    characteristic_moments,
    value_series,
)
from db.records import Unit
from station.quality.pictures import Picture, Trace
from station.quality.reports.choices import SplitBy
from station.quality.reports.report import Section, TableRow, in_words, shown_time
from station.quality.reports.units import in_unit, moments_in_unit, unit_of

NEWEST = 20_000
"""Single values that distributions and charts take at most, the newest ones."""
_PICTURES = 16
_DRAWN = 2000  # points of a chart that are drawn, the newest ones; signals are listed for all
_BINS = 40
_SPLITS: dict[SplitBy, tuple[GroupBy, ...]] = {
    SplitBy.NOTHING: (), SplitBy.STATION: (GroupBy.STATION,), SplitBy.DAY: (GroupBy.DAY,),
}  # fmt: skip
_BRIEF = (
    "cp", "cpk", "cpk_low", "ppk", "ppk_low", "missed_low",
    "missed_high",
)  # fmt: skip


def capability_section(
    reader: ResultReader,
    where: Filter,
    characteristics: Sequence[Characteristic],
    split: SplitBy = SplitBy.NOTHING,
    unit: Unit = Unit.DEGREES,
) -> Section:
    """Indices of every characteristic of one unit with limits, by vehicle type, and its distribution."""
    by = [GroupBy.VEHICLE_TYPE, *_SPLITS[split]]
    with_limits = [
        found
        for found in characteristic_moments(reader, where, characteristics, by)
        if found.n >= 2
        and (found.low is not None or found.high is not None)
        and unit_of(found.characteristic) is unit
    ]
    rows: list[TableRow] = []
    pictures: list[Picture] = []
    series: dict[Characteristic, ValueSeries] = {}
    for found in with_limits:
        values = np.zeros(0)
        if split is SplitBy.NOTHING:
            if found.characteristic not in series:
                series[found.characteristic] = value_series(
                    reader, found.characteristic, where, newest=NEWEST
                )
            values = _values_of(series[found.characteristic], found)
        rows.append(_capability_row(found, values, split))
        if len(pictures) < _PICTURES and len(values) > 1:
            pictures.append(_histogram(found, values))
    if split is not SplitBy.NOTHING:
        pictures = _courses(rows)
    least = {
        name: min((value for row in rows if (value := _value(row, name)) is not None), default=None)
        for name in ("cpk", "ppk")
    }
    figures: dict[str, float | int | None] = {
        "capable_characteristics": sum(row["verdict"] == Conclusion.SHOWN for row in rows),
        "judged_characteristics": len(rows),
        "characteristics_without_verdict": sum(row["verdict"] == Conclusion.NONE for row in rows),
        "least_cpk": least["cpk"],
        "least_ppk": least["ppk"],
    }
    if len(rows) == 1:
        keys = [f"{name}{end}" for name in ("cp", "cpk", "pp", "ppk") for end in ("", "_low", "_high")]
        figures |= {key: _value(rows[0], key) for key in ("n", f"mean_{unit}", f"sigma_{unit}", *keys)}
    grouped = () if split is SplitBy.NOTHING else ("group",)
    return Section(
        "capability",
        "Distributions and capability",
        rows,
        figures,
        "Cp and Cpk: spread within the hours of one station, or of successive values where no two came in "
        "one hour. Pp and Ppk: spread of all values. Limits of the indices are for 95 % confidence. "
        "Capability counts as shown only where the lower limit of Cpk (of Ppk without a short-term spread) "
        f"is above {LEAST_CPK:g}; too few values, or equal ones, give no verdict. A small normality p "
        f"(Anderson-Darling, newest {NEWEST} values) says that the expected share outside is not to be "
        "relied on; from 1000 values on pp_quantile and ppk_quantile (ISO 22514-2) do without a normal "
        "distribution.",
        pictures,
        brief=(
            "characteristic",
            "type",
            *grouped,
            "n",
            "verdict",
            f"mean_{unit}",
            f"sigma_{unit}",
            *_BRIEF,
        ),
        empty="No characteristic with limits has two values or more.",
    )


def _capability_row(found: CharacteristicMoments, values: Array, split: SplitBy) -> TableRow:
    overall, unit = moments_in_unit(found), unit_of(found.characteristic)
    low, high = in_unit(found.low, unit), in_unit(found.high, unit)
    sigma, df = _within(found, values)
    indices = capability(overall, low, high, within_sigma=sigma, within_df=df)
    verdict = judged(indices)
    by_quantile = quantile_performance(values, low, high) or (None, None)
    groups = [_shown(found.group[each]) for each in _SPLITS[split]]
    grouped = {"group": groups[0]} if groups else {}
    return {
        "characteristic": str(found.characteristic), "type": _shown(found.group[GroupBy.VEHICLE_TYPE]),
        **grouped, "n": found.n, "verdict": str(verdict.judgement), f"mean_{unit}": overall.mean,
        f"sigma_within_{unit}": indices.within_sigma, f"sigma_{unit}": overall.deviation,
        f"low_{unit}": low, f"high_{unit}": high,
        **_index("cp", indices.cp), **_index("cpk", indices.cpk),
        **_index("pp", indices.pp), **_index("ppk", indices.ppk),
        "missed_low": found.n_low, "missed_high": found.n_high,
        "expected_outside_ppm": indices.expected_outside_ppm, "normality_p": normality_p(values),
        "pp_quantile": by_quantile[0], "ppk_quantile": by_quantile[1],
        "verdict_reason": verdict.reason,
    }  # fmt: skip


def _courses(rows: Sequence[TableRow]) -> list[Picture]:
    """Ppk and its lower confidence limit over the groups, a picture for each characteristic and type."""
    pictures = []
    for name, kind in dict.fromkeys((str(row["characteristic"]), str(row["type"])) for row in rows):
        mine = [row for row in rows if (row["characteristic"], row["type"]) == (name, kind)]
        known = [row for row in mine if row["ppk"] is not None]
        x = [str(row["group"]) for row in known]
        traces = tuple(
            Trace(key, "line", x, [_value(row, key) or 0.0 for row in known], colour=colour)
            for key, colour in (("ppk", ""), ("ppk_low", "second"))
        )
        pictures.append(
            Picture(f"{name}, {kind}", "group", "Ppk", traces, {f"limit {LEAST_CPK:g}": LEAST_CPK})
        )
    return pictures[:_PICTURES]


def chart_sections(
    reader: ResultReader,
    where: Filter,
    characteristics: Sequence[Characteristic],
    kind: ChartKind,
    rules: RuleSet,
    size: int,
    baseline: Filter | None = None,
    unit: Unit = Unit.DEGREES,
) -> list[Section]:
    """A control chart of each characteristic of one unit, and the list of its signals.

    Limits come from the results of `baseline`, or from the values themselves without.
    """
    wanted = [each for each in characteristics or wheel_angles(reader, where) if unit_of(each) is unit]
    rows: list[TableRow] = []
    signals: list[TableRow] = []
    pictures: list[Picture] = []
    for characteristic in wanted:
        series = value_series(reader, characteristic, where, newest=NEWEST)
        values, relative = comparable(series)
        least = 2 if kind is ChartKind.INDIVIDUALS else 2 * size
        if len(values) < least:
            continue
        known = None
        if baseline is not None:
            earlier, _ = comparable(value_series(reader, characteristic, baseline, newest=NEWEST))
            if len(earlier) < least:
                continue
            before = control_chart(kind, earlier, rules, size=size)
            known = Baseline(before.location.centre, before.sigma)
        chart = control_chart(kind, values, rules, size=size, baseline=known)
        rows.append(
            {
                "characteristic": str(characteristic), "values": len(values),
                f"centre_{unit}": chart.location.centre, f"lower_{unit}": chart.location.lower,
                f"upper_{unit}": chart.location.upper, f"sigma_{unit}": chart.sigma,
                f"spread_upper_{unit}": chart.spread.upper,
                "signals": None if chart.in_control is None else len(chart.location.signals),
                "spread_signals": None if chart.in_control is None else len(chart.spread.signals),
                "from_middle": "yes" if relative else "no",
            }
        )  # fmt: skip
        for track in (chart.location, chart.spread):
            signals += _signals(characteristic, chart, track, series)
        if len(pictures) < _PICTURES:
            pictures += [
                _chart_picture(characteristic, chart, track, series, relative)
                for track in (chart.location, chart.spread)
            ]
    texts = "; ".join(f"{number} {text}" for number, text in enumerate(rule_texts(rules), start=1))
    return [
        Section(
            "chart",
            f"Control charts ({kind}{'' if kind is ChartKind.INDIVIDUALS else f', subgroups of {size}'})",
            rows,
            {
                "charts": len(rows),
                "signals": len(signals),
                "charts_without_spread": sum(row["signals"] is None for row in rows),
            },
            f"Rules {rules} ({rule_source(rules)}): {texts}. "
            f"The newest {NEWEST} values in the order of storing. Where vehicle types differ in their "
            "limits, values are taken from the middle of their own limits. "
            "Equal values have no spread, so their chart has no limits and judges nothing."
            + ("" if baseline is None else f" Control limits: {in_words(baseline)}."),
            pictures,
            brief=(
                "characteristic",
                "values",
                f"centre_{unit}",
                f"lower_{unit}",
                f"upper_{unit}",
                "signals",
            ),
            empty="No characteristic has enough values for a chart.",
        ),
        Section(
            "signals",
            "Signals of the charts",
            signals,
            brief=("characteristic", "track", "time", "vin", "rule"),
            empty="No point signals.",
        ),
    ]


def wheel_angles(reader: ResultReader, where: Filter) -> list[Characteristic]:
    """Camber and toe of every wheel that has values."""
    found = {m.characteristic for m in characteristic_moments(reader, where) if m.n}
    wheels = [c for c in found if c.quantity in ("camber", "toe")]
    return sorted(wheels, key=str)


def comparable(series: ValueSeries) -> tuple[Array, bool]:
    """(N,) values in their unit, and whether they count from the middle of their own limits.

    They do where vehicles have different limits: their nominal angles differ, and one process is looked for.
    Where a type has no middle, the median of its values stands for it.
    """
    factor = unit_of(series.characteristic).factor
    limits = {(low, high) for low, high in zip(_known(series.low), _known(series.high), strict=True)}
    if len(limits) < 2:
        return series.value * factor, False
    middle = (series.low + series.high) / 2.0
    for kind in set(series.vehicle_type[np.isnan(middle)]):
        without = np.isnan(middle) & (series.vehicle_type == kind)
        middle[without] = np.median(series.value[without])
    return (series.value - middle) * factor, True


def aware_times(series: ValueSeries) -> list[datetime]:
    """Times of a series, aware."""
    micros = series.time.astype("datetime64[us]").astype(np.int64)
    return [datetime.fromtimestamp(int(us) / 1e6, UTC) for us in micros]


def _known(values: Array) -> list[float | None]:
    return [None if math.isnan(value) else float(value) for value in values]


def _within(found: CharacteristicMoments, values: Array) -> tuple[float | None, int | None]:
    """Short-term spread in the unit of the values and its degrees of freedom.

    Where no two vehicles came in one hour, it is that of successive values.
    """
    if found.std_within is not None:
        return found.std_within * unit_of(found.characteristic).factor, found.dof_within
    return moving_range_sigma(values) or (None, None)


def _values_of(series: ValueSeries, found: CharacteristicMoments) -> Array:
    """(N,) values in their unit of the same limits and vehicle type."""
    same = [
        (low, high) == (found.low, found.high)
        for low, high in zip(_known(series.low), _known(series.high), strict=True)
    ]
    of_type = series.vehicle_type == found.group[GroupBy.VEHICLE_TYPE]
    out: Array = series.value[np.array(same, dtype=bool) & of_type] * unit_of(found.characteristic).factor
    return out


def _histogram(found: CharacteristicMoments, values: Array) -> Picture:
    overall, unit = moments_in_unit(found), unit_of(found.characteristic)
    low, high = in_unit(found.low, unit), in_unit(found.high, unit)
    bins, ends = min(_BINS, max(5, round(math.sqrt(len(values))))), None
    if not overall.varied:
        # One bar at the value between four empty ones, narrow beside the limits.
        half = 0.025 if low is None or high is None else (high - low) / 20
        bins, ends = 5, (overall.mean - half, overall.mean + half)
    counts, edges = np.histogram(values, bins=bins, range=ends)
    middles = (edges[:-1] + edges[1:]) / 2
    traces = [Trace("values", "bar", middles.tolist(), counts.astype(float).tolist())]
    if overall.deviation > 0.0:
        x = np.linspace(edges[0], edges[-1], 80)
        z = (x - overall.mean) / overall.deviation
        density = np.exp(-0.5 * z * z) / (overall.deviation * math.sqrt(2 * math.pi))
        scaled = density * len(values) * (edges[1] - edges[0])
        traces.append(Trace("normal", "curve", x.tolist(), scaled.tolist(), colour="second"))
    levels = {
        name: value
        for name, value in (("limit low", low), ("limit high", high), ("centre mean", overall.mean))
        if value is not None
    }
    kind = _shown(found.group[GroupBy.VEHICLE_TYPE])
    return Picture(
        f"{found.characteristic}, {kind}", unit.word, "vehicles", tuple(traces), levels, limits_on_x=True,
        counted=True,
    )  # fmt: skip


def _chart_picture(
    characteristic: Characteristic, chart: ControlChart, track: Track, series: ValueSeries, relative: bool
) -> Picture:
    first = max(0, len(track.points) - _DRAWN)
    drawn = range(first, len(track.points))
    vins = [str(series.vin[track_index(chart, track, index)]) for index in drawn]
    line = Trace(track.name, "line", [index + 1 for index in drawn], track.points[first:].tolist(), vins)
    traces = [line]
    said: dict[int, list[str]] = defaultdict(list)
    for signal in track.signals:
        if signal.index >= first:
            said[signal.index].append(signal.text)
    if said:
        texts = [f"{vins[index - first]}: {', '.join(found)}" for index, found in said.items()]
        y = [float(track.points[index]) for index in said]
        traces.append(Trace("signal", "points", [index + 1 for index in said], y, texts, "signal"))
    levels = {"centre": track.centre, "control upper": track.upper, "control lower": track.lower}
    word = unit_of(characteristic).word
    unit = f"{word} from the middle of the limits" if relative else word
    return Picture(
        f"{characteristic}: {track.name}",
        "subgroup" if chart.size > 1 else "value",
        unit,
        tuple(traces),
        levels,
    )


def track_index(chart: ControlChart, track: Track, index: int) -> int:
    """Position of the last value that a point of a track stands for."""
    if chart.size > 1:
        return (index + 1) * chart.size - 1
    return index + 1 if track is chart.spread else index


def _signals(
    characteristic: Characteristic, chart: ControlChart, track: Track, series: ValueSeries
) -> list[TableRow]:
    at = aware_times(series)
    rows: list[TableRow] = []
    for signal in track.signals:
        last = track_index(chart, track, signal.index)
        rows.append(
            {
                "characteristic": str(characteristic), "track": track.name, "time": shown_time(at[last]),
                "vin": str(series.vin[last]), "station": str(series.station[last]),
                f"point_{unit_of(characteristic)}": float(track.points[signal.index]),
                "rule": signal.rule, "what": signal.text,
            }
        )  # fmt: skip
    return rows


def _index(name: str, index: CapabilityIndex | None) -> dict[str, float | None]:
    if index is None:
        return {name: None, f"{name}_low": None, f"{name}_high": None}
    return {name: index.value, f"{name}_low": index.low, f"{name}_high": index.high}


def _value(row: TableRow, name: str) -> float | None:
    value = row[name]
    return None if value is None or isinstance(value, str) else float(value)


def _shown(value: str | datetime | None) -> str:
    return f"{value:%Y-%m-%d}" if isinstance(value, datetime) else str(value or "unknown")
