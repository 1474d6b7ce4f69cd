"""Every way in which a camera is known to fail, in a whole cycle: told by its place, bounded, mended."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import pytest

from alignment.errors import CameraConnectionError, CameraError, CameraTimeoutError
from db.records import CycleOutcome, WheelOutcome
from sensors.bounded import CallBounds
from sensors.guarded import GuardedCamera
from sensors.rig import Rig, StereoHead
from station.cycle.modes.adjusting import _REST_S
from station.cycle.words.cycle import ErrorCode, LiveState, Mode, Outcome, Reset, StationState, Stop
from tests.documents import ROOT
from tests.sensors.samples import HEIGHT, WIDTH
from tests.sensors.scripted import Device, Patience
from tests.station.bench import WHEELS, Bench, open_bench

BOUNDS = CallBounds(call_s=10.0, trigger_s=4.0, late_s=2.0)
BAD = "front_left/head_2/right"
PLACE = "wheel front left, head 2, right camera, serial 40123456"


class Station:
    """A bench whose front left rig has six guarded cameras; one of them fails."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        names = [f"front_left/head_{n}/{side}" for n in (1, 2, 3) for side in ("left", "right")]
        self.devices = {name: Device(name, serial=str(40123451 + k)) for k, name in enumerate(names)}
        self.bad = self.devices[BAD]
        self.bad.serial = "40123456"
        self.patience = Patience(*self.devices.values())
        size = (HEIGHT, WIDTH)
        self.cameras = [
            GuardedCamera(d.make(), d.make, BOUNDS, self.patience, size=size) for d in self.devices.values()
        ]
        pairs = zip(self.cameras[::2], self.cameras[1::2], strict=True)
        heads = [StereoHead(f"head_{n}", *pair) for n, pair in enumerate(pairs, 1)]
        self.rig = Rig("front_left", heads, clock=bench.clock, now=lambda: bench.today)
        bench.put_rig(self.rig)
        self.rig.connect()
        self._sequence = 0

    def start(self) -> CycleOutcome:
        """One start for all wheels; its outcome."""
        self._sequence += 1
        report = self.bench.trigger(self._sequence)
        assert report is not None, self.bench.line.refused
        return report.record.outcome

    def reset(self) -> StationState:
        self.bench.line.queue.append(Reset(self._sequence))
        self.bench.cycle.step(0.1)
        return self.bench.cycle.state

    @property
    def told(self) -> str:
        """What the last record says of the wheel."""
        wheel = next(w for w in self.bench.store.cycles[-1].wheels if w.wheel == "front_left")
        assert wheel.outcome is WheelOutcome.FAULT
        return wheel.reason_text or ""

    def mend(self) -> None:
        fresh = Device(BAD)
        names = ("plugged", "frames_left", "rows", "counter_error", "frozen", "exposure_ms")
        for name in names:
            setattr(self.bad, name, getattr(fresh, name))
        self.bad.serial = "40123456"
        self.bad.hangs.clear()
        self.bad.raises.clear()
        self.bad.once.clear()

    def close(self) -> None:
        self.mend()
        self.bad.go_on.set()
        self.rig.close()


@pytest.fixture
def station() -> Iterator[Station]:
    with open_bench(retake_within_s=60.0) as bench:
        station = Station(bench)
        yield station
        station.close()


@dataclass(frozen=True)
class Fault:
    """What is done to the camera, what the record says of it, and the longest that detection takes.

    `seen_by_reset`: a reset while it lasts leaves the station at fault.
    """

    name: str
    script: Callable[[Device], object]
    words: str
    bound_s: float = 0.0
    seen_by_reset: bool = False


def gone(device: Device, what: str) -> None:
    """The connection breaks at this call, and the camera stays away."""
    device.once[what] = CameraConnectionError(device.name, "the connection broke")
    device.plugged = what == "connect"


def hung_after_loss(device: Device, what: str) -> None:
    """The connection breaks at arming, and this call hangs when the camera is reached anew."""
    device.once["arm"] = CameraConnectionError(device.name, "the connection broke")
    device.hangs.add(what)


FAULTS = (
    Fault("unplugged", lambda d: setattr(d, "plugged", False), "no such camera", seen_by_reset=True),
    Fault("unplugged amid the shot", lambda d: gone(d, "fetch"), "no such camera", seen_by_reset=True),
    Fault("hangs while connecting", lambda d: hung_after_loss(d, "connect"), "back from connect", 10.0, True),
    Fault("hangs while arming", lambda d: d.hangs.add("arm"), "back from arm within 10 s", 20.0),
    Fault("hangs in a trigger", lambda d: d.hangs.add("trigger"), "back from trigger within 4 s", 8.0),
    Fault("hangs while fetching", lambda d: d.hangs.add("fetch"), "back from fetch within 3 s", 6.0),
    Fault("driver raises", lambda d: d.raises.update(trigger=ValueError("0xE1018006")), "0xE1018006"),
    Fault("stops delivering", lambda d: setattr(d, "frames_left", 0), "expected a frame of trigger 1 within"),
    Fault("incomplete image", lambda d: setattr(d, "rows", 12), "an incomplete image"),
    Fault("wrong counter", lambda d: setattr(d, "counter_error", 3), "out of step"),
    Fault(
        "another camera", lambda d: setattr(d, "serial", "77"), "expected serial number 40123456, found 77"
    ),
    Fault("changed setting", lambda d: setattr(d, "exposure_ms", 9.0), "its settings changed"),
    Fault("frozen image", lambda d: setattr(d, "frozen", True), "frozen: expected a new image"),
)


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name.replace(" ", "-"))
def test_fault_is_told_by_its_place_within_its_bound_and_mended_without_restart(
    station: Station, fault: Fault
) -> None:
    assert station.start() is CycleOutcome.OK
    fault.script(station.bad)
    station.patience.bounds_s.clear()
    assert station.start() is CycleOutcome.FAULT
    assert fault.words in station.told
    assert f"camera {BAD} ({PLACE})" in station.told
    assert sum(station.patience.bounds_s) <= fault.bound_s
    outcomes = station.bench.line.outcomes
    assert outcomes == dict.fromkeys(WHEELS, Outcome.OK) | {"front_left": Outcome.FAULT}
    assert station.bench.line.status.error_code is ErrorCode.CAMERA_FAULT
    assert station.bench.line.status.wheel == "front_left"
    assert station.reset() is (StationState.FAULT if fault.seen_by_reset else StationState.IDLE)
    if not fault.seen_by_reset and not fault.bound_s:
        assert station.start() is CycleOutcome.FAULT, "a reset alone mends nothing"
        assert fault.words in station.told
    station.mend()
    assert station.reset() is StationState.IDLE
    assert station.start() is CycleOutcome.OK


def test_driver_that_hangs_while_closing_costs_its_bound_and_nothing_else(station: Station) -> None:
    assert station.start() is CycleOutcome.OK
    hung_after_loss(station.bad, "close")
    assert station.start() is CycleOutcome.OK, "another driver object reaches the camera"
    assert station.patience.bounds_s == [10.0]
    station.mend()


TRANSIENT = {
    "no frame": ("fetch", CameraTimeoutError(BAD, "late")),
    "lost": ("fetch", CameraConnectionError(BAD, "lost")),
    "refuses a trigger": ("trigger", CameraError(BAD, "busy")),
    "driver raises": ("fetch", RuntimeError("0xE1018006")),
    "not armed": ("arm", CameraError(BAD, "not ready")),
    "lost while arming": ("arm", ConnectionResetError("104")),
}


@pytest.mark.parametrize("name", TRANSIENT)
def test_one_transient_error_is_no_lost_camera(station: Station, name: str) -> None:
    """It was a camera fault, and the vehicle not measured."""
    assert station.start() is CycleOutcome.OK
    what, error = TRANSIENT[name]
    station.bad.once[what] = error
    report = station.bench.trigger(17)
    assert report is not None
    assert report.record.outcome is CycleOutcome.OK
    assert station.bench.cycle.state is StationState.IDLE
    (result,) = [w.result for w in report.evaluation.wheels if w.result.retaken]
    assert result.wheel == "front_left"
    assert PLACE in (result.retaken or "")
    guarded = next(camera for camera in station.cameras if camera.name == BAD)
    assert guarded.counts.failures == 1
    assert station.start() is CycleOutcome.OK
    assert not any(w.retaken for w in station.bench.store.cycles[-1].wheels if hasattr(w, "retaken"))


def test_second_failure_of_one_cycle_is_a_fault(station: Station) -> None:
    assert station.start() is CycleOutcome.OK
    station.bad.once["trigger"] = CameraError(BAD, "busy")
    station.bad.once["fetch"] = CameraTimeoutError(BAD, "late")
    assert station.start() is CycleOutcome.FAULT
    assert "expected a frame of trigger 1" in station.told


def test_nothing_is_taken_again_when_half_of_the_time_is_over(station: Station) -> None:
    """What failed once may take as long again, and the line waits no longer than it was promised."""
    assert station.start() is CycleOutcome.OK

    class LateError(CameraError):
        def __init__(self) -> None:
            station.bench.clock.now += 31.0
            super().__init__(BAD, "late")

    class Raising(dict[str, BaseException]):
        def get(self, what: str, default: object = None) -> BaseException | None:  # type: ignore[override]
            return LateError() if what == "trigger" else None

    station.bad.raises = Raising()
    shots = station.bad.calls.count("trigger")
    assert station.start() is CycleOutcome.FAULT
    assert station.bad.calls.count("trigger") == shots + 1


def test_recording_is_never_played_on_for_a_second_attempt() -> None:
    with open_bench() as bench:
        station = Station(bench)
        assert station.start() is CycleOutcome.OK
        station.bad.once["trigger"] = CameraError(BAD, "busy")
        assert station.start() is CycleOutcome.FAULT
        station.close()


def test_camera_that_is_plugged_in_again_while_adjusting_is_shown_again(station: Station) -> None:
    """A tie rod is turned for minutes; the wheel was dark from a loose plug to the end of it."""
    bench = station.bench
    assert station.start() is CycleOutcome.OK
    seen: list[LiveState] = []

    def look() -> None:
        angles = bench.line.live[-1][0]
        if angles.wheel != "front_left":
            return
        seen.append(angles.state)
        station.bad.plugged = len(seen) != 1 and seen.count(LiveState.NOT_MEASURED) != 1
        if seen[-2:] == [LiveState.NOT_MEASURED, LiveState.INSIDE]:
            bench.line.queue.append(Stop(5))

    bench.line.on_live = look
    report = bench.trigger(5, mode=Mode.ADJUST)
    assert report is not None
    assert report.record.outcome is CycleOutcome.OK
    assert seen[0] is LiveState.INSIDE
    assert LiveState.NOT_MEASURED in seen


def test_camera_that_stays_away_while_adjusting_is_logged_once_and_tried_at_leisure(
    station: Station, caplog: pytest.LogCaptureFixture
) -> None:
    """Its driver failed at once, so that the log and the bus had a thousand lines a second."""
    bench = station.bench
    assert station.start() is CycleOutcome.OK
    shown: list[LiveState] = []

    def look() -> None:
        angles = bench.line.live[-1][0]
        if angles.wheel != "front_left":
            return
        station.bad.plugged = False
        shown.append(angles.state)
        if shown.count(LiveState.NOT_MEASURED) == 4:
            bench.line.queue.append(Stop(5))

    bench.line.on_live = look
    begun = time.monotonic()
    assert bench.trigger(5, mode=Mode.ADJUST) is not None
    assert time.monotonic() - begun > 2 * _REST_S
    said = [record.message for record in caplog.records if "done again" in record.message]
    assert 1 <= len(set(said)) <= 4
    assert len(said) == len(set(said))


def test_page_for_the_maintainer_names_every_fault() -> None:
    page = (ROOT / "docs" / "how-to" / "when-a-camera-fails.md").read_text(encoding="utf-8")
    for name in (*[fault.name for fault in FAULTS], "hangs while closing"):
        assert f"| {name} |" in page
