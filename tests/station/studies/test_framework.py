"""What every study leaves behind, and what the command says of it."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from alignment.errors import ConfigurationError, DegenerateInputError
from station.cli import main
from station.figures import Goal, Progress, Study, StudyResult, write_study
from station.studies import registry
from station.studies.registry import STUDIES, load_study


def result(value: float) -> StudyResult:
    return StudyResult(
        rows=({"method": "a", "error_mm": 0.5}, {"method": "b", "error_mm": None}),
        figures={"error_mm": value, "sets": 3.0},
        goals=(Goal("error_mm", "at_most", 1.0), Goal("error_mm", "at_least", 0.1)),
        text="Done thus.",
        plots={"errors": Figure(figsize=(1, 1))},
    )


def a_study(value: float = 0.5) -> Study:
    def run(seed: int, quick: bool, progress: Progress) -> StudyResult:
        progress(0.5, "half")
        return result(value)

    return Study("example", "Shows nothing.", run)


@pytest.fixture
def registered(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    def register(**studies: Study) -> None:
        monkeypatch.setattr(registry, "STUDIES", dict.fromkeys(studies, ""))
        monkeypatch.setattr("station.commands.study.STUDIES", dict.fromkeys(studies, ""))
        monkeypatch.setattr("station.studies.load_study", studies.__getitem__)

    return register


def run(*arguments: str) -> int:
    with pytest.raises(SystemExit) as ended:
        main(["study", *arguments])
    return int(ended.value.code or 0)


@pytest.mark.parametrize(
    ("value", "missed"), [(0.5, 0), (1.0, 0), (1.01, 1), (0.05, 1), (math.nan, 2), (math.inf, 1)]
)
def test_goals(value: float, missed: int) -> None:
    assert len(result(value).missed) == missed


def test_table_plot_and_text_are_written(tmp_path: Path) -> None:
    files = write_study(a_study(), result(2.0), tmp_path / "new" / "folder")
    assert [file.name for file in files] == ["example.csv", "errors.png", "example.md"]
    with files[0].open(encoding="utf-8") as stream:
        assert list(csv.DictReader(stream)) == [
            {"method": "a", "error_mm": "0.5"},
            {"method": "b", "error_mm": ""},
        ]
    text = files[2].read_text(encoding="utf-8")
    assert "| error_mm | 2 | ≤ 1 and ≥ 0.1 | **no** |" in text
    assert "![errors](errors.png)" in text
    assert files[1].read_bytes().startswith(b"\x89PNG")


def test_command_prints_figures_as_one_object(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], registered: Callable[..., None]
) -> None:
    registered(example=a_study())
    assert run("example", "--out", str(tmp_path), "--seed", "4", "--quick", "--json") == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["figures"] == {"error_mm": 0.5, "sets": 3.0}
    assert (printed["study"], printed["seed"], printed["quick"]) == ("example", 4, True)
    assert [goal["met"] for goal in printed["goals"]] == [True, True]
    assert all(Path(file).is_file() for file in printed["files"])


def test_missed_goal_ends_with_status_1(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], registered: Callable[..., None]
) -> None:
    registered(example=a_study(math.nan))
    assert run("example", "--out", str(tmp_path), "--json") == 1
    assert json.loads(capsys.readouterr().out)["figures"]["error_mm"] is None
    assert run("example", "--out", str(tmp_path)) == 1
    assert "goal ≤ 1: MISSED" in capsys.readouterr().out


def test_all_goes_on_after_a_failure_and_reports_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], registered: Callable[..., None]
) -> None:
    def fail(seed: int, quick: bool, progress: Progress) -> StudyResult:
        raise DegenerateInputError(expected="a table", seen="none")

    registered(broken=Study("broken", "", fail), example=a_study())
    assert run("all", "--out", str(tmp_path), "--json") == 2
    out, err = capsys.readouterr()
    assert json.loads(out)["studies"]["example"]["figures"]["error_mm"] == 0.5
    assert "expected a table" in err
    assert (tmp_path / "example" / "example.csv").is_file()


def test_unknown_study_is_bad_input_and_names_the_known(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("nonsense", "--out", "nowhere") == 2
    assert "correction" in capsys.readouterr().err
    with pytest.raises(ConfigurationError):
        load_study("nonsense")


@pytest.mark.parametrize("name", STUDIES)
def test_every_study_loads_under_its_name(name: str) -> None:
    study = load_study(name)
    assert study.name == name
    assert study.summary.endswith(".")
