"""Verbs that ask a database find that of the folder's station, or of the environment, by themselves."""

from __future__ import annotations

import json
import shutil
import sqlite3
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path

import pytest

from db.connection import migrate
from db.records import EventRecord, Severity
from db.store import ResultStore
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


def check_of(url: str, capsys: pytest.CaptureFixture[str]) -> tuple[str, object]:
    run("db", "check", "--database", url)
    told = capsys.readouterr().out
    run("db", "check", "--database", url, "--json")
    return told, json.loads(capsys.readouterr().out)["figures"]["records_to_ship"]


def test_a_check_does_not_speak_of_shipping_where_nothing_is_ever_shipped(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Whoever has no central database read that thousands of records wait to be shipped."""
    write_starter(tmp_path)
    [settings] = tmp_path.rglob("station.toml")
    url = f"sqlite:///{tmp_path / 'truewheel.db'}"
    migrate(url)
    with ResultStore(url) as store:
        noon = datetime(2026, 11, 22, 12, tzinfo=UTC)
        store.record_event(EventRecord(noon, "EOL-1", Severity.INFO, "station", "started", "started"))
    told, figure = check_of(url, capsys)
    assert "ship" not in told
    assert figure is None
    central = '# central_url = "postgresql://station_1@quality-server/results"'
    assert central in settings.read_text()
    settings.write_text(settings.read_text().replace(central, central.removeprefix("# ")))
    told, figure = check_of(url, capsys)
    assert "1 record waits to be shipped" in told
    assert figure == 1
    other = f"sqlite:///{tmp_path / 'other.db'}"
    shutil.copyfile(tmp_path / "truewheel.db", tmp_path / "other.db")
    told, figure = check_of(other, capsys)
    assert ("ship" in told, figure) == (False, None), "another database than that station's"
    settings.write_text("damaged")
    assert check_of(url, capsys)[1] is None


def test_a_database_that_has_shipped_says_what_waits(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Where its configuration is not at hand, as on the desk of who looks at a copy."""
    url = f"sqlite:///{tmp_path / 'copy.db'}"
    migrate(url)
    with closing(sqlite3.connect(tmp_path / "copy.db")) as file, file:
        file.execute("UPDATE shipments SET shipped_utc = '2026-11-22 12:00:00.000000'")
    told, figure = check_of(url, capsys)
    assert ("ship" in told, figure) == (False, 0)
    with ResultStore(url) as store:
        noon = datetime(2026, 11, 22, 12, tzinfo=UTC)
        for _ in range(2):
            store.record_event(EventRecord(noon, "EOL-1", Severity.INFO, "station", "started", "started"))
    told, figure = check_of(url, capsys)
    assert "2 records wait to be shipped" in told
    assert figure == 2
