"""Lengths, yaw and run-outs are characteristics as angles are: series, moments, Pareto, sums."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from datetime import timedelta
from uuid import UUID

import numpy as np
import pytest

from db.connection import make_engine, parse_url
from db.queries import (
    Characteristic,
    Filter,
    Quantity,
    ResultReader,
    characteristic_moments,
    known_names,
    reasons,
    value_series,
)
from db.records import (
    GEOMETRY_LIMITED,
    AngleVerdict,
    CycleOutcome,
    CycleRecord,
    VehicleRecord,
    Verdict,
    WheelKind,
)
from db.store import ResultStore
from db.sums import bring_up_to_date
from db.upkeep.check import check_database
from tests.db.example_records import CALIBRATION, NOON, WHEELS, cycle, geometry, wheel

TRACK = Characteristic("vehicle", Quantity.TRACK_FRONT)
RUN_OUT = Characteristic("front_left", Quantity.RUN_OUT)


def vehicles(n: int = 24) -> list[CycleRecord]:
    """Front tracks about 1512.5 mm, some of them out of limits; run-outs of turned wheels."""
    rng = np.random.default_rng(5)
    found = []
    for number in range(n):
        track = 1512.5 + float(rng.normal(0.0, 2.4))
        good = 1510.125 <= track <= 1514.875
        turned = wheel(
            "front_left", kind=WheelKind.SPIN_AXIS, run_out=float(rng.uniform(0.1, 1.4)), run_out_u=0.05,
            run_out_high=1.0, run_out_phase=float(rng.uniform(-3.0, 3.0)), run_out_phase_u=0.02, load_mm=0.25,
            toe_tyre_u=6e-6,
        )  # fmt: skip
        accepted = good and turned.run_out_verdict is AngleVerdict.OK
        found.append(
            cycle(
                UUID(int=number + 1),
                vehicle=VehicleRecord(f"TRUEWHEEL{number:08d}", "compact"),
                received_utc=NOON + timedelta(minutes=11 * number),
                measured_utc=NOON + timedelta(minutes=11 * number + 1),
                outcome=CycleOutcome.OK if accepted else CycleOutcome.NOK,
                wheels=(turned, *map(wheel, WHEELS[1:])),
                geometry=geometry(track_front=track, verdict=Verdict.OK if good else Verdict.NOK),
            )
        )
    nothing = dict.fromkeys(name for name in vars(found[0].geometry) if name.endswith("_u"))
    values = {name.removesuffix("_u"): None for name in nothing}
    unmeasured = replace(
        found[0].geometry,  # type: ignore[type-var]
        **(nothing | {name: None for name in values if name != "thrust_angle_tyre"}), end_points=None,
        verdict=Verdict.NONE,
    )  # fmt: skip
    return [*found, cycle(geometry=unmeasured, outcome=CycleOutcome.FAULT, reason_code="x", reason_text="y")]


RECORDS = vehicles()
TRACKS = [record.geometry.track_front for record in RECORDS[:-1] if record.geometry is not None]


@pytest.fixture(scope="module", params=["sqlite", "postgresql"])
def url(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    def filled(url: str) -> str:
        with ResultStore(url, create=True) as store:
            store.record_calibration(CALIBRATION)
            for record in RECORDS:
                store.write_cycle(record)
        return url

    if request.param == "sqlite":
        yield filled(f"sqlite:///{tmp_path_factory.mktemp('lengths') / 'r.db'}")
    else:
        with request.getfixturevalue("postgres_server").database() as found:
            yield filled(found)


def test_a_series_of_lengths_has_their_values_limits_and_verdicts(url: str) -> None:
    with ResultReader(url) as reader:
        found = value_series(reader, TRACK)
        assert found.value.tolist() == TRACKS
        assert set(found.low) == {1510.0}
        assert set(found.u) == {0.0625}
        run_outs = value_series(reader, RUN_OUT, Filter(verdict=Verdict.OK))
        assert run_outs.value.tolist() == [record.wheels[0].run_out for record in RECORDS[:-1]]
        assert np.isnan(run_outs.low).all()
        assert set(run_outs.high) == {1.0}


def test_moments_and_pareto_are_those_of_the_values_with_sums_and_without(url: str) -> None:
    missed = sum(track < 1510.125 for track in TRACKS), sum(track > 1514.875 for track in TRACKS)
    turned = sum((record.wheels[0].run_out or 0.0) > 0.9 for record in RECORDS[:-1])
    assert min(*missed, turned) > 0
    for summed in (False, True):
        if summed:
            engine = make_engine(parse_url(url), timeout_s=5.0)
            bring_up_to_date(engine)
            engine.dispose()
        with ResultReader(url) as reader:
            (moments,) = characteristic_moments(reader, characteristics=(TRACK,))
            assert (moments.n, moments.n_low, moments.n_high) == (len(TRACKS), *missed)
            assert moments.mean == pytest.approx(np.mean(TRACKS), abs=1e-9)
            assert moments.std == pytest.approx(np.std(TRACKS, ddof=1), rel=1e-9)
            told = {(one.part, one.code): one.count for one in reasons(reader)}
            assert told["vehicle", "track_front_low"] == missed[0]
            assert told["vehicle", "track_front_high"] == missed[1]
            assert told["front_left", "run_out_high"] == turned
            known = {str(each) for each in known_names(reader).characteristics}
            assert known >= {f"vehicle.{quantity}" for quantity in GEOMETRY_LIMITED} | {str(RUN_OUT)}
    assert check_database(url, days=None).findings == ()


def test_whole_records_come_back_as_they_were_stored(url: str) -> None:
    with ResultStore(url) as store:
        found = {stored.record.uuid: stored.record for stored in store.recent_cycles(99)}
    assert found == {record.uuid: record for record in RECORDS}
