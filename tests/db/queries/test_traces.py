"""One vehicle with everything that explains it, and the vehicles since the last good check."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from datetime import datetime, timedelta
from typing import Any

import pytest

from db.connection import make_engine, parse_url
from db.queries import (
    Characteristic,
    Filter,
    ResultReader,
    checks,
    events,
    gauge_studies,
    gauge_study,
    gauge_value_counts,
    since_last_good_check,
    value_series,
    vin_history,
)
from db.records import (
    ArchiveRemoval,
    CalibrationRecord,
    CheckKind,
    CheckOutcome,
    CycleRecord,
    EventRecord,
    Severity,
    StudyKind,
    VehicleRecord,
)
from db.rows import write_cycles
from db.store import ResultStore
from db.sums import bring_up_to_date
from tests.db.example_records import (
    CALIBRATION,
    NOON,
    WHEELS,
    check,
    cycle,
    installation,
    revocation,
    shot,
    station,
    study,
    study_value,
    wheel,
    zero,
)

HOUR = timedelta(hours=1)


@pytest.fixture
def reader(store: ResultStore, database_url: str) -> Iterator[ResultReader]:
    with ResultReader(database_url) as opened:
        yield opened


def vehicle(number: int, received: datetime, **changes: Any) -> CycleRecord:
    return cycle(
        received_utc=received,
        measured_utc=received,
        vehicle=VehicleRecord(f"VIN{number:04d}", "compact"),
        **changes,
    )


def master(utc: datetime, calibration_id: str = CALIBRATION.id, good: bool = True) -> Any:
    return check(
        calibration_id,
        utc=utc,
        kind=CheckKind.MASTER_WHEEL,
        outcome=CheckOutcome.WITHIN if good else CheckOutcome.OUT,
    )


def since(reader: ResultReader, **filters: Any) -> dict[tuple[str, ...], list[str]]:
    return {
        (found.station, *found.wheels): [vehicle.vin for vehicle in found.vehicles]
        for found in since_last_good_check(reader, Filter(**filters))
    }


def test_vehicles_since_the_last_good_check_of_each_wheel(store: ResultStore, reader: ResultReader) -> None:
    other = CalibrationRecord("cal-right", "front_right", NOON, {})
    store.record_calibration(other)
    store.describe_station(
        station(rigs=("front_left", "front_right")),
        (),
        (installation(), installation(rig="front_right", calibration_id=other.id)),
    )
    for number in range(6):
        store.write_cycle(vehicle(number, NOON + number * HOUR))
    for record in (
        master(NOON + 1.5 * HOUR),
        master(NOON + 3.5 * HOUR),
        # Neither a bad check nor one with a plate clears the vehicles before it.
        master(NOON + 4.5 * HOUR, good=False),
        check(utc=NOON + 5.5 * HOUR),
        master(NOON + 2.5 * HOUR, other.id),
    ):
        store.record_check(record)
    assert since(reader) == {
        ("EOL-1", "front_left"): ["VIN0004", "VIN0005"],
        ("EOL-1", "front_right"): ["VIN0003", "VIN0004", "VIN0005"],
    }
    assert since(reader, wheels=("front_left",)) == {("EOL-1", "front_left"): ["VIN0004", "VIN0005"]}
    assert since(reader, stations=("EOL-2",)) == {}
    assert since(reader, plants=("Werk Süd",), until_utc=NOON + 4.5 * HOUR) == {
        ("EOL-1", "front_left"): ["VIN0004"],
        ("EOL-1", "front_right"): ["VIN0003", "VIN0004"],
    }
    found = checks(reader, Filter(from_utc=NOON + 4 * HOUR))
    assert [(item.station, item.rig, item.check.outcome) for item in found] == [
        ("EOL-1", "front_left", CheckOutcome.OUT),
        ("EOL-1", "front_left", CheckOutcome.WITHIN),
    ]


def test_wheels_that_were_never_checked_are_named_with_all_their_vehicles(
    store: ResultStore, reader: ResultReader, database_url: str
) -> None:
    for number in range(3):
        store.write_cycle(vehicle(number, NOON + number * HOUR))
    # Stored by a program that did not tell its rigs: the results do.
    assert since(reader) == {("EOL-1", *WHEELS): ["VIN0000", "VIN0001", "VIN0002"]}
    engine = make_engine(parse_url(database_url), timeout_s=5.0)
    bring_up_to_date(engine)
    engine.dispose()
    store.record_check(master(NOON + 1.5 * HOUR))
    assert since(reader) == {
        ("EOL-1", "front_left"): ["VIN0002"],
        ("EOL-1", "front_right", "rear_left", "rear_right"): ["VIN0000", "VIN0001", "VIN0002"],
    }


def test_a_clock_set_back_after_a_check_hides_no_vehicle(store: ResultStore, reader: ResultReader) -> None:
    store.describe_station(station(rigs=("front_left",)), (), (installation(),))
    store.write_cycle(vehicle(0, NOON))
    store.record_check(master(NOON + 0.1 * HOUR))
    store.write_cycle(vehicle(1, NOON + 0.2 * HOUR))
    # An hour back: these seem to be older than the check.
    store.write_cycle(vehicle(2, NOON - 0.7 * HOUR))
    store.write_cycle(vehicle(3, NOON - 0.6 * HOUR))
    assert since(reader) == {("EOL-1", "front_left"): ["VIN0001", "VIN0002", "VIN0003"]}


def test_a_vehicle_comes_with_everything_that_explains_it(store: ResultStore, reader: ResultReader) -> None:
    store.describe_station(station(), (), (installation(),))
    store.record_check(check())
    store.record_zero(zero())
    wheels = (wheel("front_left", zero_measurement_id="zero-1"), *(wheel(name) for name in WHEELS[1:]))
    record = vehicle(7, NOON, wheels=wheels)
    store.write_cycle(record)
    store.write_cycle(vehicle(8, NOON))
    store.revoke_zero(revocation())
    kept = shot(record.uuid)
    store.record_shot(kept)
    store.remove_shot(ArchiveRemoval(kept.uuid, NOON + HOUR, "the ring is full"))
    near = EventRecord(NOON - 0.1 * HOUR, "EOL-1", Severity.WARNING, "cameras", "hot", "head 2 at 61 °C")
    later = EventRecord(
        NOON + 5 * HOUR, "EOL-1", Severity.INFO, "station.cycle", "acknowledged", "", cycle_uuid=record.uuid
    )
    for event in (
        later,
        near,
        EventRecord(NOON - HOUR, "EOL-1", Severity.INFO, "station", "start", "started"),
        EventRecord(NOON, "EOL-2", Severity.INFO, "station", "start", "started"),
    ):
        store.record_event(event)
    found = vin_history(reader, "VIN0007")
    assert [stored.record for stored in found.cycles] == [record]
    assert found.calibrations == {CALIBRATION.id: CALIBRATION}
    assert [item.reason for item in found.checks] == [check().reason]
    assert found.zeros["zero-1"].revocation == revocation()
    assert [item.plant for item in found.stations] == ["Werk Süd"]
    assert found.events == (near, later)
    assert {event.station for event in found.events} == {"EOL-1"}
    assert [item.record for item in found.shots] == [kept]
    assert found.shots[0].removal is not None
    nothing = vin_history(reader, "VIN9999")
    assert (nothing.cycles, nothing.events, nothing.shots) == ((), (), ())


def test_events_are_found_by_time_station_code_and_text(store: ResultStore, reader: ResultReader) -> None:
    for hour, name, code, text in (
        (0, "EOL-1", "start", "Gestartet"),
        (1, "EOL-1", "hot", "head 2 at 61 °C, 100% load"),
        (2, "EOL-2", "hot", "head 1 at 62 °C"),
    ):
        store.record_event(EventRecord(NOON + hour * HOUR, name, Severity.INFO, "x", code, text))
    assert [event.code for event in events(reader)] == ["start", "hot", "hot"]
    assert [event.station for event in events(reader, codes=("hot",))] == ["EOL-1", "EOL-2"]
    assert len(events(reader, Filter(stations=("EOL-2",)))) == 1
    assert len(events(reader, Filter(from_utc=NOON + HOUR, until_utc=NOON + 2 * HOUR))) == 1
    assert [event.text for event in events(reader, text="100%")] == ["head 2 at 61 °C, 100% load"]
    assert [event.text for event in events(reader, text="gestartet")] == ["Gestartet"]
    store.record_event(EventRecord(NOON, "EOL-1", Severity.ERROR, "x", "dark", ""))
    assert [event.code for event in events(reader, severities=(Severity.WARNING, Severity.ERROR))] == ["dark"]
    assert len(events(reader, severities=tuple(Severity))) == 4


def test_a_study_reads_back_with_every_raw_value_and_the_newest_counts(
    store: ResultStore, reader: ResultReader
) -> None:
    planned = study()
    store.plan_study(planned)
    store.plan_study(study(kind=StudyKind.TYPE1, name="Typ 1", comment=""))
    values = [study_value(planned.uuid, part=part, trial=k) for part in ("2", "1") for k in (1, 2)]
    correction = study_value(planned.uuid, part="1", trial=2, value=9.0)
    store.record_study_values(values)
    store.record_study_values([correction])
    found = gauge_study(reader, planned.uuid)
    assert found is not None
    assert found.record == planned
    assert found.all_values == (*values, correction)
    assert found.values == (values[2], correction, values[0], values[1])
    assert [item.name for item in gauge_studies(reader, StudyKind.TYPE1)] == ["Typ 1"]
    assert [item.name for item in gauge_studies(reader, text="umbau")] == ["Abnahme 2026"]
    assert [item.name for item in gauge_studies(reader, name="Typ 1")] == ["Typ 1"]
    assert gauge_studies(reader, name="Typ") == gauge_studies(reader, name="' OR 1=1 --") == ()
    assert gauge_value_counts(reader) == {planned.uuid: 4}
    assert gauge_study(reader, values[0].uuid) is None


def test_a_vehicle_that_comes_every_day_for_years_has_its_history(
    store: ResultStore, reader: ResultReader, database_url: str
) -> None:
    """The conditions of a thousand cycles were one expression, which SQLite refuses."""
    store.describe_station(station(), (), ())
    days = [NOON + timedelta(days=day) for day in range(1100)]
    engine = make_engine(parse_url(database_url), timeout_s=30.0)
    with engine.connect().execution_options(writes=True) as connection, connection.begin():
        write_cycles(connection, [vehicle(1, day, wheels=(), outcome="fault", reason_code="x",
                                          reason_text="x", axles=(), vehicle_angles=None)
                                  for day in days], NOON)  # fmt: skip
    engine.dispose()
    for day in (days[0], days[500], days[500] + 6 * HOUR, days[-1]):
        store.record_event(EventRecord(day, "EOL-1", Severity.INFO, "x", "start", str(day)))
    found = vin_history(reader, "VIN0001")
    assert len(found.cycles) == len(days)
    assert [event.utc for event in found.events] == [days[0], days[500], days[-1]]


def test_the_oldest_values_are_those_of_the_first_triggers(store: ResultStore, reader: ResultReader) -> None:
    for number, hour in enumerate((3, 1, 0, 2)):
        store.write_cycle(vehicle(number, NOON + hour * HOUR))
    toe = Characteristic.parse("front_left.toe")
    assert list(value_series(reader, toe, oldest=3).vin) == ["VIN0002", "VIN0001", "VIN0003"]
    assert list(value_series(reader, toe, newest=3).vin) == ["VIN0001", "VIN0002", "VIN0003"]
    assert len(value_series(reader, toe, oldest=9)) == 4


def test_checks_are_those_of_the_wheels_stations_and_plants_asked_for(
    store: ResultStore, reader: ResultReader
) -> None:
    other = replace(CALIBRATION, id="cal-right", rig="front_right")
    store.record_calibration(other)
    store.describe_station(station(), (), (installation(),))
    store.describe_station(
        station(station="EOL-2", plant="Werk Nord"), (),
        (installation(station="EOL-2", rig="front_right", calibration_id=other.id),),
    )  # fmt: skip
    for calibration_id in (CALIBRATION.id, other.id):
        store.record_check(check(calibration_id))

    def found(**where: Any) -> list[str | None]:
        return [one.station for one in checks(reader, Filter(**where))]

    assert found() == ["EOL-1", "EOL-2"]
    assert found(wheels=("front_right",)) == ["EOL-2"]
    assert found(stations=("EOL-1",)) == found(plants=("Werk Süd",)) == ["EOL-1"]
    assert found(stations=("EOL-1",), plants=("Werk Nord",)) == found(wheels=("rear_left",)) == []


def test_only_what_changed_is_recorded_of_a_station(store: ResultStore) -> None:
    store.describe_station(station(), (), (installation(),))
    store.describe_station(station(valid_from_utc=NOON + HOUR), (), (installation(from_utc=NOON + HOUR),))
    assert store.counts()["station_versions"] == store.counts()["installations"] == 1
    store.describe_station(station(config_hash="sha256:01"), (), ())
    assert store.counts()["station_versions"] == 2
