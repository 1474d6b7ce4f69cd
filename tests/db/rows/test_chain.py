"""What was changed, taken out or put in past the program is named, whatever tool did it."""

from __future__ import annotations

import json
import shutil
import sqlite3
from collections.abc import Callable, Iterator
from pathlib import Path
from uuid import UUID, uuid4

import psycopg
import pytest
from sqlalchemy import text
from typer.testing import CliRunner

from alignment.errors import StoreError
from benchmarks.postgres_server import PostgresServer
from db.connection import make_engine, migrate, parse_url
from db.records import ArchiveRemoval, EventRecord, Severity
from db.rows import digest, link_hash, record_rows
from db.store import ResultStore
from db.upkeep.check import check_database
from db.upkeep.shipping import Shipper
from station.cli import app
from tests.db.example_records import (
    CALIBRATION,
    NOON,
    adjusting,
    bad_vehicle,
    check,
    concession,
    cycle,
    doubt,
    doubt_closing,
    installation,
    limits,
    refused_wheel,
    revocation,
    shot,
    station,
    steering,
    steering_axis,
    study,
    study_value,
    wheel,
    withdrawal,
    zero,
)
from tests.once import folder_once

_STEERED = {
    "steering": steering(),
    "steering_axes": (steering_axis(), steering_axis("front_right")),
    "adjustings": (adjusting(), adjusting(adjuster="camber_bolt", left_camber=None, left_toe=None)),
}
CYCLES = [cycle(UUID(int=number), **(_STEERED if number == 2 else {})) for number in range(1, 5)]
EVENT = EventRecord(
    NOON, "EOL-1", Severity.INFO, "station", "start", "begonnen: 100 % „gut“", 3.5, uuid=UUID(int=5)
)


def fill(store: ResultStore) -> None:
    """One record of each kind, with numbers that databases like to rewrite."""
    store.record_calibration(CALIBRATION)
    store.describe_station(station(configuration={"a": [1, 2.0, -0.0, 1e22, 1e23, 0.1, True, None]}),
                           (limits(),), (installation(),))  # fmt: skip
    checked = check(as_left={"x": 1e-300})
    store.record_check(checked)
    store.record_zero(zero(toe=0, camber=-0.0))
    store.revoke_zero(revocation())
    for record in CYCLES:
        store.write_cycle(record)
    store.write_cycle(cycle(station="EOL-2", outcome="fault", vehicle=None, measured_utc=None,
                            measured_monotonic_s=None, wheels=(), axles=(), vehicle_angles=None,
                            reason_code="store", reason_text="disk\nfull"))  # fmt: skip
    store.record_event(EVENT)
    spoken = doubt(CYCLES[0].uuid, checked.uuid)
    store.record_found(lambda connection: [spoken])
    store.record_found(lambda connection: [doubt_closing(spoken.uuid)])
    planned = study()
    store.plan_study(planned)
    store.record_study_values([study_value(planned.uuid)])
    image = shot(CYCLES[0].uuid)
    store.record_shot(image)
    store.remove_shot(ArchiveRemoval(image.uuid, NOON, "older than 14 days"))
    released = bad_vehicle(UUID(int=9))
    store.write_cycle(released)
    granted = concession(released.uuid)
    store.grant_concession(granted)
    store.withdraw_concession(withdrawal(granted.uuid))


@folder_once
def filled_file(folder: Path) -> None:
    """With the database `results.db`."""
    with ResultStore(f"sqlite:///{folder / 'results.db'}", create=True) as store:
        fill(store)


@pytest.fixture
def filled_sqlite_url(tmp_path: Path) -> str:
    shutil.copyfile(filled_file() / "results.db", tmp_path / "results.db")
    return f"sqlite:///{tmp_path / 'results.db'}"


@pytest.fixture(scope="module")
def filled_template(postgres_server: PostgresServer, postgres_template: str) -> Iterator[str]:
    """Name of a database to copy."""
    with postgres_server.database(postgres_template) as url:
        with ResultStore(url) as store:
            fill(store)
        yield url.rpartition("/")[2]


@pytest.fixture
def filled_postgres_url(postgres_server: PostgresServer, filled_template: str) -> Iterator[str]:
    with postgres_server.database(filled_template) as url:
        yield url


@pytest.fixture(params=["filled_sqlite_url", "filled_postgres_url"], ids=["sqlite", "postgresql"])
def filled(request: pytest.FixtureRequest) -> str:
    """URL of a database with one record of each kind, once for each kind of database."""
    url: str = request.getfixturevalue(request.param)
    return url


def tamper(url: str, *statements: str) -> None:
    """What somebody does who may do everything: no trigger, no foreign key, no check holds."""
    if url.startswith("sqlite"):
        with sqlite3.connect(url.removeprefix("sqlite:///"), isolation_level=None) as connection:
            triggers = connection.execute("SELECT name FROM sqlite_master WHERE type = 'trigger'").fetchall()
            for (name,) in triggers:
                connection.execute(f"DROP TRIGGER {name}")
            connection.execute("PRAGMA ignore_check_constraints=ON")
            for statement in statements:
                connection.execute(statement)
        connection.close()
        return
    with psycopg.connect(url, autocommit=True) as server:
        server.execute("SET session_replication_role = replica")
        for statement in statements:
            server.execute(statement.encode())


def findings(url: str) -> list[str]:
    return list(check_database(url, days=None).findings)


def test_what_is_untouched_has_no_findings_on_either_database(filled: str) -> None:
    report = check_database(filled, days=None)
    assert report.findings == ()
    # The start of the database is a link of the chain without station.
    assert {name: end.number for name, end in report.heads.items()} == {"": 8, "EOL-1": 14, "EOL-2": 1}


@pytest.mark.parametrize(
    ("table", "change"),
    [
        ("cycles", "station = 'EOL-9'"),
        ("cycles", "trigger_sequence = 8"),
        ("cycles", "outcome = 'nok'"),
        ("cycles", "stored_utc = '2026-11-22 12:00:00.000001'"),
        ("wheel_results", "camber = camber + 1e-12"),
        ("wheel_results", "guard_band = NOT guard_band"),
        ("wheel_results", "toe_high = NULL"),
        ("wheel_results", "degraded = true"),
        ("axle_results", "total_toe_u = 1e-4"),
        ("vehicle_results", "thrust_angle = -thrust_angle"),
        ("wheel_results", "ride_height = 'not_known'"),
        ("steering_results", "steering_wheel = 0.0"),
        ("steering_results", "steer_u = steer_u * 2.0"),
        ("steering_axis_results", "caster = caster + 1e-12"),
        ("adjusting_results", "left_toe = -left_toe"),
        ("adjusting_results", "corrections = 1"),
        ("calibrations", 'document = \'{"schema": "calibration", "fx": 2500.5}\''),
        ("calibration_checks", "outcome = 'out'"),
        ("zero_measurements", "certified_toe = 2e-5"),
        ("zero_revocations", "reason = 'another reason'"),
        ("events", "text = 'nothing happened'"),
        ("events", "cycle_uuid = uuid"),
        ("events", "value = 31.5"),
        ("station_versions", "configuration = '{}'"),
        ("vehicle_type_limits", "limits = '{}'"),
        ("installations", "from_utc = '2026-11-21 12:00:00.123456'"),
        ("gauge_studies", "comment = ''"),
        ("gauge_values", "value = value * 0.9"),
        ("archived_shots", "path = '2026-11-22/0002'"),
        ("archive_removals", "reason = 'lost'"),
        ("doubts", "reason = 'nothing'"),
        ("doubts", "wheel = 'rear_left'"),
        ("doubt_closings", "person = 'B. Example'"),
        ("vehicles", "vin = 'TRUEWHEEL0000000' || id"),
        ("stations", "name = 'EOL-3'"),
    ],
)
def test_one_value_changed_in_any_table_is_named(filled: str, table: str, change: str) -> None:
    """The old check told nothing of any of these."""
    where = {"cycles": "uuid", "wheel_results": "wheel", "axle_results": "axle"}.get(table)
    value = {"cycles": f"'{CYCLES[1].uuid if not filled.startswith('sqlite') else CYCLES[1].uuid.hex}'",
             "wheel_results": "'front_left'", "axle_results": "'front'"}.get(table)  # fmt: skip
    only = "" if where is None else f" WHERE {where} = {value}"
    tamper(filled, f"UPDATE {table} SET {change}{only}")
    found = findings(filled)
    seen = {"vehicles": "cycles", "stations": "station_versions"}.get(table, table)
    assert any(finding.startswith(f"{seen}: ") and "altered" in finding for finding in found), found
    if table == "cycles":
        # The whole name, and no other row is suspected.
        (one,) = [finding for finding in found if finding.startswith("cycles: ")]
        assert one.startswith(f"cycles: cycle {CYCLES[1].uuid} of station 'EOL-1' (row 2)")


def test_rows_taken_out_and_put_in_are_named(filled: str) -> None:
    tamper(
        filled,
        "DELETE FROM wheel_results WHERE cycle_id = 2 AND wheel = 'rear_left'",
        "INSERT INTO axle_results SELECT 3, 'third', total_toe, total_toe_u, camber_difference,"
        " camber_difference_u, verdict, total_toe_low, total_toe_high, camber_difference_low,"
        " camber_difference_high, guard_band, coverage_factor FROM axle_results WHERE cycle_id = 1 AND"
        " axle = 'front'",
        "DELETE FROM events",
        "INSERT INTO zero_revocations SELECT 'zero-2', utc, reason, stored_utc FROM zero_revocations",
    )
    found = findings(filled)
    assert any(
        f.startswith(f"wheel_results: rear_left of cycle {CYCLES[1].uuid} of station 'EOL-1'")
        and f.endswith("was removed")
        for f in found
    ), found
    assert any(
        f.startswith(f"axle_results: third of cycle {CYCLES[2].uuid}") and "put in" in f for f in found
    )
    assert f"events: event {EVENT.uuid} of station 'EOL-1' was removed" in found
    assert "zero_revocations: revocation zero-2 was put in past the program" in found


def test_a_record_taken_out_with_its_link_leaves_a_gap(filled: str) -> None:
    tamper(
        filled,
        "DELETE FROM events",
        "DELETE FROM chain_links WHERE kind = 'event'",
        "DELETE FROM chain_links WHERE chain = 'EOL-1' AND number = 5",
    )
    found = " ".join(findings(filled))
    assert (
        "chain_links, link 6 of station 'EOL-1': 1 links before it are missing: records were removed" in found
    )
    assert "was put in past the program" in found


@pytest.mark.parametrize("change", ["rows = '{}'", "hash = previous", "key = 'x'", "kind = 'wheel'"])
def test_a_link_written_anew_is_named(filled: str, change: str) -> None:
    tamper(filled, f"UPDATE chain_links SET {change} WHERE chain = 'EOL-1' AND number = 5")
    assert any(f.startswith("chain_links, link 5 of station 'EOL-1'") for f in findings(filled))


def test_a_row_changed_together_with_its_link_breaks_the_next_one(filled: str) -> None:
    engine = make_engine(parse_url(filled), timeout_s=5.0)
    with engine.connect() as connection:
        row = connection.execute(
            text("SELECT * FROM chain_links WHERE chain = 'EOL-1' AND number = 5")
        ).mappings().one()  # fmt: skip
    engine.dispose()
    rows = json.dumps(json.loads(row["rows"]) | {"cycle": 32 * "0"}, sort_keys=True, separators=(",", ":"))
    new = link_hash(row["previous"], "EOL-1", 5, row["kind"], row["key"], rows)
    tamper(filled, f"UPDATE chain_links SET rows = '{rows}', hash = '{new}'"
                   " WHERE chain = 'EOL-1' AND number = 5")  # fmt: skip
    assert any("link 6 of station 'EOL-1' does not continue link 5" in f for f in findings(filled))


def test_the_end_that_somebody_wrote_down_proves_what_came_before(filled: str) -> None:
    done = CliRunner().invoke(app, ["db", "check", "--all", "--database", filled, "--json"])
    assert done.exit_code == 0
    chains = json.loads(done.stdout)["chains"]
    assert chains["EOL-2"]["number"] == 1
    assert chains["EOL-2"]["hash"] == check_database(filled, None).heads["EOL-2"].hash


def test_an_auditor_verifies_the_chain_with_the_lines_of_the_documentation(
    sqlite_url: str, open_store: Callable[..., ResultStore], capsys: pytest.CaptureFixture[str]
) -> None:
    fill(open_store(sqlite_url))
    page = (Path(__file__).parents[3] / "docs" / "database.md").read_text(encoding="utf-8")
    section = page.split("## The chain of hashes")[1]
    lines = section.split("```python\n")[1].split("```")[0].replace("results.db", sqlite_url[10:])
    exec(compile(lines, "docs/database.md", "exec"), {})
    end = check_database(sqlite_url, None).heads["EOL-1"]
    assert capsys.readouterr().out.splitlines() == [f"link 14 of station EOL-1: {end.hash}"]
    query = section.split("```sql\n")[1].split("```")[0]
    ask_breaks = sqlite3.connect(sqlite_url[10:])
    assert ask_breaks.execute(query).fetchall() == []
    ask_breaks.close()
    tamper(sqlite_url, "UPDATE events SET text = 'nothing'")
    with pytest.raises(AssertionError, match="event"):
        exec(compile(lines, "docs/database.md", "exec"), {})
    tamper(sqlite_url, "DELETE FROM chain_links WHERE chain = 'EOL-1' AND number = 4")
    ask_breaks = sqlite3.connect(sqlite_url[10:])
    assert ask_breaks.execute(query).fetchall() == [("EOL-1", 5)]
    ask_breaks.close()


def test_the_same_records_have_the_same_hashes_on_both_databases(
    postgres_url: str, tmp_path: Path, open_store: Callable[..., ResultStore]
) -> None:
    urls = (postgres_url, f"sqlite:///{tmp_path / 'results.db'}")
    for url in urls:
        fill(open_store(url, now=lambda: NOON))
    (on_server, in_file) = (check_database(url, None).heads["EOL-2"] for url in urls)
    # The fault of station 2 has a UUID of its own each time.
    assert on_server != in_file
    texts = []
    for url in urls:
        engine = make_engine(parse_url(url), timeout_s=5.0)
        with engine.connect() as connection:
            query = text(
                "SELECT kind, rows FROM chain_links WHERE chain = 'EOL-1' AND kind IN ('cycle', 'event')"
            )
            texts.append(sorted(tuple(row) for row in connection.execute(query)))
        engine.dispose()
    assert texts[0] == texts[1]
    assert len(texts[0]) == 6


def test_a_column_that_a_later_revision_adds_changes_no_hash() -> None:
    given = {"camber": 0.5, "toe": -0.0, "points_used": 3}
    assert digest(given) == digest(given | {"added_later": None}) == digest(given | {"toe": 0})
    assert digest(given) != digest(given | {"added_later": 0})
    # Kept as it is for ever: stored hashes depend on it.
    assert digest(given) == "e3a5abdaa9669b3755fc1547a1f647d1"


def test_a_row_cannot_be_replaced(sqlite_url: str, open_store: Callable[..., ResultStore]) -> None:
    """INSERT OR REPLACE deletes without asking a trigger: results were rewritten without a trace."""
    fill(open_store(sqlite_url))
    path = sqlite_url.removeprefix("sqlite:///")
    with sqlite3.connect(path, isolation_level=None) as connection:
        tables = connection.execute(
            "SELECT name FROM sqlite_master WHERE type = 'table' AND name IN"
            " (SELECT tbl_name FROM sqlite_master WHERE type = 'trigger')"
        ).fetchall()
        assert len(tables) > 20
        for (table,) in tables:
            before = connection.execute(f"SELECT rowid, * FROM {table}").fetchall()
            if not before:
                continue
            names = ", ".join(row[1] for row in connection.execute(f"PRAGMA table_info({table})"))
            for statement in (
                f"INSERT OR REPLACE INTO {table} ({names}) SELECT {names} FROM {table}",
                f"REPLACE INTO {table} (rowid, {names}) SELECT rowid, {names} FROM {table}",
            ):
                with pytest.raises(sqlite3.IntegrityError, match="never changed or deleted"):
                    connection.execute(statement)
            assert connection.execute(f"SELECT rowid, * FROM {table}").fetchall() == before
        # Another identity, the same place.
        with pytest.raises(sqlite3.IntegrityError, match="never changed or deleted"):
            connection.execute(
                "REPLACE INTO calibrations (rowid, id, rig, valid_from_utc, document, stored_utc)"
                " SELECT rowid, 'other', rig, valid_from_utc, document, stored_utc FROM calibrations"
            )
    connection.close()


def test_rows_from_before_the_chain_are_counted(empty_database_url: str) -> None:
    migrate(empty_database_url, "0006")
    old = uuid4().hex
    tamper(
        empty_database_url,
        "INSERT INTO events (uuid, utc, station, severity, source, code, text) VALUES"
        f" ('{old}', '2026-11-22 12:00:00.000000', 'EOL-1', 'info', 's', 'start', 't')",
    )
    migrate(empty_database_url)
    with ResultStore(empty_database_url) as store:
        fill(store)
    assert findings(empty_database_url) == []
    new = uuid4()
    tamper(
        empty_database_url,
        "INSERT INTO events (uuid, utc, station, severity, source, code, text) VALUES"
        f" ('{new.hex}', '2026-11-22 12:00:00.000000', 'EOL-1', 'info', 's', 'start', 't')",
    )
    assert f"events: event {new} was put in past the program" in findings(empty_database_url)
    tamper(empty_database_url, "DELETE FROM events WHERE id IN (1, 3)")
    assert "events: 1 rows from before the chain were removed" in findings(empty_database_url)


def test_what_is_shipped_has_a_chain_of_its_own_where_it_arrives(postgres_url: str, tmp_path: Path) -> None:
    local = f"sqlite:///{tmp_path / 'station.db'}"
    with ResultStore(local, create=True) as store, Shipper(local, postgres_url, "EOL-1") as shipper:
        fill(store)
        shipper.ship()
    assert findings(local) == findings(postgres_url) == []
    tamper(postgres_url, "UPDATE wheel_results SET toe = 0.001 WHERE wheel = 'front_left' AND cycle_id = 1")
    assert len(findings(postgres_url)) == 1
    assert findings(local) == []


def test_a_database_that_comes_back_with_less_is_not_written_on(
    filled: str, open_store: Callable[..., ResultStore]
) -> None:
    """A server restored from a backup, or a standby without the last commits: nothing noticed."""
    store = open_store(filled)
    store.write_cycle(cycle())
    tamper(filled, "DELETE FROM chain_links WHERE chain = 'EOL-1' AND number > 7")
    with pytest.raises(
        StoreError, match=r"has lost what was stored: link 15 of the chain of station 'EOL-1'"
    ):
        store.write_cycle(cycle())
    # Nor when others have made the chain longer since.
    other = open_store(filled)
    for _ in range(4):
        other.write_cycle(cycle())
    with pytest.raises(StoreError, match="has lost what was stored"):
        store.write_cycle(cycle())


def test_a_partition_that_was_taken_away_leaves_its_hashes(
    postgres_url: str, open_store: Callable[..., ResultStore]
) -> None:
    fill(open_store(postgres_url))
    with psycopg.connect(postgres_url, autocommit=True) as server:
        server.execute("ALTER TABLE wheel_results DETACH PARTITION wheel_results_0")
    seen = "wheel_results: the partition of the cycles 0 to 499999 is not attached, 20 rows of it are known"
    (one,) = [finding for finding in findings(postgres_url) if "refer" not in finding]
    assert one.startswith(seen)
    # What is left of these cycles is compared as before.
    tamper(postgres_url, "UPDATE axle_results SET total_toe_u = 1e-4 WHERE cycle_id = 1 AND axle = 'front'")
    assert any(f.startswith("axle_results: front of cycle") for f in findings(postgres_url))
    with psycopg.connect(postgres_url, autocommit=True) as server:
        server.execute(
            "ALTER TABLE wheel_results ATTACH PARTITION wheel_results_0"
            " FOR VALUES FROM (MINVALUE) TO (500000)"
        )
    assert not any("not attached" in finding for finding in findings(postgres_url))


def test_digests_tell_parts_apart() -> None:
    record = cycle(wheels=(wheel("front_left"), refused_wheel()), outcome="fault", reason_code="r",
                   reason_text="t", axles=(), vehicle_angles=None)  # fmt: skip
    assert set(json.loads(record_rows(record, NOON))) == {
        "cycle", "wheel_results/front_left", "wheel_results/rear_left",
    }  # fmt: skip
