"""Asking for steering wheel and steering axes: values, moments and reasons, with sums and without."""

from __future__ import annotations

from datetime import timedelta
from pathlib import Path
from uuid import UUID

import numpy as np

from db.connection import make_engine, parse_url
from db.queries import (
    Characteristic,
    Filter,
    Quantity,
    ResultReader,
    characteristic_moments,
    reasons,
    value_series,
)
from db.records import CycleOutcome, Verdict
from db.store import ResultStore
from db.sums import bring_up_to_date
from db.upkeep.check import check_database
from tests.db.example_records import CALIBRATION, NOON, cycle, steering, steering_axis

CASTER = Characteristic("front_left", Quantity.CASTER)
OFFSET = Characteristic("vehicle", Quantity.STEERING_WHEEL_OFFSET)
CASTERS = [float(value) for value in np.linspace(0.08, 0.13, 11)]
RECORDS = [
    cycle(
        UUID(int=number + 1),
        received_utc=NOON + timedelta(minutes=7 * number),
        measured_utc=NOON + timedelta(minutes=7 * number + 1),
        outcome=CycleOutcome.OK if 0.0876 < caster < 0.1249 else CycleOutcome.NOK,
        steering=steering(steering_wheel_offset=0.001 * number),
        steering_axes=(
            steering_axis(caster=caster, verdict=Verdict.OK if 0.0876 < caster < 0.1249 else Verdict.NOK),
        ),
    )
    for number, caster in enumerate(CASTERS)
]


def test_casters_and_offsets_are_characteristics_like_all_others(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'r.db'}"
    with ResultStore(url, create=True) as store:
        store.record_calibration(CALIBRATION)
        for record in RECORDS:
            store.write_cycle(record)
    for summed in (False, True):
        if summed:
            engine = make_engine(parse_url(url), timeout_s=5.0)
            bring_up_to_date(engine)
            engine.dispose()
        with ResultReader(url) as reader:
            assert value_series(reader, CASTER).value.tolist() == CASTERS
            assert set(value_series(reader, CASTER).low) == {0.0875}
            (moments,) = characteristic_moments(reader, characteristics=(CASTER,))
            low, high = sum(c < 0.0876 for c in CASTERS), sum(c > 0.1249 for c in CASTERS)
            assert (moments.n, moments.n_low, moments.n_high) == (11, low, high)
            told = {(one.part, one.code): one.count for one in reasons(reader)}
            assert told["front_left", "caster_low"] == low
            (offsets,) = characteristic_moments(reader, characteristics=(OFFSET,))
            assert offsets.n == 11
            # Asked for one wheel, its axis is among what is told of it.
            of_wheel = characteristic_moments(reader, Filter(wheels=("front_left",)))
            assert {Quantity.CASTER, Quantity.TOE} <= {each.characteristic.quantity for each in of_wheel}
    assert check_database(url, days=None).findings == ()
