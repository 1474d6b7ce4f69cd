"""What a failed master check left: listed in every form, shown beside each verdict, answered for by name."""

from __future__ import annotations

import csv
import json
from datetime import timedelta
from pathlib import Path
from typing import Any

import pypdf
import pytest

from db.records import CalibrationRecord, CheckKind, CheckOutcome, VehicleRecord
from db.store import ResultStore
from db.upkeep.doubting import MasterBook
from station.cli import main
from tests.db.example_records import NOON, WHEELS, axle, check, cycle, installation, station, wheel

MINUTE = timedelta(minutes=1)
VIN, OTHER = "WVWZZZ1KZAW000001", "WVWZZZ1KZAW000002"


@pytest.fixture
def url(tmp_path: Path) -> str:
    """Two vehicles in doubt for their left front wheel, after a good check and a failed one."""
    address = f"sqlite:///{tmp_path / 'results.db'}"
    used = {rig: f"cal-{rig}" for rig in WHEELS}
    with ResultStore(address, create=True) as store:
        for rig, identity in used.items():
            store.record_calibration(CalibrationRecord(identity, rig, NOON, {}))
        store.describe_station(
            station(rigs=WHEELS), (),
            [installation(rig=rig, calibration_id=identity) for rig, identity in used.items()],
        )  # fmt: skip
        checks = [
            check(used["front_left"], utc=NOON + at * MINUTE, kind=CheckKind.MASTER_WHEEL, outcome=outcome,
                  reason=f"front_left: master M-17 is {outcome}")
            for at, outcome in ((1, CheckOutcome.WITHIN), (9, CheckOutcome.OUT))
        ]  # fmt: skip
        store.record_check(checks[0])
        for at, vin in ((2, VIN), (3, OTHER)):
            store.write_cycle(
                cycle(
                    received_utc=NOON + at * MINUTE,
                    vehicle=VehicleRecord(vin, "compact"),
                    wheels=tuple(wheel(rig, calibration_id=used[rig]) for rig in WHEELS),
                    axles=(axle("front"), axle("rear")),
                )
            )
        store.record_check(checks[1])
        assert MasterBook(store, "EOL-1", used).settle(NOON + 10 * MINUTE).doubted == (VIN, OTHER)
    return address


def said(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str]:
    with pytest.raises(SystemExit) as end:
        main(list(arguments))
    out = capsys.readouterr()
    return int(end.value.code or 0), out.out + out.err


def report(capsys: pytest.CaptureFixture[str], url: str, *more: str) -> dict[str, Any]:
    status, text = said(capsys, "report", *more, "--database", url, "--json")
    assert status == 0, text
    found = json.loads(text)
    # A table of the same name as its figure is what is asked for here.
    return found["figures"] | {section["name"]: section["rows"] for section in found["sections"]}


def release(capsys: pytest.CaptureFixture[str], url: str, *more: str) -> tuple[int, str]:
    asked = ["master", "release", "--database", url, "--station", "EOL-1"]
    return said(capsys, *asked, "--person", "A. Example", "--reason", "measured again", *more)


def test_the_report_lists_them_on_the_terminal_and_as_json(
    url: str, capsys: pytest.CaptureFixture[str]
) -> None:
    found = report(capsys, url, "since-check")
    assert found["vehicles_in_doubt"] == 2
    assert {(row["vin"], row["in_doubt"]) for row in found["since_check"]} == {(VIN, True), (OTHER, True)}
    assert {(row["wheel"], row["doubt"], row["person"]) for row in found["doubted"]} == {
        ("front_left", "in doubt", None)
    }
    status, text = said(capsys, "report", "since-check", "--database", url)
    assert status == 0
    assert "Vehicles in doubt after a failed master check" in text
    assert "in doubt" in text
    assert report(capsys, url, "since-check", "--vin", OTHER)["vehicles_in_doubt"] == 1


def test_the_page_and_the_paper_list_them(
    url: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page, paper = tmp_path / "doubted.html", tmp_path / "doubted.pdf"
    for out in (page, paper):
        assert said(capsys, "report", "since-check", "--database", url, "--out", str(out))[0] == 0
    text = page.read_text(encoding="utf-8")
    assert "Vehicles in doubt after a failed master check" in text
    assert VIN in text
    pages = "".join(each.extract_text() for each in pypdf.PdfReader(paper).pages)
    assert "in doubt" in pages


def test_the_doubt_stands_beside_the_verdict_of_a_vehicle(
    url: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert release(capsys, url, "--vin", OTHER)[0] == 0
    found = report(capsys, url, "vin", "--vin", VIN)
    assert [row["doubt"] for row in found["cycles"]] == ["front_left: in doubt"]
    by_angle = {row["angle"]: (row["doubt"], row["verdict"]) for row in found["angles"]}
    assert by_angle["front_left.toe"] == ("in doubt", "ok")
    assert by_angle["front.total_toe"][0] == "in doubt"
    assert by_angle["rear.total_toe"][0] is None
    assert by_angle["front_right.toe"][0] is None
    table, values, paper = tmp_path / "r.csv", tmp_path / "r.dfq", tmp_path / "r.pdf"
    said(capsys, "export", "csv", "--database", url, "--out", str(table))
    with table.open(newline="", encoding="utf-8") as stream:
        doubts = {(row["vin"], row["part"]): row["doubt"] for row in csv.DictReader(stream)}
    assert (doubts[VIN, "front_left"], doubts[VIN, "rear_left"]) == ("in doubt", "")
    assert doubts[OTHER, "front_left"] == "released by A. Example"
    said(capsys, "export", "aqdef", "--database", url, "--out", str(values))
    assert "verdict=ok; in doubt" in values.read_text(encoding="utf-8-sig")
    for vin, words in ((VIN, "in doubt since"), (OTHER, "released by A. Example")):
        said(capsys, "export", "certificate", "--database", url, "--vin", vin, "--out", str(paper))
        text = " ".join("".join(each.extract_text() for each in pypdf.PdfReader(paper).pages).split())
        assert words in text
        assert "M-17" in text


def test_a_person_answers_for_them(url: str, capsys: pytest.CaptureFixture[str]) -> None:
    status, text = release(capsys, url)
    assert (status, text.strip()) == (0, f"released 2 vehicles of EOL-1: {VIN}, {OTHER}")
    found = report(capsys, url, "since-check")
    assert found["vehicles_in_doubt"] == 0
    assert {(row["person"], row["closed_because"]) for row in found["doubted"]} == {
        ("A. Example", "measured again")
    }
    # Nothing is left to answer for.
    status, text = release(capsys, url)
    assert status == 2
    assert "vehicles in doubt" in text


def test_a_release_as_json(url: str, capsys: pytest.CaptureFixture[str]) -> None:
    status, text = release(capsys, url, "--json", "--vin", VIN)
    assert status == 0
    assert json.loads(text) == {"station": "EOL-1", "released": [VIN], "figures": {"vehicles": 1}}


@pytest.mark.parametrize(
    ("option", "value"), [("--person", "  "), ("--reason", ""), ("--station", "EOL-7"), ("--vin", "NONE")]
)
def test_a_release_that_nobody_answers_for_is_refused_with_one_error(
    url: str, capsys: pytest.CaptureFixture[str], option: str, value: str
) -> None:
    status, text = release(capsys, url, option, value)
    assert status == 2
    assert len(text.strip().splitlines()) == 1
    assert option in text
    assert report(capsys, url, "since-check")["vehicles_in_doubt"] == 2
