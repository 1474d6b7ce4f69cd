"""An archive of a year: what the asking process keeps and does for each of very many folders."""

from __future__ import annotations

import gc
import json
import tracemalloc
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from station.replay.archive_walk import archived_folders
from station.replay.run import ReplayRequest, replay_archive
from station.replay.values import Choices, Job, Replayed, ReplayState

DAYS, WHEELS = 20, 100
AS_THEN = Choices({}, None)
_BYTES_EACH = 300
"""Of a folder that was measured before: its key, and its place in a set."""


def name_of(number: int) -> str:
    return f"00000000-0000-4000-8000-{number:012d}-front_left"


@pytest.fixture
def year(tmp_path: Path) -> Path:
    """Folders as a station names them; all are the same few files."""
    archive = tmp_path / "images"
    record = tmp_path / "archived.json"
    record.write_text(json.dumps({"vin": "W"}))
    for number in range(DAYS * WHEELS):
        folder = archive / f"2026-03-{1 + number % DAYS:02d}" / name_of(number)
        folder.mkdir(parents=True)
        (folder / "archived.json").hardlink_to(record)
    return archive


@pytest.fixture
def measured(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Every folder is identical at once; the keys in their order."""
    keys: list[str] = []

    def measure(jobs: Iterator[Job], choices: Choices, workers: int) -> Iterator[Replayed]:
        for job in jobs:
            keys.append(job.key)
            yield Replayed(job.key, ReplayState.IDENTICAL, measured=True)

    monkeypatch.setattr("station.replay.run.measure_in_processes", measure)
    return keys


def peak_of(call: Callable[[], object]) -> int:
    tracemalloc.start()
    try:
        call()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_what_is_kept_does_not_grow_with_the_archive(
    year: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    held: dict[int, int] = {}

    def measure(jobs: Iterator[Job], choices: Choices, workers: int) -> Iterator[Replayed]:
        for number, job in enumerate(jobs, 1):
            # Between two portions of folders.
            if number % 200 == 100:
                gc.collect()  # which lets go of what Python keeps for tuples to come
                held[number] = tracemalloc.get_traced_memory()[0]
            yield Replayed(job.key, ReplayState.IDENTICAL, measured=True)

    monkeypatch.setattr("station.replay.run.measure_in_processes", measure)
    request = ReplayRequest(year, AS_THEN, journal=tmp_path / "journal.jsonl")
    peak_of(lambda: replay_archive(request))
    assert len(held) == DAYS * WHEELS // 200
    # Not one byte a folder: names of files come and go.
    assert held[1900] - held[300] < 1600 * 16


def test_what_was_measured_before_is_neither_measured_nor_kept_twice(
    year: Path, measured: list[str], tmp_path: Path
) -> None:
    journal = tmp_path / "journal.jsonl"
    request = ReplayRequest(year, AS_THEN, journal=journal)

    class Killed(BaseException):
        pass

    def stop(progress: Any) -> None:
        if progress.done == DAYS * WHEELS // 2:
            raise Killed

    with pytest.raises(Killed):
        replay_archive(request, stop)
    measured.clear()
    kept = peak_of(lambda: replay_archive(request))
    assert len(measured) == DAYS * WHEELS // 2
    assert len(journal.read_bytes().splitlines()) == 1 + DAYS * WHEELS
    assert kept < _BYTES_EACH * DAYS * WHEELS + 500_000
    summary = replay_archive(request)
    assert (summary.folders, summary.earlier) == (DAYS * WHEELS, DAYS * WHEELS)


def test_a_look_at_a_year_asks_the_file_system_for_names_alone(
    year: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each folder was resolved twice: a shared disk is asked for every part of its path."""
    asked: list[Path] = []
    resolve = Path.resolve
    monkeypatch.setattr(Path, "resolve", lambda self, *a: asked.append(self) or resolve(self, *a))
    found = list(archived_folders(year))
    assert len(found) == DAYS * WHEELS
    assert all(each.wheel == "front_left" for each in found)
    # The archive itself and its days: whether they are folders of images.
    assert len(asked) <= 1 + DAYS


def test_for_one_vehicle_every_record_is_read_once(
    year: Path, measured: list[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A year's records were read three times over before the first wheel was measured."""
    from station.replay import run

    read: list[Path] = []
    load = run.load_json
    monkeypatch.setattr(run, "load_json", lambda path, what: read.append(path) or load(path, what))
    for number in (7, 1234):
        [folder] = year.glob(f"*/{name_of(number)}")
        (folder / "archived.json").unlink()
        (folder / "archived.json").write_text(json.dumps({"vin": "MINE"}))
    request = ReplayRequest(year, AS_THEN, vin="MINE", journal=tmp_path / "journal.jsonl")
    next(request.folders())
    summary = replay_archive(request)
    assert (summary.folders, len(measured)) == (2, 2)
    assert len(read) == DAYS * WHEELS
