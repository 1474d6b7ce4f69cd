"""Reports as they are looked at: on paper, in wide and narrow windows, printed there; with long names."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from uuid import UUID

import numpy as np
import pytest
from pypdf import PdfReader

from db.connection import migrate
from db.queries import Filter, ResultReader
from db.records import CalibrationRecord, CycleOutcome, VehicleRecord, Verdict
from db.store import ResultStore
from station.pages import page
from station.quality.reports.choices import ReportKind
from station.quality.reports.make import ReportOptions, make_report, write_report
from station.quality.reports.report import Report
from tests.browser import asked, printed
from tests.db.example_records import WHEELS, axle, cycle, refused_wheel, wheel

START = datetime(2026, 11, 2, 4, tzinfo=UTC)
MADE = datetime(2026, 11, 30, 12, tzinfo=UTC)
A4_PX = 794  # width of a sheet in pixels of a style sheet
STATION = "Achsvermessung-Halle-Sued-Linie-2-Platz-1"
KINDS = ("Golf_Variant_GTI_Clubsport_2026_Facelift", "X" * 40)
VIN = "WVWZZZ1JZXW{:06d}-PROTOTYP-0000000000000"
Ask = Callable[..., Report]


def fill(path: Path, vehicles: int, station: str, kinds: tuple[str, ...], vin: str) -> str:
    """A database of a morning: one vehicle refused, a new calibration in the middle."""
    url = f"sqlite:///{path}"
    migrate(url)
    rng = np.random.default_rng(5)
    with ResultStore(url) as store:
        for name in WHEELS:
            for number in range(2):
                store.record_calibration(
                    CalibrationRecord(f"{station}-{name}-{number}", name, START, {"schema": "calibration"})
                )
        for number in range(vehicles):
            wheels = [
                wheel(
                    name, toe=math.radians(rng.normal(0.1, 0.03)), toe_low=0.0, toe_high=math.radians(0.2),
                    camber=math.radians(rng.normal(-0.5, 0.06)), verdict=Verdict.OK,
                    calibration_id=f"{station}-{name}-{int(number >= vehicles // 2)}",
                )
                for name in WHEELS
            ]  # fmt: skip
            outcome = CycleOutcome.OK
            if number == 3:
                reason = "head 2 sees no light: clean its window, look at the lamp and measure again"
                wheels[2], outcome = refused_wheel(reason_text=reason), CycleOutcome.FAULT
            time = START + timedelta(minutes=3 * number)
            store.write_cycle(
                cycle(
                    UUID(int=number + 1), station=station, received_utc=time, measured_utc=time,
                    vehicle=VehicleRecord(vin.format(number), kinds[number % len(kinds)]),
                    outcome=outcome, reason_code=None if outcome is CycleOutcome.OK else "refused",
                    reason_text=None if outcome is CycleOutcome.OK else "a wheel was refused",
                    wheels=tuple(wheels), axles=(axle("front"),),
                    config_hash="sha256:9f86d081884c7d659a2feaa0c55ad015a3bf4f1b",
                )
            )  # fmt: skip
    return url


def report_of(url: str, kind: ReportKind, vin: str | None = None) -> Report:
    with ResultReader(url) as reader:
        return make_report(reader, kind, Filter(vin=vin), ReportOptions(), MADE)


@pytest.fixture(scope="module")
def ten(tmp_path_factory: pytest.TempPathFactory) -> str:
    return fill(tmp_path_factory.mktemp("ten") / "r.db", 10, "station_1", ("Compact",), "WVWZZZ1JZXW{:06d}")


@pytest.fixture(scope="module")
def long_names(tmp_path_factory: pytest.TempPathFactory) -> str:
    return fill(tmp_path_factory.mktemp("long") / "r.db", 12, STATION, KINDS, VIN)


@pytest.fixture(scope="module")
def page_of_all(long_names: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of everything, as a page."""
    path = tmp_path_factory.mktemp("page") / "r.html"
    write_report(path, report_of(long_names, ReportKind.ALL))
    return path


def test_ten_vehicles_fit_on_three_sheets(ten: str, tmp_path: Path) -> None:
    """They took seventeen: a picture over the width of the page for every angle, and again for its spread."""
    write_report(tmp_path / "r.pdf", report_of(ten, ReportKind.ALL))
    pages = PdfReader(tmp_path / "r.pdf").pages
    assert len(pages) <= 3
    for number, sheet in enumerate(pages, start=1):
        text = sheet.extract_text()
        assert f"{number} of {len(pages)}" in text
        assert "Quality report" in text


def test_no_name_is_broken_on_paper(long_names: str, tmp_path: Path) -> None:
    for kind, vin in (
        (ReportKind.YIELD, None),
        (ReportKind.SINCE_CHECK, None),
        (ReportKind.VIN, VIN.format(3)),
    ):
        write_report(tmp_path / f"{kind}.pdf", report_of(long_names, kind, vin))
        pages = PdfReader(tmp_path / f"{kind}.pdf").pages
        text = " ".join(sheet.extract_text() for sheet in pages).split()
        for word in (STATION, *({VIN.format(3)} if kind is not ReportKind.YIELD else KINDS)):
            assert word in text


def test_one_day_is_a_line_of_the_table_and_no_picture(ten: str) -> None:
    """A single bar filled the width of the page, and a mean of one day was a point in an empty frame."""
    sections = {section.name: section for section in report_of(ten, ReportKind.ALL).sections}
    assert not sections["yield"].pictures
    assert not sections["drift"].pictures
    assert len(sections["capability"].pictures) == 8


@pytest.mark.parametrize("ending", ["html", "pdf"])
def test_an_empty_period_says_what_there_is_not(tmp_path: Path, ending: str) -> None:
    url = f"sqlite:///{tmp_path / 'r.db'}"
    migrate(url)
    path = tmp_path / f"r.{ending}"
    write_report(path, report_of(url, ReportKind.ALL))
    text = path.read_text(encoding="utf-8") if ending == "html" else "\n".join(
        sheet.extract_text() for sheet in PdfReader(path).pages
    )  # fmt: skip
    for said in ("No angle out of limits", "No characteristic with limits", "No vehicle was measured since"):
        assert said in text
    assert "Nothing." not in text


def test_the_page_keeps_words_whole_and_heads_on_every_sheet(long_names: str, tmp_path: Path) -> None:
    path = tmp_path / "r.html"
    write_report(path, report_of(long_names, ReportKind.VIN, VIN.format(3)))
    written = path.read_text(encoding="utf-8")
    [style] = re.findall(r"<style>(.*?)</style>", written, re.DOTALL)
    assert "word-break" not in style
    assert "hyphens" not in style
    assert "table-header-group" in style
    assert "size: A4" in style
    assert "url(" not in style
    assert written.count("<thead>") == written.count("<table>") == 4


def test_a_title_in_the_style_sheet_ends_nothing(ten: str, tmp_path: Path) -> None:
    text = page(
        "station.quality.reports", "report.html", title='a"}</style>\\',
        report=report_of(ten, ReportKind.YIELD), program="", shown=lambda *_: "", heading=str,
        numbers_of=lambda _: [], drawn=str, longest_table=1, longest_line=1,
    )  # fmt: skip
    assert text.count("</style>") == 1
    [style] = re.findall(r"<style>(.*?)</style>", text, re.DOTALL)
    assert '"a\\22 \\7d \\3c \\2f style\\3e \\5c "' in style


WIDE = """[root.scrollWidth, root.clientWidth,
  [...document.querySelectorAll('body *')].filter((e) => !e.closest('.frame, svg')
    && e.getBoundingClientRect().right > root.clientWidth + 1).map((e) => e.tagName).slice(0, 5),
  [...document.querySelectorAll('.frame')].filter((e) => e.scrollWidth > e.clientWidth + 1).length]"""


@pytest.mark.parametrize(("kind", "width"), [("all", 1280), ("all", 700), ("vin", A4_PX), ("vin", 1280)])
def test_nothing_is_wider_than_the_window(
    page_of_all: Path, long_names: str, tmp_path: Path, kind: str, width: int
) -> None:
    """Tables and pictures ran over the right edge."""
    path = page_of_all
    if kind == "vin":
        path = tmp_path / "r.html"
        write_report(path, report_of(long_names, ReportKind.VIN, VIN.format(3)))
    scroll, client, beyond, _ = asked(path, tmp_path, width, WIDE)
    assert scroll <= client
    assert beyond == []


def test_a_usual_report_needs_no_scrolling_at_all(ten: str, tmp_path: Path) -> None:
    path = tmp_path / "r.html"
    write_report(path, report_of(ten, ReportKind.VIN, "WVWZZZ1JZXW000003"))
    assert asked(path, tmp_path, 1280, WIDE)[3] == 0


def test_a_printed_page_has_whole_words_numbers_and_its_pictures(page_of_all: Path, tmp_path: Path) -> None:
    """Pictures were as wide as the window had been, and wide tables ended at the edge of the sheet."""
    printed(page_of_all, tmp_path / "p.pdf")
    reader = PdfReader(tmp_path / "p.pdf")
    width, height = (float(value) for value in reader.pages[0].mediabox[2:])
    assert (width, height) == (pytest.approx(595, abs=2), pytest.approx(842, abs=2))
    texts = [sheet.extract_text() for sheet in reader.pages]
    for number, text in enumerate(texts, start=1):
        assert f"{number} of {len(texts)}" in text
    assert all("Quality report" in text for text in texts)
    assert STATION in " ".join(texts).split()
    assert _rightmost(reader) < width


def _rightmost(reader: PdfReader) -> float:
    """Where the text furthest to the right begins, points."""
    found = [0.0]

    def look(said: str, cm: list[float], matrix: list[float], *_: object) -> None:
        if said.strip():
            found.append(cm[0] * matrix[4] + cm[4])

    for sheet in reader.pages:
        sheet.extract_text(visitor_text=look)
    return max(found)
