"""What earlier programs wrote into texts alone is in columns after the upgrade, and proven unchanged."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any
from uuid import UUID, uuid4

import pytest
from sqlalchemy import Connection, text
from sqlalchemy.exc import DBAPIError

from db.connection import make_engine, parse_url
from db.connection.revisions import _revisions, head_revision, migrate
from db.records import CalibrationRecord, CycleRecord, EventRecord, Severity, WheelKind
from db.rows.chain import new_links
from db.schema import (
    axle_results,
    calibrations,
    chain_links,
    cycles,
    events,
    geometry_results,
    vehicle_results,
    vehicles,
)
from db.schema import wheel_results as wheels
from db.store import ResultStore
from db.upkeep.check import check_database
from db.upkeep.shipping import Shipper
from tests.db.databases import migrate_new
from tests.db.example_records import CALIBRATION, NOON, WHEELS, axle, cycle, geometry, given, wheel
from tests.db.rows.test_chain import tamper

EARLIER = _revisions()[: _revisions().index("0010")]
BEFORE_KINDS = _revisions()[: _revisions().index("0011")]
CHAINED = [revision for revision in EARLIER if revision >= "0007"]
DEGRADED = "tyre_plane/revolution/degraded"
LOST = cycle(
    wheels=(wheel("front_left", method=DEGRADED), wheel("rear_left")), axles=(axle("front"),),
    vehicle_angles=None,
)  # fmt: skip
WHOLE = cycle(wheels=tuple(map(wheel, WHEELS)), axles=(), vehicle_angles=None)


def event(code: str, said: str) -> EventRecord:
    return EventRecord(NOON, "EOL-1", Severity.INFO, "station.cycle", code, said)


# Code and text as earlier programs wrote them, and what that tells: the cycle, the number.
TEXTS: tuple[tuple[str, str, UUID | None, float | None], ...] = (
    ("offered", f"{LOST.uuid}: results of start 7", LOST.uuid, None),
    ("acknowledged", f"{LOST.uuid}: results of start 7", LOST.uuid, None),
    ("discarded", f"{WHOLE.uuid}: results of start 8", WHOLE.uuid, None),
    ("contradicted", f"{WHOLE.uuid}: results of start 8; see cycle {LOST.uuid}", WHOLE.uuid, None),
    ("aborted_late", f"{WHOLE.uuid}: results of start 8 are stored as 'ok'", WHOLE.uuid, None),
    ("not_reported", f"cycle {WHOLE.uuid}: the bus is off", WHOLE.uuid, None),
    ("images_not_archived", f"images of cycle {WHOLE.uuid} are not archived: disk full", WHOLE.uuid, None),
    ("images_not_archived", f"images of cycle {WHOLE.uuid} and 3 more are not archived: slow", None, None),
    ("temperature", "31.5 °C", None, 31.5),
    ("temperature", " -4,25 °C at the gate", None, -4.25),
    ("temperature", "warm", None, None),
    ("temperature", "9" * 400, None, None),
    ("maintenance", f"{WHOLE.uuid} was looked at", None, None),
    ("acknowledged", "the operator took 31.5 °C for granted", None, None),
    ("started", "version 1 started", None, None),
)  # fmt: skip
EVENTS = [event(code, said) for code, said, _, _ in TEXTS]
UPGRADED = [
    replace(record, cycle_uuid=of, value=value)
    for record, (_, _, of, value) in zip(EVENTS, TEXTS, strict=True)
]


def link(connection: Connection, record: Any, stored: bool) -> None:
    """As the program of then did: columns without a value are in no hash."""
    connection.execute(chain_links.insert(), new_links(connection, [(record, NOON if stored else None)]))


def put(connection: Connection, record: CalibrationRecord | CycleRecord | EventRecord) -> None:
    if isinstance(record, EventRecord):
        connection.execute(events.insert().values(**given(record)))
        return
    if isinstance(record, CalibrationRecord):
        connection.execute(calibrations.insert().values(**given(record), stored_utc=NOON))
        return
    assert record.vehicle is not None
    of = connection.execute(vehicles.insert().values(**given(record.vehicle)).returning(vehicles.c.id))
    values = {"vehicle_id": of.scalar_one(), "stored_utc": NOON}
    one = connection.execute(cycles.insert().values(**given(record), **values).returning(cycles.c.id))
    number = one.scalar_one()
    for table, parts in ((wheels, record.wheels), (axle_results, record.axles)):
        for part in parts:
            connection.execute(table.insert().values(cycle_id=number, **given(part)))
    if record.geometry is not None:
        connection.execute(geometry_results.insert().values(cycle_id=number, **given(record.geometry)))
    if record.vehicle_angles is not None:
        connection.execute(vehicle_results.insert().values(cycle_id=number, **given(record.vehicle_angles)))


def fill(url: str, revision: str) -> None:
    """A vehicle with a lost head, a whole one, and an event of every text."""
    whole = replace(WHOLE, vehicle=replace(WHOLE.vehicle, vin="TRUEWHEEL00000002"))  # type: ignore[type-var]
    engine = make_engine(parse_url(url), timeout_s=5.0)
    with engine.begin() as connection:
        for record in (CALIBRATION, LOST, whole, *EVENTS):
            put(connection, record)
            if revision >= "0007":
                link(connection, record, stored=not isinstance(record, EventRecord))
            if connection.dialect.name == "sqlite" and revision >= "0005":
                kinds = {CalibrationRecord: "calibration", CycleRecord: "cycle", EventRecord: "event"}
                key = record.id if isinstance(record, CalibrationRecord) else record.uuid.hex
                into = text("INSERT INTO outbox (kind, key) VALUES (:kind, :key)")
                connection.execute(into, {"kind": kinds[type(record)], "key": key})
    engine.dispose()


def upgraded(url: str, revision: str) -> None:
    migrate_new(url, revision)
    fill(url, revision)
    assert migrate(url) == head_revision()


def lost_heads(store: ResultStore) -> dict[tuple[str, str], bool | None]:
    found = {}
    for stored in store.recent_cycles(5):
        assert stored.record.vehicle is not None
        for one in stored.record.wheels:
            found[stored.record.vehicle.vin[-1], one.wheel] = one.degraded
    return found


@pytest.mark.parametrize("revision", EARLIER)
def test_what_texts_tell_is_in_columns_after_the_upgrade(empty_database_url: str, revision: str) -> None:
    """An acknowledgement was found by the beginning of a text, a lost head by the end of one."""
    upgraded(empty_database_url, revision)
    with ResultStore(empty_database_url) as store:
        assert store.recent_events(99) == tuple(UPGRADED[::-1])
        closings = store.cycle_events(LOST.uuid, ("offered", "acknowledged", "discarded"))
        assert {one.code for one in closings} == {"offered", "acknowledged"}
        found = lost_heads(store)
        assert {name: value for name, value in found.items() if value is not None} == {
            ("1", "front_left"): True
        }
        store.write_cycle(cycle(wheels=(wheel(degraded=True), wheel("rear_left", degraded=False))))
        store.record_event(replace(EVENTS[0], uuid=uuid4(), cycle_uuid=LOST.uuid))
    assert check_database(empty_database_url, days=None).findings == ()


def test_rows_are_kept_again_after_the_upgrade(empty_database_url: str) -> None:
    upgraded(empty_database_url, EARLIER[-1])
    engine = make_engine(parse_url(empty_database_url), timeout_s=5.0)
    for change in ("events SET value = 1.0", "wheel_results SET camber = 1.0"):
        with engine.connect() as connection, pytest.raises(DBAPIError, match="never changed or deleted"):
            connection.execute(text(f"UPDATE {change}"))
    engine.dispose()


def test_what_was_filled_in_is_proven_by_the_text_that_is_hashed(empty_database_url: str) -> None:
    upgraded(empty_database_url, CHAINED[0])
    changes = (
        ("events", "cycle_uuid = NULL WHERE code = 'acknowledged'"),
        ("events", "cycle_uuid = uuid WHERE code = 'started'"),
        ("events", "cycle_uuid = uuid WHERE code = 'offered'"),
        ("events", "value = 20.0 WHERE code = 'temperature'"),
        ("events", "value = 1.5 WHERE code = 'started'"),
        ("events", "text = 'nothing happened' WHERE code = 'acknowledged'"),
        ("wheel_results", "degraded = NULL"),
        ("wheel_results", "degraded = NOT degraded WHERE degraded"),
        ("wheel_results", "degraded = true"),
        ("wheel_results", "method = 'tyre_plane/revolution'"),
    )
    same = {
        "events": "kept.id = events.id",
        "wheel_results": "kept.cycle_id = wheel_results.cycle_id AND kept.wheel = wheel_results.wheel",
    }
    names = {"events": ("cycle_uuid", "value", "text"), "wheel_results": ("degraded", "method")}
    for table, change in changes:
        kept = f"FROM kept WHERE {same[table]}"
        back = ", ".join(f"{name} = (SELECT kept.{name} {kept})" for name in names[table])
        keep = f"CREATE TABLE kept AS SELECT * FROM {table}"
        tamper(empty_database_url, keep, f"UPDATE {table} SET {change}")
        found = check_database(empty_database_url, days=None).findings
        tamper(empty_database_url, f"UPDATE {table} SET {back}", "DROP TABLE kept")
        assert found, change
        assert all(one.startswith(f"{table}: ") and one.endswith("was altered") for one in found), found
    assert check_database(empty_database_url, days=None).findings == ()


def test_what_is_written_with_its_columns_is_proven_by_them(sqlite_url: str, postgres_server: Any) -> None:
    """The rule for old rows is no way around for new ones, in a database that was upgraded."""
    with postgres_server.database() as postgres_url:
        for url in (sqlite_url, postgres_url):
            upgraded(url, CHAINED[0])
            with ResultStore(url) as store:
                later = cycle(wheels=(wheel(degraded=True, method="prepared"),), vehicle_angles=None)
                store.write_cycle(later)
                store.record_event(replace(EVENTS[0], uuid=uuid4(), cycle_uuid=later.uuid))
            newest = "(SELECT max(cycle_id) FROM wheel_results)"
            tamper(
                url,
                f"UPDATE wheel_results SET degraded = NULL WHERE cycle_id = {newest}",
                "UPDATE events SET cycle_uuid = NULL WHERE id = (SELECT max(id) FROM events)",
            )
            found = check_database(url, days=None).findings
            assert [one.split(":")[0] for one in found] == ["wheel_results", "events"], found


def test_an_auditor_verifies_upgraded_events_with_the_lines_of_the_documentation(
    sqlite_url: str, capsys: pytest.CaptureFixture[str]
) -> None:
    upgraded(sqlite_url, CHAINED[0])
    with ResultStore(sqlite_url) as store:
        store.record_event(replace(EVENTS[0], uuid=uuid4(), cycle_uuid=LOST.uuid, value=2.0))
    page = (Path(__file__).parents[3] / "docs" / "database.md").read_text(encoding="utf-8")
    lines = page.split("## The chain of hashes")[1].split("```python\n")[1].split("```")[0]
    program = compile(lines.replace("results.db", sqlite_url[10:]), "docs/database.md", "exec")
    exec(program, {})
    end = check_database(sqlite_url, None).heads["EOL-1"]
    assert capsys.readouterr().out.splitlines() == [f"link {end.number} of station EOL-1: {end.hash}"]
    tamper(sqlite_url, "UPDATE events SET value = 3.0 WHERE value = 2.0")
    with pytest.raises(AssertionError, match="event"):
        exec(program, {})


def test_upgraded_records_are_shipped_as_they_were_read(tmp_path: Path, postgres_url: str) -> None:
    url = f"sqlite:///{tmp_path / 'station.db'}"
    upgraded(url, CHAINED[-1])
    with Shipper(url, postgres_url, "EOL-1") as shipper:
        while shipper.ship(4).pending:
            pass
    with ResultStore(url) as local, ResultStore(postgres_url) as central:
        assert local.recent_events(99) == central.recent_events(99) == tuple(UPGRADED[::-1])
        assert lost_heads(local) == lost_heads(central)
    assert check_database(postgres_url, days=None).findings == ()


def test_an_empty_database_has_no_mark_of_the_upgrade(empty_database_url: str) -> None:
    migrate(empty_database_url)
    report = check_database(empty_database_url, days=None)
    assert report.findings == ()
    assert {name: end.number for name, end in report.heads.items()} == {"": 1}


def kinds(store: ResultStore) -> set[tuple[str | None, WheelKind | None]]:
    wheels_found = [one for stored in store.recent_cycles(9) for one in stored.record.wheels]
    return {(one.method, one.kind) for one in wheels_found}


@pytest.mark.parametrize("revision", BEFORE_KINDS)
def test_the_kind_of_a_wheel_is_told_by_its_method_after_the_upgrade(
    empty_database_url: str, revision: str
) -> None:
    """Whether a stored toe was of a tyre plane or of a spin axis was the beginning of a text."""
    migrate_new(empty_database_url, revision)
    others = cycle(
        wheels=(
            wheel("front_left", method="spin_axis"), wheel("rear_left", method="tyre_planer"),
            wheel("rear_right", method="tyre_plane"),
        ), axles=(), vehicle_angles=None,
    )  # fmt: skip
    engine = make_engine(parse_url(empty_database_url), timeout_s=5.0)
    fill(empty_database_url, revision)
    others = replace(others, vehicle=replace(LOST.vehicle, vin="TRUEWHEEL00000003"))  # type: ignore[type-var]
    with engine.begin() as connection:
        put(connection, others)
        if revision >= "0007":
            link(connection, others, stored=True)
        if connection.dialect.name == "sqlite" and revision >= "0005":
            into = text("INSERT INTO outbox (kind, key) VALUES ('cycle', :key)")
            connection.execute(into, {"key": others.uuid.hex})
    engine.dispose()
    assert migrate(empty_database_url) == head_revision()
    with ResultStore(empty_database_url) as store:
        assert kinds(store) == {
            (DEGRADED, WheelKind.TYRE_PLANE),
            ("tyre_plane/revolution", WheelKind.TYRE_PLANE),
            ("tyre_plane", WheelKind.TYRE_PLANE),
            ("spin_axis", WheelKind.SPIN_AXIS),
            ("tyre_planer", None),
        }
        assert all(stored.record.geometry is None for stored in store.recent_cycles(9))
        store.write_cycle(cycle(wheels=tuple(map(wheel, WHEELS)), geometry=geometry()))
    assert check_database(empty_database_url, days=None).findings == ()


@pytest.mark.parametrize("revision", ["0007", "0010"])
def test_a_kind_that_was_changed_later_is_named(empty_database_url: str, revision: str) -> None:
    """Two revisions filled columns, and each row is proven without those that came after it."""
    migrate_new(empty_database_url, revision)
    fill(empty_database_url, revision)
    migrate(empty_database_url)
    assert check_database(empty_database_url, days=None).findings == ()
    for change in ("kind = NULL", "kind = 'spin_axis'", "method = 'spin_axis'"):
        tamper(
            empty_database_url,
            "CREATE TABLE kept AS SELECT * FROM wheel_results",
            f"UPDATE wheel_results SET {change} WHERE wheel = 'front_left'",
        )
        found = check_database(empty_database_url, days=None).findings
        of_row = "FROM kept WHERE kept.cycle_id = wheel_results.cycle_id AND kept.wheel = wheel_results.wheel"
        tamper(
            empty_database_url,
            f"UPDATE wheel_results SET kind = (SELECT kept.kind {of_row}),"
            f" method = (SELECT kept.method {of_row})",
            "DROP TABLE kept",
        )
        assert len(found) == 2, (change, found)
        assert all(one.startswith("wheel_results: front_left of cycle") for one in found), found
    assert check_database(empty_database_url, days=None).findings == ()


def test_rows_that_revision_0010_wrote_itself_are_hashed_with_its_columns(empty_database_url: str) -> None:
    """Their lost head was in the hash, so that it may not be taken for filled in."""
    migrate_new(empty_database_url, "0010")
    engine = make_engine(parse_url(empty_database_url), timeout_s=5.0)
    theirs = cycle(wheels=(wheel(degraded=True, method=DEGRADED),), axles=(), vehicle_angles=None)
    with engine.begin() as connection:
        for record in (CALIBRATION, theirs):
            put(connection, record)
            link(connection, record, stored=True)
    engine.dispose()
    migrate(empty_database_url)
    found = [one for one in check_database(empty_database_url, days=None).findings if "outbox" not in one]
    assert found == []
    tamper(empty_database_url, "UPDATE wheel_results SET degraded = NULL")
    assert any("was altered" in one for one in check_database(empty_database_url, days=None).findings)
