"""Images are kept beside the results as a ring: the oldest ordinary ones go first, evidence last."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from db.quality_records import RetentionClass
from db.queries import ResultReader, vin_history
from db.records import CycleRecord, Verdict
from db.retention import Policy, enforce, kept
from db.store import ResultStore
from sensors.camera import Frame
from sensors.formats.shot import read_shot
from sensors.shot import HeadFrames, WheelShot
from station.archive import ImageArchive
from tests.db.example_records import CALIBRATION, NOON, axle, cycle, wheel

WIDE = Policy(10**9, 30.0, 300.0)


@pytest.fixture
def url(tmp_path: Path) -> str:
    return f"sqlite:///{tmp_path / 'results.db'}"


@pytest.fixture
def store(url: str) -> Iterator[ResultStore]:
    with ResultStore(url, create=True) as opened:
        opened.record_calibration(CALIBRATION)
        yield opened


def shot_of(record: CycleRecord, name: str = "front_left") -> WheelShot:
    image = np.random.default_rng(1).integers(0, 255, (40, 50), dtype=np.uint8)
    frames = [Frame(f"{name}/head_1/{side}", image, 1, 12.5, 100.0, 5.0) for side in ("left", "right")]
    (time,) = {w.measured_utc for w in record.wheels if w.wheel == name}
    assert time is not None
    return WheelShot(name, time, (HeadFrames("head_1", *frames),))


def stored(store: ResultStore, *, bad: bool = False, **changes: object) -> CycleRecord:
    record = cycle(**changes)
    if bad:
        wheels = (wheel("front_left", verdict=Verdict.NOK, toe=0.1), *record.wheels[1:])
        record = cycle(wheels=wheels, outcome="nok", axles=(axle(),), **changes)
    store.write_cycle(record)
    return record


def test_archived_images_read_back_and_are_named_by_the_vehicle(
    tmp_path: Path, url: str, store: ResultStore
) -> None:
    record = stored(store)
    shot = shot_of(record)
    with ImageArchive(store, tmp_path / "images", WIDE, "all", pytest.fail, lambda: NOON) as archive:
        archive.offer(record, [shot])
    with ResultReader(url) as reader:
        (found,) = vin_history(reader, "TRUEWHEEL00000001").shots
    assert found.removal is None
    assert found.record.retention is RetentionClass.ORDINARY
    assert found.record.bytes > 0
    again = read_shot(tmp_path / "images" / found.record.path)
    assert np.array_equal(again.frames[0].image, shot.frames[0].image)


def test_only_evidence_is_kept_when_that_is_asked(tmp_path: Path, store: ResultStore) -> None:
    good, bad = stored(store), stored(store, bad=True)
    with ImageArchive(store, tmp_path / "images", WIDE, "evidence", pytest.fail, lambda: NOON) as archive:
        archive.offer(good, [shot_of(good)])
        archive.offer(bad, [shot_of(bad)])
    (folder,) = (tmp_path / "images").glob("*/*")
    assert folder.name == f"{bad.uuid}-front_left"


def fill(tmp_path: Path, store: ResultStore, times: list[tuple[datetime, bool]]) -> list[CycleRecord]:
    records = []
    for time, bad in times:
        record = stored(store, bad=bad)
        with ImageArchive(
            store, tmp_path / "images", WIDE, "all", pytest.fail, lambda time=time: time
        ) as archive:
            archive.offer(record, [shot_of(record)])
        records.append(record)
    return records


def left(tmp_path: Path) -> set[str]:
    return {path.name.removesuffix("-front_left") for path in (tmp_path / "images").glob("*/*")}


def test_old_images_go_and_evidence_stays_longer(tmp_path: Path, url: str, store: ResultStore) -> None:
    days = [NOON + timedelta(days=day) for day in range(4)]
    records = fill(tmp_path, store, [(days[0], True), (days[1], False), (days[2], False), (days[3], False)])
    gone = enforce(store, tmp_path / "images", replace(WIDE, ordinary_days=1.5), days[3])
    assert [record.cycle for record in gone] == [records[1].uuid]
    assert left(tmp_path) == {str(records[k].uuid) for k in (0, 2, 3)}
    with ResultReader(url) as reader:
        removals = [shot.removal for shot in vin_history(reader, "TRUEWHEEL00000001").shots]
    assert [removal and removal.reason for removal in removals] == [None, "older than 1.5 days", None, None]
    gone = enforce(store, tmp_path / "images", WIDE, NOON + timedelta(days=400))
    assert len(gone) == 3
    assert left(tmp_path) == set()


def test_a_full_ring_takes_the_oldest_ordinary_ones_first(tmp_path: Path, store: ResultStore) -> None:
    days = [NOON + timedelta(days=day) for day in range(4)]
    records = fill(tmp_path, store, [(days[0], True), (days[1], False), (days[2], False), (days[3], False)])
    each = kept(store).bytes // 4
    enforce(store, tmp_path / "images", replace(WIDE, most_bytes=2 * each + each // 2), days[3])
    assert left(tmp_path) == {str(records[0].uuid), str(records[3].uuid)}
    assert kept(store).shots == 2
    enforce(store, tmp_path / "images", replace(WIDE, most_bytes=1), days[3])
    assert left(tmp_path) == set()


def test_files_that_could_not_be_deleted_are_tried_again(
    tmp_path: Path, store: ResultStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    (record,) = fill(tmp_path, store, [(NOON, False)])

    def refuse(_: Path) -> None:
        raise PermissionError

    with monkeypatch.context() as patched:
        patched.setattr("db.retention.shutil.rmtree", refuse)
        enforce(store, tmp_path / "images", replace(WIDE, most_bytes=0), NOON)
    assert left(tmp_path) == {str(record.uuid)}
    assert kept(store).shots == 0
    assert enforce(store, tmp_path / "images", replace(WIDE, most_bytes=0), NOON) == ()
    assert left(tmp_path) == set()


def test_a_disk_that_is_too_slow_or_full_loses_images_and_says_so(
    tmp_path: Path, store: ResultStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[str] = []
    going, full = threading.Event(), threading.Event()

    def slow(*_: object) -> None:
        going.set()
        full.wait(60)
        raise OSError("No space left on device")

    monkeypatch.setattr("station.archive.write_shot", slow)
    record = stored(store)
    with ImageArchive(store, tmp_path / "images", WIDE, "all", said.append, lambda: NOON) as archive:
        archive.offer(record, [shot_of(record)])
        going.wait(60)
        for _ in range(5):
            archive.offer(record, [shot_of(record)])
        assert said == [f"images of cycle {record.uuid} are not archived: the disk is too slow"]
        full.set()
    assert said[1:] == [f"images of cycle {record.uuid} are not archived: No space left on device"] * 5
    assert store.counts()["archived_shots"] == 0
