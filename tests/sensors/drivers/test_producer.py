"""GenICam cameras through a GenTL producer: the one that the standard's package brings, of three cameras."""

import logging
import os
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from alignment.errors import CameraConnectionError, CameraError, ConfigurationError, SeveralErrors
from sensors.camera import CameraSettings
from sensors.drivers.driver import RigPlace
from sensors.drivers.genicam import producer
from sensors.drivers.genicam.options import ActionOptions
from sensors.drivers.genicam.producer import DRIVER, PRODUCERS, PRODUCERS_PATH, ProducerOptions
from sensors.frames import FrameTolerance
from tests.sensors.camera_contract import CameraContract

pytest.importorskip("harvesters.core", reason="harvesters is not installed: pip install 'truewheel[genicam]'")
genicam = pytest.importorskip("genicam", reason="genicam is not installed: pip install 'truewheel[genicam]'")

PRODUCER = str(Path(genicam.__file__).parent / "viky.cti")
"""A game of three cameras of 800 × 800 pixels that run freely; no trigger, no exposure time, no clock."""
if not Path(PRODUCER).is_file():
    pytest.skip("this version of genicam brings no producer", allow_module_level=True)


def options(**changed):
    chosen = {"cameras": {"head_1": ("0", "1")}, "trigger_source": "Off", "producer": PRODUCER, **changed}
    return ProducerOptions(**chosen)


def place(folder=Path(), heads=("head_1",)):
    return RigPlace("front_left", "left", heads, folder, CameraSettings(), FrameTolerance())


def camera(**changed):
    return DRIVER.make(options(**changed), place()).cameras[0]


class TestProducerCamera(CameraContract):
    SHAPE = (800, 800)
    DEVICE_CLOCK = False

    def make(self, clock, tmp_path):
        return camera()


@pytest.fixture(autouse=True)
def all_closed():
    yield
    assert not PRODUCERS._open


def test_two_cameras_of_one_producer_at_once_and_again():
    rig = DRIVER.make(options(), place())
    for _ in range(2):
        rig.connect()
        rig.arm()
        frames = [(c.trigger(), c.fetch(2.0))[1] for c in rig.cameras]
        assert [frame.trigger_counter for frame in frames] == [1, 1]
        assert {frame.image.dtype for frame in frames} == {np.dtype(np.uint8)}
        assert {frame.in_force for frame in frames} == {None}
        rig.close()


def test_frames_that_nobody_fetched_go_by_and_the_ring_stays_as_it_is():
    one = camera(buffers=4)
    one.connect()
    one.arm(CameraSettings())
    assert one._device._acquirer.num_buffers == 4
    device = one._device
    seen = []
    retrieve = device.retrieve
    device.retrieve = lambda timeout_s: seen.append(retrieve(timeout_s)) or seen[-1]
    # The ring fills while nothing is asked: what is in it was exposed before.
    numbers = []
    for _ in range(3):
        one.trigger()
        one.fetch(0.0)
        numbers.append([buffer.frame_id for buffer in seen if buffer is not None][-1])
    assert numbers == sorted(set(numbers))
    one.close()


def test_a_trigger_that_the_camera_does_not_have_is_told():
    one = camera(trigger_source="Software")
    one.connect()
    with pytest.raises(CameraError, match="set TriggerSelector to FrameStart, it has no such feature"):
        one.arm(CameraSettings())
    one.close()


def test_a_camera_that_the_producer_does_not_see_is_told_with_those_that_it_sees():
    rig = DRIVER.make(options(cameras={"head_1": ("0", "77")}), place())
    with pytest.raises(SeveralErrors) as caught:
        rig.connect()
    [error] = caught.value.exceptions
    assert isinstance(error, CameraConnectionError)
    assert "expected a camera '77', the producer viky.cti sees 0, 1, 2" in str(error)


def test_a_camera_that_is_open_elsewhere_is_told(caplog):
    caplog.set_level(logging.CRITICAL, "harvesters.core")
    first, second = camera(), camera()
    first.connect()
    with pytest.raises(CameraConnectionError, match=first.name):
        second.connect()
    first.close()
    second.connect()
    second.close()


def test_an_incomplete_frame_which_harvesters_drops_is_told():
    one = camera()
    one.connect()
    one.arm(CameraSettings())
    acquirer = one._device._acquirer
    acquirer._emit_callbacks(acquirer.Events.INCOMPLETE_BUFFER)
    acquirer.try_fetch = lambda **asked: None
    buffer = one._device.retrieve(0.0)
    assert buffer.problem == "packets of it are missing"
    assert one._device.retrieve(0.0) is None
    one.close()


def test_whoever_waits_is_let_go_when_the_camera_is_closed(caplog):
    caplog.set_level(logging.CRITICAL, "harvesters.core")
    one = camera()
    one.connect()
    one.arm(CameraSettings())
    device, waiting, ends = one._device, threading.Event(), []

    def wait():
        while one._device is device:
            waiting.set()
            buffer = device.retrieve(5.0)
            if buffer is not None and one._device is device:
                buffer.release()
        ends.append(True)

    thread = threading.Thread(target=wait)
    thread.start()
    assert waiting.wait(5.0)
    one.close()
    thread.join(10.0)
    assert ends == [True]


def test_cameras_of_announced_producers_are_seen(monkeypatch, tmp_path):
    monkeypatch.setenv(PRODUCERS_PATH, os.pathsep.join([str(Path(PRODUCER).parent), str(tmp_path)]))
    assert [one.serial_number for one in DRIVER.discover()] == ["0", "1", "2"]
    assert {one.model for one in DRIVER.discover()} == {"Viky"}
    monkeypatch.setenv(PRODUCERS_PATH, "")
    assert DRIVER.discover() == []


def test_a_file_that_is_no_producer_is_refused(tmp_path):
    (tmp_path / "false.cti").write_bytes(b"no library")
    (tmp_path / "false.txt").write_text("no producer")
    for name, text in (("false.txt", "ends in .cti"), ("none.cti", "no such file")):
        with pytest.raises(ConfigurationError, match=text) as caught:
            DRIVER.check(options(producer=name), place(tmp_path))
        assert caught.value.field == "producer"
    rig = DRIVER.make(options(producer="false.cti"), place(tmp_path))
    with pytest.raises(SeveralErrors, match="2 of 2 cameras did not connect"):
        rig.connect()


def test_an_action_command_is_refused_since_gentl_has_none():
    with pytest.raises(ConfigurationError, match="no action command"):
        DRIVER.check(options(trigger_source="Action1", action=ActionOptions()), place())


@pytest.mark.parametrize("act", ["check", "make", "discover"])
def test_a_library_that_is_missing_is_one_error_with_the_extra(monkeypatch, act):
    monkeypatch.setitem(sys.modules, "harvesters", None)
    call = DRIVER.discover if act == "discover" else lambda: getattr(DRIVER, act)(options(), place())
    with pytest.raises(ConfigurationError, match=r"pip install 'truewheel\[genicam\]'"):
        call()


def test_a_library_that_does_not_load_is_told(monkeypatch):
    monkeypatch.delitem(sys.modules, "harvesters.core", raising=False)
    monkeypatch.delattr("harvesters.core", raising=False)
    monkeypatch.setitem(sys.modules, "genicam.gentl", None)
    monkeypatch.delattr("genicam.gentl", raising=False)
    with pytest.raises(ConfigurationError, match=r"truewheel\[genicam\]"):
        producer._library()
