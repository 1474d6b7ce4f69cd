"""Verbs that ask a database find that of the folder's station, or of the environment, by themselves."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from db.connection import migrate
from station.cli import main
from station.configuration import write_starter


@pytest.fixture(autouse=True)
def nothing_said(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("TRUEWHEEL_DATABASE", raising=False)
    monkeypatch.chdir(tmp_path)


def run(*arguments: str) -> None:
    with pytest.raises(SystemExit) as ended:
        main(list(arguments))
    assert ended.value.code == 0


def revision(capsys: pytest.CaptureFixture[str]) -> str:
    run("db", "migrate", "--json")
    return str(json.loads(capsys.readouterr().out)["revision"])


def test_the_station_of_this_folder_says_which_database_is_meant(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_starter(tmp_path)
    found = revision(capsys)
    [made] = tmp_path.rglob("*.db")
    assert found == migrate(f"sqlite:///{made}")


def test_the_environment_comes_before_the_folder_and_the_command_line_before_both(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    write_starter(tmp_path)
    monkeypatch.setenv("TRUEWHEEL_DATABASE", f"sqlite:///{tmp_path}/environment.db")
    revision(capsys)
    assert [path.name for path in tmp_path.rglob("*.db")] == ["environment.db"]
    run("db", "migrate", "--database", f"sqlite:///{tmp_path}/given.db")
    assert {path.name for path in tmp_path.rglob("*.db")} == {"environment.db", "given.db"}


@pytest.mark.parametrize("verb", [("db", "check"), ("report", "yield"), ("zero", "list"), ("db", "show")])
def test_without_any_of_them_the_three_ways_are_told(
    verb: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(list(verb))
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert len(said.strip().splitlines()) == 1
    for way in ("--database", "TRUEWHEEL_DATABASE", "configuration in this folder"):
        assert way in said


@pytest.mark.parametrize("verb", [(), ("db",), ("db", "check"), ("measure",), ("gauge", "grr")])
def test_help_is_there_under_its_short_name_too(
    verb: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main([*verb, "-h"])
    assert ended.value.code == 0
    assert "Usage: " in capsys.readouterr().out
