"""Answers are those that the records themselves give, however much of them the sums hold."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, time, timedelta
from uuid import UUID

import numpy as np
import pytest
from sqlalchemy import text

from alignment.errors import InputError
from db.connection import make_engine, parse_url
from db.queries import (
    Characteristic,
    Filter,
    GroupBy,
    Quantity,
    ResultReader,
    Shift,
    characteristic_moments,
    cycle_records,
    reasons,
    value_series,
    wheel_counts,
    yield_counts,
)
from db.records import CycleOutcome, CycleRecord, Verdict, WheelOutcome
from db.rows import write_cycles
from db.store import ResultStore
from db.sums import bring_up_to_date, check_sums, forget_sums, update_sums
from tests.db.example_plant import STATIONS, TYPES, plant
from tests.db.example_records import CALIBRATION, NOON, WHEELS, station

RECORDS = plant(600)
TOE = Characteristic("front_left", Quantity.TOE)
PERIODS = {
    "everything": Filter(),
    "whole days": Filter(
        from_utc=datetime(2026, 11, 23, tzinfo=UTC), until_utc=datetime(2026, 11, 25, tzinfo=UTC)
    ),
    "odd minutes": Filter(from_utc=NOON + timedelta(hours=3.3), until_utc=NOON + timedelta(hours=70.7)),
    "within an hour": Filter(from_utc=NOON + timedelta(hours=5.2), until_utc=NOON + timedelta(hours=5.9)),
    "late shift of one station": Filter(
        from_utc=NOON,
        until_utc=NOON + timedelta(days=4),
        stations=("EOL-2",),
        shift=Shift("late", time(21, 30), time(5, 45), "Europe/Berlin"),
    ),
    "one type, one wheel": Filter(vehicle_types=("van",), wheels=("rear_left",)),
    "bad ones": Filter(verdict=Verdict.NOK, from_utc=NOON + timedelta(hours=10)),
    "some VINs": Filter(vin="*00*7"),
    "one plant": Filter(plants=("Werk Süd",)),
    "a station that is not there": Filter(stations=("EOL-9",)),
}


@pytest.fixture(scope="module", params=["sqlite", "postgresql"])
def url(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    if request.param == "sqlite":
        yield f"sqlite:///{tmp_path_factory.mktemp('queries') / 'results.db'}"
    else:
        with request.getfixturevalue("postgres_server").database() as found:
            yield found


@pytest.fixture(scope="module", params=["no sums", "some sums", "all sums"])
def reader(request: pytest.FixtureRequest, url: str) -> Iterator[ResultReader]:
    engine = make_engine(parse_url(url), timeout_s=5.0, create=True)
    with ResultStore(url, create=True) as store:
        store.record_calibration(CALIBRATION)
        store.describe_station(station())
    with engine.connect().execution_options(writes=True) as connection, connection.begin():
        write_cycles(connection, RECORDS, NOON)
    forget_sums(engine)
    if request.param == "some sums":
        assert update_sums(engine, most=250) == 250
        assert update_sums(engine, most=200) == 200
    elif request.param == "all sums":
        assert bring_up_to_date(engine) == len(RECORDS)
    engine.dispose()
    with ResultReader(url) as opened:
        yield opened


def chosen(where: Filter) -> list[CycleRecord]:
    def wanted(record: CycleRecord) -> bool:
        assert record.vehicle is not None
        inside = any(
            (start is None or record.received_utc >= start) and (end is None or record.received_utc < end)
            for start, end in where.intervals()
        )
        named = where.vin is None or (record.vehicle.vin.endswith("7") and "00" in record.vehicle.vin[:-1])
        return (
            inside
            and named
            and (not where.stations or record.station in where.stations)
            and (not where.plants or record.station == "EOL-1")
            and (not where.vehicle_types or record.vehicle.vehicle_type in where.vehicle_types)
        )

    return [record for record in RECORDS if wanted(record)]


@pytest.mark.parametrize("name", PERIODS)
def test_yield_is_the_count_of_the_records(reader: ResultReader, name: str) -> None:
    where = PERIODS[name]
    expected = Counter(
        (record.station, record.outcome.value)
        for record in chosen(where)
        if where.verdict is None or record.outcome == where.verdict.value
    )
    found = yield_counts(reader, where, by=(GroupBy.STATION,))
    assert {row.group[GroupBy.STATION] for row in found} == {key for key, _ in expected}
    for row in found:
        for outcome in CycleOutcome:
            assert getattr(row, outcome.value) == expected[str(row.group[GroupBy.STATION]), outcome.value]


def wheels_of(where: Filter) -> Iterator[tuple[CycleRecord, object]]:
    for record in chosen(where):
        for wheel in record.wheels:
            named = not where.wheels or wheel.wheel in where.wheels
            if named and (where.verdict is None or wheel.verdict is where.verdict):
                yield record, wheel


@pytest.mark.parametrize("name", PERIODS)
def test_wheels_are_counted_by_verdict(reader: ResultReader, name: str) -> None:
    where = PERIODS[name]
    wheels = [wheel for _, wheel in wheels_of(where)]
    expected = {
        part: Counter(
            w.verdict.value if w.outcome is WheelOutcome.MEASURED else w.outcome.value
            for w in wheels
            if w.wheel == part
        )
        for part in {w.wheel for w in wheels}
    }
    found = {str(row.group[GroupBy.PART]): row for row in wheel_counts(reader, where, by=(GroupBy.PART,))}
    assert set(found) == set(expected)
    for part, row in found.items():
        assert (row.ok, row.nok, row.unjudged, row.refused) == tuple(
            expected[part][key] for key in ("ok", "nok", "none", "refused")
        )


@pytest.mark.parametrize("name", PERIODS)
def test_moments_are_those_of_the_values(reader: ResultReader, name: str) -> None:
    where = PERIODS[name]
    found = characteristic_moments(reader, where, by=(GroupBy.STATION, GroupBy.DAY))
    values: dict[object, list[tuple[float, str]]] = {}
    for record, wheel in wheels_of(where):
        if wheel.outcome is WheelOutcome.MEASURED:
            for quantity in (Quantity.CAMBER, Quantity.TOE):
                limits = (getattr(wheel, f"{quantity}_low"), getattr(wheel, f"{quantity}_high"))
                key = (
                    Characteristic(wheel.wheel, quantity),
                    *limits,
                    record.station,
                    record.received_utc.date(),
                )
                hour = f"{record.received_utc:%H}{record.vehicle.vehicle_type}"
                values.setdefault(key, []).append((getattr(wheel, quantity), hour))
    of_wheels = [m for m in found if m.characteristic.quantity in (Quantity.CAMBER, Quantity.TOE)]
    assert len(of_wheels) == len(values)
    for moment in of_wheels:
        day = moment.group[GroupBy.DAY]
        key = (moment.characteristic, moment.low, moment.high, moment.group[GroupBy.STATION], day.date())
        sample = np.array([value for value, _ in values[key]])
        assert moment.n == len(sample)
        assert moment.mean == pytest.approx(sample.mean(), rel=1e-12)
        assert moment.m2 == pytest.approx(((sample - sample.mean()) ** 2).sum(), rel=1e-9, abs=1e-22)
        assert (moment.minimum, moment.maximum) == (sample.min(), sample.max())
        assert moment.n_high == (sample > moment.high - 2e-5).sum()
        hours = [
            np.array([value for value, _ in group])
            for _, group in itertools.groupby(sorted(values[key], key=lambda v: v[1]), key=lambda v: v[1])
        ]
        assert moment.dof_within == sum(len(hour) - 1 for hour in hours)
        within = sum(((hour - hour.mean()) ** 2).sum() for hour in hours)
        assert moment.m2_within == pytest.approx(within, rel=1e-9, abs=1e-22)


def test_the_pareto_names_angles_refusals_and_aborts(reader: ResultReader) -> None:
    found = {(r.kind, r.code, r.part): r.count for r in reasons(reader)}
    wheels = [wheel for record in RECORDS for wheel in record.wheels]
    for part in WHEELS:
        high = sum(w.wheel == part and w.toe is not None and w.toe > math.radians(0.2) - 2e-5 for w in wheels)
        assert found["out_of_limits", "toe_high", part] == high
    assert found["refused", "head_dark", "rear_left"] == sum(
        w.outcome is WheelOutcome.REFUSED for w in wheels
    )
    assert found["aborted", "aborted", ""] == sum(r.outcome is CycleOutcome.ABORTED for r in RECORDS)
    counts = [r.count for r in reasons(reader)]
    assert counts == sorted(counts, reverse=True)


@pytest.mark.parametrize("name", PERIODS)
def test_a_series_holds_every_value_with_what_explains_it(reader: ResultReader, name: str) -> None:
    where = PERIODS[name]
    expected = [
        (record, wheel)
        for record, wheel in wheels_of(Filter(**{**vars(where), "wheels": ()}))
        if wheel.wheel == "front_left" and wheel.outcome is WheelOutcome.MEASURED
    ]
    found = value_series(reader, TOE, where)
    assert found.value.tolist() == [wheel.toe for _, wheel in expected]
    assert found.time.astype("datetime64[us]").tolist() == [
        record.received_utc.replace(tzinfo=None) for record, _ in expected
    ]
    assert [UUID(text) for text in found.cycle] == [record.uuid for record, _ in expected]
    assert found.vin.tolist() == [record.vehicle.vin for record, _ in expected]
    assert found.high.tolist() == [wheel.toe_high for _, wheel in expected]
    assert found.verdict.tolist() == [wheel.verdict.value for _, wheel in expected]
    assert set(found.calibration_id.tolist()) <= {CALIBRATION.id}
    newest = value_series(reader, TOE, where, newest=3)
    assert newest.value.tolist() == found.value.tolist()[-3:]


def test_vehicle_angles_without_limits_have_none(reader: ResultReader) -> None:
    found = value_series(reader, Characteristic("vehicle", Quantity.THRUST_ANGLE))
    assert len(found) == len(RECORDS)
    assert np.isnan(found.low).all()
    assert np.isfinite(found.u).all()
    assert set(found.calibration_id.tolist()) == {None}


def test_whole_records_come_in_portions(reader: ResultReader) -> None:
    where = Filter(stations=("EOL-1",), vehicle_types=("compact",))
    found = [stored.record for stored in cycle_records(reader, where, portion=50)]
    assert found == chosen(where)


def test_the_sums_agree_with_the_results(url: str, reader: ResultReader) -> None:
    with reader.transaction() as connection:
        assert check_sums(connection).differences == ()


@pytest.mark.parametrize(
    "bad",
    [
        lambda: Filter(from_utc=datetime(2026, 1, 1)),
        lambda: Filter(from_utc=NOON, until_utc=NOON),
        lambda: Filter(vin="\0"),
        lambda: Filter(stations=("\ud800",)),
        lambda: Filter(shift=Shift("early", time(6), time(14))),
        lambda: Shift("early", time(6), time(6)),
        lambda: Shift("early", time(6), time(14), "Europe/Atlantis"),
        lambda: Characteristic.parse("toe"),
        lambda: Characteristic.parse("front_left.length"),
    ],
)
def test_a_question_that_makes_no_sense_is_refused(bad: Callable[[], object]) -> None:
    with pytest.raises(InputError):
        bad()


def test_a_night_shift_ends_on_the_next_day_and_follows_the_clock_change() -> None:
    night = Shift("night", time(22), time(6), "Europe/Berlin")
    start, end = datetime(2026, 10, 24, tzinfo=UTC), datetime(2026, 10, 26, tzinfo=UTC)
    found = [(a.isoformat()[5:16], b.isoformat()[5:16]) for a, b in night.within(start, end)]
    # Summer time ends in the second night, which lasts nine hours.
    assert found == [
        ("10-24T00:00", "10-24T04:00"),
        ("10-24T20:00", "10-25T05:00"),
        ("10-25T21:00", "10-26T00:00"),
    ]


def test_stations_and_types_of_the_plant_are_what_the_records_say() -> None:
    assert {record.station for record in RECORDS} == set(STATIONS)
    assert {record.vehicle.vehicle_type for record in RECORDS if record.vehicle} == set(TYPES)


def test_numbers_with_gaps_are_summed_to_the_last(postgres_url: str) -> None:
    with ResultStore(postgres_url, create=True) as store:
        store.record_calibration(CALIBRATION)
        store.write_cycle(RECORDS[0])
        engine = make_engine(parse_url(postgres_url), timeout_s=5.0)
        with engine.begin() as connection:
            connection.execute(text("SELECT setval('cycles_id_seq', 3000000)"))
        store.write_cycle(RECORDS[1])
        assert bring_up_to_date(engine) == 2
        engine.dispose()
    with ResultReader(postgres_url) as reader, reader.transaction() as connection:
        assert check_sums(connection).cycles == 2
        assert check_sums(connection).differences == ()


def test_a_writer_that_takes_its_time_delays_the_sums_and_nothing_else(postgres_url: str) -> None:
    with ResultStore(postgres_url, create=True) as store:
        store.record_calibration(CALIBRATION)
        engine = make_engine(parse_url(postgres_url), timeout_s=5.0)
        # Of another station: those of one station come after each other, as in its chain of hashes.
        other = next(record for record in RECORDS if record.station != RECORDS[0].station)
        with engine.begin() as slow:
            # Has its number already, and is not committed when the next one is.
            write_cycles(slow, RECORDS[:1], NOON)
            store.write_cycle(other)
            assert update_sums(engine) == 0
        assert update_sums(engine) == 2
        assert update_sums(engine) == 0
        engine.dispose()
