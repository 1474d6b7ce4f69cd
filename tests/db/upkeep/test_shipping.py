"""A station's own database first, the central one when it can: nothing lost, nothing doubled, order kept."""

from __future__ import annotations

import shutil
import threading
from collections.abc import Callable, Iterator
from datetime import timedelta
from pathlib import Path

import pytest
from sqlalchemy import select

from alignment.errors import ConfigurationError, StoreError, StoreUnavailableError
from db.connection import make_engine, migrate, parse_url, station_lock
from db.queries import Characteristic, Quantity, ResultReader, value_series
from db.records import ArchiveRemoval, CalibrationRecord, EventRecord, Severity, StoredDoubt
from db.schema import arrivals, cycles
from db.store import ResultStore
from db.upkeep.background import BackgroundWork
from db.upkeep.check import check_database
from db.upkeep.shipping import Shipper, StationTakenError
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
    geometry,
    installation,
    limits,
    revocation,
    shot,
    station,
    steering,
    steering_axis,
    study,
    study_value,
    withdrawal,
    zero,
)
from tests.db.queries.test_lengths import RECORDS as VEHICLES

QUANTITIES = (("vehicle", Quantity.TRACK_FRONT), ("front_left", Quantity.RUN_OUT))


@pytest.fixture
def local_url(tmp_path: Path) -> str:
    return f"sqlite:///{tmp_path / 'station.db'}"


@pytest.fixture
def central_url(database_url: str) -> str:
    migrate(database_url)
    return database_url


@pytest.fixture
def station_store(local_url: str, open_store: Callable[..., ResultStore]) -> ResultStore:
    store = open_store(local_url)
    store.record_calibration(CALIBRATION)
    return store


@pytest.fixture
def shipper(station_store: ResultStore, local_url: str, central_url: str) -> Iterator[Shipper]:
    with Shipper(local_url, central_url, "EOL-1", host="pc-1") as opened:
        yield opened


def ship_all(shipper: Shipper, most: int = 7) -> int:
    total = 0
    while True:
        done = shipper.ship(most)
        total += done.shipped
        if not done.pending:
            return total


def shipped_order(url: str) -> list[str]:
    engine = make_engine(parse_url(url), timeout_s=5.0)
    with engine.connect() as connection:
        found = [
            uuid.hex for uuid in connection.execute(select(cycles.c.uuid).order_by(cycles.c.id)).scalars()
        ]
        numbers = (
            connection.execute(select(arrivals.c.sequence).order_by(arrivals.c.sequence)).scalars().all()
        )
    engine.dispose()
    assert numbers == list(range(1, len(numbers) + 1))
    return found


def test_every_kind_of_record_arrives_equal(
    station_store: ResultStore, shipper: Shipper, central_url: str, open_store: Callable[..., ResultStore]
) -> None:
    measured, planned = (
        cycle(
            geometry=geometry(),
            steering=steering(),
            steering_axes=(steering_axis(),),
            adjustings=(adjusting(), adjusting("front_right"), adjusting(adjuster="camber_bolt")),
        ),
        study(),
    )
    kept = shot(measured.uuid)
    station_store.describe_station(station(), (limits(),), (installation(),))
    checked = check()
    station_store.record_check(checked)
    station_store.record_zero(zero())
    station_store.write_cycle(measured)
    station_store.revoke_zero(revocation())
    station_store.record_event(EventRecord(NOON, "EOL-1", Severity.INFO, "station", "start", "started"))
    station_store.plan_study(planned)
    station_store.record_study_values([study_value(planned.uuid), study_value(planned.uuid, trial=2)])
    station_store.record_shot(kept)
    station_store.remove_shot(ArchiveRemoval(kept.uuid, NOON, "the ring is full"))
    released = bad_vehicle()
    station_store.write_cycle(released)
    granted = concession(released.uuid)
    station_store.grant_concession(granted)
    station_store.withdraw_concession(withdrawal(granted.uuid))
    spoken = doubt(measured.uuid, checked.uuid)
    station_store.record_found(lambda connection: [spoken])
    ended = doubt_closing(spoken.uuid)
    station_store.record_found(lambda connection: [ended])
    assert ship_all(shipper) == 19
    central = open_store(central_url, create=False)
    counts = central.counts()
    assert counts == station_store.counts() | {"plants": 1}
    stored = central.cycle(measured.uuid)
    assert stored is not None
    assert stored.record == measured
    assert stored.doubts == (StoredDoubt(spoken, ended),)
    assert central.calibration_checks(CALIBRATION.id)[0].reason == check().reason
    assert central.zeros() != ()
    (conceded,) = central.concessions([released.uuid])
    assert (conceded.record, conceded.withdrawal) == (granted, withdrawal(granted.uuid))
    assert ship_all(shipper) == 0


def test_lengths_and_run_outs_arrive_as_they_were_stored(
    station_store: ResultStore,
    shipper: Shipper,
    local_url: str,
    central_url: str,
    open_store: Callable[..., ResultStore],
) -> None:
    """Columns of a later revision than the rest: what is shipped must not stop at those of the first."""
    for record in VEHICLES:
        station_store.write_cycle(record)
    ship_all(shipper)
    central = open_store(central_url, create=False)
    found = {stored.record.uuid: stored.record for stored in central.recent_cycles(99)}
    assert found == {record.uuid: record for record in VEHICLES}
    assert any(record.geometry is not None and record.geometry.track_front for record in found.values())
    assert any(wheel.run_out_phase is not None for record in found.values() for wheel in record.wheels)
    with ResultReader(central_url) as reader:
        asked = [value_series(reader, Characteristic(*name)).value for name in QUANTITIES]
    with ResultReader(local_url) as reader:
        own = [value_series(reader, Characteristic(*name)).value for name in QUANTITIES]
    for there, here in zip(asked, own, strict=True):
        assert len(there) == len(VEHICLES) - 1
        assert there.tolist() == here.tolist()
    assert check_database(central_url, days=None).findings == ()


def test_order_is_kept_and_shipping_resumes_where_it_stopped(
    station_store: ResultStore, shipper: Shipper, local_url: str, central_url: str
) -> None:
    records = [cycle(trigger_sequence=k) for k in range(20)]
    for record in records[:12]:
        station_store.write_cycle(record)
    assert shipper.ship(5).pending == 8
    for record in records[12:]:
        station_store.write_cycle(record)
    shipper.close()
    # A new run of the same station, whose name has been given back.
    with Shipper(local_url, central_url, "EOL-1", host="pc-1") as again:
        assert again.pending() == 16
        ship_all(again)
        assert again.pending() == 0
    assert shipped_order(central_url) == [record.uuid.hex for record in records]


def test_a_shipment_whose_end_was_not_seen_is_not_doubled(
    station_store: ResultStore, shipper: Shipper, central_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    records = [cycle() for _ in range(6)]
    for record in records:
        station_store.write_cycle(record)

    def fails(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        # The central database has committed; the own one does not hear of it.
        patched.setattr("db.upkeep.shipping._pending", fails)
        with pytest.raises(KeyboardInterrupt):
            shipper.ship(4)
    assert shipper.pending() == 7
    ship_all(shipper)
    assert shipped_order(central_url) == [record.uuid.hex for record in records]


def test_a_central_database_restored_from_a_backup_gets_again_what_it_lost(
    tmp_path: Path, station_store: ResultStore, local_url: str
) -> None:
    central = tmp_path / "central.db"
    migrate(f"sqlite:///{central}")
    records = [cycle() for _ in range(8)]
    with Shipper(local_url, f"sqlite:///{central}", "EOL-1") as shipper:
        for record in records[:4]:
            station_store.write_cycle(record)
        ship_all(shipper)
    shutil.copy(central, tmp_path / "backup.db")
    with Shipper(local_url, f"sqlite:///{central}", "EOL-1") as shipper:
        for record in records[4:]:
            station_store.write_cycle(record)
        ship_all(shipper)
    for path in tmp_path.glob("central.db*"):
        path.unlink()
    (tmp_path / "backup.db").rename(central)
    with Shipper(local_url, f"sqlite:///{central}", "EOL-1") as shipper:
        ship_all(shipper)
    assert shipped_order(f"sqlite:///{central}") == [record.uuid.hex for record in records]


def test_a_station_restored_from_an_old_copy_ships_under_a_new_identity(
    tmp_path: Path, central_url: str, open_store: Callable[..., ResultStore]
) -> None:
    path = tmp_path / "station.db"
    url = f"sqlite:///{path}"
    with ResultStore(url, create=True) as store:
        store.record_calibration(CALIBRATION)
        before = [cycle() for _ in range(3)]
        for record in before:
            store.write_cycle(record)
    shutil.copy(path, tmp_path / "old.db")
    with ResultStore(url) as store, Shipper(url, central_url, "EOL-1") as shipper:
        lost = cycle()
        store.write_cycle(lost)
        ship_all(shipper)
    shutil.copy(tmp_path / "old.db", path)
    with ResultStore(url) as store, Shipper(url, central_url, "EOL-1") as shipper:
        after = [cycle() for _ in range(3)]
        for record in after:
            store.write_cycle(record)
        done = shipper.ship()
        assert done.renewed_origin
        # Everything waits again: the calibration and six cycles.
        assert done.pending == 7
        ship_all(shipper)
    central = open_store(central_url, create=False)
    found = [stored.record.uuid for stored in central.recent_cycles(20)][::-1]
    assert found == [record.uuid for record in (*before, lost, *after)]


def test_two_stations_of_the_same_name_do_not_both_ship(
    tmp_path: Path, station_store: ResultStore, shipper: Shipper, central_url: str
) -> None:
    shipper.ship()
    other_url = f"sqlite:///{tmp_path / 'clone.db'}"
    with (
        ResultStore(other_url, create=True) as other,
        Shipper(other_url, central_url, "EOL-1", host="pc-2", lease_s=0.0) as second,
    ):
        other.record_calibration(CALIBRATION)
        record = cycle()
        other.write_cycle(record)
        with pytest.raises(
            StationTakenError, match=r"station 'EOL-1' is running on pc-1 too.*another station id"
        ):
            second.ship()
        assert second.pending() == 2
        # The first one ends properly and gives the name back.
        shipper.close()
        assert second.ship().pending == 0
    with Shipper(other_url, central_url, "EOL-1", host="pc-3") as third:
        # A station that vanished keeps the name for its lease only, here none.
        assert third.ship().pending == 0


def test_two_programs_on_one_computer_cannot_ship_as_one_station(
    tmp_path: Path, station_store: ResultStore, local_url: str, central_url: str
) -> None:
    """The name was the computer's: a second program beside the first took turns with it."""
    other_url = f"sqlite:///{tmp_path / 'beside.db'}"
    with (
        ResultStore(other_url, create=True),
        Shipper(local_url, central_url, "EOL-1", host="pc-1") as first,
        Shipper(other_url, central_url, "EOL-1", host="pc-1") as second,
    ):
        first.ship()
        with pytest.raises(StationTakenError, match="is running on pc-1 too"):
            second.ship()
        # The first one keeps it for as long as it shows life.
        first.ship()


def test_what_contradicts_the_central_record_stops_shipping_with_the_reason(
    station_store: ResultStore, shipper: Shipper, central_url: str
) -> None:
    with ResultStore(central_url) as central:
        central.record_calibration(CalibrationRecord(CALIBRATION.id, "rear_left", NOON, {}))
    with pytest.raises(StoreError, match="already holds another calibration cal-2026-11"):
        shipper.ship()
    assert shipper.pending() == 1


def test_a_server_in_the_place_of_the_own_file_is_refused(postgres_url: str) -> None:
    with pytest.raises(ConfigurationError, match="the station's own file"):
        Shipper(postgres_url, postgres_url, "EOL-1")


def test_health_tells_of_a_central_database_that_is_away_and_back(
    tmp_path: Path, station_store: ResultStore, local_url: str
) -> None:
    central = tmp_path / "central.db"
    migrate(f"sqlite:///{central}")
    shipper = Shipper(local_url, f"sqlite:///{central}", "EOL-1")
    work = BackgroundWork(station_store, local_url, "EOL-1", shipper)
    shipper.open()
    away = central.rename(tmp_path / "away.db")
    waits = [work.step() for _ in range(8)]
    assert waits == [1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 60.0, 60.0]
    assert work.health.pending == 2
    assert "cannot be opened" in str(work.health.central_error)
    assert not work.health.good
    away.rename(central)
    assert work.step() == 5.0
    assert work.health.good
    work.step()
    assert work.health.pending == 0
    shipper.close()
    codes = [event.code for event in station_store.recent_events(5)]
    assert codes == ["central_back", "central_away"]


def test_health_tells_of_a_disk_that_is_nearly_full(station_store: ResultStore, local_url: str) -> None:
    free = iter([2_000, 500, 400, 3_000])
    work = BackgroundWork(
        station_store, local_url, "EOL-1", minimum_free_bytes=1_000, free_bytes=lambda _: next(free)
    )
    seen = []
    for _ in range(4):
        work.step()
        seen.append(work.health.disk_nearly_full)
    assert seen == [False, True, True, False]
    codes = [event.code for event in station_store.recent_events(5)]
    assert codes == ["disk_has_room", "disk_nearly_full"]


def test_the_thread_ships_beside_the_cycles(
    station_store: ResultStore, local_url: str, central_url: str
) -> None:
    records = [cycle() for _ in range(5)]
    shipper = Shipper(local_url, central_url, "EOL-1")
    with BackgroundWork(station_store, local_url, "EOL-1", shipper, period_s=0.01):
        for record in records:
            station_store.write_cycle(record)
        deadline = 500
        while shipper.pending() and deadline:
            deadline -= 1
            threading.Event().wait(0.02)
    assert shipped_order(central_url) == [record.uuid.hex for record in records]


def test_a_second_program_of_the_same_station_is_refused(database_url: str) -> None:
    migrate(database_url)
    with station_lock(database_url, "EOL-1"):
        with (
            pytest.raises(StoreUnavailableError, match="station 'EOL-1' is running already on database"),
            station_lock(database_url, "EOL-1"),
        ):
            pass
        with station_lock(database_url, "EOL-2"):
            pass
    with station_lock(database_url, "EOL-1"):
        pass


def test_a_clock_set_back_an_hour_changes_neither_order_nor_count(
    local_url: str, central_url: str, open_store: Callable[..., ResultStore]
) -> None:
    offsets = iter([timedelta(0)] * 4 + [timedelta(hours=-1)] * 40)
    store = open_store(local_url, now=lambda: NOON + next(offsets))
    store.record_calibration(CALIBRATION)
    records = [
        cycle(received_utc=NOON + timedelta(minutes=k) - (timedelta(hours=1) if k >= 3 else timedelta(0)))
        for k in range(6)
    ]
    for record in records:
        store.write_cycle(record)
    with Shipper(local_url, central_url, "EOL-1") as shipper:
        ship_all(shipper)
    assert shipped_order(central_url) == [record.uuid.hex for record in records]
