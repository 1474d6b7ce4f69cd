"""The same results give the same reports on SQLite and PostgreSQL; the guide's commands work as written."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from benchmarks.postgres_server import PostgresServer
from tests.station.quality.conftest import write_month

Run = Callable[..., tuple[int, str, str]]
GUIDE = Path(__file__).resolve().parents[3] / "docs" / "quality.md"


@pytest.fixture
def postgres_month(postgres_server: PostgresServer) -> Iterator[str]:
    with postgres_server.database() as url:
        write_month(url)
        yield url


def sections(run: Run, database: str, *arguments: str) -> Any:
    status, out, err = run("report", *arguments, "--database", database, "--json")
    assert (status, err) == (0, "")
    found = json.loads(out)
    for section in found["sections"]:
        for row in section["rows"]:
            # When it was stored differs.
            row.pop("stored", None)
    return found["figures"], found["sections"]


@pytest.mark.slow
def test_reports_of_both_databases_agree(month: str, postgres_month: str, run: Run) -> None:
    for arguments in (
        ("all",),
        ("capability", "--from", "2026-10-05", "--until", "2026-10-20", "--station", "Halle Süd"),
        ("chart", "--chart", "xbar-s", "--rules", "western-electric"),
        ("yield", "--vin", "WMONTH*1"),
        ("vin", "--vin", "WMONTH00000000041"),
    ):
        figures, parts = sections(run, month, *arguments)
        other_figures, other_parts = sections(run, postgres_month, *arguments)
        assert other_figures == pytest.approx(figures, rel=1e-9)
        assert [part["name"] for part in other_parts] == [part["name"] for part in parts]
        for part, other in zip(parts, other_parts, strict=True):
            for row, other_row in zip(part["rows"], other["rows"], strict=True):
                numbers = {name: cell for name, cell in row.items() if isinstance(cell, float)}
                others = {name: other_row[name] for name in numbers}
                assert others == pytest.approx(numbers, rel=1e-7, abs=1e-12)
                assert other_row | numbers == row


@pytest.mark.slow
def test_commands_of_the_guide_work_as_written(
    month: str, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    commands = re.findall(
        r"^    truewheel (report|export) ([^\n#]+)", GUIDE.read_text(encoding="utf-8"), re.MULTILINE
    )
    assert len(commands) >= 10
    for verb, rest in commands:
        if "--study" in rest:
            continue
        text = rest.replace("URL", month).replace("sqlite:///results.db", month)
        text = text.replace("WVWZZZ1JZXW000001", "WMONTH00000000041").replace("Compact", "'Kompakt ü'")
        text = text.replace("station_1", "'Halle Süd'").replace("rear.total_toe", "front_left.toe")
        status, _, err = run(verb, *shlex.split(text))
        assert (status, err) == (0, ""), rest
    assert {"report.html", "results.dfq", "results.dfd", "results.dfx", "certificate.pdf"} <= {
        file.name for file in tmp_path.iterdir()
    }


@pytest.mark.slow
def test_gauge_study_lives_on_the_server_too(
    postgres_server: PostgresServer, run: Run, tmp_path: Path
) -> None:
    file = tmp_path / "v.csv"
    file.write_text(
        "part,appraiser,trial,value\n"
        + "".join(f"Ä{p},{who},{t},{p + 0.01 * t}\n" for p in range(5) for who in "AB" for t in (1, 2))
    )
    with postgres_server.database() as url:
        assert run("db", "migrate", "--database", url)[0] == 0
        status, out, err = run(
            "gauge", "grr", "--from-file", file, "--database", url, "--name", "Prüfung", "--json"
        )
        assert (status, err) == (0, "")
        first = json.loads(out)
        again = json.loads(run("gauge", "grr", "--study", "Prüfung", "--database", url, "--json")[1])
        assert again["figures"] == first["figures"]
        status, out, _ = run(
            "gauge", "plan", "grr", "--database", url, "--name", "live", "--characteristic", "front_left.toe",
            "--part", "A", "--part", "B", "--json",
        )  # fmt: skip
        assert (status, len(json.loads(out)["order"])) == (0, 6)
        status, out, _ = run("gauge", "fill", "live", "--database", url, "--json")
        assert (status, json.loads(out)["added"]) == (1, 0)
        status, out, _ = run(
            "export", "certificate", "--study", "Prüfung", "--database", url, "--out", tmp_path / "s.pdf"
        )
        assert status == 0
