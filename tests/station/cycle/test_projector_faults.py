"""A projector whose driver hangs or raises, in a whole cycle: bounded, told by its rig, mended by a reset."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import pytest

from db.records import CycleOutcome, WheelOutcome
from sensors.bounded import CallBounds
from sensors.projectors.guarded import GuardedProjector
from sensors.projectors.lit_rig import LitRig, RigLight
from sensors.rig import Rig, StereoHead
from station.cycle.words.cycle import ErrorCode, Reset, StationState
from tests.sensors.projectors.fakes import Lamp, ScriptedProjector
from tests.sensors.scripted import Device, Patience
from tests.station.bench import Bench, open_bench

BOUNDS = CallBounds(call_s=10.0, trigger_s=4.0)


@dataclass
class Station:
    """A bench whose front left rig has a projector that does what its lamp says."""

    bench: Bench
    lamp: Lamp
    patience: Patience
    sequence: int = 0

    def start(self) -> CycleOutcome:
        self.sequence += 1
        report = self.bench.trigger(self.sequence)
        assert report is not None, self.bench.line.refused
        return report.record.outcome

    def reset(self) -> StationState:
        self.bench.line.queue.append(Reset(self.sequence))
        self.bench.cycle.step(0.1)
        return self.bench.cycle.state


@pytest.fixture
def station() -> Iterator[Station]:
    with open_bench(retake_within_s=60.0) as bench:
        names = [f"front_left/head_{n}/{side}" for n in (1, 2, 3) for side in ("left", "right")]
        cameras = [Device(name).make() for name in names]
        heads = [StereoHead(f"head_{n}", *cameras[2 * n - 2 : 2 * n]) for n in (1, 2, 3)]
        lamp = Lamp()
        patience = Patience(lamp)
        projector = GuardedProjector(ScriptedProjector(lamp), "front_left", lamp.make, BOUNDS, patience)
        rig = LitRig(
            Rig("front_left", heads, clock=bench.clock, now=lambda: bench.today),
            projector,
            RigLight(0.5, dark=True),
            bench.clock,
        )
        bench.put_rig(rig)
        rig.connect()
        yield Station(bench, lamp, patience)
        lamp.hangs.clear()
        lamp.raises.clear()
        lamp.go_on.set()
        rig.close()
        assert lamp.is_let_go()


@pytest.mark.parametrize("what", ["light", "dark"])
def test_a_projector_that_hangs_for_good_is_a_fault_with_its_name_until_a_reset(
    station: Station, what: str
) -> None:
    """The call held the wheel's thread: the cycle timed out without a name, and every reset failed."""
    station.lamp.hangs.add(what)
    assert station.start() is CycleOutcome.FAULT
    [cycle] = station.bench.store.cycles
    told = {wheel.wheel: (wheel.outcome, wheel.reason_text) for wheel in cycle.wheels}
    outcome, text = told.pop("front_left")
    assert outcome is WheelOutcome.FAULT
    assert f"projector of front_left: its driver did not come back from {what} within 4 s" in str(text)
    assert all(outcome is not WheelOutcome.FAULT for outcome, _ in told.values())
    assert station.bench.line.status.error_code is ErrorCode.CAMERA_FAULT
    assert set(station.patience.bounds_s) == {4.0}
    assert len(station.patience.bounds_s) <= 2
    station.lamp.hangs.clear()
    assert station.reset() is StationState.IDLE
    assert station.start() is CycleOutcome.OK


@pytest.mark.parametrize("what", ["light", "dark"])
def test_a_projector_that_fails_once_costs_no_vehicle(
    station: Station, what: str, caplog: pytest.LogCaptureFixture
) -> None:
    """A lost character was a fault of the wheel; a lost frame was not."""
    station.lamp.once[what] = OSError("framing error")
    assert station.start() is CycleOutcome.OK
    again = f"done again after projector of front_left: its driver failed ({what}): OSError: framing error"
    assert again in caplog.text
    assert station.lamp.calls.count("close") == 1
