import numpy as np
import pytest

from alignment.errors import (
    CameraConnectionError,
    CameraError,
    CameraTimeoutError,
    ConfigurationError,
    FormatError,
)
from sensors.camera import CameraSettings
from sensors.drivers.recorded import RecordedCamera, recorded_rig
from sensors.drivers.simulated import Faults, SimulatedCamera
from sensors.formats import write_shot
from tests.sensors.camera_contract import CameraContract
from tests.sensors.samples import StillClock, shot


class CountingSource:
    """Paints the trigger counter into every pixel."""

    def image(self, trigger_counter):
        return np.full((30, 40), trigger_counter, np.uint8)


def record(tmp_path, count=3):
    folders = [tmp_path / f"shot_{index}" for index in range(1, count + 1)]
    for index, folder in enumerate(folders, 1):
        write_shot(folder, shot(trigger=index))
    return folders


class TestSimulatedCamera(CameraContract):
    def make(self, clock, tmp_path):
        return SimulatedCamera(self.NAME, CountingSource(), clock=clock, sleep=clock.sleep)


class TestRecordedCamera(CameraContract):
    EXPOSURE_MS = 5.0

    def make(self, clock, tmp_path):
        folders = record(tmp_path)
        return RecordedCamera(self.NAME, folders, "head_1", "left", clock=clock, sleep=clock.sleep)


def simulated(clock, **faults):
    camera = SimulatedCamera("cam", CountingSource(), Faults(**faults), clock=clock, sleep=clock.sleep)
    camera.connect()
    camera.arm(CameraSettings())
    return camera


def test_a_late_frame_is_waited_for_no_longer_than_needed():
    clock = StillClock()
    camera = simulated(clock, delays_s={1: 0.2})
    camera.trigger()
    frame = camera.fetch(1.0)
    assert clock.slept == [pytest.approx(0.2)]
    assert frame.host_time_s == clock.now
    assert frame.device_time_s == 100.0


def test_a_frame_later_than_the_bound_times_out_and_is_there_afterwards():
    clock = StillClock()
    camera = simulated(clock, delays_s={1: 0.2})
    camera.trigger()
    with pytest.raises(CameraTimeoutError, match=r"cam: expected a frame within 0\.1 s"):
        camera.fetch(0.1)
    assert camera.fetch(0.11).trigger_counter == 1


def test_a_frame_later_than_its_successor_arrives_after_it():
    camera = simulated(StillClock(), delays_s={1: 0.5})
    camera.trigger()
    camera.trigger()
    assert [camera.fetch(1.0).trigger_counter for _ in range(2)] == [2, 1]


def test_a_dropped_frame_never_comes_the_next_one_does():
    camera = simulated(StillClock(), dropped=frozenset({1}))
    camera.trigger()
    with pytest.raises(CameraTimeoutError):
        camera.fetch(1.0)
    camera.trigger()
    assert camera.fetch(1.0).trigger_counter == 2


def test_a_stale_frame_carries_the_counter_of_the_trigger_it_was_taken_at():
    camera = simulated(StillClock(), stale=frozenset({2}))
    camera.trigger()
    camera.fetch(1.0)
    camera.trigger()
    frame = camera.fetch(1.0)
    assert frame.trigger_counter == 1
    assert (frame.image == 1).all()


def test_the_connection_breaks_and_heals():
    camera = simulated(StillClock(), lost_at=2)
    camera.trigger()
    with pytest.raises(CameraConnectionError, match="broke at trigger 2"):
        camera.trigger()
    with pytest.raises(CameraConnectionError, match="not connected"):
        camera.fetch(1.0)
    camera.faults = Faults()
    camera.connect()
    camera.arm(CameraSettings())
    assert camera.trigger() == 1


def test_an_unreachable_camera_is_also_the_builtin_connection_error():
    camera = SimulatedCamera("cam", CountingSource(), Faults(unreachable=True))
    with pytest.raises(ConnectionError, match="camera cam: expected an answer"):
        camera.connect()


def test_recorded_shots_play_in_order_and_stop(tmp_path):
    camera = RecordedCamera("cam", record(tmp_path), "head_2", "right")
    camera.connect()
    camera.arm(CameraSettings())
    for index in (1, 2, 3):
        camera.trigger()
        frame = camera.fetch(0.0)
        recorded = shot(trigger=index).heads[1].right
        assert (frame.image == recorded.image).all()
        assert frame.device_time_s == recorded.device_time_s
    with pytest.raises(CameraError, match="ended after 3 shots"):
        camera.trigger()


def test_recorded_shots_repeat_when_told_to(tmp_path):
    rig = recorded_rig(record(tmp_path, 2), at_end="repeat")
    rig.connect()
    rig.arm()
    shots = [rig.shoot(1.0) for _ in range(5)]
    assert [s.heads[0].left.trigger_counter for s in shots] == [1, 2, 3, 4, 5]
    assert (shots[4].images[2].right == shots[0].images[2].right).all()
    assert not (shots[1].images[2].right == shots[0].images[2].right).all()


def test_arming_goes_on_with_the_recording_connecting_begins_again(tmp_path):
    rig = recorded_rig(record(tmp_path, 2))
    rig.connect()
    rig.arm()
    first = rig.shoot(0.0)
    rig.arm()
    second = rig.shoot(0.0)
    rig.close()
    rig.connect()
    rig.arm()
    again = rig.shoot(0.0)
    assert (again.images[0].left == first.images[0].left).all()
    assert not (second.images[0].left == first.images[0].left).all()


def test_a_recording_that_lacks_an_image_fails_at_connect_not_in_the_run(tmp_path):
    folders = record(tmp_path)
    (folders[2] / "head_1_left.png").unlink()
    camera = RecordedCamera("cam", folders, "head_1", "left")
    with pytest.raises(FormatError, match=r"shot_3/head_1_left\.png: expected the image"):
        camera.connect()


def test_a_recording_that_lacks_the_head_names_the_heads_it_has(tmp_path):
    camera = RecordedCamera("cam", record(tmp_path), "head_9", "left")
    with pytest.raises(FormatError, match=r"expected head 'head_9'.*found head_1, head_2, head_3"):
        camera.connect()


@pytest.mark.parametrize(
    "make", [lambda: RecordedCamera("cam", [], "head_1", "left"), lambda: recorded_rig([])]
)
def test_a_recording_without_folders_is_refused(make):
    with pytest.raises(ConfigurationError, match="at least one shot folder"):
        make()


@pytest.mark.parametrize(
    "settings", [{"exposure_ms": 0}, {"exposure_ms": float("nan")}, {"gain_db": -1}, {"exposure_ms": 1e6}]
)
def test_impossible_settings_are_refused(settings):
    with pytest.raises(ConfigurationError):
        CameraSettings(**settings)
