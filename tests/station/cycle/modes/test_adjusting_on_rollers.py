"""Adjusting before simulated rollers: the wheel that turns on is the one whose run-out was found."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from alignment.units import ARCMIN
from alignment.values import Refusal, WheelMeasurement
from sensors.camera import CameraSettings
from sensors.simulation import simulated_rig
from sensors.simulation.simulated_rig import Road, SimulatedRig, angles_about
from sensors.simulation.turning import Rollers
from station.cycle.words.cycle import LiveState, Mode, Outcome, Stop
from tests.sensors.samples import HEIGHT, WIDTH
from tests.sensors.samples import calibration as sample_calibration
from tests.station.cycle.test_turning_wheels import CHOICE, TURNING, TurningBench

SHOWN = 6


class RollersBench(TurningBench):
    """One wheel before simulated rollers; its planes are the truth of what each exposure saw, and noise."""

    def __init__(self) -> None:
        super().__init__(series=CHOICE, types={3: TURNING})
        known = replace(sample_calibration(rig="front_left", covariance=False), id="cal-front_left")
        self.simulated = SimulatedRig(
            known, "ccir", 3, angles_about(-0.8, 0.1, 0.05, 0.19),
            CameraSettings(exposure_ms=4.0), road=Road(rollers=Rollers()),
        )  # fmt: skip
        self.simulated.connect()
        self.put_rig(self.simulated)  # type: ignore[arg-type]
        self.truths: list[tuple[float, float]] = []
        self._rng = np.random.default_rng(8)
        self.armed = 0
        arm = self.simulated.arm

        def counted() -> None:
            self.armed += 1
            arm()

        self.simulated.arm = counted  # type: ignore[method-assign]

    def _measure(self, rig: str) -> WheelMeasurement | Refusal:
        truth = self.simulated.truth
        self.truths.append((truth.spin_camber_deg, truth.spin_toe_deg))
        camber, toe = np.radians([truth.camber_deg, truth.toe_deg]) + 0.02 * ARCMIN * self._rng.normal(size=2)
        plane = self.planes[rig][0]
        assert isinstance(plane, WheelMeasurement)
        return replace(
            plane, camber=float(camber), toe=float(toe), centre=np.array(truth.centre_mm) * [1.0, 1.0, 0.0]
        )


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[RollersBench]:
    rng = np.random.default_rng(1)

    def image(*_: Any) -> np.ndarray:
        return rng.integers(0, 255, (HEIGHT, WIDTH), dtype=np.uint8)

    monkeypatch.setattr(simulated_rig, "camera_image", image)
    # One exposure is measured after the other, so that the truth is that of its exposure.
    monkeypatch.setattr("station.cycle.wheels.series.MOST_WAITING", 1)
    bench = RollersBench()
    bench.cycle.start()
    try:
        yield bench
    finally:
        bench.cycle.close()


def test_adjusting_on_simulated_rollers_keeps_the_wheel_its_axis_and_its_run_out(bench: RollersBench) -> None:
    """Each arming put another wheel there: its run-out was none of the one shown, and it was soon lost."""

    def stop() -> None:
        shown = sum(angles.state is not LiveState.NOT_MEASURED for angles, _ in bench.line.live)
        if shown == SHOWN or len(bench.line.live) == 3 * SHOWN:
            bench.line.queue.append(Stop(1))

    bench.line.on_live = stop
    report = bench.trigger(wheels=["front_left"], vehicle_type=3, mode=Mode.ADJUST)
    assert report is not None
    assert report.told is Outcome.OK, report.record.wheels[0].reason_text
    assert bench.armed == 1
    shown = [angles for angles, _ in bench.line.live if angles.state is not LiveState.NOT_MEASURED]
    assert len(shown) >= SHOWN
    assert len(bench.line.live) <= len(shown) + 1
    for angles, (camber, toe) in zip(shown, bench.truths[16:], strict=False):
        # 2 mm of run-out are 11'; adjusted is what the operator sees, to a minute.
        assert angles.camber_deg == pytest.approx(camber, abs=1.0 / 60.0)
        assert angles.toe_deg == pytest.approx(toe, abs=1.0 / 60.0)
    axes = np.array(bench.truths)
    assert np.ptp(axes[:, 0]) <= 2.0 * 0.05 + 1e-6, "another wheel stood there"
    (wheel,) = report.record.wheels
    last = axes[-16:].mean(axis=0)
    assert wheel.camber is not None
    assert math.degrees(wheel.camber) == pytest.approx(last[0], abs=0.1 / 60.0)
    assert wheel.run_out == pytest.approx(2.0 * 300.0 * math.sin(math.radians(0.19)), abs=0.05)


def test_the_clock_of_simulated_cameras_is_that_of_the_turning_wheel(bench: RollersBench) -> None:
    """Rendering takes seconds, a turn two: by the computer's clock the wheel's rate was another each time."""
    bench.simulated.arm()
    times = [bench.simulated.shoot(1.0).frames[0].device_time_s for _ in range(5)]
    steps = np.diff(times)
    assert steps.mean() == pytest.approx(0.28, abs=0.06)
    assert steps.min() > 0.28 * 0.5
