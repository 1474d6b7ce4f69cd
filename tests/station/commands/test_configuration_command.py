"""A configuration to start from, and one that is checked before anybody starts with it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from station.cli import main
from station.configuration.settings import read_configuration

CONFIGS = Path(__file__).parents[3] / "configs"


def run(*arguments: str) -> int:
    with pytest.raises(SystemExit) as end:
        main(list(arguments))
    return int(end.value.code or 0)


@pytest.fixture
def home(tmp_path: Path) -> Path:
    assert run("init", str(tmp_path / "home"), "--station", "st_7") == 0
    return tmp_path / "home"


def change(home: Path, *changes: tuple[str, str]) -> Path:
    path = home / "configs" / "station.toml"
    text = path.read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path.write_text(text, encoding="utf-8")
    return path


def test_a_starter_is_what_the_program_ships_under_its_own_name(home: Path) -> None:
    configuration = read_configuration(home / "configs" / "station.toml")
    assert configuration.settings.station.id == "st_7"
    shipped = {p.relative_to(CONFIGS) for p in CONFIGS.rglob("*") if p.suffix in (".toml", ".dbc")}
    assert {p.relative_to(home / "configs") for p in (home / "configs").rglob("*.*")} == shipped
    # The database of a station that starts there lies in its home, not beside the program.
    assert Path(configuration.database_url.removeprefix("sqlite:///")).resolve().parent == home.resolve()


def test_the_service_unit_names_this_home_and_this_program(home: Path) -> None:
    unit = (home / "truewheel.service").read_text(encoding="utf-8")
    assert f"WorkingDirectory={home.resolve()}\n" in unit
    assert "@" not in "".join(line for line in unit.splitlines() if not line.startswith("#"))
    assert "RestartPreventExitStatus=2" in unit


def test_a_home_that_is_in_use_is_left_as_it_is(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    kept = change(home, ("st_7", "mine"))
    before = {path: path.read_bytes() for path in home.rglob("*") if path.is_file()}
    assert run("init", str(home)) == 2
    assert "nothing was changed" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in home.rglob("*") if path.is_file()} == before
    assert 'id = "mine"' in kept.read_text(encoding="utf-8")


@pytest.mark.parametrize("identity", ["", "a b", 'x"\ny = 1', "-x", "ä", "x" * 65])
def test_an_identity_that_no_record_could_carry_is_refused(
    tmp_path: Path, identity: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("init", str(tmp_path / "home"), "--station", identity) == 2
    assert "station.id" in capsys.readouterr().err
    assert not (tmp_path / "home").exists()


def test_a_sound_configuration_is_said_to_be_so(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert run("config", "check", str(home / "configs" / "station.toml"), "--json") == 0
    said = json.loads(capsys.readouterr().out)
    assert said["findings"] == []
    assert len(said["hash"]) == 64
    assert not (home / "truewheel.db").exists()  # checked, not started


def test_every_mistake_is_told_at_once(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (home / "configs" / "line.dbc").write_text("no DBC")
    path = change(
        home,
        ('interface = "virtual"', 'interface = "morse"'),
        ("create = true", "create = false"),
        (
            "simulated = { seed = 1, camber_deg = -0.5, toe_deg = 0.1 }",
            'calibration = "gone.json"\nrecorded = { shots = "nowhere" }',
        ),
    )
    capsys.readouterr()
    assert run("config", "check", str(path), "--json") == 2
    findings = json.loads(capsys.readouterr().out)["findings"]
    assert len(findings) == 4
    for word in ("line.dbc", "morse", "database.url", "gone.json"):
        assert any(word in finding for finding in findings), word
    assert any("Create it with `truewheel db migrate --database sqlite:///" in each for each in findings)
    assert run("config", "check", str(path)) == 2
    assert len(capsys.readouterr().err.splitlines()) == 4


def test_a_folder_that_cannot_be_written_is_found_before_the_first_vehicle(
    home: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (home / "file").write_text("")
    path = change(home, ("# [archive]\n", '[archive]\nfolder = "../file/images"\n'))
    assert run("config", "check", str(path)) == 2
    assert "archive.folder" in capsys.readouterr().err


def test_a_station_runs_with_a_configuration_of_its_own_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The one beside the program would put the database there, where the next update removes it."""
    monkeypatch.chdir(tmp_path)
    assert run("run") == 2
    assert "truewheel init" in capsys.readouterr().err
    shutil.copytree(CONFIGS, tmp_path / "configs")
    assert run("config", "check") == 0
