"""Every verb looks at the places where it shall write before it works, and before it reads what it needs.

`calibrate --database` with the name of a database that was not there lost its twelve seconds of work.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from db.connection import migrate
from station.cli import commands, main

GONE = "not-there"
"""No input of this name is anywhere: a verb that read it first would speak of it."""
CALIBRATED = ("--rig", "r", "--side", "left")
FILES: dict[str, list[tuple[str, ...]]] = {
    "calibrate": [(GONE, "--out")],
    "calibration export": [(GONE, "--format", "opencv", "--out"), (GONE, "--format", "kalibr", "--out")],
    "calibration import": [(GONE, "--format", "opencv", *CALIBRATED, "--out")],
    "calibration refresh": [(GONE, "--calibration", GONE, "--out")],
    "db backup": [("--database", "sqlite:///not-there.db", "--out")],
    "export": [
        (kind, "--database", "sqlite:///not-there.db", "--out")
        for kind in ("aqdef", "csv", "parquet", "certificate")
    ],
    "report": [("all", "--database", "sqlite:///not-there.db", "--out")],
    "line monitor": [(GONE, "--out")],
    "line document": [("--config", GONE, "--out")],
}
FOLDERS: dict[str, list[tuple[str, ...]]] = {
    "calibrate": [(GONE, "--out", "c.json", "--report")],
    "calibration export": [(GONE, "--format", "mrcal", "--out")],
    "calibration frame": [(GONE, "--calibration", GONE, "--out")],
    "simulate wheel": [("--camber", "0", "--toe", "0", "--seed", "1", "--config", GONE, "--out")],
    "simulate vehicle": [("--seed", "1", "--config", GONE, "--out")],
    "simulate steering": [("--seed", "1", "--config", GONE, "--out")],
    "simulate plate-session": [("--seed", "1", "--config", GONE, "--out")],
    "simulate gauge-session": [("--seed", "1", "--config", GONE, "--out")],
    "gauge type1": [("--from-file", GONE, "--out")],
    "gauge grr": [("--from-file", GONE, "--out")],
    "gauge linearity": [("--from-file", GONE, "--out")],
    "gauge stability": [("--from-file", GONE, "--out")],
    "gauge budget": [("--from-file", GONE, "--tolerance", "1", "--out")],
    "study": [(GONE, "--out")],
    "camera show": [("front_left", "--config", GONE, "--out")],
    "capture plate-session": [("front_left", "--config", GONE, "--out")],
    "capture gauge-session": [("--config", GONE, "--out")],
    "capture shot": [("front_left", "--config", GONE, "--out")],
    "demo": [("--config", GONE, "--out")],
}
DATABASES: dict[str, tuple[str, ...]] = {
    "calibrate": (GONE, "--out", "c.json"),
    "calibration check": (GONE, "--calibration", GONE),
    "calibration frame": (GONE, "--calibration", GONE, "--out", "o"),
    "zero measure": (GONE, "--calibration", GONE, "--camber", "0", "--toe", "0"),
    "zero measure-vehicle": (GONE, "--certificate", GONE),
}
ASKED_ELSEWHERE = {
    # These write nothing but the database, at once, or only read it.
    "db check", "db event", "db migrate", "db restore", "db show", "db sums", "db backup", "export", "report",
    "replay",
    "gauge fill", "gauge list", "gauge plan", "gauge type1", "gauge grr", "gauge linearity",
    "gauge stability", "zero list", "zero revoke", "camera health", "master release",
    "concession grant", "concession list", "concession withdraw",
    # Makes what is not there.
    "demo",
}  # fmt: skip


def verbs() -> Iterator[tuple[str, Any]]:
    def walk(command: Any, name: str) -> Iterator[tuple[str, Any]]:
        for sub, each in getattr(command, "commands", {}).items():
            yield from walk(each, f"{name} {sub}".strip())
        if not hasattr(command, "commands"):
            yield name, command

    return walk(commands(), "")


def run(*arguments: str) -> int:
    with pytest.raises(SystemExit) as ended:
        main(list(arguments))
    return int(ended.value.code or 0)


def test_every_verb_with_an_output_is_tried() -> None:
    options = {name: {option for p in verb.params for option in p.opts} for name, verb in verbs()}
    writing = {name for name, those in options.items() if "--out" in those}
    assert writing == {*FILES, *FOLDERS}
    assert {name for name, those in options.items() if "--report" in those} == {"calibrate"}
    storing = {name for name, those in options.items() if "--database" in those}
    assert storing - ASKED_ELSEWHERE == set(DATABASES)


def with_ending(verb: str, path: Path) -> Path:
    return path.with_suffix({"report": ".html", "line monitor": ".log"}.get(verb, ".x"))


@pytest.mark.parametrize(
    ("verb", "arguments"), [(verb, each) for verb, those in FILES.items() for each in those]
)
def test_a_file_that_cannot_be_written_is_told_first(
    verb: str,
    arguments: tuple[str, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    below_a_file = tmp_path / "file" / "out"
    below_a_file.parent.write_text("")
    folder = with_ending(verb, tmp_path / "folder")
    folder.mkdir()
    (folder / "kept").write_text("")
    long = tmp_path / ("x" * 300)
    nul = Path("/proc/nothing/out")
    for place in (below_a_file, folder, long, nul):
        wrong = place if place is folder else with_ending(verb, place)
        assert run(*verb.split(), *arguments, str(wrong)) == 2
        said = capsys.readouterr().err
        assert f"{wrong}, field '--out': expected a " in said
        assert GONE not in said.replace("not-there.db", "")
        assert "Traceback" not in said
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(["file", folder.name])


@pytest.mark.parametrize(
    ("verb", "arguments"), [(verb, each) for verb, those in FOLDERS.items() for each in those]
)
def test_a_folder_that_cannot_be_made_is_told_first(
    verb: str,
    arguments: tuple[str, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "file"
    file.write_text("")
    for wrong in (file, file / "out", tmp_path / ("x" * 300), Path("/proc/nothing/out")):
        assert run(*verb.split(), *arguments, str(wrong)) == 2
        said = capsys.readouterr().err
        assert f"{wrong}" in said
        assert "expected a " in said
        assert GONE not in said
        assert "Traceback" not in said
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize(("verb", "arguments"), DATABASES.items())
def test_a_database_that_cannot_be_written_is_told_first(
    verb: str,
    arguments: tuple[str, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "other.db").write_bytes(b"no database, but long enough to be looked at" * 30)
    for url, expected in (
        ("sqlite:///missing.db", "does not exist"),
        ("sqlite:///other.db", "is not an SQLite database"),
        ("sqlite://missing.db", "three slashes"),
        ("mysql://u@h/d", "postgresql://USER@HOST/DATABASE"),
    ):
        assert run(*verb.split(), *arguments, "--database", url) in (2, 3)
        said = capsys.readouterr().err
        assert expected in said
        assert GONE not in said


@pytest.mark.parametrize("verb", ["calibration check", "zero measure"])
def test_with_a_sound_database_it_is_the_input_that_is_spoken_of(
    verb: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    migrate("sqlite:///good.db")
    assert run(*verb.split(), *DATABASES[verb], "--database", "sqlite:///good.db") == 2
    assert GONE in capsys.readouterr().err


def test_a_medium_that_is_read_only_is_told_first(tmp_path: Path) -> None:
    medium = tmp_path / "m"
    medium.mkdir()
    migrate(f"sqlite:///{medium / 'r.db'}")
    script = (
        "import sys\nfrom station.commands.outputs import *\nfrom pathlib import Path\n"
        "for ask in (lambda: ready_file(Path('m/a')), lambda: ready_folder(Path('m/b/c')),"
        " lambda: ready_folder(Path('m')), lambda: ready_database('sqlite:///m/r.db')):\n"
        "    try:\n        ask()\n        sys.exit('not refused')\n"
        "    except Exception as error:\n        print(error)\n"
    )
    mount = 'mount --bind m m && mount -o remount,ro,bind m && exec "$0" -c "$1"'
    done = subprocess.run(
        ["unshare", "-m", "sh", "-c", mount, sys.executable, script],
        cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False,
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[3])},
    )  # fmt: skip
    if "not permitted" in done.stderr:
        pytest.skip("this user may not mount a folder read-only")
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("Read-only file system") == 3
    assert "r.db" in done.stdout.splitlines()[-1]
