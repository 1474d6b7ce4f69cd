"""Drivers that hang, end, lie or lose their camera: the thread that measures always comes back."""

from __future__ import annotations

import gc
import threading
import time
import tracemalloc
import weakref
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from alignment.errors import CameraConnectionError, CameraError, CameraTimeoutError, ConfigurationError
from sensors.bounded import MOST_LEFT, CallBounds
from sensors.camera import CameraSettings
from sensors.camera_health import CameraStatistics, place_in_words
from sensors.drivers.simulated import SimulatedCamera
from sensors.guarded import GuardedCamera
from tests.sensors.camera_contract import CameraContract
from tests.sensors.samples import HEIGHT, WIDTH
from tests.sensors.scripted import Device, Patience, ScriptedCamera

BOUNDS = CallBounds(call_s=10.0, trigger_s=4.0, late_s=2.0)
BOUND_OF = {"connect": 10.0, "arm": 10.0, "trigger": 4.0, "fetch": 3.0, "close": 10.0, "statistics": 4.0}


class TestGuardedCamera(CameraContract):
    def make(self, clock, tmp_path):  # type: ignore[no-untyped-def]
        class Counting:
            def image(self, trigger_counter: int) -> Any:
                return np.full((30, 40), trigger_counter, np.uint8)

        return GuardedCamera(SimulatedCamera(self.NAME, Counting(), clock=clock, sleep=clock.sleep))


@pytest.fixture
def device() -> Iterator[Device]:
    device = Device()
    yield device
    device.hangs.clear()
    device.go_on.set()


@pytest.fixture
def patience(device: Device) -> Patience:
    return Patience(device)


@pytest.fixture
def camera(device: Device, patience: Patience) -> Iterator[GuardedCamera]:
    camera = GuardedCamera(ScriptedCamera(device), device.make, BOUNDS, patience, size=(HEIGHT, WIDTH))
    yield camera
    device.hangs.clear()
    device.go_on.set()
    camera.close()
    assert_no_threads()


def threads() -> list[threading.Thread]:
    return [thread for thread in threading.enumerate() if thread.name.startswith("camera ")]


def assert_no_threads() -> None:
    """Those that were let go end by themselves."""
    for thread in threads():
        thread.join(5.0)
    assert not threads()


def shoot(camera: GuardedCamera) -> Any:
    camera.trigger()
    return camera.fetch(1.0)


def ready(camera: GuardedCamera) -> GuardedCamera:
    camera.connect()
    camera.arm(CameraSettings())
    return camera


def armed_shot(camera: GuardedCamera) -> Any:
    camera.arm(CameraSettings())
    return shoot(camera)


def do(camera: GuardedCamera, what: str) -> None:
    """Make this call of the driver."""
    if what == "connect":
        camera.connect()
        return
    camera.connect()
    if what == "close":
        camera.close()
        return
    camera.arm(CameraSettings())
    if what in ("trigger", "fetch"):
        camera.trigger()
    if what == "fetch":
        camera.fetch(1.0)


@pytest.mark.parametrize("what", ["connect", "arm", "statistics", "trigger", "fetch", "close"])
def test_hanging_call_is_given_up_within_its_bound_and_a_new_driver_object_reached(
    camera: GuardedCamera, device: Device, patience: Patience, what: str
) -> None:
    device.hangs.add(what)
    with pytest.raises(CameraConnectionError, match=f"did not come back from {what} within") as caught:
        do(camera, what)
    assert patience.bounds_s == [BOUND_OF[what]]
    assert caught.value.camera == device.name
    assert camera.left_behind == 1
    for act in (lambda: camera.arm(CameraSettings()), camera.trigger, lambda: camera.fetch(0.0)):
        with pytest.raises(CameraConnectionError, match=f"did not come back from {what}"):
            act()
    device.hangs.clear()
    assert shoot(ready(camera)).trigger_counter == 1
    assert device.made == 1, "the object in which a call hangs is touched no more"
    assert camera.counts.hung == 1
    device.go_on.set()
    camera.close()
    assert_no_threads()
    assert camera.left_behind == 0


def test_call_that_comes_back_late_closes_its_driver_and_ends_its_thread(
    camera: GuardedCamera, device: Device
) -> None:
    ready(camera)
    device.hangs.add("trigger")
    with pytest.raises(CameraConnectionError):
        camera.trigger()
    device.hangs.clear()
    device.go_on.set()
    assert_no_threads()
    assert device.calls[-2:] == ["trigger", "close"]
    assert shoot(ready(camera)).trigger_counter == 1
    assert device.made == 0, "the same object serves again"
    assert device.opened == 2


def test_driver_that_hangs_again_and_again_is_refused_until_the_next_start(
    camera: GuardedCamera, device: Device
) -> None:
    device.hangs.add("connect")
    for _ in range(MOST_LEFT):
        with pytest.raises(CameraConnectionError, match="did not come back from connect"):
            camera.connect()
    for _ in range(20):
        with pytest.raises(CameraConnectionError, match=r"from 3 calls\. Start the station anew"):
            camera.connect()
    assert len(threads()) == MOST_LEFT
    assert device.calls == ["connect"] * MOST_LEFT
    assert camera.counts.hung == MOST_LEFT


def test_driver_that_cannot_be_made_anew_is_waited_for(device: Device, patience: Patience) -> None:
    camera = ready(GuardedCamera(ScriptedCamera(device), None, BOUNDS, patience))
    device.hangs.add("fetch")
    camera.trigger()
    with pytest.raises(CameraConnectionError, match="did not come back from fetch within 3 s"):
        camera.fetch(1.0)
    for _ in range(5):
        with pytest.raises(CameraConnectionError, match=r"and still has not\. Cut the camera's power"):
            camera.connect()
    assert len(threads()) == 1
    device.hangs.clear()
    device.go_on.set()
    assert_no_threads()
    assert shoot(ready(camera)).trigger_counter == 1
    camera.close()


def test_making_of_a_driver_object_may_hang_too(device: Device, patience: Patience) -> None:
    def make() -> ScriptedCamera:
        device.hanging.set()
        assert device.go_on.wait(10.0)
        return ScriptedCamera(device)

    camera = ready(GuardedCamera(ScriptedCamera(device), make, BOUNDS, patience))
    device.hangs.add("trigger")
    with pytest.raises(CameraConnectionError):
        camera.trigger()
    device.hangs.clear()
    with pytest.raises(CameraConnectionError, match="from the making of its cameras within 10 s"):
        camera.connect()
    device.go_on.set()
    assert_no_threads()
    assert shoot(ready(camera)).trigger_counter == 1
    camera.close()


def test_object_that_hangs_is_not_touched_where_no_other_can_be_made(
    device: Device, patience: Patience
) -> None:
    made: list[str] = []

    def make() -> ScriptedCamera:
        made.append("tried")
        raise OSError("no licence")

    camera = ready(GuardedCamera(ScriptedCamera(device), make, BOUNDS, patience))
    device.hangs.add("trigger")
    with pytest.raises(CameraConnectionError):
        camera.trigger()
    calls = len(device.calls)
    for _ in range(5):
        with pytest.raises(OSError, match="no licence"):
            camera.connect()
        camera.note_failure(CameraError(device.name, "no licence"))
    assert len(device.calls) == calls
    assert len(threads()) == 1
    device.hangs.clear()
    device.go_on.set()
    assert_no_threads()
    assert shoot(ready(camera)).trigger_counter == 1
    assert len(made) == 5
    camera.close()


def test_never_two_calls_at_once_whoever_calls(device: Device) -> None:
    """The end of the station closes cameras while a wheel's thread still waits for a frame."""
    camera = ready(GuardedCamera(ScriptedCamera(device), None, BOUNDS))
    device.hangs.add("fetch")
    camera.trigger()
    fetched: list[Any] = []
    waiting = threading.Thread(target=lambda: fetched.append(camera.fetch(1.0)))
    waiting.start()
    assert device.hanging.wait(10.0)
    closing = threading.Thread(target=camera.close)
    closing.start()
    device.go_on.set()
    waiting.join(10.0)
    closing.join(10.0)
    assert len(fetched) == 1
    assert device.calls[-2:] == ["fetch", "close"]


@pytest.mark.parametrize(
    ("error", "kind"),
    [
        (CameraTimeoutError("40123456", "late", "Wait"), CameraTimeoutError),
        (CameraConnectionError("40123456", "gone"), CameraConnectionError),
        (CameraError("40123456", "strange"), CameraError),
    ],
)
def test_errors_of_a_driver_that_names_its_camera_otherwise_are_this_camera_s(
    camera: GuardedCamera, device: Device, error: CameraError, kind: type[CameraError]
) -> None:
    ready(camera)
    device.raises["trigger"] = error
    with pytest.raises(kind) as caught:
        camera.trigger()
    assert type(caught.value) is kind
    assert caught.value.camera == device.name
    assert caught.value.problem == error.problem


@pytest.mark.parametrize("error", [SystemExit(3), KeyboardInterrupt(), GeneratorExit()])
def test_driver_that_would_end_the_program_fails_like_any_other(
    camera: GuardedCamera, device: Device, error: BaseException
) -> None:
    ready(camera)
    device.raises["trigger"] = error
    with pytest.raises(RuntimeError, match=type(error).__name__):
        camera.trigger()
    device.raises.clear()
    camera.arm(CameraSettings())
    assert shoot(camera).trigger_counter == 1


def test_failed_camera_is_let_go_first_when_it_is_connected_again(
    camera: GuardedCamera, device: Device
) -> None:
    """A driver that believes itself connected did nothing when it was connected again."""
    ready(camera)
    camera.connect()
    assert device.opened == 1
    camera.note_failure(CameraTimeoutError(device.name, "silent"))
    device.raises["close"] = OSError("device is gone")
    camera.connect()
    device.raises.clear()
    assert device.calls[-2:] == ["close", "connect"]
    assert (camera.counts.missing, camera.counts.reconnected) == (1, 1)


def test_camera_that_cannot_be_reached_keeps_no_thread(camera: GuardedCamera, device: Device) -> None:
    device.plugged = False
    with pytest.raises(CameraConnectionError, match="no such camera"):
        camera.connect()
    assert_no_threads()
    with pytest.raises(CameraConnectionError, match="is not connected"):
        camera.trigger()
    device.plugged = True
    assert shoot(ready(camera)).trigger_counter == 1


def test_another_camera_that_answers_is_refused_whatever_it_sends(
    camera: GuardedCamera, device: Device
) -> None:
    shoot(ready(camera))
    device.serial = "40999999"
    with pytest.raises(CameraConnectionError, match="expected serial number 40123456, found 40999999"):
        shoot(ready(camera))
    assert camera.place == "wheel front left, head 2, right camera, serial 40123456"
    device.serial = "40123456"
    shoot(ready(camera))


def test_camera_that_was_calibrated_is_expected_from_the_first_frame_on(
    camera: GuardedCamera, device: Device
) -> None:
    camera.expect("40111111")
    assert camera.place.endswith("serial 40111111")
    with pytest.raises(CameraConnectionError, match="expected serial number 40111111, found 40123456"):
        shoot(ready(camera))
    device.serial = "40111111"
    shoot(ready(camera))


def test_changed_setting_is_told_and_set_again_by_arming(camera: GuardedCamera, device: Device) -> None:
    shoot(ready(camera))
    device.exposure_ms = 5.2
    with pytest.raises(CameraError, match=r"its settings changed: exposure_ms expected 5, found 5\.2"):
        shoot(camera)
    device.exposure_ms, device.pixel_format = None, "Mono12p"
    with pytest.raises(CameraError, match="pixel_format expected Mono8, found Mono12p"):
        shoot(camera)
    device.pixel_format = "Mono8"
    shoot(ready(camera))


def test_steps_of_a_camera_and_what_it_is_told_otherwise_are_no_change(
    camera: GuardedCamera, device: Device
) -> None:
    device.exposure_ms = 4.98
    shoot(ready(camera))
    device.exposure_ms = None
    for settings in (CameraSettings(8.0, 6.0), CameraSettings(5.0, 0.0)):
        camera.arm(settings)
        assert shoot(camera).in_force.gain_db == settings.gain_db


def test_image_with_rows_missing_is_incomplete(camera: GuardedCamera, device: Device) -> None:
    device.rows = 11
    with pytest.raises(CameraError, match="incomplete image: expected 40 × 30 pixels, it sent 40 × 11"):
        shoot(ready(camera))
    device.rows = HEIGHT
    assert shoot(ready(camera)).image.shape == (HEIGHT, WIDTH)


def test_camera_without_readback_or_calibration_is_believed(device: Device) -> None:
    device.known = False
    camera = ready(GuardedCamera(ScriptedCamera(device), None, BOUNDS))
    device.rows = 11
    assert shoot(camera).image.shape == (11, WIDTH)
    assert camera.place == "wheel front left, head 2, right camera"
    camera.close()


def test_statistics_are_asked_for_once_in_a_while_and_harm_nothing(device: Device) -> None:
    now = [100.0]
    camera = GuardedCamera(ScriptedCamera(device), None, BOUNDS, clock=lambda: now[0])
    device.statistics = CameraStatistics(link_mbit=1000.0, dropped=3)
    camera.connect()
    for _ in range(4):
        camera.arm(CameraSettings())
    assert device.calls.count("statistics") == 1
    assert camera.statistics == CameraStatistics(1000.0, 3)
    now[0] += 60.0
    device.raises["statistics"] = ValueError("no such node")
    camera.arm(CameraSettings())
    assert device.calls.count("statistics") == 2
    assert camera.statistics.dropped == 3
    camera.close()


def test_a_guarded_camera_that_leads_is_still_triggered_last(device: Device, patience: Patience) -> None:
    """The guard hid that a camera makes the others expose: they were not yet waiting for its line."""
    own = ScriptedCamera(device)
    guarded = GuardedCamera(own, device.make, BOUNDS, patience, size=(HEIGHT, WIDTH))
    assert not guarded.leads
    own.leads = True
    assert guarded.leads
    guarded.close()


def test_what_only_one_driver_can_is_asked_in_its_thread_and_within_its_bound(
    camera: GuardedCamera, device: Device, patience: Patience
) -> None:
    with pytest.raises(CameraConnectionError, match="is not connected"):
        camera.ask("strobe", lambda own: own.name)
    ready(camera)
    assert camera.ask("strobe", lambda own: (type(own), threading.current_thread().name)) == (
        ScriptedCamera,
        f"camera {device.name}",
    )
    device.hangs.add("statistics")
    with pytest.raises(CameraConnectionError, match="did not come back from strobe within 10 s"):
        camera.ask("strobe", lambda own: own.statistics())  # type: ignore[attr-defined]
    assert patience.bounds_s == [10.0]


def test_thousand_reconnects_leave_no_thread_and_no_memory_behind(device: Device, patience: Patience) -> None:
    camera = GuardedCamera(ScriptedCamera(device), device.make, BOUNDS, patience)

    def reconnect(number: int) -> None:
        device.go_on.clear()
        shoot(ready(camera))
        # Unplugged, silent, hanging and refused by turns.
        fault = number % 4
        device.plugged = fault != 0
        device.frames_left = 0 if fault == 1 else None
        device.hangs = {"fetch"} if fault == 2 else set()
        device.raises = {"arm": OSError("busy")} if fault == 3 else {}
        with pytest.raises((CameraError, OSError)):
            armed_shot(camera)
        device.plugged, device.frames_left, device.hangs, device.raises = True, None, set(), {}
        device.go_on.set()
        camera.note_failure(CameraError(device.name, "failed"))
        camera.connect()
        # What the test itself notes would grow too.
        device.calls.clear()
        patience.bounds_s.clear()

    for number in range(40):
        reconnect(number)
    gc.collect()
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    for number in range(1000):
        reconnect(number)
    gc.collect()
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert grown < 50_000, "bytes; one image of each reconnect would be 1.2 million"
    camera.close()
    assert_no_threads()
    assert camera.left_behind == 0


def test_forgotten_camera_takes_its_thread_with_it(device: Device) -> None:
    camera = ready(GuardedCamera(ScriptedCamera(device), None, BOUNDS))
    gone = weakref.ref(camera)
    del camera
    gc.collect()
    assert gone() is None
    assert_no_threads()


def test_frame_is_let_go_when_whoever_took_it_does(camera: GuardedCamera) -> None:
    frame = shoot(ready(camera))
    kept = weakref.ref(frame.image)
    del frame
    gc.collect()
    assert kept() is None


def test_guard_costs_less_than_a_fifth_of_a_millisecond_a_call(device: Device) -> None:
    camera = ready(GuardedCamera(ScriptedCamera(device), None, BOUNDS))
    bare = ScriptedCamera(device)
    bare.connect()
    bare.arm(CameraSettings())

    def best_of(call: Any) -> float:
        found = []
        for _ in range(30):
            begun = time.perf_counter()
            for _ in range(20):
                call()
            found.append((time.perf_counter() - begun) / 20)
        return min(found)

    assert best_of(camera.trigger) - best_of(bare.trigger) < 2e-4
    camera.close()


@pytest.mark.parametrize("field", ["call_s", "trigger_s", "late_s"])
@pytest.mark.parametrize("value", [0.0, -1.0, 3600.1, float("nan"), float("inf")])
def test_bounds_are_bounded(field: str, value: float) -> None:
    with pytest.raises(ConfigurationError, match=field):
        CallBounds(**{field: value})


@pytest.mark.parametrize(
    ("camera", "serial", "words"),
    [
        ("rear_right/head_1/left", "7", "wheel rear right, head 1, left camera, serial 7"),
        ("front_left/upper/right", None, "wheel front left, head upper, right camera"),
        ("cam", None, "camera cam"),
        ("a//b", "1", "camera a//b, serial 1"),
    ],
)
def test_place_is_told_in_words(camera: str, serial: str | None, words: str) -> None:
    assert place_in_words(camera, serial) == words
