"""`truewheel concession`: who answers for a vehicle that is not ok, and what is shown of it afterwards."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest

from db.store import ResultStore
from station.cli import main
from tests.db.example_records import CALIBRATION, bad_vehicle, cycle

Run = Callable[..., "Ended"]
VIN = "TRUEWHEEL00000077"
REASON = "goes to the test track, not to a customer"


@pytest.fixture
def database(tmp_path: Path) -> str:
    url = f"sqlite:///{tmp_path / 'results.db'}"
    with ResultStore(url, create=True) as store:
        store.record_calibration(CALIBRATION)
        store.write_cycle(bad_vehicle())
        store.write_cycle(cycle())
    return url


class Ended(NamedTuple):
    exit_code: int
    stdout: str
    stderr: str


@pytest.fixture
def run(database: str, capsys: pytest.CaptureFixture[str]) -> Run:
    def call(*words: str) -> Ended:
        with pytest.raises(SystemExit) as ended:
            main([*words, "--database", database])
        assert isinstance(ended.value.code, int)
        return Ended(ended.value.code, *capsys.readouterr())

    return call


def granted(run: Run, **changes: str) -> Ended:
    said = {"vin": VIN, "person": "A. Example", "reason": REASON} | changes
    return run("concession", "grant", *(x for k, v in said.items() for x in (f"--{k}", v)))


def test_a_released_vehicle_shows_who_answers_for_it_beside_its_verdict(run: Run, tmp_path: Path) -> None:
    done = granted(run)
    assert done.exit_code == 0, done.output
    assert done.stdout.startswith(f"{VIN} is released by A. Example, concession ")
    assert "front left toe +1.1459° (−0.2000° to +0.2000°)" in done.stdout
    listed = run("concession", "list", "--vin", VIN).stdout
    assert f"A. Example: {REASON}" in listed
    report = run("report", "vin", "--vin", VIN, "--json").stdout
    sections = json.loads(report)
    text = json.dumps(sections, ensure_ascii=False)
    assert "A. Example" in text
    assert '"result": "nok"' in text
    table = tmp_path / "out.csv"
    assert run("export", "csv", "--out", str(table)).exit_code == 0
    rows = list(csv.DictReader(table.read_text(encoding="utf-8").splitlines()))
    told = {(row["vin"], row["cycle_outcome"], row["concession_person"]) for row in rows}
    assert told == {(VIN, "nok", "A. Example"), ("TRUEWHEEL00000001", "ok", "")}


def test_a_release_that_was_taken_back_is_shown_as_such(run: Run) -> None:
    granted(run)
    (found,) = json.loads(run("concession", "list", "--vin", VIN, "--json").stdout)["concessions"]
    ended = run(
        "concession", "withdraw", found["concession"], "--person", "B. Example",
        "--reason", "it was another vehicle",
    )  # fmt: skip
    assert ended.exit_code == 0, ended.output
    listed = run("concession", "list", "--vin", VIN).stdout
    assert "by B. Example: it was another vehicle]" in listed
    assert granted(run, person="C. Example").exit_code == 0


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"vin": "NOBODY"}, "no cycle of 'NOBODY'"),
        ({"person": "  "}, "a name with letters"),
        ({"person": "17"}, "a name with letters"),
        ({"reason": " - "}, "a sentence"),
        ({"vin": "TRUEWHEEL00000001"}, "with the result ok"),
        ({"cycle": "x"}, "a UUID"),
        ({"cycle": "00000000-0000-0000-0000-000000000001"}, "no cycle 00000000-0000-0000-0000-000000000001"),
    ],
)
def test_a_concession_that_nobody_could_stand_by_is_refused(
    run: Run, database: str, changes: dict[str, str], expected: str
) -> None:
    done = granted(run, **changes)
    assert (done.exit_code, done.stdout) == (2, "")
    assert expected in done.stderr
    with ResultStore(database) as store:
        assert store.counts()["concessions"] == 0
