"""One folder of archived images measured again: identical, or why not, and what is wrong with it."""

from __future__ import annotations

import json
import math
import shutil
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from alignment.geometry.transforms import RigidTransform
from alignment.values import MeasureSettings
from alignment.wheel import SeriesRules
from db.queries import ResultReader
from db.records import ZeroRecord
from db.store import ResultStore
from sensors.formats.archived import digest_of, read_archived
from sensors.formats.images import read_image, write_image
from station.cycle.wheels.image_memory import ImageMemory
from station.cycle.wheels.series import SeriesPlan
from station.replay.archive_walk import archived_folders
from station.replay.one import Measurer
from station.replay.stored import StoredResults
from station.replay.values import Cause, Choices, Job, Replayed, ReplayState
from station.threads import Worker
from tests.alignment.wheel.test_series import exposures
from tests.once import folder_once
from tests.rendered import moved
from tests.station.cycle.test_turning_wheels import TurningRig
from tests.station.replay.archives import DAY, WHEEL, Archived, NoisyRig, calibration_of, dark, in_force

ARCMIN = math.pi / 180 / 60


@folder_once
def station(folder: Path) -> None:
    """Three wheels: measured, measured with a zero measurement, and refused."""
    made = Archived(folder)
    made.add(NoisyRig(1))
    zero = (
        ZeroRecord(
            "zero-7", WHEEL, made.in_force.calibration.id, DAY, "Master", "spin_axis", 16, 0.001, -0.002,
            0.0005, -0.0015, 1e-6, 2e-6, 0.1, "0.1.0",
        )
    )  # fmt: skip
    made.zeros = [zero]
    with ResultStore(made.url) as store:
        store.record_zero(zero)
    made.add(NoisyRig(2), "WVWZZZ1KZAW000002")
    made.zeros = ()
    made.add(NoisyRig(3, dark), "WVWZZZ1KZAW000003")


@pytest.fixture
def archive(tmp_path: Path) -> Path:
    copy = tmp_path / "station"
    shutil.copytree(station(), copy)
    return copy


def folders(archive: Path) -> list[Path]:
    found = [each.path for each in archived_folders(archive / "images")]
    return sorted(found, key=lambda path: read_archived(path).vin or "")


def replayed(path: Path, **choices: Any) -> Replayed:
    given = {"calibrations": {}, "settings": None} | choices
    return Measurer(Choices(**given)).replay(Job(path.name, str(path)))


def test_measured_corrected_and_refused_wheels_come_out_to_the_last_bit(archive: Path) -> None:
    outcomes = []
    for path in folders(archive):
        done = replayed(path)
        assert (done.state, done.differences, done.damage, done.lacks) == (ReplayState.IDENTICAL, (), (), ())
        assert done.measured
        outcomes.append(read_archived(path).result)
    assert [each.outcome for each in outcomes] == ["measured", "measured", "refused"]
    assert outcomes[2].reason_code == "head_dark"


def test_the_database_agrees_with_the_archive(archive: Path) -> None:
    with ResultReader(f"sqlite:///{archive / 'results.db'}") as reader:
        found = list(archived_folders(archive / "images"))
        facts = StoredResults(reader).facts(found)
    assert len(facts) == 3
    for each in found:
        done = Measurer(Choices({}, None)).replay(Job(each.key, str(each.path), facts[each.key]))
        assert (done.state, done.damage, done.lacks) == (ReplayState.IDENTICAL, (), ())


def document(archive: Path, movement: RigidTransform, *heads: int) -> dict[str, Any]:
    calibration = replace(moved(calibration_of("second"), movement, *heads))
    return dict(in_force(calibration, archive).document)


def test_another_calibration_is_told_as_the_cause_and_the_program_is_not(archive: Path) -> None:
    """The archive says another program; measured as then it finds the same, so it has no part in it."""
    first, corrected, _ = folders(archive)
    turn = RigidTransform.from_rotvec(np.array([0.0, 0.001, 0.0]), np.zeros(3))
    second = document(archive, turn)
    rewrite(first, lambda data: data["environment"].update(numpy="1.0.0"))
    done = replayed(first, calibrations={WHEEL: second})
    assert done.state is ReplayState.DIFFERS
    assert done.causes == ("other calibration: second instead of first",)
    toe = next(each for each in done.differences if each.field == "toe")
    assert isinstance(toe.stored, float)
    assert isinstance(toe.found, float)
    assert abs(toe.found - toe.stored) == pytest.approx(0.001, rel=0.05)
    with_zero = replayed(corrected, calibrations={WHEEL: second})
    assert any("zero-7" in text for text in with_zero.lacks)
    # The same calibration under another path is no other one.
    same = json.loads((first / "calibration.json").read_text())
    assert replayed(first, calibrations={WHEEL: same}).state is ReplayState.IDENTICAL


def test_other_settings_are_named(archive: Path) -> None:
    first, *_ = folders(archive)
    done = replayed(first, settings=MeasureSettings(method="plane"))
    assert done.state is ReplayState.DIFFERS
    assert done.causes == ("other settings: method plane instead of revolution",)


def rewrite(folder: Path, change: Callable[[dict[str, Any]], object]) -> None:
    """Change a record as a program would: with the digest that fits."""
    data = json.loads((folder / "archived.json").read_text())
    change(data)
    data["sha256"] = digest_of(data)
    (folder / "archived.json").write_text(json.dumps(data))


def test_another_program_is_told_with_what_is_another_one(archive: Path) -> None:
    first, *_ = folders(archive)

    def older(data: dict[str, Any]) -> None:
        data["software_version"] = "0.0.9"
        data["environment"]["numpy"] = "1.26.4"
        data["environment"]["code"] = 64 * "0"
        data["result"]["camber"] += 1e-15

    rewrite(first, older)
    done = replayed(first)
    (cause,) = done.causes
    assert cause.startswith(f"{Cause.SOFTWARE}: truewheel 0.0.9 → ")
    assert "numpy 1.26.4 → " in cause
    assert "the program's mathematics" in cause
    assert [each.field for each in done.differences] == ["camber"]
    assert replayed(first, within=0.001 * ARCMIN).state is ReplayState.IDENTICAL


def test_what_nothing_explains_is_told_as_unexplained(archive: Path) -> None:
    first, _, refused = folders(archive)
    rewrite(first, lambda data: data["result"].update(toe=data["result"]["toe"] + 1e-9))
    rewrite(refused, lambda data: data["result"].update(reason_code="head_saturated"))
    for path, field in ((first, "toe"), (refused, "reason_code")):
        done = replayed(path)
        assert (done.state, done.causes) == (ReplayState.DIFFERS, (str(Cause.UNEXPLAINED),))
        assert [each.field for each in done.differences] == [field]


# Damage


def altered(folder: Path) -> None:
    """A picture that somebody worked on: sound as a file, and not what the camera saw."""
    path = folder / sorted(file.name for file in folder.glob("*.png"))[0]
    image = read_image(path)
    write_image(path, np.roll(image, 3, axis=0))


def truncated(folder: Path) -> None:
    path = sorted(folder.glob("*.png"))[1]
    path.write_bytes(path.read_bytes()[:5000])


def one_lost(folder: Path) -> None:
    sorted(folder.glob("*.png"))[2].unlink()


def edited(folder: Path) -> None:
    path = folder / "archived.json"
    data = json.loads(path.read_text())
    data["result"]["camber"] = 0.0
    path.write_text(json.dumps(data))


def edited_shot(folder: Path) -> None:
    path = folder / "shot.json"
    path.write_text(path.read_text().replace("5.0", "6.0"))


def edited_calibration(folder: Path) -> None:
    path = folder / "calibration.json"
    data = json.loads(path.read_text())
    data["heads"][0]["left"]["cx"] += 2.0
    path.write_text(json.dumps(data))


def no_json(folder: Path) -> None:
    (folder / "archived.json").write_text("{")


def record_lost(folder: Path) -> None:
    (folder / "archived.json").unlink()


def all_lost(folder: Path) -> None:
    shutil.rmtree(folder)


@pytest.mark.parametrize(
    ("harm", "words", "measured", "cause"),
    [
        (altered, "head_1_left.png has ", True, "other image content: head_1_left.png"),
        (truncated, "has 5000 bytes, not ", False, None),
        (one_lost, "is missing", False, None),
        (edited, "was changed since it was written", False, None),
        (edited_shot, "shot.json has another content than was written", True, None),
        (edited_calibration, "calibration.json", True, "other calibration: the archived one was changed"),
        (no_json, "archived.json", False, None),
        (record_lost, "archived.json is missing", False, None),
        (all_lost, "the folder is missing", False, None),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_damage_is_told_and_never_taken_for_a_result(
    archive: Path, harm: Callable[[Path], None], words: str, measured: bool, cause: str | None
) -> None:
    first, *others = folders(archive)
    harm(first)
    done = replayed(first)
    assert (done.state, done.measured) == (ReplayState.DAMAGED, measured)
    assert any(words in text for text in done.damage), done.damage
    assert done.causes == (() if cause is None else (cause,))
    assert replayed(others[0]).state is ReplayState.IDENTICAL


def test_a_record_that_fits_itself_but_not_the_database_is_damage(archive: Path) -> None:
    """Whoever changes a record and its digest too is found by the hash that the database holds."""
    first, *_ = folders(archive)
    rewrite(first, lambda data: data["result"].update(camber=data["result"]["camber"] + 0.01))
    with ResultReader(f"sqlite:///{archive / 'results.db'}") as reader:
        (found,) = [each for each in archived_folders(archive / "images") if each.path.name == first.name]
        facts = StoredResults(reader).facts([found])[found.key]
    done = Measurer(Choices({}, None)).replay(Job(found.key, str(found.path), facts))
    assert done.state is ReplayState.DAMAGED
    assert "archived.json is another one than the database knows" in done.damage
    assert "archived.json and the database differ in camber" in done.damage


def test_a_calibration_of_other_cameras_measures_nothing(archive: Path) -> None:
    first, *_ = folders(archive)
    data = json.loads((first / "calibration.json").read_text())
    data["id"], data["heads"], data["covariance"] = "two heads", data["heads"][:2], None
    done = replayed(first, calibrations={WHEEL: data})
    assert (done.state, done.measured) == (ReplayState.INCOMPLETE, False)
    assert any("expected the heads" in text for text in done.lacks)


# Archives of earlier programs: images and shot.json, nothing beside them


def as_before(archive: Path) -> list[Path]:
    found = folders(archive)
    for path in found:
        (path / "archived.json").unlink()
        (path / "calibration.json").unlink()
    return found


def earlier(archive: Path) -> dict[str, Replayed]:
    """Replay what an earlier program archived, beside its database."""
    with ResultReader(f"sqlite:///{archive / 'results.db'}") as reader:
        found = list(archived_folders(archive / "images"))
        facts = {
            key: replace(each, record_sha256=None, document=in_force(calibration_of(), archive).document)
            for key, each in StoredResults(reader).facts(found).items()
        }
    measurer = Measurer(Choices({}, None))
    return {
        each.path.name: measurer.replay(Job(each.key, str(each.path), facts.get(each.key))) for each in found
    }


def test_archives_of_earlier_programs_come_out_the_same_and_say_what_they_lack(archive: Path) -> None:
    paths = as_before(archive)
    done = earlier(archive)
    for path in paths:
        one = done[path.name]
        assert (one.state, one.differences, one.damage) == (ReplayState.IDENTICAL, (), ())
        assert any("hashes" in text for text in one.lacks)
        assert any("settings" in text for text in one.lacks)


def test_without_database_and_calibration_an_earlier_archive_is_told_as_incomplete(archive: Path) -> None:
    first, *_ = as_before(archive)
    done = replayed(first)
    assert (done.state, done.measured) == (ReplayState.INCOMPLETE, False)
    with_one = replayed(first, calibrations={WHEEL: dict(in_force(calibration_of(), archive).document)})
    assert (with_one.state, with_one.measured) == (ReplayState.INCOMPLETE, True)


# Wheels that turn


def series(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, **plan: Any) -> tuple[Archived, Path]:
    """A series of 16 exposures, archived; planes stand for the images' measurement, then and now."""
    planes, _ = exposures(np.random.default_rng(31))
    taken = {}

    def measure(images: Any, rig: Any, settings: Any) -> Any:
        key = images[0].left.tobytes()
        return taken.setdefault(key, planes[len(taken)] if key not in taken else None)

    made = Archived(tmp_path, sample())
    made.measure = measure
    worker, rig = Worker("series", 2), TurningRig(WHEEL, [])
    rules = SeriesRules(len(planes), math.radians(270.0))
    plan = {"memory": ImageMemory(10**9)} | plan
    try:
        position = made.position(rig)
        rig.arm()
        result = position.run_series(SeriesPlan(rules, 0.0, **plan), worker, threading.Event(), 60.0)
    finally:
        worker.close(10.0)
    assert result.spin is not None
    monkeypatch.setattr("station.replay.one.measure_wheel", measure)
    return made, made.put(result)


def sample() -> Any:
    from tests.sensors.samples import calibration

    return calibration(rig=WHEEL, covariance=False)


def test_a_spin_axis_comes_out_the_same_with_its_run_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, path = series(tmp_path, monkeypatch)
    stored = read_archived(path).result
    assert stored.method == "spin_axis"
    assert stored.run_out is not None
    assert stored.run_out > math.radians(0.05)
    done = replayed(path)
    assert (done.differences, done.state, done.measured) == ((), ReplayState.IDENTICAL, True)
    # It is the run-out that is compared, and not only the angles.
    rewrite(path, lambda data: data["result"].update(run_out=data["result"]["run_out"] * (1 + 1e-12)))
    assert [each.field for each in replayed(path).differences] == ["run_out"]


def test_a_lost_exposure_of_a_series_is_damage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _, path = series(tmp_path, monkeypatch)
    shutil.rmtree(path / "turn_05")
    done = replayed(path)
    assert (done.state, done.measured) == (ReplayState.DAMAGED, False)
    assert any("turn_05/shot.json is missing" in text for text in done.damage)


def test_a_series_of_which_only_the_last_exposure_is_kept_is_incomplete(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = Archived(tmp_path, sample())
    made.measure = lambda *_: exposures(np.random.default_rng(31))[0][0]
    result = made.position(TurningRig(WHEEL, [])).run()
    assert result.measured_with is not None
    with_rules = replace(result.measured_with, rules=SeriesRules())
    monkeypatch.setattr("station.store.archive.ImageArchive._tell_incomplete", lambda *_: None)
    done = replayed(made.put(replace(result, measured_with=with_rules)))
    assert (done.state, done.measured) == (ReplayState.INCOMPLETE, False)
    assert done.lacks == ("the exposures of its series: only the last one is archived",)
