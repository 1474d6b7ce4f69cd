"""Vehicles since the last good master check: the same as the records themselves give, for every filter."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime, timedelta

import numpy as np
import pytest

from db.connection import make_engine, parse_url
from db.queries import Filter, ResultReader, VehicleSince, since_check, since_last_good_check
from db.records import CalibrationRecord, CheckKind, CheckOutcome, CycleOutcome, CycleRecord, VehicleRecord
from db.rows import write_cycles
from db.store import ResultStore
from tests.db.example_plant import STATIONS, plant
from tests.db.example_records import CALIBRATION, NOON, WHEELS, check, cycle, installation, station, wheel

HOUR = timedelta(hours=1)


def with_clock_set_back(records: list[CycleRecord]) -> list[CycleRecord]:
    """As `records`, of which some are stored with a time an hour too early."""
    return [
        replace(record, received_utc=record.received_utc - HOUR) if number % 10 < 5 else record
        for number, record in enumerate(records)
    ]


def expected(
    records: list[CycleRecord], good: dict[tuple[str, str], datetime], where: Filter
) -> dict[tuple[str, str], list[str]]:
    """For every station and wheel the VINs, by the rule as it is written."""
    found: dict[tuple[str, str], list[str]] = defaultdict(list)
    for name in where.stations or STATIONS:
        for rig in where.wheels or WHEELS:
            last = good.get((name, rig))
            reached = False
            for record in (r for r in records if r.station == name):
                assert record.vehicle is not None
                time = record.received_utc
                behind = last is not None and reached and time > last - 2 * HOUR
                reached |= last is not None and last < time < last + 2 * HOUR
                after = last is None or time > last or behind
                wanted = (
                    (not where.vehicle_types or record.vehicle.vehicle_type in where.vehicle_types)
                    and (where.vin is None or record.vehicle.vin.startswith(where.vin.rstrip("*")))
                    and (where.until_utc is None or time < where.until_utc)
                    and (where.from_utc is None or time >= where.from_utc)
                )
                if after and wanted and rig in {w.wheel for w in record.wheels}:
                    found[name, rig].append(record.vehicle.vin)
    return found


@pytest.fixture
def filled(
    database_url: str, open_store: Callable[..., ResultStore]
) -> tuple[str, list[CycleRecord], dict[tuple[str, str], datetime]]:
    """Two stations: most wheels checked at their own times, one never, one only badly."""
    rng = np.random.default_rng(5)
    records = with_clock_set_back(plant(300))
    store = open_store(database_url)
    store.record_calibration(CALIBRATION)
    engine = make_engine(parse_url(database_url), timeout_s=5.0)
    with engine.connect().execution_options(writes=True) as connection, connection.begin():
        write_cycles(connection, records, NOON)
    engine.dispose()
    good: dict[tuple[str, str], datetime] = {}
    for name in STATIONS:
        uses = []
        for rig in WHEELS:
            used = CalibrationRecord(f"cal-{name}-{rig}", rig, NOON, {})
            store.record_calibration(used)
            uses.append(installation(station=name, rig=rig, calibration_id=used.id))
            if (name, rig) == ("EOL-2", "rear_left"):
                continue
            for _ in range(4):
                within = bool(rng.uniform() < 0.7) and (name, rig) != ("EOL-2", "rear_right")
                # Near the hour at which the clock of the example is set back.
                utc = NOON + (46.0 + float(rng.uniform(-3.0, 6.0))) * HOUR
                outcome = CheckOutcome.WITHIN if within else CheckOutcome.OUT
                store.record_check(check(used.id, utc=utc, kind=CheckKind.MASTER_WHEEL, outcome=outcome))
                if within:
                    good[name, rig] = max(utc, good.get((name, rig), utc))
        store.describe_station(station(station=name), (), uses)
    return database_url, records, good


@pytest.mark.parametrize("dense", [0.0, 10.0], ids=["in one pass", "one by one"])
def test_the_vehicles_are_those_that_the_records_give(
    filled: tuple[str, list[CycleRecord], dict[tuple[str, str], datetime]],
    dense: float,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    url, records, good = filled
    monkeypatch.setattr(since_check, "_DENSE", dense)
    filters = (
        Filter(),
        Filter(stations=("EOL-2",)),
        Filter(wheels=("front_left", "rear_left")),
        Filter(vehicle_types=("van",)),
        Filter(vin="TRUEWHEEL000002*"),
        Filter(from_utc=NOON + 47 * HOUR, until_utc=NOON + 60 * HOUR),
        Filter(vehicle_types=("compact",), until_utc=NOON + 50 * HOUR, stations=("EOL-1",)),
    )
    with ResultReader(url) as reader:
        for where in filters:
            found: dict[tuple[str, str], list[str]] = {}
            for group in since_last_good_check(reader, where):
                assert {good.get((group.station, rig)) for rig in group.wheels} == {group.last_good_utc}
                for rig in group.wheels:
                    found[group.station, rig] = [v.vin for v in group.vehicles]
            wanted = expected(records, good, where)
            groups = {(group.station, group.wheels): group for group in since_last_good_check(reader, where)}
            for (name, wheels), group in groups.items():
                together = {vin for rig in wheels for vin in wanted[name, rig]}
                assert {v.vin for v in group.vehicles} == together
                assert len(group.vehicles) == len(together)
            alone = {key: vins for key, vins in found.items() if len(groups_of(groups, key)) == 1}
            assert alone
            assert all(vins == wanted[key] for key, vins in alone.items())


def groups_of(groups: dict[tuple[str, tuple[str, ...]], object], key: tuple[str, str]) -> tuple[str, ...]:
    """The wheels that share the group of one."""
    return next(wheels for name, wheels in groups if name == key[0] and key[1] in wheels)


def test_more_wheels_than_a_number_has_bits(store: ResultStore, database_url: str) -> None:
    """Stations that name their rigs after themselves."""
    for number in range(20):
        rigs = tuple(f"{number}_{name}" for name in WHEELS)
        store.write_cycle(
            cycle(
                station=f"station_{number}",
                vehicle=VehicleRecord(f"VIN{number}", "compact"),
                wheels=tuple(wheel(rig) for rig in rigs),
                axles=(),
                vehicle_angles=None,
            )
        )
    with ResultReader(database_url) as reader:
        found = since_last_good_check(reader)
    assert {group.station: [v.vin for v in group.vehicles] for group in found} == {
        f"station_{number}": [f"VIN{number}"] for number in range(20)
    }


def test_vehicles_are_made_when_they_are_looked_at(store: ResultStore, database_url: str) -> None:
    records = [cycle(received_utc=NOON + k * HOUR, measured_utc=NOON + k * HOUR) for k in range(3)]
    for record in records:
        store.write_cycle(record)
    with ResultReader(database_url) as reader:
        (group,) = since_last_good_check(reader)
    assert len(group.vehicles) == 3
    assert [vehicle.cycle for vehicle in group.vehicles[1:]] == [record.uuid for record in records[1:]]
    assert group.vehicles[-1] == VehicleSince(
        "TRUEWHEEL00000001", "compact", records[2].received_utc, CycleOutcome.OK, records[2].uuid
    )
    assert group.vehicles.time.tolist() == [r.received_utc.replace(tzinfo=None) for r in records]
