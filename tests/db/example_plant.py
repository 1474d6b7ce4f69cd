"""A small plant, seeded: two stations, two vehicle types, all outcomes, written the way stations write."""

from __future__ import annotations

import math
from dataclasses import replace
from datetime import timedelta
from uuid import UUID

import numpy as np

from db.records import CycleOutcome, CycleRecord, VehicleRecord, Verdict
from tests.db.example_records import ANGLES, NOON, WHEELS, axle, cycle, refused_wheel, wheel

STATIONS = ("EOL-1", "EOL-2")
TYPES = ("compact", "van")


def plant(n: int, seed: int = 1, days: float = 4.0) -> list[CycleRecord]:
    """`n` cycles in the order of their times, spread over some days from noon on."""
    rng = np.random.default_rng(seed)
    moments = np.sort(rng.uniform(0.0, days * 86_400.0, n))
    return [_cycle(rng, number, float(moment)) for number, moment in enumerate(moments)]


def _cycle(rng: np.random.Generator, number: int, moment: float) -> CycleRecord:
    received = NOON + timedelta(seconds=moment)
    kind = TYPES[int(rng.integers(2))]
    wheels = []
    for name in WHEELS:
        toe = math.radians(0.1) + float(rng.normal(0.0, math.radians(0.06)))
        good = abs(toe) <= math.radians(0.2) - 2e-5
        camber = -math.radians(0.5) + float(rng.normal(0.0, math.radians(0.05)))
        high = math.radians(0.0 if kind == "compact" else 0.1)
        wheels.append(
            wheel(name, toe=toe, camber=camber, camber_high=high, verdict=Verdict.OK if good else Verdict.NOK)
        )
    chance = float(rng.uniform())
    outcome = CycleOutcome.OK if all(w.verdict is Verdict.OK for w in wheels) else CycleOutcome.NOK
    reason = None
    if chance < 0.06:
        wheels[2] = refused_wheel(WHEELS[2], measured_utc=received)
        outcome, reason = CycleOutcome.FAULT, "head_dark"
    elif chance < 0.1:
        wheels, outcome, reason = wheels[:1], CycleOutcome.ABORTED, "aborted"
    record = cycle(
        UUID(bytes=rng.bytes(16), version=4),
        station=STATIONS[int(rng.integers(2))],
        trigger_sequence=number,
        received_utc=received,
        measured_utc=received + timedelta(seconds=2),
        vehicle=VehicleRecord(f"TRUEWHEEL{number:08d}", kind),
        outcome=outcome,
        reason_code=reason,
        reason_text=reason and "see the event",
        wheels=tuple(wheels),
        axles=(axle("front", total_toe=wheels[0].toe + 1e-4),),
        vehicle_angles=replace(ANGLES, thrust_angle=float(rng.normal(0.0, 1e-4))),
    )
    return record
