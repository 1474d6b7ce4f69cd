"""The ring of images and the events that people record, as the command line sees them."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from uuid import UUID

import pytest
from typer.testing import CliRunner

from alignment.errors import InputError
from db.connection import station_lock
from db.queries import Filter, ResultReader, events
from db.records import CheckKind, CheckOutcome, RetentionClass
from db.store import ResultStore
from db.upkeep import retention
from db.upkeep.retention import Policy, enforce, kept, leaving
from station.cli import app
from station.configuration.settings import read_configuration
from station.quality.reports.compare import TEMPERATURE
from tests.db.example_records import CALIBRATION, check, cycle, doubt, doubt_closing, shot, station
from tests.db.queries.test_lengths import RECORDS as VEHICLES

CONFIGS = Path(__file__).parents[3] / "configs"
NOW = datetime.now(UTC)
DAY = timedelta(days=1)


@pytest.fixture
def store(sqlite_url: str) -> Iterator[ResultStore]:
    with ResultStore(sqlite_url, create=True) as opened:
        opened.record_calibration(CALIBRATION)
        opened.describe_station(station())
        yield opened


def archived(store: ResultStore, folder: Path, days: float, kind: RetentionClass) -> Path:
    """One shot of a thousand bytes, so many days old."""
    record = cycle()
    store.write_cycle(record)
    path = folder / str(record.uuid)
    path.mkdir(parents=True)
    (path / "left.png").write_bytes(bytes(1000))
    reference = shot(record.uuid, path=path.name, bytes=1000, archived_utc=NOW - days * DAY, retention=kind)
    store.record_shot(reference)
    return path


def test_evidence_stays_while_any_other_image_could_go(
    store: ResultStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Evidence went too as soon as more ordinary images than one call takes were too many."""
    monkeypatch.setattr(retention, "_MOST", 3)
    for number in range(6):
        archived(store, tmp_path / "images", 6 - number, RetentionClass.ORDINARY)
    evidence = archived(store, tmp_path / "images", 20, RetentionClass.EVIDENCE)
    policy = Policy(1000, 30.0, 300.0)
    while enforce(store, tmp_path / "images", policy, NOW):
        assert evidence.exists()
    assert kept(store).shots == 1
    assert evidence.exists()
    assert leaving(store, policy, NOW) == ()


def test_images_of_a_wheel_in_doubt_stay_as_evidence_until_somebody_answers(
    store: ResultStore, tmp_path: Path
) -> None:
    checked = check(kind=CheckKind.MASTER_WHEEL, outcome=CheckOutcome.OUT)
    store.record_check(checked)
    ordinary, doubted = (archived(store, tmp_path / "images", 20, RetentionClass.ORDINARY) for _ in range(2))
    spoken = doubt(UUID(doubted.name), checked.uuid)
    store.record_found(lambda connection: [spoken])
    policy = Policy(10**9, 14.0, 300.0)
    enforce(store, tmp_path / "images", policy, NOW)
    assert (ordinary.exists(), doubted.exists()) == (False, True)
    # They are not kept for ever.
    assert len(leaving(store, Policy(10**9, 14.0, 15.0), NOW)) == 1
    store.record_found(lambda connection: [doubt_closing(spoken.uuid)])
    enforce(store, tmp_path / "images", policy, NOW)
    assert not doubted.exists()


def test_images_that_leave_take_no_length_and_no_run_out_with_them(
    store: ResultStore, tmp_path: Path
) -> None:
    images = tmp_path / "images"
    for number, record in enumerate(VEHICLES[:4]):
        store.write_cycle(record)
        path = images / str(record.uuid)
        path.mkdir(parents=True)
        (path / "left.png").write_bytes(bytes(1000))
        store.record_shot(
            shot(record.uuid, path=path.name, bytes=1000, archived_utc=NOW - (40 + number) * DAY)
        )
    assert enforce(store, images, Policy(1000, 30.0, 30.0), NOW)
    assert kept(store).shots == 0
    found = {stored.record.uuid: stored.record for stored in store.recent_cycles(9)}
    assert found == {record.uuid: record for record in VEHICLES[:4]}


@pytest.fixture
def configuration(tmp_path: Path, sqlite_url: str) -> Path:
    """The shipped configuration, with an archive of four thousand bytes beside it."""
    shutil.copytree(CONFIGS, tmp_path / "configs")
    path = tmp_path / "configs" / "station.toml"
    text = path.read_text(encoding="utf-8")
    shipped = read_configuration(path).settings.database.url
    archive = '[archive]\nfolder = "../images"\nmost_gb = 4e-6\nordinary_days = 14\nevidence_days = 30\n\n'
    text = text.replace(shipped, sqlite_url).replace("[line]\n", archive + "[line]\n", 1)
    path.write_text(text, encoding="utf-8")
    return path


def test_what_leaves_the_archive_is_told_before_it_goes(
    store: ResultStore, sqlite_url: str, configuration: Path, tmp_path: Path
) -> None:
    images = tmp_path / "images"
    old = archived(store, images, 15, RetentionClass.ORDINARY)
    most = archived(store, images, 10, RetentionClass.ORDINARY)
    staying = [archived(store, images, days, RetentionClass.EVIDENCE) for days in (29, 3, 2, 1)]
    runner = CliRunner()
    asked = ["db", "retention", "--config", str(configuration)]
    done = runner.invoke(app, [*asked, "--json"])
    found = json.loads(done.stdout)
    assert found["reasons"] == {
        "ordinary: older than 14 days": 1,
        "ordinary: the archive holds more than 4e-06 GB": 1,
    }
    assert found["figures"] == {
        "shots": 6, "bytes": 6000, "leaving_shots": 2, "leaving_bytes": 2000, "removed_shots": 0,
        "kept_shots": 6,
    }  # fmt: skip
    assert "2 would go" in runner.invoke(app, asked).stdout
    assert old.exists()
    with station_lock(sqlite_url, read_configuration(configuration).settings.station.id):
        # A station that runs keeps its ring by itself.
        assert runner.invoke(app, [*asked, "--apply"]).exit_code != 0
    assert old.exists()
    done = runner.invoke(app, [*asked, "--apply"])
    assert "removed 2; 4 shots" in done.stdout
    assert not old.exists()
    assert not most.exists()
    assert all(path.exists() for path in staying)


def test_people_record_events_of_known_stations(store: ResultStore, sqlite_url: str) -> None:
    runner = CliRunner()
    asked = ["db", "event", "--database", sqlite_url, "--station", "EOL-1"]
    done = runner.invoke(app, [*asked, "--temperature", "31.5", "--time", "2026-11-22T06:00", "--json"])
    assert json.loads(done.stdout)["text"] == "31.5 °C"
    done = runner.invoke(app, [*asked, "31.5 °C", "--code", TEMPERATURE])
    assert isinstance(done.exception, InputError)
    assert "Record degrees Celsius with --temperature 31.5" in str(done.exception)
    done = runner.invoke(app, [*asked, "lamp 2 changed", "--code", "lamp"])
    assert "EOL-1: lamp: lamp 2 changed" in done.stdout
    with ResultReader(sqlite_url) as reader:
        (warm,) = events(reader, Filter(stations=("EOL-1",)), codes=(TEMPERATURE,))
        (lamp,) = events(reader, codes=("lamp",))
    assert warm.utc == datetime(2026, 11, 22, 6, tzinfo=UTC)
    assert warm.value == 31.5
    assert lamp.value is None
    assert lamp.source == "command line"
    assert runner.invoke(app, [*asked, "both", "--temperature", "20"]).exit_code != 0
    wrong = [*asked[:-1], "EOL-7", "a text"]
    assert runner.invoke(app, wrong).exit_code != 0
