"""A seeded plant for the benchmark of the database, written past the product's store: that takes minutes.

Every station measures a vehicle a minute in two shifts of eight hours, five days a week, until `END`. Values
scatter about nominal angles of three vehicle types, drift slowly, and are judged as the product judges.
"""

from __future__ import annotations

import io
import math
import os
import sqlite3
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any
from uuid import UUID, uuid4

import numpy as np
import psycopg
from numpy.typing import NDArray
from sqlalchemy import text

from db.connection import make_engine, migrate, parse_url
from db.records import (
    AxleRecord,
    CalibrationCheckRecord,
    CalibrationRecord,
    CheckKind,
    CheckOutcome,
    CycleOutcome,
    CycleRecord,
    InstallationRecord,
    StationRecord,
    VehicleAnglesRecord,
    VehicleRecord,
    Verdict,
    WheelOutcome,
    WheelRecord,
)
from db.schema.partitions import ensure_partitions
from db.store import ResultStore
from db.sums import bring_up_to_date

STATIONS = tuple(f"station_{number:02d}" for number in range(1, 21))
PLANTS = ("Plant North", "Plant South")
TYPES = ("compact", "van", "estate")
WHEELS = ("front_left", "front_right", "rear_left", "rear_right")
# Two shifts, 06:00 to 22:00 UTC; the last one ends here.
END = datetime(2026, 11, 20, 22, tzinfo=UTC)
SEED = 1
# Every rig is checked with the master wheel once a day, at most so long back.
CHECKED_DAYS = 60
MINUTES_A_DAY = 960
_DEG = math.radians(1.0)
_U = 1.2e-5


@dataclass(frozen=True)
class Chunk:
    """Rows of some cycles: names of columns and columns of equal length, for each table."""

    tables: dict[str, tuple[tuple[str, ...], list[list[Any]]]]


def calibration_id(station: str, wheel: str) -> str:
    """The calibration that this rig uses."""
    return f"cal-{station}-{wheel}"


def received(minutes: NDArray[np.int64], last: int) -> NDArray[np.int64]:
    """Seconds since 1970 of production minutes, of which `last` is the one before `END`."""
    back = last - minutes
    days, rest = np.divmod(back, MINUTES_A_DAY)
    # END is on a Friday: five days of work, two of rest.
    weeks, day = np.divmod(days, 5)
    seconds: NDArray[np.int64] = int(END.timestamp()) - (weeks * 7 + day) * 86_400 - (rest + 1) * 60
    return seconds


def chunks(wheel_results: int, seed: int = 1, cycles_each: int = 20_000) -> Iterator[Chunk]:
    """The results of the plant, oldest first, `wheel_results` of them."""
    rng = np.random.default_rng(seed)
    total = wheel_results // len(WHEELS)
    for first in range(0, total, cycles_each):
        yield _chunk(rng, first, min(cycles_each, total - first), (total - 1) // len(STATIONS))


def _chunk(rng: np.random.Generator, first: int, n: int, last_minute: int) -> Chunk:
    index = np.arange(first, first + n)
    minute, station = np.divmod(index, len(STATIONS))
    seconds = received(minute, last_minute) + rng.integers(0, 50, n)
    times = [
        datetime.fromtimestamp(int(s), UTC).replace(microsecond=int(us)).strftime("%Y-%m-%d %H:%M:%S.%f")
        for s, us in zip(seconds, rng.integers(0, 10**6, n), strict=True)
    ]
    kind = rng.integers(0, len(TYPES), n)
    names = [STATIONS[k] for k in station]
    ids = (index + 1).tolist()
    refused = rng.uniform(size=n) < 0.008
    verdicts = []
    wheels: dict[str, list[Any]] = {}
    for number, wheel in enumerate(WHEELS):
        camber_middle = np.array([-0.5, -0.3, -0.6])[kind] * _DEG - (0.8 * _DEG if number >= 2 else 0.0)
        toe_middle = np.array([0.10, 0.08, 0.12])[kind] * _DEG
        drift = 0.01 * _DEG * np.sin(minute / 20_000.0 + station + number)
        camber = camber_middle + drift + rng.normal(0.0, 0.16 * _DEG, n)
        toe = toe_middle + drift / 2 + rng.normal(0.0, 0.035 * _DEG, n)
        limits = {"camber": (camber_middle - 0.5 * _DEG, camber_middle + 0.5 * _DEG),
                  "toe": (toe_middle - 0.1 * _DEG, toe_middle + 0.1 * _DEG)}  # fmt: skip
        inside = np.ones(n, bool)
        for value, (low, high) in ((camber, limits["camber"]), (toe, limits["toe"])):
            inside &= (value >= low + 2 * _U) & (value <= high - 2 * _U)
        lost = refused & (index % 4 == number)
        verdicts.append((inside, lost))
        verdict = np.where(lost, "none", np.where(inside, "ok", "nok")).tolist()
        ok = ~lost

        def some(values: NDArray[np.float64], ok: NDArray[np.bool_] = ok) -> list[Any]:
            return [v if k else None for v, k in zip(values.tolist(), ok.tolist(), strict=True)]

        calibrations = [calibration_id(name, wheel) for name in STATIONS]
        columns: dict[str, list[Any]] = {
            "cycle_id": ids,
            "wheel": [wheel] * n,
            "outcome": np.where(lost, "refused", "measured").tolist(),
            "verdict": verdict,
            "measured_utc": times,
            "device_time_s": (seconds % 100_000).astype(float).tolist(),
            "camber": some(camber),
            "toe": some(toe),
            "camber_u": some(np.full(n, _U)),
            "toe_u": some(np.full(n, _U)),
            "coverage_factor": [2.0] * n,
            "method": ["tyre_plane/revolution" if k else None for k in ok],
            "calibration_id": [calibrations[k] for k in station],
            "reason_code": ["head_dark" if k else None for k in lost],
            "reason_text": ["head 2 sees no light: clean its window" if k else None for k in lost],
            "camber_low": limits["camber"][0].tolist(),
            "camber_high": limits["camber"][1].tolist(),
            "toe_low": limits["toe"][0].tolist(),
            "toe_high": limits["toe"][1].tolist(),
            "guard_band": [True] * n,
            "points_used": rng.integers(3000, 5000, n).tolist(),
            "residual_rms_mm": np.round(rng.uniform(0.015, 0.03, n), 4).tolist(),
            "duration_s": np.round(rng.uniform(0.15, 0.25, n), 3).tolist(),
        }
        for name, column in columns.items():
            wheels.setdefault(name, []).append(column)
    # The wheels of a cycle lie side by side, as the product writes them.
    together = [[value for row in zip(*parts, strict=True) for value in row] for parts in wheels.values()]
    good = np.logical_and.reduce([inside for inside, _ in verdicts])
    outcome = np.where(refused, "fault", np.where(good, "ok", "nok")).tolist()
    uuids = rng.bytes(16 * n)
    cycles: dict[str, list[Any]] = {
        "id": ids,
        "uuid": [UUID(bytes=uuids[16 * k : 16 * k + 16]).hex for k in range(n)],
        "station": names,
        "vehicle_id": ids,
        "trigger_sequence": minute.tolist(),
        "received_utc": times,
        "received_monotonic_s": (minute * 60.0).tolist(),
        "measured_utc": times,
        "measured_monotonic_s": (minute * 60.0 + 2.0).tolist(),
        "stored_utc": times,
        "software_version": ["0.1.0"] * n,
        "config_hash": ["benchmark"] * n,
        "outcome": outcome,
        "reason_code": ["head_dark" if k else None for k in refused],
        "reason_text": ["head 2 sees no light: clean its window" if k else None for k in refused],
    }
    vehicles: dict[str, list[Any]] = {
        "id": ids,
        "vin": [f"TWBENCH{k:010d}" for k in ids],
        "vehicle_type": [TYPES[k] for k in kind],
    }
    tables = {
        name: (tuple(columns), list(columns.values()))
        for name, columns in (("vehicles", vehicles), ("cycles", cycles))
    }
    tables["wheel_results"] = (tuple(wheels), together)
    return Chunk(tables)


def load_postgresql(url: str, parts: Iterator[Chunk]) -> None:
    """Write chunks with COPY; foreign keys are not checked meanwhile."""
    engine = make_engine(parse_url(url), timeout_s=60.0)
    with psycopg.connect(url, autocommit=True) as connection:
        connection.execute("SET session_replication_role = replica")
        connection.execute("SET synchronous_commit = off")
        for part in parts:
            # As stations do; before the rows that need them.
            with engine.begin() as maintenance:
                ensure_partitions(maintenance)
            for table, (names, columns) in part.tables.items():
                statement = f"COPY {table} ({', '.join(names)}) FROM STDIN"
                with connection.cursor() as cursor, cursor.copy(statement.encode()) as copy:
                    copy.write(_copy_text(columns))
        for table in ("vehicles", "cycles"):
            newest = f"(SELECT max(id) FROM {table})"
            connection.execute(f"SELECT setval(pg_get_serial_sequence('{table}', 'id'), {newest})".encode())
    engine.dispose()


def _copy_text(columns: Sequence[list[Any]]) -> bytes:
    texts = [["\\N" if value is None else str(value) for value in column] for column in columns]
    out = io.StringIO()
    out.writelines("\t".join(row) + "\n" for row in zip(*texts, strict=True))
    return out.getvalue().encode()


def load_sqlite(path: str, parts: Iterator[Chunk]) -> None:
    """Write chunks with executemany; foreign keys are not checked meanwhile."""
    connection = sqlite3.connect(path, isolation_level=None)
    connection.execute("PRAGMA synchronous=OFF")
    connection.execute("PRAGMA cache_size=-400000")
    for part in parts:
        connection.execute("BEGIN")
        for table, (names, columns) in part.tables.items():
            marks = ", ".join("?" * len(names))
            statement = f"INSERT INTO {table} ({', '.join(names)}) VALUES ({marks})"
            connection.executemany(statement, zip(*columns, strict=True))
        connection.execute("COMMIT")
    connection.close()


def new_cycle(station: str, number: int) -> CycleRecord:
    """A good vehicle at the end of the line, now."""
    received = END + timedelta(minutes=30, seconds=number % 1700)
    wheels = tuple(
        WheelRecord(
            wheel,
            WheelOutcome.MEASURED,
            Verdict.OK,
            received,
            camber=-0.009,
            toe=0.0017,
            camber_u=1.2e-5,
            toe_u=1.2e-5,
            coverage_factor=2.0,
            method="tyre_plane/revolution",
            calibration_id=calibration_id(station, wheel),
            camber_low=-0.02,
            camber_high=0.0,
            toe_low=0.0,
            toe_high=0.0035,
            guard_band=True,
            points_used=4000,
            residual_rms_mm=0.02,
            duration_s=0.2,
        )
        for wheel in WHEELS
    )
    axles = tuple(
        AxleRecord(
            axle, 0.0034, 1.7e-5, 0.0, 1.7e-5, Verdict.OK,
            total_toe_low=0.0, total_toe_high=0.007, guard_band=True, coverage_factor=2.0,
        )
        for axle in ("front", "rear")
    )  # fmt: skip
    angles = VehicleAnglesRecord(1e-4, 8e-6, "left_positive", 0.0018, 0.0016)
    vin = f"TWNEW{os.getpid():07d}{number:08d}"
    return CycleRecord(
        uuid4(), station, number, received, CycleOutcome.OK, "0.1.0", "benchmark",
        VehicleRecord(vin, TYPES[number % 3]), 1.0, received, 2.0, None, None,
        wheels, axles, angles,
    )  # fmt: skip


def prepare(url: str, wheel_results: int) -> dict[str, float]:
    """Build a database with the plant in it; return seconds of each step."""
    migrate(url)
    minutes = wheel_results // (len(WHEELS) * len(STATIONS))
    first = int(received(np.zeros(1, np.int64), minutes)[0])
    checked_days = min(CHECKED_DAYS, 2 + (int(END.timestamp()) - first) // 86_400)
    with ResultStore(url) as store:
        for number, name in enumerate(STATIONS):
            uses = []
            for rig, wheel in enumerate(WHEELS):
                used = calibration_id(name, wheel)
                store.record_calibration(CalibrationRecord(used, wheel, END - timedelta(days=400), {}))
                uses.append(InstallationRecord(name, wheel, used, END - timedelta(days=400)))
                for days in range(checked_days):
                    # Every day, one rig after the other.
                    checked = END - timedelta(days=days, hours=26, minutes=-2 * rig)
                    store.record_check(
                        CalibrationCheckRecord(
                            checked, used, CheckKind.MASTER_WHEEL, CheckOutcome.WITHIN, "ok", {"d": 0.0}
                        )
                    )
            plant = PLANTS[number % len(PLANTS)]
            described = StationRecord(
                name, plant, name, END - timedelta(days=400), "0.1.0", "benchmark", {"id": name}, WHEELS
            )
            store.describe_station(described, (), uses)
    started = time.monotonic()
    parts = chunks(wheel_results, SEED)
    if url.startswith("sqlite"):
        load_sqlite(url.removeprefix("sqlite:///"), parts)
    else:
        load_postgresql(url, parts)
    loaded = time.monotonic()
    engine = make_engine(parse_url(url), timeout_s=3600.0)
    bring_up_to_date(engine)
    summed = time.monotonic()
    # The newest results of every station are not in the sums yet, as in a plant.
    with ResultStore(url) as store:
        for number, name in enumerate(STATIONS):
            store.write_cycle(new_cycle(name, number))
    with engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
        connection.execute(text("ANALYZE" if url.startswith("sqlite") else "VACUUM ANALYZE"))
    engine.dispose()
    return {"load_s": loaded - started, "sums_s": summed - loaded}
