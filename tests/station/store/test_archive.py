"""Images are kept beside the results as a ring: the oldest ordinary ones go first, evidence last."""

from __future__ import annotations

import shutil
import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from uuid import UUID

import numpy as np
import pytest

from alignment.errors import StoreUnavailableError
from alignment.values import MeasureSettings
from db.queries import ResultReader, vin_history
from db.records import ArchivedShotRecord, CycleRecord, RetentionClass, Verdict
from db.store import ResultStore
from db.upkeep.retention import Policy, enforce, kept
from sensors.camera import Frame
from sensors.formats.shot import read_shot
from sensors.shot import HeadFrames, WheelShot
from station.configuration.settings import read_configuration
from station.cycle.judging.evaluation import Evaluation, JudgedWheel
from station.cycle.judging.verdict import Angle
from station.cycle.ports import CycleReport, Observer
from station.cycle.wheels.positions import CalibrationInForce, MeasuredWith, WheelResult
from station.cycle.words.cycle import Trigger
from station.store.archive import ArchivingObserver, ImageArchive
from station.store.archived import write_wheel
from station.store.keeping import Keeping
from station.store.opening import StationStore, open_archive
from tests.db.databases import new_database
from tests.db.example_records import CALIBRATION, NOON, axle, cycle, wheel
from tests.documents import ROOT
from tests.sensors.samples import calibration as sample_calibration
from tests.station.bench import measurement

WIDE = Policy(10**9, 30.0, 300.0)


@pytest.fixture
def url(tmp_path: Path) -> str:
    return new_database(tmp_path / "results.db")


@pytest.fixture
def store(url: str) -> Iterator[ResultStore]:
    with ResultStore(url) as opened:
        opened.record_calibration(CALIBRATION)
        yield opened


def into(said: list[str]) -> Callable[[str, UUID | None], None]:
    """Keep what is noted; one cycle that a sentence names is the one that the event is of."""

    def note(text: str, cycle: UUID | None) -> None:
        said.append(text)
        assert (cycle is not None) == ("of cycle" in text and " more are" not in text)
        assert str(cycle or "") in text

    return note


def shot_of(record: CycleRecord, name: str = "front_left") -> WheelShot:
    image = np.random.default_rng(1).integers(0, 255, (40, 50), dtype=np.uint8)
    frames = [Frame(f"{name}/head_1/{side}", image, 1, 12.5, 100.0, 5.0) for side in ("left", "right")]
    (time,) = {w.measured_utc for w in record.wheels if w.wheel == name}
    assert time is not None
    return WheelShot(name, time, (HeadFrames("head_1", *frames),))


def wheel_of(record: CycleRecord, name: str = "front_left", shot: WheelShot | None = None) -> WheelResult:
    """A wheel as the cycle hands it over: its images, what it was measured with, what was found."""
    known = replace(sample_calibration(heads=("head_1",)), rig=name)
    document = {"id": known.id, "rig": name}
    basis = MeasuredWith(
        CalibrationInForce(known, NOON, 365.0, document), MeasureSettings(), False, None, None
    )
    return WheelResult(
        name, known.id, True, measurement(), None, shot=shot or shot_of(record, name), measured_with=basis
    )


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
    with ImageArchive(store, tmp_path / "images", WIDE, Keeping("all"), pytest.fail, lambda: NOON) as archive:
        archive.offer(record, [wheel_of(record, shot=shot)])
    with ResultReader(url) as reader:
        (found,) = vin_history(reader, "TRUEWHEEL00000001").shots
    assert found.removal is None
    assert found.record.retention is RetentionClass.ORDINARY
    assert found.record.bytes > 0
    again = read_shot(tmp_path / "images" / found.record.path)
    assert np.array_equal(again.frames[0].image, shot.frames[0].image)


def test_only_evidence_is_kept_when_that_is_asked(tmp_path: Path, store: ResultStore) -> None:
    good, bad = stored(store), stored(store, bad=True)
    with ImageArchive(
        store, tmp_path / "images", WIDE, Keeping("evidence"), pytest.fail, lambda: NOON
    ) as archive:
        archive.offer(good, [wheel_of(good)])
        archive.offer(bad, [wheel_of(bad)])
    (folder,) = (tmp_path / "images").glob("*/*")
    assert folder.name == f"{bad.uuid}-front_left"


def fill(tmp_path: Path, store: ResultStore, times: list[tuple[datetime, bool]]) -> list[CycleRecord]:
    records = []
    for time, bad in times:
        record = stored(store, bad=bad)
        with ImageArchive(
            store, tmp_path / "images", WIDE, Keeping("all"), pytest.fail, lambda time=time: time
        ) as archive:
            archive.offer(record, [wheel_of(record)])
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
        patched.setattr("db.upkeep.retention.shutil.rmtree", refuse)
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

    monkeypatch.setattr("station.store.archive.write_wheel", slow)
    record = stored(store)
    with ImageArchive(store, tmp_path / "images", WIDE, Keeping("all"), into(said), lambda: NOON) as archive:
        archive.offer(record, [wheel_of(record)])
        going.wait(60)
        for _ in range(6):
            archive.offer(record, [wheel_of(record)])
        full.set()
    slow_ones = f"images of cycle {record.uuid} and 1 more are not archived: the disk is too slow"
    assert sorted(said) == sorted(
        [slow_ones, *[f"images of cycle {record.uuid} are not archived: No space left on device"] * 5]
    )
    assert store.counts()["archived_shots"] == 0


@pytest.mark.parametrize(
    "error", [MemoryError("no room"), KeyError("x"), UnicodeError("bad"), ValueError("a name with NUL")]
)
@pytest.mark.parametrize("place", ["write_wheel", "enforce"])
def test_whatever_befalls_one_cycles_images_the_next_ones_are_archived(
    tmp_path: Path, store: ResultStore, monkeypatch: pytest.MonkeyPatch, error: Exception, place: str
) -> None:
    """The thread died without a word: later cycles blamed the disk, and the station's end waited for ever."""

    def fail(*_: object) -> None:
        raise error

    said: list[str] = []
    first, *others = [stored(store) for _ in range(6)]
    with ImageArchive(store, tmp_path / "images", WIDE, Keeping("all"), into(said), lambda: NOON) as archive:
        with monkeypatch.context() as patched:
            patched.setattr(f"station.store.archive.{place}", fail)
            archive.offer(first, [wheel_of(first)])
            archive.wait()
        for record in others:
            archive.offer(record, [wheel_of(record)])
            archive.wait()
        assert (archive.thread.alive, archive.thread.failures) == (True, 1)
        assert archive.thread.last_error == f"{type(error).__name__}: {error}"
    assert said == [f"images of cycle {first.uuid} are not archived: {type(error).__name__}: {error}"]
    assert {str(record.uuid) for record in others} <= left(tmp_path)


def test_images_that_come_twice_do_not_cost_the_first_ones(tmp_path: Path, store: ResultStore) -> None:
    record = stored(store)
    with ImageArchive(
        store, tmp_path / "images", WIDE, Keeping("all"), lambda _: None, lambda: NOON
    ) as archive:
        for _ in range(2):
            archive.offer(record, [wheel_of(record)])
    assert left(tmp_path) == {str(record.uuid)}
    assert list((tmp_path / "images").glob("*/*/shot.json"))


def test_what_was_half_written_leaves_the_disk(
    tmp_path: Path, store: ResultStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It filled the disk: no record counted it, so nothing ever removed it."""

    def half(folder: Path, *_: object) -> str:
        folder.mkdir()
        (folder / "left.png").write_bytes(bytes(1000))
        raise OSError("No space left on device")

    monkeypatch.setattr("station.store.archive.write_wheel", half)
    record = stored(store)
    with ImageArchive(
        store, tmp_path / "images", WIDE, Keeping("all"), lambda _: None, lambda: NOON
    ) as archive:
        archive.offer(record, [wheel_of(record)])
    assert left(tmp_path) == set()


def test_images_whose_record_may_have_been_stored_stay(
    tmp_path: Path, store: ResultStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    def outlasts(record: object) -> None:
        raise StoreUnavailableError("did not answer in time")

    monkeypatch.setattr(store, "record_shot", outlasts)
    record = stored(store)
    with ImageArchive(
        store, tmp_path / "images", WIDE, Keeping("all"), lambda _: None, lambda: NOON
    ) as archive:
        archive.offer(record, [wheel_of(record)])
    assert left(tmp_path) == {str(record.uuid)}


def test_disk_that_hangs_for_ever_does_not_hang_the_end_of_the_station(
    tmp_path: Path, store: ResultStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    going, gate, said = threading.Event(), threading.Event(), list[str]()

    def hang(*_: object) -> None:
        going.set()
        gate.wait(60)

    monkeypatch.setattr("station.store.archive.write_wheel", hang)
    record = stored(store)
    archive = ImageArchive(
        store, tmp_path / "images", WIDE, Keeping("all"), into(said), lambda: NOON, closing_s=0.1
    )

    def live() -> None:
        with archive:
            archive.offer(record, [wheel_of(record)])
            going.wait(60)

    station = threading.Thread(target=live)
    station.start()
    station.join(20)
    assert not station.is_alive()
    ended = "the station ended before those of front_left were written"
    assert said == [f"images of cycle {record.uuid} are not archived: {ended}"]
    gate.set()


def test_the_end_waits_for_all_that_was_taken_and_then_ends_at_once(
    tmp_path: Path, store: ResultStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Series of four wheels take longer than the half minute after which the rest of them was dropped."""
    going, gate = threading.Event(), threading.Event()
    write = write_wheel

    def slow(*of: Any) -> str:
        going.set()
        assert gate.wait(60)
        return write(*of)

    monkeypatch.setattr("station.store.archive.write_wheel", slow)
    records = [stored(store) for _ in range(5)]
    archive = ImageArchive(
        store, tmp_path / "images", WIDE, Keeping("all"), pytest.fail, lambda: NOON, closing_s=60.0
    )
    waits = archive.wait

    def wait_and_let_go() -> bool:
        # The disk goes on only once the station has begun to end.
        gate.set()
        return waits()

    archive.wait = wait_and_let_go  # type: ignore[method-assign]
    with archive:
        archive.offer(records[0], [wheel_of(records[0])])
        assert going.wait(60)
        for record in records[1:]:
            archive.offer(record, [wheel_of(record, name) for name in ("front_left", "rear_right")])
    folders = list((tmp_path / "images").glob("*/*"))
    assert len(folders) == 9


def test_what_the_end_could_not_wait_for_is_told_by_cycle_and_wheel(
    tmp_path: Path, store: ResultStore, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """One sentence counted cycles, and of one that was half written nobody knew which wheels were."""
    hanging, gate, said = threading.Event(), threading.Event(), list[str]()
    write = write_wheel

    def hang(folder: Path, record: CycleRecord, found: WheelResult, kind: Any) -> str:
        if found.wheel == "rear_left":
            hanging.set()
            gate.wait(60)
        return write(folder, record, found, kind)

    monkeypatch.setattr("station.store.archive.write_wheel", hang)
    first, second = stored(store), stored(store)
    names = ("front_left", "rear_left", "rear_right")
    archive = ImageArchive(
        store, tmp_path / "images", WIDE, Keeping("all"), into(said), lambda: NOON, closing_s=0.1
    )
    with archive:
        for record in (first, second):
            archive.offer(record, [wheel_of(record, name) for name in names])
        assert hanging.wait(60)
    ended = "are not archived: the station ended before those of"
    assert said == [
        f"images of cycle {first.uuid} {ended} rear_left, rear_right were written",
        f"images of cycle {second.uuid} {ended} front_left, rear_left, rear_right were written",
    ]
    assert all(text in caplog.text for text in said)
    gate.set()
    [thread] = [each for each in threading.enumerate() if each.name == archive.thread.name]
    thread.join(60)
    # What the step had not begun it leaves: the store may be closed by now.
    assert len(list((tmp_path / "images").glob("*/*"))) <= 2


def test_how_long_the_end_waits_is_the_configuration_s(tmp_path: Path, store: ResultStore) -> None:
    shutil.copytree(ROOT / "configs", tmp_path / "configs")
    path = tmp_path / "configs" / "station.toml"
    path.write_text(f'{path.read_text()}\n[archive]\nfolder = "images"\nclosing_s = 7.5\n')
    background: Any = SimpleNamespace(note=pytest.fail)
    archive = open_archive(read_configuration(path), StationStore(store, background))
    assert archive is not None
    assert archive.closing_s == 7.5


class Offered:
    """Stands for the archive."""

    def __init__(self) -> None:
        self.rigs: list[list[str]] = []

    def offer(self, record: CycleRecord, wheels: list[WheelResult]) -> None:
        self.rigs.append([wheel.wheel for wheel in wheels])


@pytest.mark.parametrize("committed_s", [None, 5.0])
def test_only_the_images_that_a_stored_result_was_measured_in_are_archived(
    store: ResultStore, committed_s: float | None
) -> None:
    """A cycle without a record has none that its images could go with."""
    record = stored(store)
    archive, seen = Offered(), list[CycleReport]()
    inner = Observer()
    inner.cycle_done = seen.append  # type: ignore[method-assign]
    observer = ArchivingObserver(inner, archive)  # type: ignore[arg-type]
    given = report(record, committed_s, {"front_left": shot_of(record), "front_right": None})
    observer.cycle_done(given)
    assert archive.rigs == ([] if committed_s is None else [["front_left"]])
    assert seen == [given]


@pytest.mark.parametrize("bad", [False, True])
def test_images_of_a_wheel_that_was_not_good_are_evidence(
    tmp_path: Path, url: str, store: ResultStore, bad: bool
) -> None:
    record = stored(store, bad=bad)
    with ImageArchive(store, tmp_path / "images", WIDE, Keeping("all"), pytest.fail, lambda: NOON) as archive:
        archive.offer(record, [wheel_of(record)])
    with ResultReader(url) as reader:
        (found,) = vin_history(reader, "TRUEWHEEL00000001").shots
    assert found.record.retention is (RetentionClass.EVIDENCE if bad else RetentionClass.ORDINARY)


def test_the_archive_makes_room_by_itself(tmp_path: Path, store: ResultStore) -> None:
    """An archive that wrote and never looked at its size filled the disk."""
    first = stored(store)
    with ImageArchive(store, tmp_path / "images", WIDE, Keeping("all"), pytest.fail, lambda: NOON) as archive:
        archive.offer(first, [wheel_of(first)])
    size = kept(store).bytes
    policy = replace(WIDE, most_bytes=2 * size + size // 2)
    records = [stored(store) for _ in range(4)]
    for number, record in enumerate(records):
        now = NOON + timedelta(seconds=number + 1)
        with ImageArchive(
            store, tmp_path / "images", policy, Keeping("all"), pytest.fail, lambda now=now: now
        ) as archive:
            archive.offer(record, [wheel_of(record)])
        assert kept(store).bytes <= policy.most_bytes
    assert left(tmp_path) == {str(record.uuid) for record in records[-2:]}


@pytest.mark.parametrize("path", ["../precious", "../../precious", "{folder}/../precious", "out", ".", "./"])
def test_nothing_outside_of_the_archive_is_deleted_and_never_all_of_it(
    tmp_path: Path, store: ResultStore, path: str
) -> None:
    folder = tmp_path / "a" / "images"
    for precious in (tmp_path / "precious", tmp_path / "a" / "precious", folder / "2026-11-22"):
        precious.mkdir(parents=True)
        (precious / "left.png").write_bytes(b"x")
    (folder / "out").symlink_to(tmp_path / "precious", target_is_directory=True)
    record = stored(store)
    store.record_shot(
        ArchivedShotRecord(
            record.uuid, "front_left", path.format(folder=folder), 1, NOON, RetentionClass.ORDINARY
        )
    )
    for _ in range(2):
        enforce(store, folder, replace(WIDE, most_bytes=0), NOON)
    assert kept(store).shots == 0
    assert len(list(tmp_path.glob("**/left.png"))) == 3


def test_images_are_those_of_the_results_and_never_matched_by_their_times(
    tmp_path: Path, store: ResultStore
) -> None:
    """A shot was left with its rig and found by its time, which a clock that is set back gives twice."""
    record = stored(store)
    mine = replace(shot_of(record), time_utc=NOON - timedelta(days=1))
    with ImageArchive(store, tmp_path / "images", WIDE, Keeping("all"), pytest.fail, lambda: NOON) as archive:
        observer = ArchivingObserver(Observer(), archive)
        observer.cycle_done(report(cycle(), None, {"front_right": shot_of(record, "front_right")}))
        observer.cycle_done(report(record, 1.0, {"front_left": mine, "front_right": None}))
    assert {path.name for path in (tmp_path / "images").glob("*/*")} == {f"{record.uuid}-front_left"}


def report(
    record: CycleRecord, committed_s: float | None, shots: Mapping[str, WheelShot | None]
) -> CycleReport:
    results = [
        WheelResult(name, "c", True, None, None) if shot is None else wheel_of(record, name, shot)
        for name, shot in shots.items()
    ]
    wheels = tuple(JudgedWheel(result, None, Angle("camber", None), Angle("toe", None)) for result in results)
    evaluation = Evaluation(wheels, (), None, guard_band=True, coverage_factor=2.0)
    trigger = Trigger(1, tuple(shots), 1, "V", 0.0)
    return CycleReport(trigger, record, evaluation, committed_s, None)
