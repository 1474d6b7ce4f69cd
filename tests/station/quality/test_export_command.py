"""`truewheel export` from a database: files that others read, and filters that choose."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from uuid import UUID

import pyarrow.parquet as pq
import pytest

from db.queries import Characteristic
from db.records import StudyKind
from station.quality.gauge.store import plan_study
from tests.station.quality.conftest import PER_STATION, STATIONS

Run = Callable[..., tuple[int, str, str]]


def test_every_format_holds_every_angle(month: str, run: Run, tmp_path: Path) -> None:
    status, out, err = run("export", "csv", "--database", month, "--out", tmp_path / "r.csv", "--json")
    assert (status, err) == (0, "")
    rows = json.loads(out)["figures"]["rows"]
    assert rows == 2 * PER_STATION * 2 * 2
    with (tmp_path / "r.csv").open(newline="", encoding="utf-8") as stream:
        lines = list(csv.DictReader(stream))
    assert {line["station"] for line in lines} == set(STATIONS)
    run("export", "parquet", "--database", month, "--out", tmp_path / "r.parquet")
    table = pq.read_table(tmp_path / "r.parquet")
    assert table.column("vin").to_pylist() == [line["vin"] for line in lines]
    status, out, _ = run("export", "aqdef", "--database", month, "--out", tmp_path / "r.dfq", "--json")
    refused = sum(1 for line in lines if line["outcome"] == "refused")
    assert json.loads(out)["figures"] == {"parts": 2, "characteristics": 8, "values": rows - refused}


def test_filters_choose(month: str, run: Run, tmp_path: Path) -> None:
    status, out, _ = run(
        "export", "csv", "--database", month, "--out", tmp_path / "r.csv", "--json", "--station", STATIONS[0],
        "--wheel", "front_left", "--from", "2026-10-11", "--until", "2026-10-21",
    )  # fmt: skip
    assert status == 0
    assert json.loads(out)["figures"]["rows"] == 2 * 20
    status, out, _ = run(
        "export",
        "csv",
        "--database",
        month,
        "--out",
        tmp_path / "r.csv",
        "--json",
        "--vin",
        "'; DROP TABLE cycles;--",
    )
    # Nobody has such a VIN; and that the table is there still, the next question shows.
    assert (status, out) == (2, "")
    assert run("db", "check", "--database", month)[0] == 0
    status, out, _ = run(
        "export", "csv", "--database", month, "--out", tmp_path / "r.csv", "--json", "--vin", "WMONTH*1"
    )
    assert json.loads(out)["figures"]["rows"] == 12 * 4


def test_certificates_of_a_vehicle_and_of_a_study(month: str, run: Run, tmp_path: Path) -> None:
    status, out, err = run(
        "export",
        "certificate",
        "--database",
        month,
        "--vin",
        "WMONTH00000000001",
        "--out",
        tmp_path / "v.pdf",
        "--json",
    )
    assert (status, err) == (0, "")
    assert json.loads(out)["figures"] == {"cycles": 1}
    assert (tmp_path / "v.pdf").read_bytes().startswith(b"%PDF-")
    # Without a VIN it is the newest vehicle's.
    status, out, err = run(
        "export", "certificate", "--database", month, "--out", tmp_path / "n.pdf", "--json"
    )
    assert (status, err) == (0, "")
    assert json.loads(out)["cycle"] == str(UUID(int=2 * PER_STATION))


def test_certificate_of_a_study_from_a_file(run: Run, tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'r.db'}"
    assert run("db", "migrate", "--database", url)[0] == 0
    values = tmp_path / "v.csv"
    values.write_text(
        "part,trial,value\n" + "".join(f"P{p},{t},{p + 0.01 * t}\n" for p in range(8) for t in (1, 2, 3))
    )
    assert run("gauge", "grr", "--from-file", values, "--database", url, "--name", "Prüfung 1")[0] == 0
    status, out, err = run(
        "export",
        "certificate",
        "--database",
        url,
        "--study",
        "Prüfung 1",
        "--out",
        tmp_path / "s.pdf",
        "--json",
    )
    assert (status, err) == (0, "")
    assert json.loads(out)["figures"]["ndc"] > 5
    assert (tmp_path / "s.pdf").read_bytes().count(b"/Subtype /Image") >= 2
    plan_study(url, StudyKind.GRR, "empty", Characteristic.parse("front_left.toe"), ("A", "B"))
    status, out, err = run(
        "export", "certificate", "--database", url, "--study", "empty", "--out", tmp_path / "e.pdf"
    )
    assert (status, out) == (2, "")
    assert "empty" in err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["aqdef", "--out", "r.txt"], ".dfq"),
        (["aqdef", "--out", "r.dfq", "--encoding", "ebcdic"], "--encoding"),
        (["csv", "--out", "r.csv", "--from", "yesterday"], "--from"),
        (["csv", "--out", "r.csv", "--shift", "early"], "--shift"),
        (["csv", "--out", "r.csv", "--shift", "06:00-14:00", "--timezone", "Mars/Olympus"], "timezone"),
        (["csv", "--out", "r.csv", "--verdict", "perhaps"], "--verdict"),
        (["csv", "--out", "/nowhere/r.csv"], "/nowhere"),
        (["certificate", "--out", "r.pdf", "--vin", "X", "--study", "Y"], "--vin, --study"),
        (["certificate", "--out", "r.pdf", "--vin", "NOBODY"], "NOBODY"),
        (["certificate", "--out", "r.pdf", "--vin", "X", "--cycle", "7"], "--cycle"),
        (["certificate", "--out", "r.pdf", "--study", "none"], "gauge list"),
        (["excel", "--out", "r.xls"], "excel"),
    ],
)
def test_wrong_use_ends_with_status_2_and_leaves_nothing(
    month: str, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], said: str
) -> None:
    monkeypatch.chdir(tmp_path)
    status, out, err = run("export", *arguments, "--database", month, "--json")
    assert (status, out) == (2, "")
    assert said in err
    assert "Traceback" not in err
    assert list(tmp_path.iterdir()) == []


def test_database_that_is_not_there_is_said(run: Run, tmp_path: Path) -> None:
    status, out, err = run(
        "export", "csv", "--database", f"sqlite:///{tmp_path}/x.db", "--out", tmp_path / "r.csv"
    )
    assert status in (2, 3)
    assert out == ""
    assert "x.db" in err
