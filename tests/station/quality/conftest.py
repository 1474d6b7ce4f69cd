"""A result database with a month of two stations: a drift, a new calibration, refusals, checks, events."""

from __future__ import annotations

import math
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from uuid import UUID

import numpy as np
import pytest

from db.connection import migrate
from db.records import (
    CalibrationCheckRecord,
    CalibrationRecord,
    CheckKind,
    CheckOutcome,
    CycleOutcome,
    EventRecord,
    Severity,
    VehicleRecord,
    Verdict,
)
from db.store import ResultStore
from station.cli import main
from tests.db.example_records import cycle, refused_wheel, wheel
from tests.once import folder_once

START = datetime(2026, 10, 1, 4, tzinfo=UTC)
STATIONS = ("Halle Süd", "Halle Nord")
PER_STATION = 60
HIGH_DEG = 0.2


def _calibration(station: int, rig: str, number: int) -> CalibrationRecord:
    return CalibrationRecord(
        f"cal-{station}-{rig}-{number}",
        rig,
        START + timedelta(days=15 * number - 1),
        {"schema": "calibration"},
    )


@folder_once
def folder_of_month(folder: Path) -> None:
    """With the database `results.db`."""
    write_month(f"sqlite:///{folder / 'results.db'}")


@pytest.fixture(scope="session")
def month() -> str:
    """URL of the database; tests only read it."""
    return f"sqlite:///{folder_of_month() / 'results.db'}"


def write_month(url: str) -> None:
    """The same month into any empty database."""
    migrate(url)
    rng = np.random.default_rng(17)
    rigs = ("front_left", "front_right")
    with ResultStore(url) as store:
        for station, name in enumerate(STATIONS):
            for rig in rigs:
                for number in (0, 1):
                    store.record_calibration(_calibration(station, rig, number))
                store.record_check(
                    CalibrationCheckRecord(
                        START + timedelta(days=20, hours=station), f"cal-{station}-{rig}-1",
                        CheckKind.MASTER_WHEEL, CheckOutcome.WITHIN, "master within tolerance",
                        as_found={"camber_arcmin": 0.02},
                    )
                )  # fmt: skip
            for day in range(0, 30, 3):
                store.record_event(
                    EventRecord(
                        START + timedelta(days=day, hours=1), name, Severity.INFO, "climate", "temperature",
                        "by the gate", value=20 + day / 2,
                    )
                )  # fmt: skip
        number = 0
        for index in range(PER_STATION):
            for station, name in enumerate(STATIONS):
                number += 1
                time = START + timedelta(days=index // 2, minutes=station + 20 * (index % 2))
                changed = int(time >= START + timedelta(days=15))
                # The second station reads 0.02 degrees more; toe drifts; the new calibration takes 0.01 off.
                offset = 0.02 * station + 0.0015 * index - 0.01 * changed
                wheels = []
                for side, rig in enumerate(rigs):
                    toe = 0.08 + offset + 0.005 * side + rng.normal(0, 0.02)
                    bad = toe > HIGH_DEG
                    wheels.append(
                        wheel(
                            rig, toe=math.radians(toe), toe_high=math.radians(HIGH_DEG), toe_low=0.0,
                            camber=math.radians(-0.5 + rng.normal(0, 0.05)),
                            calibration_id=f"cal-{station}-{rig}-{changed}",
                            verdict=Verdict.NOK if bad or toe < 0 else Verdict.OK,
                            measured_utc=time,
                        )
                    )  # fmt: skip
                outcome, reason = CycleOutcome.OK, None
                if any(each.verdict is Verdict.NOK for each in wheels):
                    outcome = CycleOutcome.NOK
                if index % 20 == 7:
                    wheels[1] = refused_wheel("front_right")
                    outcome, reason = CycleOutcome.FAULT, "refused"
                store.write_cycle(
                    cycle(
                        UUID(int=number), station=name,
                        vehicle=VehicleRecord(f"WMONTH{number:011d}", "Kompakt ü"),
                        received_utc=time, measured_utc=time + timedelta(seconds=3), outcome=outcome,
                        reason_code=reason, reason_text=None if reason is None else "a wheel was refused",
                        wheels=tuple(wheels), axles=(), vehicle_angles=None,
                    )
                )  # fmt: skip


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, str]]:
    """Run the command line: exit status, standard output, standard error."""

    def run_(*arguments: object) -> tuple[int, str, str]:
        with pytest.raises(SystemExit) as end:
            main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return int(end.value.code or 0), captured.out, captured.err

    return run_
