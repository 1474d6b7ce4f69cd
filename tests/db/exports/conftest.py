"""Cycles to export: two types, a refusal, a fault, a repeated VIN, names that are not ASCII."""

from __future__ import annotations

import math
from datetime import timedelta
from uuid import UUID

import pytest

from db.exports.rows import AngleRow, angle_rows
from db.records import CycleOutcome, CycleRecord, EventRecord, Severity, StoredCycle, VehicleRecord, Verdict
from tests.db.example_records import NOON, cycle, refused_wheel, wheel


def stored(record: CycleRecord) -> StoredCycle:
    return StoredCycle(record, record.received_utc + timedelta(seconds=1))


@pytest.fixture
def cycles() -> list[StoredCycle]:
    records = []
    for number in range(6):
        wheels = tuple(
            wheel(name, camber=math.radians(-0.5 + 0.01 * number), toe=math.radians(0.1 - 0.003 * number))
            for name in ("front_left", "front_right")
        )
        records.append(
            cycle(
                UUID(int=number + 1),
                station="Straße 7",
                vehicle=VehicleRecord(f"WTEST{number % 5:012d}", "Kompakt ü"),
                received_utc=NOON + timedelta(minutes=number),
                measured_utc=NOON + timedelta(minutes=number, seconds=5),
                wheels=wheels,
            )
        )
    records.append(
        cycle(
            UUID(int=100),
            station="Straße 7",
            vehicle=VehicleRecord("WTEST000000000099", "Kompakt ü"),
            received_utc=NOON + timedelta(minutes=10),
            measured_utc=NOON + timedelta(minutes=10),
            outcome=CycleOutcome.FAULT,
            reason_code="refused",
            reason_text="a wheel was refused",
            wheels=(
                wheel("front_left", verdict=Verdict.NONE, calibration_id="cal-neu"),
                refused_wheel("front_right"),
            ),
            axles=(),
            vehicle_angles=None,
        )
    )
    narrower = wheel("front_left", toe_high=math.radians(0.15))
    records.append(
        cycle(
            UUID(int=101),
            station="Straße 7",
            vehicle=VehicleRecord("WTEST000000000101", "Kompakt ü"),
            received_utc=NOON + timedelta(minutes=11),
            measured_utc=NOON + timedelta(minutes=11),
            wheels=(narrower,),
            axles=(),
            vehicle_angles=None,
        )
    )
    return [stored(record) for record in records]


@pytest.fixture
def rows(cycles: list[StoredCycle]) -> list[AngleRow]:
    return [row for each in cycles for row in angle_rows(each)]


@pytest.fixture
def events() -> list[EventRecord]:
    return [
        EventRecord(
            NOON + timedelta(minutes=1, seconds=30), "Straße 7", Severity.WARNING, "climate", "warm", "38 °C"
        ),
        EventRecord(
            NOON + timedelta(minutes=1, seconds=31), "Straße 7", Severity.INFO, "line", "start", "started"
        ),
        EventRecord(NOON, "elsewhere", Severity.ERROR, "x", "y", "z"),
    ]
