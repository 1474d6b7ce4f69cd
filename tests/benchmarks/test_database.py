"""The benchmark of the database on a small plant: every question is answered, every writer writes."""

from __future__ import annotations

import json

import numpy as np
import pytest

from benchmarks import database
from benchmarks.database_plant import END, MINUTES_A_DAY, STATIONS, chunks, received


@pytest.mark.slow
def test_a_small_plant_answers_all_questions_and_takes_all_cycles(capsys: pytest.CaptureFixture[str]) -> None:
    status = database.main(
        ["--wheel-results", "800", "--seconds", "1.2", "--times", "1", "--engine", "sqlite", "--json"]
    )
    found = json.loads(capsys.readouterr().out)
    # A busy machine may miss a goal, which is no fault of the program.
    assert status in (0, 1)
    assert found["sqlite"]["sizes"]["wheel_results"]["rows"] == 800 + 4 * len(STATIONS)
    assert found["figures"]["sqlite cycles_per_s, 1 per commit"] > 0
    assert len([name for name in found["figures"] if name.endswith("p95_ms")]) == 8
    assert any(
        "ix_cycles_station_received_utc" in line for line in found["sqlite"]["plans"]["chart of a week"]
    )


def test_the_plant_works_two_shifts_on_five_days() -> None:
    minutes = np.arange(6 * MINUTES_A_DAY)
    times = received(minutes, int(minutes[-1]))
    assert np.all(np.diff(times) > 0)
    days = (times - int(END.timestamp())) // 86_400
    # Six days of work, with a weekend between.
    assert np.ptp(days) == 7
    hours = times % 86_400 / 3600
    assert hours.min() == 6.0
    assert hours.max() < 22.0


def test_the_same_seed_makes_the_same_plant() -> None:
    first, again = (next(chunks(4 * len(STATIONS), seed=3)) for _ in range(2))
    assert first.tables == again.tables
