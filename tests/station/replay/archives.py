"""Archives as a station writes them: rendered once, with noise of their own for each wheel."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from alignment.measure import measure_wheel
from alignment.values import Image, MeasureSettings, RigCalibration
from db.records import CycleRecord, ZeroRecord
from db.store import ResultStore
from db.upkeep.retention import Policy
from sensors.camera import Frame
from sensors.formats.calibration import read_calibration_file, write_calibration
from sensors.shot import HeadFrames, WheelShot
from station.configuration.vehicle_types import VehicleType
from station.cycle.judging.evaluation import evaluate
from station.cycle.ports import Identity
from station.cycle.recording.record import cycle_record
from station.cycle.under_way import CycleUnderWay
from station.cycle.wheels.positions import CalibrationInForce, MeasureFunction, WheelPosition, WheelResult
from station.cycle.words.cycle import Trigger
from station.store.archive import ImageArchive
from station.store.keeping import Keeping
from tests.rendered import images, known_rig
from tests.station.bench import AXLE

WHEEL = "front_left"
MADE = datetime(2026, 3, 1, 8, tzinfo=UTC)
DAY = datetime(2026, 3, 2, 12, tzinfo=UTC)
WIDE = Policy(10**12, 3650.0, 3650.0)
KIND = VehicleType.model_validate(
    {"number": 1, "name": "Car", "tyre_width_mm": 205.0, "axles": {"front": AXLE, "rear": AXLE}}
)
IDENTITY = Identity("EOL-1", "0.1.0", "c0ffee")


def calibration_of(name: str = "first", **changes: Any) -> RigCalibration:
    return replace(known_rig(), rig=WHEEL, id=name, **changes)


def in_force(calibration: RigCalibration, folder: Path) -> CalibrationInForce:
    """As the station reads it from a file."""
    path = folder / f"{calibration.id}.json"
    write_calibration(path, calibration, method="test", created_utc=MADE)
    file = read_calibration_file(path)
    document = file.model_dump(mode="json", by_alias=True)
    return CalibrationInForce(file.calibration(), file.created_utc, 36_500.0, document)


class NoisyRig:
    """Gives the rendered wheel with other noise in every shot."""

    name = WHEEL

    def __init__(self, seed: int, spoil: Callable[[Image], Image] = lambda image: image) -> None:
        self._rng, self._taken, self._spoil = np.random.default_rng(seed), 0, spoil

    def connect(self) -> None: ...

    def close(self) -> None: ...

    def arm(self) -> None:
        self._taken = 0

    def shoot(self, timeout_s: float) -> WheelShot:
        self._taken += 1
        heads = []
        for number, pair in enumerate(images(), 1):
            frames = [
                Frame(f"{WHEEL}/head_{number}/{side}", self._noisy(image), self._taken, 1.0, 2.0, 5.0)
                for side, image in (("left", pair.left), ("right", pair.right))
            ]
            heads.append(HeadFrames(f"head_{number}", *frames))
        names = [head.name for head in known_rig().heads]
        named = [replace(head, name=name) for head, name in zip(heads, names, strict=True)]
        return WheelShot(WHEEL, DAY, tuple(named))

    def _noisy(self, image: Image) -> Image:
        noise = self._rng.normal(0.0, 1.0, image.shape).astype(np.float32)
        return self._spoil(np.clip(image + noise, 0, 255).astype(np.uint8))


def dark(image: Image) -> Image:
    return np.zeros_like(image)


class Archived:
    """A folder of images with the database beside it, filled through the station's own parts."""

    def __init__(self, folder: Path, calibration: RigCalibration | None = None) -> None:
        self.folder = folder
        self.images = folder / "images"
        self.url = f"sqlite:///{folder / 'results.db'}"
        self.in_force = in_force(calibration or calibration_of(), folder)
        self.zeros: Sequence[ZeroRecord] = ()
        self.count = 0
        self.measure: MeasureFunction = measure_wheel
        with ResultStore(self.url, create=True) as store:
            store.record_calibration(self.in_force.record())

    def position(self, rig: Any, settings: MeasureSettings | None = None) -> WheelPosition:
        return WheelPosition(rig, self.in_force, self.measure, settings or MeasureSettings(), 10.0)

    def add(self, rig: Any, vin: str = "WVWZZZ1KZAW000001", **options: Any) -> Path:
        """Measure one wheel of one vehicle and archive it; its folder."""
        return self.put(self.position(rig, **options).run(self.zeros), vin)

    def put(self, result: WheelResult, vin: str = "WVWZZZ1KZAW000001") -> Path:
        self.count += 1
        received = DAY + timedelta(minutes=self.count)
        trigger = Trigger(self.count, (WHEEL,), KIND.number, vin, 0.0)
        cycle = CycleUnderWay(trigger, received, [self.position(NoisyRig(0))], KIND)
        cycle.take({WHEEL: result})
        cycle.measured_s = 1.0
        record, _ = cycle_record(IDENTITY, cycle, evaluate(KIND, cycle.wheels, 2.0))
        return self.store(record, result)

    def store(self, record: CycleRecord, result: WheelResult) -> Path:
        lost: list[str] = []
        with ResultStore(self.url) as store:
            store.write_cycle(record)
            with ImageArchive(
                store, self.images, WIDE, Keeping("all"), lambda text, _: lost.append(text), lambda: DAY,
                closing_s=120.0, kinds={KIND.name: KIND},
            ) as archive:  # fmt: skip
                archive.offer(record, [result])
        assert lost == []
        return self.images / f"{record.received_utc:%Y-%m-%d}" / f"{record.uuid}-{WHEEL}"
