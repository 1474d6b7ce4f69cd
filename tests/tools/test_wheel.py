"""The wheel of a commit is the same wherever and whenever it is built, and says which commit it is."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import time
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from station.running.parts import program_source
from tools.wheel import ROOT, build, epoch_of, require_builder

AUTHOR = {
    f"GIT_{who}_{what}": value
    for who in ("AUTHOR", "COMMITTER")
    for what, value in (("NAME", "A. Example"), ("EMAIL", "a@example.org"), ("DATE", "2026-11-30T12:00:00Z"))
}


def git(folder: Path, *command: str) -> str:
    done = subprocess.run(
        ["git", *command],
        cwd=folder,
        env={**os.environ, **AUTHOR},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.strip()


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """This project's build, with few of its modules: a commit of a repository of its own."""
    folder = tmp_path / "first"
    for name in ("pyproject.toml", "requirements.lock", "README.md", "LICENSE"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes((ROOT / name).read_bytes())
    for package in ("station", "alignment"):
        (folder / package).mkdir()
        for source in sorted((ROOT / package).glob("*.py*")):
            if source.suffix in (".py", ".pyi"):
                (folder / package / source.name).write_bytes(source.read_bytes())
        (folder / package / "py.typed").touch()
    git(folder, "init", "-q")
    git(folder, "add", ".")
    git(folder, "commit", "-q", "-m", "first")
    return folder


@pytest.fixture
def elsewhere(checkout: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The same commit in another folder, with files of another time, permissions, and another builder."""
    folder = tmp_path / "a longer name of a folder" / "second"
    folder.parent.mkdir()
    git(tmp_path, "clone", "-q", "--no-hardlinks", str(checkout), str(folder))
    for path in folder.rglob("*.py"):
        path.chmod(0o600)
        os.utime(path, (1_000_000_000, 1_000_000_000))
    monkeypatch.setenv("TZ", "Pacific/Auckland")
    monkeypatch.setenv("PYTHONHASHSEED", "77")
    time.tzset()
    before = os.umask(0o077)
    yield folder
    os.umask(before)
    monkeypatch.delenv("TZ")
    time.tzset()


def sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.slow
def test_two_builders_build_the_same_bits(checkout: Path, elsewhere: Path, tmp_path: Path) -> None:
    os.umask(0o022)
    first = build(checkout, tmp_path / "one")
    os.umask(0o077)
    (elsewhere / "station" / "added.py").write_text("not committed\n")
    second = build(elsewhere, tmp_path / "two")
    assert sha256(first) == sha256(second)
    commit = git(checkout, "rev-parse", "HEAD")
    with zipfile.ZipFile(second) as wheel:
        assert json.loads(wheel.read("station/built.json")) == {"commit": commit}
        assert "station/added.py" not in wheel.namelist()
        # 12:00 UTC of the commit, wherever it was built; zip files count in steps of two seconds.
        assert {info.date_time for info in wheel.infolist()} == {(2026, 11, 30, 12, 0, 0)}
        wheel.extract("station/built.json", tmp_path)
    found = program_source(tmp_path, tmp_path / "station" / "built.json")
    assert (found.commit, found.modified) == (commit, False)


@pytest.mark.parametrize("given", ["yesterday", "-1", "1.5", "9" * 30])
def test_a_time_that_is_none_builds_nothing(
    given: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", given)
    with pytest.raises(SystemExit) as end:
        epoch_of(ROOT, "HEAD")
    assert end.value.code == 2
    assert "SOURCE_DATE_EPOCH: expected whole seconds" in capsys.readouterr().err


def test_another_setuptools_than_the_pinned_one_builds_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "requirements.lock").write_text("setuptools==1.0\n")
    with pytest.raises(SystemExit) as end:
        require_builder(tmp_path / "requirements.lock")
    assert end.value.code == 2
    assert "expected 1.0 of requirements.lock" in capsys.readouterr().err


@pytest.mark.parametrize("revision", ["no-such-branch", "HEAD~99999"])
def test_a_commit_that_is_none_builds_nothing(
    revision: str, checkout: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as end:
        build(checkout, tmp_path / "out", revision)
    assert end.value.code == 2
    assert "expected a checkout with the commit" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_checkout_says_its_commit_and_whether_it_was_changed(checkout: Path, tmp_path: Path) -> None:
    commit, nothing = git(checkout, "rev-parse", "HEAD"), tmp_path / "none.json"
    assert program_source(checkout, nothing).modified is False
    (checkout / "README.md").write_text("otherwise\n")
    found = program_source(checkout, nothing)
    assert (found.commit, found.modified) == (commit, True)


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"commit": 7}', '{"commit": "zz"}', "\u00e9"])
def test_a_damaged_note_of_the_commit_is_no_commit(text: str, tmp_path: Path) -> None:
    (tmp_path / "built.json").write_text(text, encoding="latin-1")
    (tmp_path / ".git").mkdir()
    assert program_source(tmp_path, tmp_path / "built.json").commit is None
