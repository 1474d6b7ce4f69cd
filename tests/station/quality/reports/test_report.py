"""Reports: their figures follow from the stored values, and every one can be shown, printed and read."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from alignment.statistics.choices import ChartKind, RuleSet
from db.connection import migrate
from db.queries import Characteristic, Filter, ResultReader, ValueSeries, value_series
from db.records import CycleOutcome, EventRecord, Severity, VehicleRecord
from db.store import ResultStore
from station.quality.reports.choices import ReportKind, SplitBy
from station.quality.reports.make import ReportOptions, make_report
from station.quality.reports.report import Report
from station.quality.reports.values import comparable
from tests.db.example_records import (
    CALIBRATION,
    NOON,
    cycle,
    installation,
    refused_wheel,
    wheel,
    zero,
)
from tests.db.example_records import check as calibration_check
from tests.db.example_records import station as described
from tests.station.quality.conftest import HIGH_DEG, PER_STATION, START, STATIONS

Run = Callable[..., tuple[int, str, str]]
TOE = Characteristic.parse("front_left.toe")


@pytest.fixture
def asked(month: str) -> Callable[..., Report]:
    def ask(kind: ReportKind, where: Filter | None = None, **options: Any) -> Report:
        with ResultReader(month) as reader:
            return make_report(
                reader, kind, where or Filter(), ReportOptions(**options), datetime(2026, 11, 1, tzinfo=UTC)
            )

    return ask


def toe_values(month: str, **chosen: Any) -> np.ndarray:
    with ResultReader(month) as reader:
        return np.degrees(value_series(reader, TOE, Filter(**chosen)).value)


def test_yield_counts_every_cycle_once(asked: Callable[..., Report]) -> None:
    report = asked(ReportKind.YIELD).as_json()
    figures = report["figures"]
    assert figures["cycles"] == 2 * PER_STATION
    assert figures["fault"] == 6
    assert figures["ok"] + figures["nok"] == 2 * PER_STATION - 6
    assert figures["yield_percent"] == pytest.approx(100 * figures["ok"] / (figures["ok"] + figures["nok"]))
    assert figures["wheels_refused_percent"] == pytest.approx(100 * 6 / (4 * PER_STATION))
    rows = report["sections"][0]["rows"]
    for group in ("station", "type", "day"):
        assert sum(row["vehicles"] for row in rows if row["by"] == group) == 2 * PER_STATION


def test_filters_restrict_a_report(asked: Callable[..., Report]) -> None:
    where = Filter(
        from_utc=START,
        until_utc=START + timedelta(days=10),
        stations=(STATIONS[0],),
        vehicle_types=("Kompakt ü",),
    )
    assert asked(ReportKind.YIELD, where).as_json()["figures"]["cycles"] == 20
    assert (
        asked(ReportKind.YIELD, Filter(vehicle_types=("x' OR '1'='1",))).as_json()["figures"]["cycles"] == 0
    )


def test_pareto_ends_at_hundred_percent(asked: Callable[..., Report]) -> None:
    rows = asked(ReportKind.PARETO).as_json()["sections"][0]["rows"]
    assert rows[-1]["cumulative_percent"] == pytest.approx(100.0)
    assert [row["count"] for row in rows] == sorted((row["count"] for row in rows), reverse=True)
    assert {"kind": "refused", "reason": "head_dark", "part": "front_right"}.items() <= rows[
        0
    ].items() | rows[1].items()


def test_capability_is_that_of_the_values(asked: Callable[..., Report], month: str) -> None:
    report = asked(ReportKind.CAPABILITY, characteristics=(TOE,)).as_json()
    values = toe_values(month)
    mean, sigma = values.mean(), values.std(ddof=1)
    figures = report["figures"]
    assert figures["n"] == len(values)
    assert figures["mean_deg"] == pytest.approx(mean, rel=1e-9)
    assert figures["pp"] == pytest.approx(HIGH_DEG / (6 * sigma), rel=1e-9)
    assert figures["ppk"] == pytest.approx(min(mean, HIGH_DEG - mean) / (3 * sigma), rel=1e-9)
    assert figures["ppk_low"] < figures["ppk"] < figures["ppk_high"]
    # The drift of the month is in Pp and not in Cp.
    assert figures["cp"] > 1.1 * figures["pp"]


@pytest.mark.parametrize(("split", "groups"), [(SplitBy.STATION, 2), (SplitBy.DAY, 30)])
def test_capability_of_groups_covers_every_value_once(
    asked: Callable[..., Report], month: str, split: SplitBy, groups: int
) -> None:
    report = asked(ReportKind.CAPABILITY, characteristics=(TOE,), split=split)
    rows = report.as_json()["sections"][0]["rows"]
    assert len({row["group"] for row in rows}) == len(rows) == groups
    assert sum(row["n"] for row in rows) == len(toe_values(month))
    assert [picture.traces[0].name for picture in report.sections[0].pictures] == ["ppk"]


@pytest.mark.parametrize("kind", ChartKind)
def test_charts_flag_the_points_that_their_signals_name(
    asked: Callable[..., Report], month: str, kind: ChartKind
) -> None:
    report = asked(
        ReportKind.CHART, Filter(stations=(STATIONS[0],)), characteristics=(TOE,), chart=kind,
        rules=RuleSet.NELSON, size=4,
    ).as_json()  # fmt: skip
    chart, signals = report["sections"]
    (row,) = chart["rows"]
    assert row["signals"] + row["spread_signals"] == len(signals["rows"]) == report["figures"]["signals"]
    # A drifting process does not stay in control by these rules.
    assert row["signals"] > 0
    assert {signal["rule"] for signal in signals["rows"]} <= set(range(1, 9))
    assert row["centre_deg"] == pytest.approx(
        toe_values(month, stations=(STATIONS[0],)).mean(), abs=1e-9 if PER_STATION % 4 == 0 else 1e-2
    )


def test_limits_of_a_good_period_show_what_changed_since(asked: Callable[..., Report]) -> None:
    where = Filter(stations=(STATIONS[0],), from_utc=START + timedelta(days=10))
    options = {"characteristics": (TOE,), "rules": RuleSet.WESTERN_ELECTRIC}
    own = asked(ReportKind.CHART, where, **options).as_json()
    since = asked(
        ReportKind.CHART, where, **options, limits_from=START, limits_until=START + timedelta(days=10)
    ).as_json()
    (mine,), (theirs,) = (found["sections"][0]["rows"] for found in (own, since))
    assert theirs["centre_deg"] < mine["centre_deg"]
    assert theirs["values"] == mine["values"]
    assert theirs["signals"] > mine["signals"]


def test_types_with_other_limits_or_none_share_a_chart() -> None:
    n = 9
    kinds = np.array(["a", "b", "c"] * 3, dtype=object)
    nominal = np.array([0.01, 0.02, 0.5] * 3)
    spread = np.linspace(-0.001, 0.001, n)
    limited = kinds != "c"
    nothing = np.full(n, None, dtype=object)
    series = ValueSeries(
        TOE, np.arange(n).astype("datetime64[us]"), nominal + spread, np.full(n, 1e-5),
        np.where(limited, nominal - 0.005, np.nan), np.where(limited, nominal + 0.005, np.nan),
        nothing, nothing, kinds, nothing, nothing, nothing,
    )  # fmt: skip
    values, relative = comparable(series)
    assert relative
    assert np.abs(values).max() < np.degrees(0.0011)
    assert values[limited] == pytest.approx(np.degrees(spread[limited]))


def test_the_station_that_reads_more_is_found(asked: Callable[..., Report]) -> None:
    sides, stations = asked(ReportKind.COMPARE).as_json()["sections"]
    (mine,) = [
        row for row in stations["rows"] if (row["characteristic"], row["station"]) == (str(TOE), STATIONS[1])
    ]
    assert mine["low_deg"] < 0.02 < mine["high_deg"]
    assert mine["p"] < 0.01
    (toe,) = [row for row in sides["rows"] if row["angle"] == "toe"]
    assert toe["vehicles"] == 2 * PER_STATION - 6
    assert toe["low_deg"] < -0.005 < toe["high_deg"]


def test_drift_new_calibration_and_temperature_are_told_apart_by_name(asked: Callable[..., Report]) -> None:
    rows = asked(ReportKind.DRIFT, characteristics=(TOE,)).as_json()["sections"][0]["rows"]
    for station in range(2):
        mine = {row["influence"]: row for row in rows if row["station"] == STATIONS[station]}
        assert set(mine) == {"over time", "calibration", "temperature"}
        # 0.0015 degrees a vehicle, two vehicles a day, less the step of the calibration.
        assert mine["over time"]["change"] == pytest.approx(0.003, abs=0.0012)
        assert mine["over time"]["p"] < 0.01
        assert f"cal-{station}-front_left-1" in mine["calibration"]["what"]
        # Half a kelvin a day.
        assert mine["temperature"]["change"] == pytest.approx(2 * mine["over time"]["change"], rel=0.25)


def test_one_vehicle_comes_with_everything_that_explains_it(asked: Callable[..., Report]) -> None:
    report = asked(ReportKind.VIN, Filter(vin="WMONTH00000000041")).as_json()
    found = {section["name"]: section["rows"] for section in report["sections"]}
    assert report["figures"]["cycles"] == 1
    assert {row["angle"] for row in found["angles"]} == {
        f"{wheel}.{angle}" for wheel in ("front_left", "front_right") for angle in ("camber", "toe")
    }
    assert {row["calibration"] for row in found["calibrations"]} == {
        row["calibration"] for row in found["angles"] if row["calibration"]
    }
    assert all(row["code"] == "temperature" for row in found["events"])
    assert set(found) == {
        "cycles", "angles", "lengths", "wheels", "calibrations",
        "checks", "concessions", "zeros", "stations", "events", "images",
    }  # fmt: skip


def test_vehicles_since_the_last_good_check(asked: Callable[..., Report], month: str) -> None:
    report = asked(ReportKind.SINCE_CHECK).as_json()
    checks, rows, doubted = (section["rows"] for section in report["sections"])
    assert doubted == []
    assert {row["in_doubt"] for row in rows} == {False}
    assert [row["station"] for row in checks] == sorted(STATIONS)
    assert sum(row["vehicles"] for row in checks) == len(rows) == len({row["cycle"] for row in rows})
    for station, name in enumerate(STATIONS):
        checked = START + timedelta(days=20, hours=station)
        expected = [
            START + timedelta(days=index // 2, minutes=station + 20 * (index % 2))
            for index in range(PER_STATION)
        ]
        assert len([row for row in rows if row["station"] == name]) == sum(
            time > checked for time in expected
        )
    assert report["figures"]["never_checked"] == 0


@pytest.mark.parametrize("kind", [kind for kind in ReportKind if kind is not ReportKind.VIN])
def test_every_report_on_the_command_line(month: str, run: Run, tmp_path: Path, kind: ReportKind) -> None:
    status, out, err = run("report", kind, "--database", month, "--json")
    assert (status, err) == (0, "")
    assert json.loads(out)["report"] == kind
    status, out, _ = run("report", kind, "--database", month)
    assert status == 0
    assert len(out) > 100


def test_html_holds_its_pictures_and_needs_no_network(month: str, run: Run, tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    status, out, _ = run("report", "all", "--database", month, "--out", path, "--json")
    assert (status, json.loads(out)["files"]) == (0, [str(path)])
    page = path.read_text(encoding="utf-8")
    assert page.count("Plotly.newPlot") > 10
    tags = re.findall(r"<(?:script|link|img|iframe)\b[^>]*>", page)
    assert not [tag for tag in tags if "src=" in tag or "href=" in tag]
    assert "Halle Süd" in page


NASTY = "</script><script>alert(1)</script>&amp;'\"[bold]x"


@pytest.fixture(scope="module")
def hostile(tmp_path_factory: pytest.TempPathFactory) -> str:
    """URL of a database in which everything that somebody typed is markup."""
    url = f"sqlite:///{tmp_path_factory.mktemp('hostile') / 'r.db'}"
    migrate(url)
    with ResultStore(url) as store:
        store.record_calibration(CALIBRATION)
        store.describe_station(
            described(station=NASTY, plant=NASTY, label=NASTY), (), (installation(station=NASTY),)
        )
        store.record_zero(zero(master=NASTY, forced_reason=NASTY))
        store.record_check(calibration_check(reason=NASTY))
        for number in range(6):
            wheels = (wheel("front_left"), wheel("front_right"), refused_wheel(reason_text=NASTY))
            vehicle = VehicleRecord(f"{NASTY}{number}", NASTY)
            store.write_cycle(
                cycle(
                    station=NASTY,
                    vehicle=vehicle,
                    wheels=wheels,
                    outcome=CycleOutcome.FAULT,
                    reason_code=NASTY,
                    reason_text=NASTY,
                )
            )
        store.record_event(EventRecord(NOON, NASTY, Severity.ERROR, NASTY, NASTY, NASTY))
    return url


class _Page(HTMLParser):
    """The text of a page, and its elements that could do something."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.text, self.scripts, self.acting = "", 0, list[str]()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.scripts += tag == "script"
        self.acting += [name for name, _ in attrs if name.startswith("on")] + [tag] * (tag == "bold")

    def handle_data(self, data: str) -> None:
        if self.lasttag != "script":
            self.text += data


@pytest.mark.parametrize("kind", ReportKind)
def test_markup_that_somebody_typed_stays_text(
    hostile: str, run: Run, tmp_path: Path, kind: ReportKind
) -> None:
    """VIN, vehicle type, station, plant, reasons, events, master and database: on every page."""
    path = tmp_path / "r.html"
    chosen = ("--vin", f"{NASTY}1") if kind is ReportKind.VIN else ()
    status, out, _ = run("report", kind, "--database", hostile, *chosen, "--out", path, "--json")
    assert status == 0
    found = _Page(path)
    pictures = path.read_text(encoding="utf-8").count('class="plotly-graph-div"')
    # The program that draws, and each picture's call of it.
    assert found.scripts == (1 + pictures if pictures else 0)
    assert found.acting == []
    assert "<script>alert" not in path.read_text(encoding="utf-8")
    assert NASTY in found.text or NASTY not in out


def test_markup_in_names_is_shown_in_the_terminal_and_on_paper(
    hostile: str, run: Run, tmp_path: Path
) -> None:
    status, out, _ = run("report", "all", "--database", hostile)
    assert status == 0
    assert "<script>alert(1)" in out
    chosen = ("--vin", f"{NASTY}1", "--database", hostile)
    assert run("report", "vin", *chosen, "--out", tmp_path / "r.pdf")[0] == 0


def test_pdf_holds_its_pictures(month: str, run: Run, tmp_path: Path) -> None:
    path = tmp_path / "report.pdf"
    assert run("report", "capability", "--database", month, "--out", path, "--characteristic", TOE)[0] == 0
    assert path.read_bytes().startswith(b"%PDF-")
    assert b"/Subtype /Image" in path.read_bytes()


def test_empty_database_gives_empty_reports(run: Run, tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'r.db'}"
    assert run("db", "migrate", "--database", url)[0] == 0
    status, out, err = run("report", "all", "--database", url, "--out", tmp_path / "r.html", "--json")
    assert (status, err) == (0, "")
    assert json.loads(out)["figures"]["cycles"] == 0
    assert run("report", "all", "--database", url, "--out", tmp_path / "r.pdf")[0] == 0


def test_shift_of_the_plant_clock(month: str, run: Run) -> None:
    def cycles(*shift: str) -> int:
        status, out, _ = run(
            "report",
            "yield",
            "--database",
            month,
            "--json",
            "--from",
            "2026-10-01",
            "--until",
            "2026-11-01",
            *shift,
        )
        assert status == 0
        found: int = json.loads(out)["figures"]["cycles"]
        return found

    # All vehicles come between 04:00 and 04:21 UTC, which is 06:00 in Berlin until the clock goes back.
    assert cycles() == 2 * PER_STATION
    assert cycles("--shift", "06:00-14:00") == 0
    assert cycles("--shift", "22:00-05:00") == 2 * PER_STATION
    assert 0 < cycles("--shift", "06:00-14:00", "--timezone", "Europe/Berlin") < 2 * PER_STATION


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["vin"], "--vin"),
        (["vin", "--vin", "NOBODY"], "NOBODY"),
        (["capability", "--characteristic", "toe"], "characteristic"),
        (["capability", "--characteristic", "front_left.width"], "front_left.width"),
        (["yield", "--out", "r.docx"], ".html or .pdf"),
        (["yield", "--out", "/nowhere/r.html"], "/nowhere"),
        (["yield", "--from", "2026-11-02", "--until", "2026-11-01"], "until"),
        (["everything"], "everything"),
        (["chart", "--rules", "mine"], "mine"),
        (["chart", "--limits-from", "2026-10-01"], "--limits-until"),
    ],
)
def test_wrong_use_ends_with_status_2(month: str, run: Run, arguments: list[str], said: str) -> None:
    status, out, err = run("report", *arguments, "--database", month, "--json")
    assert (status, out) == (2, "")
    assert said in err
    assert "Traceback" not in err
