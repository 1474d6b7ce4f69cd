"""Pipes, devices, sockets, folders and files without an end, given to every verb in place of a file.

A pipe was opened and waited for a writer for ever (`db check`, a log of CAN frames); a file of 20 GB was
read until the memory was full.
"""

from __future__ import annotations

import itertools
import os
import shutil
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import pytest

import sensors.formats.files
from alignment.errors import ConfigurationError, FormatError
from alignment.file_limits import DOCUMENT, size_in_words, unfit_kind, unfit_size
from sensors.formats import read_image, write_calibration, write_shot
from sensors.formats.files import entries, open_ordinary, read_bytes
from station.configuration.vehicle_types import read_vehicle_types
from station.line.tools.logs.reading import read_log
from tests.db.databases import new_database
from tests.end_to_end.conftest import CONFIGS, Truewheel
from tests.sensors.samples import TIME, calibration, shot

PLATES = CONFIGS / "plates"
SPARSE = 20 * 2**30
# Nothing here is rendered or measured: what is wrong shows at the file.
pytestmark = pytest.mark.timeout(60)


def pipe(path: Path) -> Path:
    os.mkfifo(path)
    return path


def device(path: Path) -> Path:
    path.symlink_to("/dev/zero")
    return path


def sparse(path: Path) -> Path:
    with path.open("wb") as file:
        file.truncate(SPARSE)
    return path


def folder(path: Path) -> Path:
    path.mkdir()
    return path


@contextmanager
def many(_: object) -> Iterator[Iterator[SimpleNamespace]]:
    """As `os.scandir`, of a folder that never ends."""
    yield (SimpleNamespace(name=f"{number}.txt") for number in itertools.count())


@pytest.fixture
def bound(tmp_path: Path) -> Iterator[Path]:
    """A socket in the file system."""
    path = tmp_path / "s"
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(path))
        yield path


VERBS = {
    "calibration of measure": "measure {shot} --calibration {bad}",
    "calibration of spin": "measure {shot} {shot} --spin --calibration {bad}",
    "configuration of measure": "measure {shot} --calibration {calibration} --config {bad}",
    "shot.json": "measure {bad_shot} --calibration {calibration}",
    "session.json": "calibrate {bad_session} --out {out}",
    "calibration checked": "calibration check {shot} --calibration {bad} --camber 0 --toe 0",
    "calibration refreshed": "calibration refresh {shot} --calibration {bad} --out {out}",
    "calibration exported": "calibration export {bad} --format opencv --out {out}",
    "OpenCV": "calibration import {bad} --format opencv --rig a --side left --out {out}",
    "Kalibr": "calibration import {bad} --format kalibr --rig a --side left --out {out}",
    "mrcal": "calibration import {bad} --format mrcal --rig a --side left --out {out}",
    "gauge session": "calibration frame {nested} --frame {frame} --calibration {calibration} --out {out}",
    "frame": "calibration frame {bad_session} --frame {bad} --calibration {calibration} --out {out}",
    "zero's calibration": "zero measure {shot} --calibration {bad} --camber 0 --toe 0 --database {database}",
    "database of zero": "zero list --database sqlite:///{bad}",
    "database of check": "db check --database sqlite:///{bad}",
    "database of migrate": "db migrate --database sqlite:///{bad}",
    "database of report": "report all --database sqlite:///{bad} --out {out}.html",
    "database of export": "export csv --database sqlite:///{bad} --out {out}",
    "backup": "db restore {bad} --database sqlite:///{out}",
    "configuration of retention": "db retention --config {bad}",
    "gauge values": "gauge grr --from-file {bad}",
    "type 1": "gauge type1 --from-file {bad} --reference 0 --tolerance 1",
    "configuration of run": "run --config {bad}",
    "configuration of the PLC": "line plc --vin WVWZZZ1JZXW000001 --config {bad}",
    "scenarios": "line plc --config {config} --scenario {bad}",
    "log": "line monitor {bad_log}",
    "configuration of the monitor": "line monitor --config {bad}",
    "simulated wheel": "simulate wheel --camber 0 --toe 0 --seed 1 --config {bad} --out {out}",
    "simulated vehicle": "simulate vehicle --seed 1 --config {bad} --out {out}",
    "simulated session": "simulate plate-session --seed 1 --config {bad} --out {out}",
    "plate": "simulate plate-session --seed 1 --plate {bad} --out {out}",
    "gauge frame": "simulate gauge-session --seed 1 --frame {bad} --out {out}",
    "DBC": "run --config {bad_dbc}",
    "demo": "demo --config {bad}",
}


# Logs and databases are not read into memory: of a large one the first bytes tell that it is none.
STREAMED = ("log", "backup", "database of")
# A pipe, which made a reader wait for ever, in place of every file; of the others one each, in turn.
CASES = [
    pytest.param(words, make, id=f"{name}: {make.__name__}")
    for number, (name, words) in enumerate(VERBS.items())
    for make in (pipe, (device, sparse, folder)[number % 3])
    if not (make is sparse and name.startswith(STREAMED)) and not (make is folder and "mrcal" in name)
]


@pytest.mark.parametrize(("words", "make"), CASES)
def test_what_is_no_ordinary_file_of_a_believable_size_is_refused_before_it_is_read(
    truewheel: Truewheel, tmp_path: Path, words: str, make: Callable[[Path], Path]
) -> None:
    bad = make(tmp_path / "bad.log") if "{bad_log}" in words else make(tmp_path / "bad")
    good = tmp_path / "good"
    write_shot(good, shot())
    write_calibration(good / "calibration.json", calibration(), method="test", created_utc=TIME)
    for name, file in (("bad_shot", "shot.json"), ("bad_session", "session.json")):
        (tmp_path / name).mkdir()
        (tmp_path / name / file).symlink_to(bad)
    (tmp_path / "nested").mkdir()
    (tmp_path / "nested" / "rig").symlink_to(tmp_path / "bad_session")
    if "{database}" in words:
        new_database(tmp_path / "new.db")
    configs = tmp_path / "configs"
    if "{bad_dbc}" in words:
        shutil.copytree(CONFIGS, configs)
        (configs / "line.dbc").unlink()
        (configs / "line.dbc").symlink_to(bad)
    names = {
        "bad": bad,
        "bad_log": bad,
        "shot": good,
        "calibration": good / "calibration.json",
        "frame": PLATES / "gauge.toml",
        "out": tmp_path / "out",
        "database": f"sqlite:///{tmp_path / 'new.db'}",
        "config": CONFIGS / "station.toml",
        "bad_shot": tmp_path / "bad_shot",
        "bad_session": tmp_path / "bad_session",
        "nested": tmp_path / "nested",
        "bad_dbc": configs / "station.toml",
    }
    ended = truewheel(*(word.format(**names) for word in words.split()))
    assert (ended.status, ended.out) == (2, ""), ended.err
    said = ended.err.strip().splitlines()[-1]
    assert said.startswith("truewheel: "), ended.err
    assert str(tmp_path) in said
    found = {pipe: "pipe", device: "device", sparse: "20 GiB", folder: "folder"}[make]
    assert found in said, said


def test_the_sentence_names_file_kind_and_cure(tmp_path: Path, bound: Path) -> None:
    for bad, found in (
        (bound, "a socket"),
        (pipe(tmp_path / "p"), "a pipe, which has no end"),
        (tmp_path, "a folder"),
        (Path("/dev/null"), "a device"),
    ):
        with pytest.raises(
            FormatError, match=f"{bad}: expected a calibration, found {found}. Name an ordinary"
        ):
            read_bytes(bad, "a calibration")


def test_a_file_just_as_large_as_allowed_is_read_and_one_byte_more_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(bytes(100))
    assert len(read_bytes(path, "a table", 100)) == 100
    with pytest.raises(FormatError, match="a table of at most 99 bytes, found 100 bytes"):
        read_bytes(path, "a table", 99)


def test_a_file_that_says_nothing_of_its_size_is_read_no_further_than_allowed() -> None:
    """Files of the system say that they are empty."""
    path = Path("/proc/self/maps")
    assert path.stat().st_size == 0
    with pytest.raises(FormatError, match="of at most 50 bytes, found 51 bytes"):
        read_bytes(path, "a table", 50)


def test_a_file_that_became_a_pipe_since_it_was_looked_at_is_not_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sensors.formats.files, "require_ordinary", lambda *_: None)
    with pytest.raises(FormatError, match="pipe"):
        open_ordinary(pipe(tmp_path / "p"), "a log", 100)


def test_an_image_of_20_gigabytes_or_a_pipe_in_its_place_is_refused(tmp_path: Path) -> None:
    for make, found in ((sparse, "20 GiB"), (pipe, "a pipe"), (device, "a device")):
        with pytest.raises(FormatError, match=found):
            read_image(make(tmp_path / f"{make.__name__}.png"))


def test_a_log_of_frames_that_is_a_pipe_or_too_large_is_refused_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(FormatError, match="a log of CAN frames, found a pipe"):
        next(iter(read_log(pipe(tmp_path / "a.blf"))))
    monkeypatch.setattr("station.line.tools.logs.reading.LOG", 10)
    (tmp_path / "b.log").write_text("(0.0) can0 123#00\n")
    with pytest.raises(FormatError, match="of at most 10 bytes"):
        next(iter(read_log(tmp_path / "b.log")))


def test_a_folder_of_very_many_entries_is_not_searched(tmp_path: Path) -> None:
    for number in range(12):
        (tmp_path / f"{number:02}").mkdir()
    (tmp_path / "07" / "shot.json").touch()
    assert entries(tmp_path, "shot.json", "shots", most=12) == [tmp_path / "07" / "shot.json"]
    with pytest.raises(FormatError, match="a folder of shots, at most 11 entries, found more"):
        entries(tmp_path, "shot.json", "shots", most=11)
    assert entries(tmp_path / "absent", "shot.json", "shots") == []


def test_a_folder_of_vehicle_types_with_very_many_entries_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sensors.formats.files.os.scandir", many)
    with pytest.raises(ConfigurationError, match="a folder of vehicle types, at most 100000 entries"):
        read_vehicle_types(tmp_path)


def test_sizes_and_kinds_in_words() -> None:
    assert [size_in_words(size) for size in (0, 1023, 1024, DOCUMENT, SPARSE, 2**50)] == [
        "0 bytes", "1023 bytes", "1 KiB", "256 MiB", "20 GiB", "1024 TiB",
    ]  # fmt: skip
    assert unfit_kind(0o100644) is None
    assert unfit_kind(0o060660) == "a device"
    assert unfit_kind(0) == "no ordinary file"
    assert unfit_size(10, 10) is None
    assert unfit_size(11, 10) == "11 bytes"
