"""Whole replays: processes, a cluster, the journal, choices that do not fit, and the command."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from alignment.errors import ConfigurationError
from db.queries import ResultReader
from station.cli import main
from station.commands.replay import summary_as_json
from station.replay.cluster import measure_on_cluster
from station.replay.journal import Journal, identity
from station.replay.pool import ENDED, measure_in_processes
from station.replay.run import ReplayRequest, replay_archive
from station.replay.stored import StoredResults
from station.replay.summary import MOST_LACKS, ReplaySummary
from station.replay.values import Choices, Job, Replayed, ReplayState
from tests.station.replay.archives import WHEEL
from tests.station.replay.test_one import all_lost, altered, folders, station, truncated

AS_THEN = Choices({}, None)


@pytest.fixture
def archive(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    copy = tmp_path / "station"
    shutil.copytree(station(), copy)
    return copy


def many(archive: Path, count: int) -> Path:
    """The first wheel so often: identical folders of other cycles, as far as the archive alone can tell."""
    first, *others = folders(archive)
    for path in others:
        shutil.rmtree(path)
    for number in range(1, count):
        name = f"00000000-0000-4000-8000-{number:012d}-{WHEEL}"
        shutil.copytree(first, first.parent / name)
    return archive / "images"


def command(*arguments: object) -> int:
    with pytest.raises(SystemExit) as end:
        main(["replay", *map(str, arguments)])
    return int(end.value.code or 0)


@pytest.mark.slow
def test_processes_find_what_is_stored_and_the_command_says_so(
    archive: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    database = f"sqlite:///{archive / 'results.db'}"
    assert command(archive / "images", "--database", database, "--workers", 2, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["folders"], found["measured"], found["identical_to_stored"]) == (3, 3, True)
    assert found["states"]["identical"] == 3
    # Its own journal went with its end.
    assert list((tmp_path / "state").rglob("*.jsonl")) == []


@pytest.mark.slow
def test_damage_is_reported_for_each_wheel_and_the_others_are_measured(
    archive: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one, other, third = folders(archive)
    altered(one)
    truncated(other)
    all_lost(third)
    database = f"sqlite:///{archive / 'results.db'}"
    assert command(archive / "images", "--database", database, "--workers", 1) == 1
    said = capsys.readouterr().out
    for path in (one, other, third):
        assert f"{path.name}" in said
    assert "3 damaged" in said
    assert "the folder is missing" in said
    assert "because of other image content" in said


@pytest.mark.slow
def test_a_killed_replay_goes_on_where_it_stopped_and_counts_nothing_twice(
    archive: Path, tmp_path: Path
) -> None:
    images, journal = many(archive, 12), tmp_path / "journal.jsonl"
    program = [sys.executable, "-m", "station.cli", "replay", str(images), "--journal", str(journal)]
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).resolve().parents[3])}
    running = subprocess.Popen([*program, "--workers", "1"], env=environment, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 240.0
    while (not journal.exists() or journal.read_bytes().count(b"\n") < 4) and time.monotonic() < deadline:
        assert running.poll() is None, "it was done before it could be killed"
        time.sleep(0.005)
    running.send_signal(signal.SIGKILL)
    running.wait(60)
    # What it was writing at that moment.
    with journal.open("ab") as stream:
        stream.write(b'{"key": "2026-03-02/half')
    before = journal.read_bytes().count(b"\n") - 1
    assert 0 < before < 12
    done = subprocess.run(
        [*program, "--workers", "1", "--json"], env=environment, capture_output=True, check=False, timeout=240
    )
    found = json.loads(done.stdout)
    assert (done.returncode, found["folders"], found["measured_by_earlier_run"]) == (0, 12, before)
    keys = [json.loads(line)["key"] for line in journal.read_text().splitlines()[1:]]
    assert len(keys) == len(set(keys)) == 12


# The journal


def of(archive: Path, **choices: Any) -> dict[str, Any]:
    return identity(archive, replace(AS_THEN, **choices), {}, "0.1.0")


def test_a_journal_holds_what_was_written_and_forgets_half_a_line(tmp_path: Path) -> None:
    path, about = tmp_path / "j.jsonl", of(tmp_path)
    with Journal(path, about) as journal:
        journal.add(Replayed("a", ReplayState.IDENTICAL, measured=True))
        journal.add(Replayed("b", ReplayState.FAILED))
        journal.add(Replayed("a", ReplayState.DAMAGED))
    with path.open("ab") as stream:
        stream.write(b'{"key": "c", "sta')
    with Journal(path, about) as journal:
        # Failed ones are tried again, and nothing counts twice.
        assert [(each.key, each.state) for each in journal.entries()] == [("a", ReplayState.IDENTICAL)]
        journal.add(Replayed("c", ReplayState.DIFFERS))
    with Journal(path, about) as journal:
        assert [each.key for each in journal.entries()] == ["a", "c"]
    with Journal(path, about, anew=True) as journal:
        assert list(journal.entries()) == []


@pytest.mark.parametrize(
    ("other", "what"),
    [
        (lambda path: of(path / "elsewhere"), "archive"),
        (lambda path: of(path, within=1e-6), "choices"),
        (lambda path: of(path, calibrations={"front_left": {"id": "second"}}), "choices"),
        (lambda path: of(path) | {"program": "0.2.0"}, "program"),
    ],
)
def test_the_journal_of_another_replay_is_refused(tmp_path: Path, other: Any, what: str) -> None:
    path = tmp_path / "j.jsonl"
    with Journal(path, of(tmp_path)):
        pass
    with pytest.raises(ConfigurationError, match=f"that of another {what}"), Journal(path, other(tmp_path)):
        pass


@pytest.mark.parametrize("content", [b"hello\n", b'{"schema": "truewheel.shot/1"}\n', b"[1]\n"])
def test_what_is_no_journal_is_left_alone(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "j.jsonl"
    path.write_bytes(content)
    with pytest.raises(ConfigurationError, match="another kind of file"), Journal(path, of(tmp_path)):
        pass
    assert path.read_bytes() == content


def test_a_journal_with_a_line_that_no_replay_wrote_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "j.jsonl"
    with Journal(path, of(tmp_path)):
        pass
    with path.open("ab") as stream:
        stream.write(b'{"key": "a", "state": "fine"}\n')
    with Journal(path, of(tmp_path)) as journal, pytest.raises(ConfigurationError, match="lines that"):
        list(journal.entries())


def test_two_replays_never_share_a_journal(tmp_path: Path) -> None:
    path = tmp_path / "j.jsonl"
    with (
        Journal(path, of(tmp_path)),
        pytest.raises(ConfigurationError, match="of a replay that runs"),
        Journal(path, of(tmp_path)),
    ):
        pass


def test_a_pipe_is_no_journal(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(ConfigurationError, match="journal"), Journal(tmp_path / "pipe", of(tmp_path)):
        pass


# Choices that do not fit


def test_bad_input_ends_with_status_two_and_names_it(
    archive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    images = archive / "images"
    first, *_ = folders(archive)
    calibration = json.loads((first / "calibration.json").read_text())
    other = tmp_path / "other.json"
    other.write_text(json.dumps(calibration | {"rig": "rear_left"}))
    (tmp_path / "empty").mkdir()
    for arguments, words in (
        ((tmp_path / "nowhere",), "no such folder"),
        ((first / "shot.json",), "a file"),
        ((tmp_path / "empty",), "expected archived images, found none"),
        ((images, "--vin", "WVWZZZ1KZAW999999"), "archived images of WVWZZZ1KZAW999999"),
        ((images, "--from", "2027-01-01"), "expected archived images, found none"),
        ((images, "--calibration", other), "rear_left"),
        ((images, "--calibration", first / "calibration.json", "--calibration", first / "calibration.json"),
         "a second one of front_left"),
        ((images, "--scheduler", "127.0.0.1"), "an address such as tcp://"),
        ((images, "--journal", first / "shot.json"), "another kind of file"),
        ((images, "--from", "soon"), "soon"),
    ):  # fmt: skip
        assert command(*arguments) == 2, arguments
        assert words in capsys.readouterr().err


def test_earlier_archives_without_a_database_ask_for_it(
    archive: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for path in folders(archive):
        (path / "archived.json").unlink()
        (path / "calibration.json").unlink()
    assert command(archive / "images") == 2
    assert "Name the station's database" in capsys.readouterr().err


def test_one_vehicle_is_found_with_and_without_the_database(archive: Path) -> None:
    vin = "WVWZZZ1KZAW000002"
    request = ReplayRequest(archive / "images", AS_THEN, vin=vin)
    (found,) = request.folders()
    with ResultReader(f"sqlite:///{archive / 'results.db'}") as reader:
        asked = ReplayRequest(archive / "images", AS_THEN, StoredResults(reader, vin), "here", vin)
        assert [each.key for each in asked.folders()] == [found.key]
    assert list(ReplayRequest(archive / "images", AS_THEN, vin="other").folders()) == []
    assert len(list(ReplayRequest(archive / "images", AS_THEN, first_day="2026-03-02").folders())) == 3
    assert list(ReplayRequest(archive / "images", AS_THEN, last_day="2026-03-01").folders()) == []


# A cluster


@contextmanager
def cluster(workers: int = 2) -> Iterator[str]:
    """A scheduler and workers on the loopback address, without a dashboard; ended by their ids."""
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join(
            [str(Path(__file__).resolve().parents[3]), os.environ.get("PYTHONPATH", "")]
        ),
        "DASK_DISTRIBUTED__VERSION_CHECK": "False",
        **dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"),
    }
    here = ["--host", "127.0.0.1", "--no-dashboard"]
    started: list[subprocess.Popen[str]] = []

    def start(*arguments: str) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [sys.executable, "-m", "distributed.cli." + arguments[0], *arguments[1:]],
            env=environment, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True,
        )  # fmt: skip
        started.append(process)
        return process

    try:
        scheduler = start("dask_scheduler", *here, "--port", "0")
        assert scheduler.stderr is not None
        address = next(
            word for line in scheduler.stderr for word in line.split() if word.startswith("tcp://127.0.0.1:")
        )
        for _ in range(workers):
            start("dask_worker", address, *here, "--nthreads", "1", "--no-nanny")
        yield address
    finally:
        # Workers first: one that has lost its scheduler looks for it before it ends.
        for process in reversed(started):
            process.terminate()
            try:
                process.communicate(timeout=20)
            except subprocess.TimeoutExpired:
                process.kill()
                process.communicate()


def wait_for(address: str, workers: int) -> None:
    from distributed import Client

    with Client(address, timeout=60, set_as_default=False) as client:
        client.wait_for_workers(workers, timeout=120)


@pytest.mark.slow
def test_a_cluster_on_the_loopback_address_finds_the_same(
    archive: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("distributed", reason="truewheel[cluster] is not installed")
    with cluster() as address:
        wait_for(address, 2)
        assert command(archive / "images", "--scheduler", address, "--json") == 0
        found = json.loads(capsys.readouterr().out)
        assert (found["folders"], found["measured"], found["states"]["identical"]) == (3, 3, 3)
        unseen = measure_on_cluster(iter(()), AS_THEN, address, archive / "unseen")
        with pytest.raises(ConfigurationError, match="workers that see"):
            list(unseen)


def test_a_scheduler_that_is_not_there_is_bad_input(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed", reason="truewheel[cluster] is not installed")
    monkeypatch.setattr("station.replay.cluster._CONNECT_S", 0.5)
    with pytest.raises(ConfigurationError, match="a Dask scheduler at tcp://127"):
        list(measure_on_cluster(iter(()), AS_THEN, "tcp://127.0.0.1:9", Path("images")))


def test_without_the_package_the_cure_is_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ConfigurationError, match=r"truewheel\[cluster\]"):
        list(measure_on_cluster(iter(()), AS_THEN, "tcp://127.0.0.1:8786", Path("images")))


# Processes that end


class Fatal(Job):
    """A folder whose reading ends the process, as lack of memory does."""

    def __reduce__(self) -> Any:
        return _die, (self.key,)


def _die(key: str) -> Job:
    os._exit(9)


@pytest.mark.slow
def test_a_folder_that_ends_its_process_is_told_and_costs_no_other(archive: Path) -> None:
    found = [Job(path.name, str(path)) for path in folders(archive)]
    jobs = [found[0], Fatal("fatal", "nowhere"), *found[1:]]
    done = {each.key: each for each in measure_in_processes(iter(jobs), AS_THEN, 1)}
    assert len(done) == 4
    assert (done["fatal"].state, done["fatal"].lacks) == (ReplayState.FAILED, (ENDED,))
    assert all(done[job.key].state is ReplayState.IDENTICAL for job in found)


def test_progress_and_counts_of_a_run_of_which_everything_was_measured_before(archive: Path) -> None:
    """Nothing is measured once more, and no process is begun."""
    journal = archive / "journal.jsonl"
    request = ReplayRequest(archive / "images", AS_THEN, journal=journal)
    of_it = [found.key for found in request.folders()]
    seen: list[object] = []
    started = time.monotonic()
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(
            "station.replay.run.measure_in_processes",
            lambda jobs, *_: iter([Replayed(job.key, ReplayState.IDENTICAL, measured=True) for job in jobs]),
        )
        assert replay_archive(request, seen.append).identical
        again = replay_archive(request, seen.append)
    assert (again.folders, again.earlier, len(seen)) == (3, 3, len(of_it))
    assert time.monotonic() - started < 60


def test_what_archives_lack_is_told_where_nothing_differs_too() -> None:
    """An earlier archive came out identical, and nobody was told that its images may have been changed."""
    summary = ReplaySummary(Path("images"))
    for key in ("a", "b"):
        summary.add(Replayed(key, ReplayState.IDENTICAL, measured=True, lacks=("hashes",)))
    assert summary.identical
    assert summary_as_json(summary)["lacks"] == {"hashes": 2}
    for number in range(100):
        summary.add(Replayed(str(number), ReplayState.INCOMPLETE, lacks=(f"zero {number}",)))
    assert len(summary.lacks) == MOST_LACKS
