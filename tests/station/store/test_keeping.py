"""Which cycles' images are kept, what their folders hold, and how a change of them is noticed."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from alignment.errors import ConfigurationError, FormatError
from alignment.wheel import SeriesRules
from db.queries import ResultReader, vin_history
from db.records import CycleRecord, RetentionClass, Verdict, WheelOutcome
from db.store import ResultStore
from sensors.formats.archived import archived_hash, changed_files, read_archived
from sensors.formats.shot import read_shot
from sensors.formats.validation import validate
from sensors.shot import SeriesPlace
from station.configuration.archive import ArchiveSettings
from station.configuration.vehicle_types import VehicleType
from station.cycle.wheels.image_memory import ImageMemory
from station.cycle.wheels.positions import WheelResult
from station.store.archive import ImageArchive
from station.store.keeping import Keeping
from tests.db.databases import new_database
from tests.db.example_records import CALIBRATION, NOON, axle, cycle, wheel, zero
from tests.sensors.samples import shot as sample_shot
from tests.station.bench import AXLE
from tests.station.store.test_archive import WIDE, wheel_of

NO_ANGLES = dict.fromkeys(("camber", "toe", "camber_u", "toe_u"))


def good() -> CycleRecord:
    return cycle()


def nok() -> CycleRecord:
    record = cycle()
    wheels = (wheel("front_left", verdict=Verdict.NOK, toe=0.1), *record.wheels[1:])
    return cycle(wheels=wheels, outcome="nok", axles=(axle(),))


def axle_nok() -> CycleRecord:
    """Every wheel is good, their total toe is not."""
    bad = replace(axle(), verdict=Verdict.NOK)
    return cycle(outcome="nok", axles=(bad,))


def unmeasured(outcome: WheelOutcome) -> CycleRecord:
    record = cycle()
    without = replace(
        record.wheels[0], outcome=outcome, verdict=Verdict.NONE, reason_code="x", reason_text="y", **NO_ANGLES
    )
    return cycle(
        wheels=(without, *record.wheels[1:]), outcome="fault", axles=(), vehicle_angles=None,
        reason_code="measurement_refused", reason_text="refused",
    )  # fmt: skip


def kept(keeping: Keeping, record: CycleRecord) -> dict[str, RetentionClass]:
    return keeping.of(record)


NAMES = {each.wheel for each in cycle().wheels}


@pytest.mark.parametrize("record", [nok, axle_nok])
def test_of_a_vehicle_that_is_nok_all_wheels_are_kept_as_evidence(record: Callable[[], CycleRecord]) -> None:
    """Only the wheel with a bad angle was: what the axle or the centreline said could not be explained."""
    assert kept(Keeping(("nok",)), record()) == dict.fromkeys(NAMES, RetentionClass.EVIDENCE)
    assert kept(Keeping(("refused", "fault")), record()) == {}


@pytest.mark.parametrize("outcome", [WheelOutcome.REFUSED, WheelOutcome.FAULT])
def test_cycles_with_a_refused_or_failed_wheel_are_kept_where_that_is_asked(outcome: WheelOutcome) -> None:
    record, (this, other) = (
        unmeasured(outcome),
        (str(outcome), "fault" if outcome == "refused" else "refused"),
    )
    assert set(kept(Keeping((this,)), record)) == NAMES  # type: ignore[arg-type]
    assert kept(Keeping((other,)), record) == {}  # type: ignore[arg-type]
    assert kept(Keeping(("nok",)), record) == {}


def test_evidence_keeps_the_wheels_that_were_not_good_as_before() -> None:
    assert kept(Keeping("evidence"), good()) == {}
    assert kept(Keeping("evidence"), nok()) == {"front_left": RetentionClass.EVIDENCE}
    assert kept(Keeping("all"), good()) == dict.fromkeys(NAMES, RetentionClass.ORDINARY)


def test_every_third_cycle_is_kept_beside_the_evidence() -> None:
    keeping = Keeping((), 3)
    assert [bool(kept(keeping, good())) for _ in range(7)] == [True, False, False, True, False, False, True]
    keeping = Keeping(("nok",), 3)
    assert [bool(kept(keeping, record())) for record in (good, nok, good, good)] == [True, True, False, True]


@pytest.mark.parametrize(
    ("given", "means"),
    [
        ({}, ("all", None)),
        ({"keep": "evidence"}, ("evidence", None)),
        ({"keep": "evidence", "every": 10}, ("evidence", 10)),
        ({"keep": ["nok", "refused"]}, (("nok", "refused"), None)),
        ({"keep": [], "every": 50}, ((), 50)),
    ],
)
def test_old_and_new_ways_to_say_what_is_kept(given: dict[str, Any], means: object) -> None:
    found = validate(ArchiveSettings, {"folder": "images"} | given, file="s", error=ConfigurationError)
    assert (found.keep, found.every) == means


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"keep": "nok"}, "keep"),
        ({"keep": ["nok", "good"]}, "keep"),
        ({"keep": ["nok", "nok"]}, "each reason once"),
        ({"keep": []}, "empty list"),
        ({"every": 5}, "none with keep = 'all'"),
        ({"keep": "evidence", "every": 0}, "every"),
    ],
)
def test_what_keeps_nothing_or_says_it_twice_is_refused(given: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        validate(ArchiveSettings, {"folder": "images"} | given, file="s", error=ConfigurationError)


# What a folder holds


@pytest.fixture
def url(tmp_path: Path) -> str:
    return new_database(tmp_path / "results.db")


@pytest.fixture
def store(url: str) -> Iterator[ResultStore]:
    with ResultStore(url) as opened:
        opened.record_calibration(CALIBRATION)
        yield opened


KIND = VehicleType.model_validate(
    {
        "number": 1,
        "name": cycle().vehicle.vehicle_type,  # type: ignore[union-attr]
        "tyre_width_mm": 205.0,
        "axles": {"front": AXLE | {"tyre_width_mm": 195.0}, "rear": AXLE},
    }
)


def archived(tmp_path: Path, store: ResultStore, result: WheelResult, record: CycleRecord) -> Path:
    kinds = {KIND.name: KIND}
    with ImageArchive(
        store, tmp_path / "images", WIDE, Keeping("all"), pytest.fail, lambda: NOON, kinds=kinds
    ) as archive:
        archive.offer(record, [result])
    (folder,) = (tmp_path / "images").glob("*/*")
    return folder


def written(store: ResultStore) -> CycleRecord:
    record = cycle()
    store.write_cycle(record)
    return record


def test_a_folder_holds_all_that_a_measurement_needs(tmp_path: Path, url: str, store: ResultStore) -> None:
    record = written(store)
    plain = wheel_of(record)
    basis = replace(plain.measured_with, zero=zero(rig="front_left"), needs_place=True)  # type: ignore[type-var]
    folder = archived(tmp_path, store, replace(plain, measured_with=basis), record)
    found = read_archived(folder)
    assert (found.cycle, found.wheel, found.vin) == (
        str(record.uuid), "front_left", record.vehicle.vin,  # type: ignore[union-attr]
    )  # fmt: skip
    assert (found.measure, found.tyre_width_mm, found.series) == ("tyre_plane", 195.0, None)
    assert found.settings.needs_place
    assert found.zero is not None
    assert found.zero.camber == zero().camber
    assert found.result.camber == plain.measurement.camber  # type: ignore[union-attr]
    assert json.loads((folder / "calibration.json").read_text()) == basis.in_force.document
    assert set(found.files) == {file.name for file in folder.iterdir()} - {"archived.json"}
    assert changed_files(folder, found) == {}
    with ResultReader(url) as reader:
        (kept_shot,) = vin_history(reader, record.vehicle.vin).shots  # type: ignore[union-attr]
    assert kept_shot.record.record_sha256 == archived_hash(folder)
    assert kept_shot.record.bytes == sum(file.stat().st_size for file in folder.iterdir())


def series_of(record: CycleRecord, count: int = 12) -> WheelResult:
    plain = wheel_of(record)
    shots = tuple(
        replace(sample_shot(heads=("head_1",), trigger=k), series=SeriesPlace(k, count))
        for k in range(1, count + 1)
    )
    basis = replace(plain.measured_with, rules=SeriesRules(count, math.radians(270.0)))  # type: ignore[type-var]
    return replace(plain, shot=shots[-1], exposures=shots, measured_with=basis)


def test_all_exposures_of_a_series_are_kept_in_their_order(tmp_path: Path, store: ResultStore) -> None:
    """Only the last one was: nobody could find the spin axis again."""
    record = written(store)
    result = series_of(record)
    folder = archived(tmp_path, store, result, record)
    found = read_archived(folder)
    assert (found.measure, found.shots) == ("spin_axis", tuple(f"turn_{k:02d}" for k in range(1, 13)))
    assert found.series is not None
    assert found.series.exposures == 12
    assert changed_files(folder, found) == {}
    for number, (name, taken) in enumerate(zip(found.shots, result.exposures or (), strict=True), 1):
        again = read_shot(folder / name)
        assert again.series == SeriesPlace(number, 12)
        assert np.array_equal(again.frames[1].image, taken.frames[1].image)


def test_a_series_that_found_no_room_in_memory_says_so(tmp_path: Path, store: ResultStore) -> None:
    record, said = written(store), list[str]()
    result = replace(series_of(record), exposures=None)
    with ImageArchive(
        store, tmp_path / "images", WIDE, Keeping("all"), lambda text, _: said.append(text), lambda: NOON
    ) as archive:
        archive.offer(record, [result])
    (folder,) = (tmp_path / "images").glob("*/*")
    assert read_archived(folder).shots == (".",)
    assert said == [
        f"images of cycle {record.uuid} are not archived but for the last exposure of front_left: no memory "
        "was left for the others. Allow more series_mb"
    ]


def test_memory_of_exposures_is_bounded_and_comes_back_when_they_go() -> None:
    shots = [sample_shot(trigger=k) for k in range(1, 4)]
    size = sum(frame.image.nbytes for frame in shots[0].frames)
    memory = ImageMemory(2 * size)
    assert [memory.take(shot) for shot in shots] == [True, True, False]
    assert memory.bytes == 2 * size
    del shots[0]
    assert memory.bytes == size
    assert memory.take(shots[1])


def edit(folder: Path, change: Callable[[dict[str, Any]], object]) -> None:
    data = json.loads((folder / "archived.json").read_text())
    change(data)
    (folder / "archived.json").write_text(json.dumps(data))


@pytest.mark.parametrize(
    "change",
    [
        lambda data: data["result"].update(camber=0.0123),
        lambda data: data["settings"].update(minimum_points=301),
        lambda data: data["files"]["head_1_left.png"].update(sha256=64 * "a"),
        lambda data: data.update(vin="WVWZZZ1KZAW999999"),
    ],
)
def test_a_record_that_was_changed_is_noticed_without_the_database(
    tmp_path: Path, store: ResultStore, change: Callable[[dict[str, Any]], object]
) -> None:
    record = written(store)
    folder = archived(tmp_path, store, wheel_of(record), record)
    edit(folder, change)
    with pytest.raises(FormatError, match="was changed since it was written"):
        read_archived(folder)


def test_files_that_were_changed_cut_or_lost_are_named(tmp_path: Path, store: ResultStore) -> None:
    record = written(store)
    folder = archived(tmp_path, store, wheel_of(record), record)
    left, right = folder / "head_1_left.png", folder / "head_1_right.png"
    whole = left.read_bytes()
    left.write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))
    right.write_bytes(right.read_bytes()[:100])
    (folder / "shot.json").unlink()
    found = changed_files(folder, read_archived(folder))
    assert found["head_1_left.png"] == "has another content than was written"
    assert found["head_1_right.png"].startswith("has 100 bytes, not ")
    assert found["shot.json"] == "is missing"
