"""A copy on a medium that may only be read: restored, reported, checked and copied from there."""

from __future__ import annotations

import os
import shutil
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest

from alignment.errors import StoreUnavailableError
from db.connection import make_engine, parse_url, store_errors, unwritten
from db.queries import ResultReader, yield_counts
from db.store import ResultStore
from db.upkeep.backups import backup, restore
from tests.db.example_plant import plant
from tests.db.example_records import CALIBRATION

ASKED = [
    ("report", "yield", "--database", "sqlite:///m/{name}"),
    ("db", "check", "--all", "--database", "sqlite:///m/{name}"),
    ("db", "backup", "--database", "sqlite:///m/{name}", "--out", "again-{name}"),
    ("export", "csv", "--database", "sqlite:///m/{name}", "--out", "{name}.csv"),
    ("db", "restore", "m/{name}", "--database", "sqlite:///new-{name}"),
    ("report", "yield", "--database", "sqlite:///new-{name}"),
]
PROGRAM = """
import sys
from station.cli import main
for arguments in {asked!r}:
    try:
        main(list(arguments))
    except SystemExit as ended:
        if ended.code not in (0, None):
            sys.exit(f"{{arguments}} ended with {{ended.code}}")
"""


def filled(path: Path) -> str:
    url = f"sqlite:///{path}"
    with ResultStore(url, create=True) as store:
        store.record_calibration(CALIBRATION)
        for record in plant(10):
            store.write_cycle(record)
    return url


def may_only_read(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = os.access
    monkeypatch.setattr("os.access", lambda path, mode: Path(path) != folder and real(path, mode))


def wal_mode(path: Path) -> bool:
    """Whether the file must be opened with a -wal file beside it (bytes 18 and 19 of its head)."""
    return path.read_bytes()[18:20] == b"\2\2"


def test_a_copy_and_what_is_restored_need_no_file_beside_them(tmp_path: Path) -> None:
    """A copy was a file of WAL mode, which SQLite cannot open where nothing can be written."""
    url = filled(tmp_path / "results.db")
    assert wal_mode(tmp_path / "results.db")
    backup(url, tmp_path / "copy.db")
    assert not wal_mode(tmp_path / "copy.db")
    assert not list(tmp_path.glob("copy.db?*"))
    restore(tmp_path / "copy.db", f"sqlite:///{tmp_path / 'new.db'}")
    # A station makes it a database of its own kind again.
    with ResultStore(f"sqlite:///{tmp_path / 'new.db'}") as store:
        assert store.counts()
        assert wal_mode(tmp_path / "new.db")


@pytest.mark.slow
def test_every_question_is_answered_from_a_medium_that_is_read_only(tmp_path: Path) -> None:
    may = subprocess.run(
        ["unshare", "-m", "mount", "--bind", str(tmp_path), str(tmp_path)], capture_output=True, check=False
    )
    if may.returncode != 0:
        pytest.skip("this user may not mount a folder read-only")
    medium = tmp_path / "m"
    medium.mkdir()
    url = filled(tmp_path / "results.db")
    backup(url, medium / "new-kind.db")
    # As copies were made before, and as a whole database is copied by hand: in WAL mode, nothing beside it.
    shutil.copyfile(tmp_path / "results.db", medium / "old-kind.db")
    assert wal_mode(medium / "old-kind.db")
    asked = [
        tuple(part.format(name=name) for part in each)
        for name, those in (("new-kind.db", ASKED), ("old-kind.db", ASKED[-2:]))
        for each in those
    ]
    script = tmp_path / "ask.py"
    script.write_text(PROGRAM.format(asked=asked), encoding="utf-8")
    mount = 'mount --bind m m && mount -o remount,ro,bind m && ! touch m/x && exec "$0" ask.py'
    done = subprocess.run(
        ["unshare", "-m", "sh", "-c", mount, sys.executable],
        cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False,
        env={"PYTHONPATH": str(Path(__file__).parents[3]), "PATH": "/usr/bin:/bin:/usr/sbin:/sbin"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "nothing is wrong" in done.stdout
    for name in ("new-kind.db", "old-kind.db"):
        with ResultReader(f"sqlite:///{tmp_path / f'new-{name}'}") as reader:
            assert sum(row.total for row in yield_counts(reader)) == 10


def test_a_database_that_is_written_after_all_is_not_read_as_one_that_is_still(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Who may only read a folder does not keep a station from writing in it."""
    url = filled(tmp_path / "results.db")
    may_only_read(tmp_path, monkeypatch)
    assert unwritten(tmp_path / "results.db")
    with ResultReader(url) as reader:
        assert sum(row.total for row in yield_counts(reader)) == 10
    reading = ResultReader(url)
    with ResultStore(url):
        # A -wal file is there: it is read by the rules of those who share a database.
        assert not unwritten(tmp_path / "results.db")
        with reading as reader:
            assert sum(row.total for row in yield_counts(reader)) == 10


def test_a_writer_that_comes_later_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    url = filled(tmp_path / "results.db")
    may_only_read(tmp_path, monkeypatch)
    engine = make_engine(parse_url(url), timeout_s=5.0, read_only=True)
    try:
        with engine.connect() as connection:
            assert connection.exec_driver_sql("SELECT count(*) FROM cycles").scalar() == 10
        with closing(sqlite3.connect(tmp_path / "results.db")) as writer:
            writer.execute("BEGIN IMMEDIATE")
            with (
                pytest.raises(StoreUnavailableError, match="written by another program"),
                store_errors(url),
                engine.connect() as connection,
            ):
                connection.exec_driver_sql("SELECT count(*) FROM cycles").scalar()
    finally:
        engine.dispose()
