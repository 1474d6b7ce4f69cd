"""A database of every earlier revision, with results in it, becomes one of today and loses nothing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import pytest
from sqlalchemy import Connection, text

from alignment.errors import StoreSchemaError
from db.connection import make_engine, parse_url
from db.connection.revisions import _revisions, current_revision, head_revision, migrate
from db.records import ArchiveRemoval, CycleRecord, EventRecord, Severity, WheelKind
from db.rows import write_record
from db.schema import (
    archived_shots,
    axle_results,
    calibration_checks,
    calibrations,
    cycles,
    events,
    vehicle_results,
    vehicles,
    wheel_results,
    zero_measurements,
    zero_revocations,
)
from db.schema.partitions import CYCLES_PER_PARTITION, ensure_partitions
from db.store import ResultStore
from db.sums import bring_up_to_date
from db.upkeep.check import check_database
from db.upkeep.shipping import Shipper
from tests.db.databases import migrate_new
from tests.db.example_plant import plant
from tests.db.example_records import (
    CALIBRATION,
    NOON,
    adjusting,
    check,
    corrected_wheel,
    cycle,
    given,
    installation,
    limits,
    revocation,
    shot,
    station,
    steering,
    steering_axis,
    study,
    study_value,
    zero,
)

EARLIER = _revisions()[:-1]
RECORDS = plant(12)
EVENT = EventRecord(NOON, "EOL-1", Severity.INFO, "station", "start", "started")


def put(connection: Connection, number: int, record: CycleRecord) -> None:
    assert record.vehicle is not None
    assert record.vehicle_angles is not None
    stored = {"stored_utc": NOON}
    connection.execute(vehicles.insert().values(id=number, **given(record.vehicle)))
    connection.execute(cycles.insert().values(id=number, vehicle_id=number, **given(record), **stored))
    for wheel in record.wheels:
        connection.execute(wheel_results.insert().values(cycle_id=number, **given(wheel)))
    for axle in record.axles:
        connection.execute(axle_results.insert().values(cycle_id=number, **given(axle)))
    angles = given(record.vehicle_angles)
    connection.execute(vehicle_results.insert().values(cycle_id=number, **angles))


def fill(url: str, revision: str) -> None:
    """Rows in every table that the revision has, as its program wrote them."""
    engine = make_engine(parse_url(url), timeout_s=5.0)
    stored = {"stored_utc": NOON}
    # There was no chain of hashes yet.
    with patch("db.rows.writing.new_links", return_value=[]), engine.begin() as connection:
        connection.execute(calibrations.insert().values(**given(CALIBRATION), **stored))
        connection.execute(events.insert().values(**given(EVENT)))
        for number, record in enumerate(RECORDS, 1):
            put(connection, number, record)
        if revision >= "0002":
            connection.execute(calibration_checks.insert().values(**given(check()), **stored))
        if revision >= "0003":
            connection.execute(zero_measurements.insert().values(**given(zero()), **stored))
            connection.execute(zero_revocations.insert().values(**given(revocation()), **stored))
        if revision >= "0004":
            planned, kept = study(), shot(RECORDS[0].uuid)
            for item in (station(), limits(), installation(), planned, study_value(planned.uuid)):
                write_record(connection, item, NOON)
            connection.execute(archived_shots.insert().values(cycle_id=1, **given(kept), **stored))
            write_record(connection, ArchiveRemoval(kept.uuid, NOON, "the ring is full"), NOON)
        if connection.dialect.name == "postgresql":
            for table in ("vehicles", "cycles"):
                newest = f"(SELECT max(id) FROM {table})"
                connection.execute(text(f"SELECT setval(pg_get_serial_sequence('{table}', 'id'), {newest})"))
    engine.dispose()


@pytest.mark.parametrize("revision", EARLIER)
def test_every_earlier_revision_keeps_its_results(empty_database_url: str, revision: str) -> None:
    migrate_new(empty_database_url, revision)
    fill(empty_database_url, revision)
    assert current_revision(empty_database_url) == revision
    assert migrate(empty_database_url) == head_revision()
    with ResultStore(empty_database_url) as store:
        # A wheel says of what its angles are since 0011; the method told it.
        told = revision < "0011"
        upgraded = [
            replace(
                record,
                wheels=tuple(
                    replace(wheel, kind=WheelKind.TYRE_PLANE if told and wheel.method else wheel.kind)
                    for wheel in record.wheels
                ),
            )
            for record in RECORDS[::-1]
        ]
        assert [stored.record for stored in store.recent_cycles(20)] == upgraded
        assert store.calibration(CALIBRATION.id) == CALIBRATION
        assert store.recent_events(5) == (EVENT,)
        assert len(store.calibration_checks(CALIBRATION.id)) == (revision >= "0002")
        assert len(store.zeros()) == (revision >= "0003")
        assert store.counts()["gauge_values"] == (revision >= "0004")
        # It goes on where it was, and stores what it never knew.
        steered = cycle(
            wheels=(corrected_wheel(),),
            steering=steering(),
            steering_axes=(steering_axis(),),
            adjustings=(adjusting(), adjusting(adjuster="camber_bolt")),
        )
        store.write_cycle(steered)
        found = store.cycle(steered.uuid)
        assert found is not None
        assert found.record == steered
    engine = make_engine(parse_url(empty_database_url), timeout_s=5.0)
    assert bring_up_to_date(engine) == len(RECORDS) + 1
    engine.dispose()
    # What came before the chain is counted, what came after is covered. The cycles above are in no outbox.
    found = check_database(empty_database_url, days=None).findings
    found = tuple(finding for finding in found if "are in the outbox" not in finding)
    if revision >= "0007":
        # `fill` stands for the program of then and makes no links, which is seen.
        assert found
        assert all(finding.endswith("was put in past the program") for finding in found)
    else:
        assert found == ()
    with pytest.raises(StoreSchemaError, match="would drop stored results"):
        migrate(empty_database_url, revision)


@pytest.mark.parametrize("revision", [revision for revision in EARLIER if revision < "0005"])
def test_what_a_station_stored_before_there_was_an_outbox_is_shipped_too(
    tmp_path: Path, postgres_url: str, revision: str
) -> None:
    url = f"sqlite:///{tmp_path / 'station.db'}"
    migrate_new(url, revision)
    fill(url, revision)
    migrate(url)
    migrate(postgres_url)
    assert check_database(url).findings == ()
    with Shipper(url, postgres_url, "EOL-1") as shipper:
        while shipper.ship(5).pending:
            pass
    with ResultStore(url) as local, ResultStore(postgres_url) as central:
        found = [stored.record for stored in central.recent_cycles(20)]
        assert found == [stored.record for stored in local.recent_cycles(20)]
        assert central.counts() == local.counts()


def test_partitions_are_made_ahead_and_rows_that_came_first_stay(postgres_url: str) -> None:
    migrate(postgres_url)
    engine = make_engine(parse_url(postgres_url), timeout_s=5.0)
    with ResultStore(postgres_url) as store:
        store.record_calibration(CALIBRATION)
        with engine.begin() as connection:
            assert ensure_partitions(connection) == 0
            connection.execute(text(f"SELECT setval('cycles_id_seq', {5 * CYCLES_PER_PARTITION + 7})"))
        # Nobody made a partition for this one.
        store.write_cycle(cycle())
        with engine.begin() as connection:
            late = connection.execute(text("SELECT count(*) FROM wheel_results_default")).scalar_one()
            assert late == 4
            assert ensure_partitions(connection) == 1
            assert ensure_partitions(connection) == 0
            connection.execute(text(f"SELECT setval('cycles_id_seq', {6 * CYCLES_PER_PARTITION})"))
        last = cycle()
        store.write_cycle(last)
        with engine.begin() as connection:
            assert connection.execute(text("SELECT count(*) FROM wheel_results_default")).scalar_one() == 4
        stored = store.cycle(last.uuid)
        assert stored is not None
        assert stored.record == last
    engine.dispose()
