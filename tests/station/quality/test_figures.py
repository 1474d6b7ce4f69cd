"""Figures of reports and gauge studies against scipy; verdicts just inside and outside their limits."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from datetime import UTC, datetime, timedelta, timezone
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pypdf import PdfReader
from scipy import stats

from alignment.statistics.choices import Conclusion, GrrMethod
from db.queries import Characteristic, Filter, ResultReader, value_series
from db.records import GaugeStudyRecord, GaugeValueRecord, StoredGaugeStudy, StudyKind
from sensors.formats.csv_table import read_table
from station.quality.gauge.analysis import analyse_grr, analyse_stability, analyse_type1
from station.quality.gauge.certificate import write_study_certificate
from station.quality.gauge.file import GaugeRow
from station.quality.periods import read_time
from tests.station.quality.conftest import HIGH_DEG, START, STATIONS

Run = Callable[..., tuple[int, str, str]]
TOE = "front_left.toe"


def answer(run: Run, *arguments: object) -> dict[str, Any]:
    status, out, _ = run("report", *arguments, "--json")
    assert status == 0
    found: dict[str, Any] = json.loads(out)
    return found


def toes(month: str, station: str | None = None, wheel: str = "front_left") -> tuple[np.ndarray, np.ndarray]:
    """Degrees and days of one station."""
    where = Filter(stations=() if station is None else (station,))
    with ResultReader(month) as reader:
        series = value_series(reader, Characteristic.parse(f"{wheel}.toe"), where)
    return np.degrees(series.value), series.time.astype("datetime64[us]").astype(np.int64) / 86_400e6


def test_stations_are_compared_by_welch(month: str, run: Run) -> None:
    rows = answer(run, "compare", "--database", month)["sections"][1]["rows"]
    (mine,) = [row for row in rows if (row["characteristic"], row["station"]) == (TOE, STATIONS[1])]
    expected = stats.ttest_ind(toes(month, STATIONS[1])[0], toes(month, STATIONS[0])[0], equal_var=False)
    limits = expected.confidence_interval(0.95)
    assert mine["p"] == pytest.approx(expected.pvalue)
    assert (mine["low_deg"], mine["high_deg"]) == pytest.approx((limits.low, limits.high))


def test_sides_are_compared_in_pairs(month: str, run: Run) -> None:
    rows = answer(run, "compare", "--database", month)["sections"][0]["rows"]
    (mine,) = [row for row in rows if row["angle"] == "toe"]
    with ResultReader(month) as reader:
        left, right = (
            value_series(reader, Characteristic.parse(f"front_{side}.toe"), Filter())
            for side in ("left", "right")
        )
    other = dict(zip(right.cycle, np.degrees(right.value), strict=True))
    both = [(a, other[c]) for a, c in zip(np.degrees(left.value), left.cycle, strict=True) if c in other]
    expected = stats.ttest_rel(*zip(*both, strict=True))
    limits = expected.confidence_interval(0.95)
    assert (mine["vehicles"], mine["p"]) == (len(both), pytest.approx(expected.pvalue))
    assert (mine["low_deg"], mine["high_deg"]) == pytest.approx((limits.low, limits.high))


def test_drift_has_the_limits_of_its_line(month: str, run: Run) -> None:
    rows = answer(run, "drift", "--database", month, "--characteristic", TOE)["sections"][0]["rows"]
    values, days = toes(month, STATIONS[0])
    expected = stats.linregress(days, values)
    half = stats.t.ppf(0.975, len(values) - 2) * expected.stderr
    (mine,) = [row for row in rows if (row["influence"], row["station"]) == ("over time", STATIONS[0])]
    found = [mine[name] for name in ("change", "p", "low", "high")]
    assert found == pytest.approx(
        [expected.slope, expected.pvalue, expected.slope - half, expected.slope + half], rel=1e-6
    )


def test_index_of_a_report_is_that_of_the_short_term_spread_and_names_what_was_missed(
    month: str, run: Run
) -> None:
    report = answer(run, "capability", "--database", month, "--characteristic", TOE, "--station", STATIONS[0])
    (row,) = report["sections"][0]["rows"]
    values, days = toes(month, STATIONS[0])
    hours = np.floor(days * 24)
    groups = [values[hours == hour] for hour in np.unique(hours)]
    df = sum(len(group) - 1 for group in groups)
    sigma = math.sqrt(sum(((group - group.mean()) ** 2).sum() for group in groups) / df)
    mean = values.mean()
    assert row["sigma_within_deg"] == pytest.approx(sigma)
    assert row["cpk"] == pytest.approx(min(mean, HIGH_DEG - mean) / (3 * sigma))
    half = 1.959964 * math.sqrt(1 / (9 * len(values)) + row["cpk"] ** 2 / (2 * df))
    assert row["cpk_low"] == pytest.approx(row["cpk"] - half)
    # Guard band included: 2 · 1e-5 rad.
    guard = math.degrees(2e-5)
    assert row["missed_high"] == int((values > HIGH_DEG - guard).sum())
    assert row["missed_low"] == int((values < guard).sum())
    s = values.std(ddof=1)
    outside = stats.norm.sf((HIGH_DEG - mean) / s) + stats.norm.cdf(-mean / s)
    assert row["expected_outside_ppm"] == pytest.approx(1e6 * outside)


def rows_of(values: list[float], part: str = "1") -> list[GaugeRow]:
    return [GaugeRow(part, "", number, Decimal(repr(value))) for number, value in enumerate(values, start=1)]


@pytest.mark.parametrize(("index", "shown"), [(1.331, Conclusion.SHOWN), (1.329, Conclusion.NOT_SHOWN)])
@pytest.mark.parametrize("which", ["cg", "cgk"])
def test_gauge_is_capable_from_one_and_a_third_on(which: str, index: float, shown: Conclusion) -> None:
    """Not from 1 on. For Cgk the spread is half as wide, and a bias takes the rest."""
    scale = 0.2 / (6 * index) * (1.0 if which == "cg" else 0.5)
    away = 0.0 if which == "cg" else 0.1 - 3 * scale * index
    values = np.tile([-1.0, 0.0, 1.0], 17)
    values = away + scale * values / values.std(ddof=1)
    report = analyse_type1(rows_of(values.tolist()), 0.0, 1.0)
    assert report.result.figures[which] == pytest.approx(index)
    assert report.judgement is shown
    assert ("NOT capable" in report.assessment) == (shown is Conclusion.NOT_SHOWN)


def gauge(percent: float) -> list[GaugeRow]:
    """Repetitions whose share of the study variation, without appraisers, is the one asked for."""
    parts = np.arange(10.0)
    inner = np.array([-1.0, 0.0, 1.0])
    between = float(np.var(parts, ddof=1))
    # var(parts' means) = PV² + EV²/3, EV² = e²; share² = e² / (PV² + e²).
    share = (percent / 100) ** 2
    e = math.sqrt(between / ((1 - share) / share + 1 / 3))
    return [
        GaugeRow(str(int(part)), "", trial, Decimal(repr(float(part + e * inner[trial - 1]))))
        for part in parts for trial in (1, 2, 3)
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("percent", "said", "shown"),
    [
        (9.9, ": acceptable", Conclusion.SHOWN),
        (10.1, ": conditionally acceptable", Conclusion.SHOWN),
        (29.9, ": conditionally acceptable", Conclusion.SHOWN),
        (30.1, ": NOT acceptable", Conclusion.NOT_SHOWN),
    ],
)
def test_gauge_is_judged_at_ten_and_thirty_percent(percent: float, said: str, shown: Conclusion) -> None:
    report = analyse_grr(gauge(percent), GrrMethod.ANOVA)
    assert report.result.figures["grr_percent_study_variation"] == pytest.approx(percent, rel=1e-6)
    assert said in report.assessment
    assert report.judgement is shown


@pytest.mark.parametrize(
    ("share", "said", "shown"),
    [
        (0.299, ": conditionally acceptable", Conclusion.SHOWN),
        (0.301, ": NOT acceptable", Conclusion.NOT_SHOWN),
    ],
)
def test_share_of_the_tolerance_may_be_the_worse_of_both(share: float, said: str, shown: Conclusion) -> None:
    rows = gauge(9.9)
    own = analyse_grr(rows, GrrMethod.ANOVA).result.figures["grr"]
    report = analyse_grr(rows, GrrMethod.ANOVA, tolerance=6 * own / share)
    assert report.result.figures["grr_percent_tolerance"] == pytest.approx(100 * share)
    assert said in report.assessment
    assert report.judgement is shown


@pytest.mark.parametrize(("percent", "few"), [(27.3, True), (27.0, False)])
def test_fewer_than_five_categories_are_said(percent: float, few: bool) -> None:
    """Categories are 1.41 times the spread of the parts over that of the gauge: five up to 27.14 %."""
    report = analyse_grr(gauge(percent), GrrMethod.ANOVA)
    assert ("distinct categories, 5 are asked for" in report.assessment) is few


def test_certificate_of_a_study_says_every_figure_and_raw_value(tmp_path: Path) -> None:
    berlin = timezone(timedelta(hours=1))
    record = GaugeStudyRecord(
        kind=StudyKind.GRR, name="Prüfung 7", created_utc=datetime(2026, 11, 20, 0, 30, tzinfo=berlin),
        characteristic=TOE, plan={"unit": "rad", "tolerance": math.radians(0.2)}, software_version="0.1.0",
        comment="after the move",
    )  # fmt: skip
    degrees = {"a": (0.01, 0.0102), "b": (0.05, 0.0503), "c": (0.09, 0.0901)}
    values = tuple(
        GaugeValueRecord(
            record.uuid, part, "", trial, math.radians(value), datetime(2026, 11, 21, 0, trial, tzinfo=berlin)
        )
        for part, both in degrees.items() for trial, value in enumerate(both, start=1)
    )  # fmt: skip
    stored = StoredGaugeStudy(record, values, values, record.created_utc)
    path = tmp_path / "s.pdf"
    report = write_study_certificate(path, stored, created=datetime(2026, 11, 22, 8, 0, tzinfo=UTC))
    said = " ".join(" ".join(page.extract_text() for page in PdfReader(path).pages).split())
    assert "Gauge study Prüfung 7" in said
    assert "Planned 2026-11-19 23:30:00 UTC" in said
    assert f"made {datetime(2026, 11, 22, 8, 0, tzinfo=UTC):%Y-%m-%d %H:%M:%S} UTC" in said
    assert report.assessment in said
    figures = report.result.figures
    assert f"grr percent study variation {figures['grr_percent_study_variation']:.5g} ≤ 30 yes" in said
    assert f"grr percent tolerance {figures['grr_percent_tolerance']:.5g} ≤ 30 yes" in said
    assert figures["grr_percent_tolerance"] == pytest.approx(600 * figures["grr"] / 0.2)
    for part, both in degrees.items():
        for trial, value in enumerate(both, start=1):
            assert f"{part} {trial} {value:.4f} 2026-11-20 23:0{trial}:00" in said


def test_certificate_of_a_dead_gauge_has_no_verdict(tmp_path: Path) -> None:
    record = GaugeStudyRecord(
        kind=StudyKind.STABILITY, name="dead", created_utc=datetime(2026, 11, 20, tzinfo=UTC),
        characteristic=TOE, plan={"unit": "mm"}, software_version="0.1.0",
    )  # fmt: skip
    values = tuple(GaugeValueRecord(record.uuid, "m", "", trial, 0.1, None) for trial in range(1, 26))
    stored = StoredGaugeStudy(record, values, values, record.created_utc)
    report = write_study_certificate(tmp_path / "s.pdf", stored, created=datetime(2026, 11, 22, tzinfo=UTC))
    said = " ".join(PdfReader(tmp_path / "s.pdf").pages[0].extract_text().split())
    assert report.judgement is Conclusion.NONE
    assert "signals location – ≤ 0 no verdict" in said
    assert "All values are equal" in said


@pytest.mark.parametrize(("away", "said"), [(0.15, False), (0.28, False), (0.29, True)])
def test_bias_is_called_significant_at_five_percent(away: float, said: bool) -> None:
    """Fifty repetitions: five percent lie at a bias of 0.284 deviations."""
    values = np.tile([-1.0, 1.0], 25)
    values = 0.01 * values / values.std(ddof=1)
    report = analyse_type1(rows_of((values + 0.01 * away).tolist()), 0.0, 1.0)
    assert (report.result.figures["bias_p"] < 0.05) is said
    assert ("is significant" in report.assessment) is said


@pytest.mark.parametrize(("slope", "said"), [(0.0, False), (0.0006, False), (0.002, True)])
def test_drift_is_said_at_one_percent(slope: float, said: bool) -> None:
    rng = np.random.default_rng(43)
    start = datetime(2026, 11, 1, tzinfo=UTC)
    rows = [
        GaugeRow(
            "m",
            "",
            day + 1,
            Decimal(f"{rng.normal(0, 0.01) + slope * day:.6f}"),
            None,
            start + timedelta(day),
        )
        for day in range(25)
    ]
    report = analyse_stability(rows)
    p = report.result.figures["drift_p"]
    assert (p < 0.01) is said
    # The middle one is not certain, and not nothing either.
    assert slope != 0.0006 or 0.01 < p < 0.5
    assert ("drift of" in report.assessment) is said


@pytest.mark.parametrize("kind", ["individuals", "xbar-r"])
def test_signal_names_the_vehicle_that_completed_it(month: str, run: Run, kind: str) -> None:
    sections = answer(
        run, "chart", "--database", month, "--characteristic", TOE, "--chart", kind, "--size", "4", "--rules",
        "nelson",
    )["sections"]  # fmt: skip
    with ResultReader(month) as reader:
        series = value_series(reader, Characteristic.parse(TOE), Filter())
    values, vins = np.degrees(series.value), series.vin.tolist()
    seen = set()
    for signal in sections[1]["rows"]:
        last = vins.index(signal["vin"])
        if kind == "xbar-r":
            group = values[last - 3 : last + 1]
            assert last % 4 == 3
            expected = group.mean() if signal["track"] == "mean" else np.ptp(group)
        elif signal["track"] == "value":
            expected = values[last]
        else:
            expected = abs(values[last] - values[last - 1])
        assert signal["point_deg"] == pytest.approx(expected)
        assert signal["time"] == f"{str(series.time[last])[:19].replace('T', ' ')} UTC"
        seen.add(signal["track"])
    assert seen


def test_influences_count_the_values_that_speak_for_them(month: str, run: Run) -> None:
    """Up to fifty on each side of a new calibration; temperature only between its first and last reading."""
    rows = answer(run, "drift", "--database", month, "--characteristic", TOE, "--station", STATIONS[0])
    mine = {row["influence"]: row for row in rows["sections"][0]["rows"]}
    values, days = toes(month, STATIONS[0])
    first = START.timestamp() / 86_400
    changed = days >= first + 15
    assert mine["calibration"]["n"] == len(values) == 60
    assert mine["calibration"]["change"] == pytest.approx(values[changed].mean() - values[~changed].mean())
    read = (days >= first + 1 / 24) & (days <= first + 27 + 1 / 24)
    assert mine["temperature"]["n"] == int(read.sum()) < len(values)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("8h", timedelta(hours=8)), ("7d", timedelta(days=7)), ("4w", timedelta(weeks=4)),
        ("0d", timedelta(0)),
    ],
)  # fmt: skip
def test_span_reaches_back_from_now(text: str, expected: timedelta) -> None:
    now = datetime(2026, 11, 30, 12, tzinfo=UTC)
    assert read_time("--from", text, now) == now - expected


@pytest.mark.parametrize("text", ["2026-11-22T06:00+01:00", "2026-11-22T05:00", "2026-11-22 05:00Z"])
def test_time_with_and_without_zone_is_the_same_moment(tmp_path: Path, text: str) -> None:
    expected = datetime(2026, 11, 22, 5, tzinfo=UTC)
    found = read_time("--from", text)
    assert (found, found.utcoffset() if found else None) == (expected, timedelta(0))
    (tmp_path / "s.csv").write_text(f"time,value\n{text},1\n")
    (line,) = read_table(tmp_path / "s.csv", ("time", "value"))
    assert line.time("time") == expected
