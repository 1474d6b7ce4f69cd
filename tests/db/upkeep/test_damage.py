"""A database that was damaged: whatever is asked of it, the answer is a result or one clear error."""

from __future__ import annotations

import random
import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout, suppress
from datetime import timedelta
from io import StringIO
from pathlib import Path

import pytest

from alignment.errors import StoreDamagedError, StoreError, TruewheelError
from db.connection import make_engine, parse_url
from db.records import ArchiveRemoval
from db.schema import metadata
from db.store import ResultStore
from db.sums import update_sums
from db.upkeep.check import check_database
from station.cli import commands, exit_status
from station.cycle.recording.held import unacknowledged
from tests.db.example_plant import plant
from tests.db.example_records import (
    CALIBRATION,
    NOON,
    bad_vehicle,
    check,
    concession,
    cycle,
    installation,
    limits,
    revocation,
    shot,
    station,
    study,
    study_value,
    withdrawal,
    zero,
)
from tests.db.rows.test_chain import EVENT
from tests.once import folder_once

VIN = "TRUEWHEEL00000003"
# What a cell may hold after a mistake, a tool or a bad disk: SQL expressions.
WRONG = (
    "'fünf'",
    "X'ff00fe'",
    "CAST(X'c328ff' AS TEXT)",
    "''",
    "9e999",
    "-1",
    "12345678901234567890",
    "'2026-13-45 99:99:99.000000'",
    "'0000-00-00'",
    "'{\"a\":'",
    "'[1, 2]'",
    "NULL",
    "'--------------------------------'",
)


@folder_once
def folder_of_sound(folder: Path) -> None:
    """With the database `results.db`."""
    url = f"sqlite:///{folder / 'results.db'}"
    with ResultStore(url, create=True) as store:
        store.record_calibration(CALIBRATION)
        store.describe_station(station(), (limits(),), (installation(),))
        store.record_check(check())
        store.record_zero(zero())
        store.record_zero(zero("zero-2"))
        store.revoke_zero(revocation())
        records = plant(24)
        for record in records:
            store.write_cycle(record)
        store.record_event(EVENT)
        planned = study()
        store.plan_study(planned)
        store.record_study_values([study_value(planned.uuid, trial=n, value=1e-3 * n) for n in (1, 2, 3)])
        image = shot(records[0].uuid)
        store.record_shot(image)
        store.remove_shot(ArchiveRemoval(image.uuid, NOON, "older"))
        released = bad_vehicle()
        store.write_cycle(released)
        granted = concession(released.uuid)
        store.grant_concession(granted)
        store.withdraw_concession(withdrawal(granted.uuid))
    engine = make_engine(parse_url(url), timeout_s=5.0)
    update_sums(engine, most=12)
    engine.dispose()


@pytest.fixture(scope="session")
def sound() -> Path:
    """A small database with a record of each kind, half of it in the sums."""
    return folder_of_sound() / "results.db"


@pytest.fixture
def damaged(sound: Path, tmp_path: Path) -> Path:
    return Path(shutil.copy(sound, tmp_path / "results.db"))


def overwrite(path: Path, table: str, column: str, value: str, row: int = 1) -> None:
    """Write a cell past every check, as a tool or a bad disk does."""
    with sqlite3.connect(path, isolation_level=None) as connection:
        for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'trigger'").fetchall():
            connection.execute(f"DROP TRIGGER {name}")
        connection.execute("PRAGMA ignore_check_constraints=ON")
        # The constraint NOT NULL, and the type of what is an id, are part of the description.
        connection.execute("PRAGMA writable_schema=ON")
        connection.execute(
            "UPDATE sqlite_master SET sql = replace(sql, ' NOT NULL,', ',') WHERE type = 'table'"
        )
        connection.execute("PRAGMA writable_schema=RESET")
    connection.close()
    with sqlite3.connect(path, isolation_level=None) as connection:
        connection.execute("PRAGMA ignore_check_constraints=ON")
        keys = connection.execute(
            f"SELECT {key_of(table)} FROM {table} LIMIT 1 OFFSET ?", [row - 1]
        ).fetchone()
        if keys is not None:
            where = " AND ".join(f"{name} IS ?" for name in key_of(table).split(", "))
            with suppress(sqlite3.IntegrityError):
                # The number of a row is the one thing that is nothing else.
                connection.execute(f"UPDATE OR IGNORE {table} SET {column} = {value} WHERE {where}", keys)
    connection.close()


def key_of(table: str) -> str:
    if table in ("value_sums", "result_counts"):
        return ", ".join(metadata.tables[table].primary_key.columns.keys())
    return "rowid"


def ask_everything(path: Path, out: Path) -> Iterator[tuple[str, BaseException | None]]:
    """Every verb that reads, and the start of a station: what each ended with."""
    url = f"sqlite:///{path}"
    for arguments in (
        ["db", "check"],
        ["db", "check", "--all"],
        ["report", "all"],
        ["report", "vin", "--vin", VIN],
        ["report", "since-check"],
        ["export", "csv", "--out", str(out / "results.csv")],
        ["export", "aqdef", "--out", str(out / "results.dfq")],
        ["export", "certificate", "--vin", VIN, "--out", str(out / "certificate.pdf")],
        ["gauge", "list"],
        ["gauge", "grr", "--name", "Abnahme 2026"],
        ["zero", "list"],
    ):
        for file in out.glob("*"):
            file.unlink()
        error: BaseException | None = None
        with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
            try:
                commands()([*arguments, "--database", url, "--json"])
            except (Exception, SystemExit) as raised:  # noqa: BLE001
                error = raised
        yield " ".join(arguments[:3]), error
    try:
        with ResultStore(url) as store:
            start(store)
        yield "start", None
    except Exception as error:  # noqa: BLE001
        yield "start", error


def start(store: ResultStore) -> None:
    store.record_calibration(CALIBRATION)
    unacknowledged(store, "EOL-1")
    store.describe_station(station(), (limits(),), (installation(),))
    store.zeros_in_force([("front_left", CALIBRATION.id)])
    store.write_cycle(cycle())
    store.recent_cycles(30)
    store.counts()


def unclear(path: Path, out: Path) -> list[str]:
    """What ended in anything but a result or an error of the product."""
    return [
        f"{verb}: {type(error).__name__}: {error}"
        for verb, error in ask_everything(path, out)
        if error is not None and not isinstance(error, TruewheelError | SystemExit)
    ]


COLUMNS = [(table.name, column.name) for table in metadata.sorted_tables for column in table.c]


def test_text_in_place_of_an_uncertainty_is_damage_to_a_report_too(damaged: Path, tmp_path: Path) -> None:
    """What was read was made an answer outside of the reading, and ended in a ValueError."""
    for row in range(1, 5):
        overwrite(damaged, "wheel_results", "toe_u", "'2026-13-45 99:99:99.000000'", row)
    assert unclear(damaged, tmp_path) == []


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_wrong_values_in_cells_end_in_one_clear_error(sound: Path, tmp_path: Path, seed: int) -> None:
    """Tracebacks came of them: UnicodeDecodeError, TypeError, ValueError, from `db check` too."""
    chance = random.Random(seed)
    for number, (table, column) in enumerate(chance.sample(COLUMNS, 3)):
        path = Path(shutil.copy(sound, tmp_path / f"{number}.db"))
        out = tmp_path / f"out{number}"
        out.mkdir()
        value = chance.choice(WRONG)
        overwrite(path, table, column, value, chance.randint(1, 4))
        assert unclear(path, out) == [], f"{table}.{column} = {value}"


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_flipped_bytes_end_in_one_clear_error(sound: Path, tmp_path: Path, seed: int) -> None:
    chance = random.Random(100 + seed)
    for number in range(2):
        content = bytearray(sound.read_bytes())
        for _ in range(chance.choice((1, 20, 400))):
            content[chance.randrange(len(content))] ^= 1 << chance.randrange(8)
        path = tmp_path / f"{number}.db"
        path.write_bytes(content)
        out = tmp_path / f"out{number}"
        out.mkdir()
        assert unclear(path, out) == []


@pytest.mark.parametrize(
    ("table", "column", "value", "seen"),
    [
        ("cycles", "uuid", "'no-uuid'", "no UUID"),
        ("events", "uuid", "X'00'", "no UUID"),
        ("cycles", "received_utc", "'1970-01-01 00:00:00.000000'", "no possible time"),
        ("events", "utc", "'2026-13-45 99:99:99.000000'", "no possible time"),
        ("cycles", "stored_utc", "42", "no possible time"),
        ("wheel_results", "toe", "'fünf'", "no number"),
        ("wheel_results", "verdict", "'good'", "no one of"),
        ("wheel_results", "guard_band", "2", "no yes or no"),
        ("wheel_results", "points_used", "1.5", "no whole number"),
        ("vehicle_type_limits", "limits", "'{\"a\":'", "no JSON document"),
        ("cycles", "config_hash", "NULL", "no text"),
        ("value_sums", "mean", "'x'", "no number"),
    ],
)
def test_a_cell_that_is_none_of_its_kind_is_named(
    damaged: Path, table: str, column: str, value: str, seen: str
) -> None:
    overwrite(damaged, table, column, value)
    found = check_database(f"sqlite:///{damaged}", days=None).findings
    assert any(f.startswith(f"{table}: 1 values of column {column} are {seen}") for f in found), found


@pytest.mark.parametrize(
    ("column", "value"),
    [
        ("received_utc", "'2026-99-01 00:00:00.000000'"),
        ("uuid", "'no-uuid'"),
        ("outcome", "'good'"),
        ("station", "CAST(X'c328ff' AS TEXT)"),
        ("received_monotonic_s", "'soon'"),
        ("trigger_sequence", "'seven'"),
    ],
)
def test_a_damaged_row_is_called_damage_and_is_bad_input(damaged: Path, column: str, value: str) -> None:
    overwrite(damaged, "cycles", column, value, row=25)
    with ResultStore(f"sqlite:///{damaged}") as store, pytest.raises(StoreDamagedError) as caught:
        store.recent_cycles(1)
    assert "restore the last backup" in str(caught.value)
    assert exit_status(caught.value) == 2


def test_a_time_before_there_were_results_is_found_on_a_server(postgres_url: str) -> None:
    with ResultStore(postgres_url) as store:
        store.record_calibration(CALIBRATION)
        store.write_cycle(cycle(received_utc=NOON - timedelta(days=365 * 57)))
    found = check_database(postgres_url).findings
    assert "cycles: 1 impossible times in column received_utc" in found


def test_what_nobody_foresaw_in_the_store_is_an_error_of_the_store(
    sound: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It went through the thread of the store and ended the station's serving loop."""

    def fails(*_: object) -> None:
        raise ZeroDivisionError("of a kind that nobody thought of")

    monkeypatch.setattr("db.store.read_cycles", fails)
    with ResultStore(f"sqlite:///{sound}") as store, pytest.raises(StoreError, match="nobody thought of"):
        store.recent_cycles(1)
