"""Left against right, station against station; and drift, new calibrations, temperature."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence

import numpy as np
from scipy import stats

from alignment.arrays import Array, Index
from alignment.statistics import Moments, drift_of, drift_per_day, merged
from alignment.statistics import moments as moments_of
from alignment.values import SIDES
from db.queries import (
    Characteristic,
    Filter,
    GroupBy,
    Quantity,
    ResultReader,
    ValueSeries,
    characteristic_moments,
    events,
    value_series,
)
from db.records import EventRecord, Unit
from station.quality.pictures import Picture, Trace
from station.quality.reports.report import Section, TableRow, shown_time
from station.quality.reports.units import in_unit, moments_in_unit, unit_of
from station.quality.reports.values import NEWEST, aware_times, comparable, wheel_angles

TEMPERATURE = "temperature"
"""Code of events whose value is a temperature in degrees Celsius."""
_SIDES = ("left", "right")
_STEP = 50  # values on each side of a new calibration
_DAY_S = 86_400.0
_PICTURES = 16


def compare_sections(
    reader: ResultReader,
    where: Filter,
    characteristics: Sequence[Characteristic],
    unit: Unit = Unit.DEGREES,
) -> list[Section]:
    """Both sides of the same vehicles, and every station against all others, of the values of one unit."""
    wanted = [each for each in characteristics or wheel_angles(reader, where) if unit_of(each) is unit]
    asked = [each for each in characteristics if unit_of(each) is unit]
    return [_sides(reader, where, wanted, unit), _stations(reader, where, asked, unit)]


def drift_section(reader: ResultReader, where: Filter, characteristics: Sequence[Characteristic]) -> Section:
    """What the values do over days, at new calibrations and with temperature, station by station."""
    rows: list[TableRow] = []
    pictures: list[Picture] = []
    temperatures = _temperatures(events(reader, where, codes=(TEMPERATURE,)))
    for characteristic in list(characteristics) or wheel_angles(reader, where):
        series = value_series(reader, characteristic, where, newest=NEWEST)
        values, _ = comparable(series)
        for station in sorted(set(series.station)):
            mine = np.flatnonzero(series.station == station)
            at = series.time[mine].astype("datetime64[us]").astype(np.int64) / 1e6
            if len(mine) < 3:
                continue
            word = unit_of(characteristic).word
            found = _drift(values[mine], at, word)
            found += _calibration_steps(values[mine], series, mine, word)
            found += _with_temperature(values[mine], at, temperatures.get(station), word)
            head = {"characteristic": str(characteristic), "station": str(station)}
            rows += [head | row for row in found]
            if len(pictures) < _PICTURES:
                pictures += [
                    p for p in (_daily(characteristic, str(station), values[mine], series, mine),) if p
                ]
    relevant = [row for row in rows if row["p"] is not None and float(str(row["p"])) < 0.01]
    return Section(
        "drift",
        "Drift, calibrations, temperature",
        rows,
        {"influences": len(rows), "significant_influences": len(relevant)},
        f"Newest {NEWEST} values. Over time: change per day, of values that span a day at least. "
        f"Calibration: mean of up to {_STEP} values after a new calibration less mean of those before. "
        f"Temperature: change per kelvin, from events with the code '{TEMPERATURE}'. Limits for 95 %; "
        "the product changes too, so this shows where to look.",
        pictures,
        brief=("characteristic", "station", "influence", "change", "low", "high", "p"),
        empty="Nothing to compare: values of less than a day, no new calibration, no temperatures.",
    )


def _sides(reader: ResultReader, where: Filter, wanted: Sequence[Characteristic], unit: Unit) -> Section:
    rows: list[TableRow] = []
    axles = sorted({(c.part.rpartition("_")[0], c.quantity) for c in wanted if c.part.endswith(SIDES)})
    for axle, quantity in axles:
        left, right = (
            value_series(reader, Characteristic(f"{axle}_{side}", Quantity(quantity)), where, newest=NEWEST)
            for side in SIDES
        )
        other = dict(zip(right.cycle, right.value, strict=True))
        pairs = [
            (value, other[cycle])
            for value, cycle in zip(left.value, left.cycle, strict=True)
            if cycle in other
        ]
        if len(pairs) < 2:
            continue
        both = unit.factor * np.array(pairs)
        difference = moments_of(both[:, 0] - both[:, 1])
        half, p = _confidence(difference.mean, difference.deviation / math.sqrt(len(pairs)), len(pairs) - 1)
        rows.append(
            {
                "axle": axle, "angle": str(quantity), "vehicles": len(pairs),
                f"left_mean_{unit}": float(both[:, 0].mean()),
                f"right_mean_{unit}": float(both[:, 1].mean()),
                f"left_less_right_{unit}": difference.mean, **_limits(difference.mean, half, unit), "p": p,
            }
        )  # fmt: skip
    largest = max((abs(float(str(row[f"left_less_right_{unit}"]))) for row in rows), default=None)
    return Section(
        "sides",
        "Left against right",
        rows,
        {f"largest_side_difference_{unit}": largest},
        f"Differences of the two wheels of the same vehicle, newest {NEWEST}; limits for 95 %.",
        brief=(
            "axle",
            "angle",
            "vehicles",
            f"left_less_right_{unit}",
            f"low_{unit}",
            f"high_{unit}",
            "p",
        ),
        empty="Fewer than two vehicles have values of both sides.",
    )


def _stations(reader: ResultReader, where: Filter, wanted: Sequence[Characteristic], unit: Unit) -> Section:
    groups: dict[tuple[str, str], dict[str, Moments]] = defaultdict(dict)
    for found in characteristic_moments(reader, where, wanted, (GroupBy.STATION,)):
        if found.n >= 2 and unit_of(found.characteristic) is unit:
            ends = (in_unit(found.low, unit), in_unit(found.high, unit))
            limits = " … ".join("none" if end is None else f"{end:.3f}" for end in ends)
            station = str(found.group[GroupBy.STATION])
            groups[str(found.characteristic), limits][station] = moments_in_unit(found)
    rows: list[TableRow] = []
    for (characteristic, limits), by_station in groups.items():
        if len(by_station) < 2:
            continue
        for station, mine in by_station.items():
            others = merged(each for name, each in by_station.items() if name != station)
            difference, half, p = _welch(mine, others)
            rows.append(
                {
                    "characteristic": characteristic, f"limits_{unit}": limits, "station": station,
                    "n": mine.n, f"mean_{unit}": mine.mean, f"sigma_{unit}": mine.deviation,
                    f"less_others_{unit}": difference, **_limits(difference, half, unit), "p": p,
                }
            )  # fmt: skip
    largest = max((abs(float(str(row[f"less_others_{unit}"]))) for row in rows), default=None)
    names = [f"{row['characteristic']} {row['station']}" for row in rows]
    values = [float(str(row[f"less_others_{unit}"])) for row in rows]
    picture = Picture(
        "Stations less all others", "characteristic, station", unit.word,
        (Trace("difference", "bar", names, values),),
    )  # fmt: skip
    return Section(
        "stations",
        "Station against station",
        rows,
        {f"largest_station_difference_{unit}": largest},
        "Mean of a station less the mean of all others, for the same limits; limits for 95 % (Welch). "
        "Stations that see different vehicles differ for that reason too.",
        (picture,) if 0 < len(rows) <= 60 else (),
        brief=(
            "characteristic",
            "station",
            "n",
            f"less_others_{unit}",
            f"low_{unit}",
            f"high_{unit}",
            "p",
        ),
        empty="Only one station has values of the same characteristic with the same limits.",
    )


def _limits(value: float, half: float | None, unit: Unit) -> dict[str, float | None]:
    low, high = _ends(value, half)
    return {f"low_{unit}": low, f"high_{unit}": high}


def _ends(value: float, half: float | None) -> tuple[float | None, float | None]:
    return (None, None) if half is None else (value - half, value + half)


def _welch(one: Moments, other: Moments) -> tuple[float, float | None, float | None]:
    """Difference of two means, half its confidence interval, and its chance probability.

    None for both where neither varies: an interval without width would prove anything.
    """
    a, b = one.variance / one.n, other.variance / other.n
    difference = one.mean - other.mean
    if not a + b > 0.0:
        return difference, None, None
    df = (a + b) ** 2 / (a * a / (one.n - 1) + b * b / (other.n - 1))
    half, p = _confidence(difference, math.sqrt(a + b), df)
    return difference, half, p


def _confidence(value: float, error: float, df: float) -> tuple[float | None, float | None]:
    if not error > 0.0:
        return None, None
    return float(stats.t.ppf(0.975, df)) * error, float(2 * stats.t.sf(abs(value) / error, df))


def _drift(values: Array, at: Array, word: str) -> list[dict[str, str | float | int | None]]:
    slope, p = drift_per_day(values, at - at[0])
    if slope is None:
        return []
    return [_influence("over time", f"{word} per day", slope, p, len(values), values, (at - at[0]) / _DAY_S)]


def _with_temperature(
    values: Array, at: Array, known: tuple[Array, Array] | None, word: str
) -> list[dict[str, str | float | int | None]]:
    if known is None:
        return []
    when, kelvin = known
    inside = (at >= when[0]) & (at <= when[-1])
    if inside.sum() < 3:
        return []
    warm = np.interp(at[inside], when, kelvin)
    slope, p = drift_of(values[inside], warm)
    if slope is None:
        return []
    return [
        _influence("temperature", f"{word} per kelvin", slope, p, int(inside.sum()), values[inside], warm)
    ]


def _influence(
    name: str, unit: str, slope: float, p: float | None, n: int, values: Array, x: Array
) -> dict[str, str | float | int | None]:
    """A line with its confidence limits."""
    dx, dy = x - x.mean(), values - values.mean()
    rest = float(np.square(dy - slope * dx).sum()) / (n - 2)
    half = float(stats.t.ppf(0.975, n - 2)) * math.sqrt(rest / float(np.square(dx).sum()))
    low, high = _ends(slope, None if p is None else half)
    return {
        "influence": name, "what": unit, "change": slope, "low": low,
        "high": high, "p": p, "n": n,
    }  # fmt: skip


def _changes(series: ValueSeries, mine: Index) -> list[int]:
    """Positions in `mine` at which the calibration is another one than before."""
    used = [series.calibration_id[index] for index in mine]
    return [k for k in range(1, len(used)) if used[k] != used[k - 1] and None not in (used[k], used[k - 1])]


def _calibration_steps(
    values: Array, series: ValueSeries, mine: Index, word: str
) -> list[dict[str, str | float | int | None]]:
    changes = _changes(series, mine)
    rows: list[dict[str, str | float | int | None]] = []
    for number, at in enumerate(changes):
        first = max(changes[number - 1] if number else 0, at - _STEP)
        last = min(changes[number + 1] if number + 1 < len(changes) else len(values), at + _STEP)
        if at - first < 2 or last - at < 2:
            continue
        before, after = moments_of(values[first:at]), moments_of(values[at:last])
        difference, half, p = _welch(after, before)
        low, high = _ends(difference, half)
        time = aware_times(series)[mine[at]]
        rows.append(
            {
                "influence": "calibration",
                "what": f"{series.calibration_id[mine[at]]} from {shown_time(time)}, {word}",
                "change": difference, "low": low, "high": high, "p": p,
                "n": after.n + before.n,
            }
        )  # fmt: skip
    return rows


def _temperatures(found: Sequence[EventRecord]) -> dict[str, tuple[Array, Array]]:
    """Times in seconds and temperatures of each station, in the order of time."""
    read: dict[str, list[tuple[float, float]]] = defaultdict(list)
    for event in found:
        if event.value is not None:
            read[event.station].append((event.utc.timestamp(), event.value))
    return {
        station: (np.array([t for t, _ in sorted(pairs)]), np.array([k for _, k in sorted(pairs)]))
        for station, pairs in read.items()
        if len(pairs) > 1
    }


def _daily(
    characteristic: Characteristic,
    station: str,
    values: Array,
    series: ValueSeries,
    mine: Index,
) -> Picture | None:
    """The course over the days; None for a single one."""
    days = series.time[mine].astype("datetime64[D]")
    known = np.unique(days)
    means = [float(values[days == day].mean()) for day in known]
    verticals = [(str(days[k]), str(series.calibration_id[mine[k]])) for k in _changes(series, mine)]
    if len(known) < 2:
        return None
    return Picture(
        f"{characteristic} at {station}", "day (UTC)", f"mean, {unit_of(characteristic).word}",
        (Trace("daily mean", "line", [str(day) for day in known], means),), verticals=verticals,
        vertical_name="new calibration",
    )  # fmt: skip
