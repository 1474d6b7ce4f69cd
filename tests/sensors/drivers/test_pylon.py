"""Basler's own library on its emulated cameras: six of a rig, and what goes wrong with one."""

import gc
import os
import sys
import threading
from dataclasses import replace
from inspect import signature
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from alignment.errors import (
    CameraConnectionError,
    CameraError,
    ConfigurationError,
    FormatError,
    SeveralErrors,
)
from sensors.camera import CameraSettings
from sensors.drivers.driver import RigPlace
from sensors.drivers.genicam.camera import GenICamCamera
from sensors.drivers.genicam.device import Action
from sensors.drivers.pylon.driver import DRIVER, EmulationOptions, PylonOptions
from sensors.drivers.pylon.library import EMULATED_CAMERAS
from sensors.drivers.recorded import recorded_rig
from sensors.formats import read_shot, write_shot
from sensors.frames import FrameTolerance
from tests.sensors.camera_contract import CameraContract
from tests.sensors.samples import shot

pytest.importorskip("pypylon.pylon", reason="pypylon is not installed: pip install 'truewheel[pylon]'")

HEADS = ("head_1", "head_2", "head_3")
WAIT_S = 5.0


def cameras():
    return {head: (f"0815-{2 * n:04d}", f"0815-{2 * n + 1:04d}") for n, head in enumerate(HEADS)}


def options(**changed):
    return PylonOptions(**{"cameras": cameras(), "emulation": EmulationOptions(shots="shots"), **changed})


def place(folder, heads=HEADS, **settings):
    return RigPlace("front_left", "left", heads, folder, CameraSettings(**settings), FrameTolerance())


@pytest.fixture(autouse=True)
def few_cameras(monkeypatch):
    monkeypatch.setenv(EMULATED_CAMERAS, "6")


@pytest.fixture
def recorded(tmp_path):
    """A folder with five recorded shots of small images."""
    for index in range(1, 6):
        write_shot(tmp_path / "shots" / f"shot_{index}", shot(trigger=index))
    return tmp_path


def ready(folder, exposure_ms=0.5, heads=HEADS, **changed):
    rig = DRIVER.make(options(**changed), place(folder, heads, exposure_ms=exposure_ms))
    rig.connect()
    try:
        rig.arm()
    except SeveralErrors:
        rig.close()
        raise
    return rig


def node(camera, name):
    """A feature of an emulated camera, past the driver: what another program does."""
    return camera._device._nodes.GetNode(name)


class TestPylonCamera(CameraContract):
    DEVICE_CLOCK = False
    TIMEOUT_S = WAIT_S

    def make(self, clock, tmp_path):
        for index in (1, 2, 3):
            write_shot(tmp_path / "shots" / f"shot_{index}", shot(trigger=index))
        return DRIVER.make(options(), place(tmp_path)).cameras[0]


@pytest.fixture
def rig(recorded):
    rig = ready(recorded)
    yield rig
    rig.close()


def test_six_cameras_deliver_bit_for_bit_what_the_folder_driver_does(rig, recorded):
    folders = sorted((recorded / "shots").iterdir())
    told = recorded_rig(folders, at_end="repeat")
    told.connect()
    told.arm()
    for expected in range(1, 7):
        seen, known = rig.shoot(WAIT_S), told.shoot(WAIT_S)
        for mine, theirs in zip(seen.frames, known.frames, strict=True):
            assert (mine.camera, mine.trigger_counter) == (theirs.camera, expected)
            assert mine.image.dtype == theirs.image.dtype
            np.testing.assert_array_equal(mine.image, theirs.image)
    rig.arm()
    np.testing.assert_array_equal(rig.shoot(WAIT_S).images[2].right, read_shot(folders[1]).images[2].right)


def test_one_shot_that_comes_again_and_again_is_no_frozen_camera(tmp_path):
    write_shot(tmp_path / "shots" / "only", shot())
    rig = ready(tmp_path)
    for _ in range(2):
        rig.shoot(WAIT_S)
    rig.close()


def test_the_settings_in_force_are_read_from_each_camera(recorded):
    rig = ready(recorded, 1.25, packet_size=1400, features=(("Gamma", 0.5), ("ReverseX", False)))
    for number, frame in enumerate(rig.shoot(WAIT_S).frames):
        told = frame.in_force
        assert (told.serial_number, told.exposure_ms) == (f"0815-{number:04d}", 1.25)
        assert (told.pixel_format, told.bits, told.packet_size) == ("Mono8", 8, 1400)
        assert (told.trigger_source, told.gain_db) == ("Software", 0.0)
        assert dict(told.others).keys() == {"Gamma", "ReverseX"}
    rig.close()


def test_twelve_bits_are_the_camera_s_own_values(recorded):
    rig = ready(recorded, pixel_format="Mono12")
    for mine, told in zip(
        rig.shoot(WAIT_S).frames, read_shot(recorded / "shots" / "shot_1").frames, strict=True
    ):
        assert mine.in_force.bits == 12
        np.testing.assert_array_equal(mine.image, told.image.astype(np.uint16) << 4)
    rig.close()


def test_sixteen_bits_are_bit_for_bit_those_of_the_file(tmp_path):
    write_shot(tmp_path / "shots" / "shot_1", shot(depth=np.uint16))
    rig = ready(tmp_path, pixel_format="Mono16")
    for mine, told in zip(rig.shoot(WAIT_S).frames, shot(depth=np.uint16).frames, strict=True):
        np.testing.assert_array_equal(mine.image, told.image)
    rig.close()


@pytest.mark.parametrize(
    ("changed", "text"),
    [
        ({"pixel_format": "Mono12p"}, r"set PixelFormat to Mono12p, it refused: .*\(it takes Mono8, Mono10"),
        ({"packet_size": 16_000}, r"set GevSCPSPacketSize to 16000, .*it takes 220 to 9014"),
        ({"features": (("Nonsense", 1),)}, "set Nonsense to 1, it has no such feature"),
        ({"features": (("Gamma", 1e9),)}, "set Gamma to 1000000000.0, it refused"),
        ({"ptp": True}, "set PtpEnable to True, it has no such feature"),
    ],
)
def test_a_setting_that_the_camera_does_not_take_is_told_of_each_camera(recorded, changed, text):
    with pytest.raises(SeveralErrors, match="6 of 6 cameras did not take their settings") as caught:
        ready(recorded, **changed)
    with pytest.raises(CameraError, match=text):
        raise caught.value.exceptions[0]


def test_an_exposure_that_the_camera_rounds_too_far_is_refused(recorded):
    """It counts in whole microseconds."""
    ready(recorded, 0.2004).close()
    with pytest.raises(SeveralErrors) as caught:
        ready(recorded, 0.0014)
    assert "expected ExposureTime 1.4" in str(caught.value)


@pytest.mark.parametrize("count", [1, 2])
def test_a_failed_buffer_makes_the_shot_fail_and_names_the_camera(rig, count):
    rig.shoot(WAIT_S)
    broken = rig.cameras[3]
    node(broken, "ForceFailedBufferCount").SetValue(count)
    node(broken, "ForceFailedBuffer").Execute()
    for trigger in range(2, 2 + count):
        with pytest.raises(SeveralErrors) as caught:
            rig.shoot(WAIT_S)
        [error] = caught.value.exceptions
        assert error.camera == broken.name
        assert f"the frame of trigger {trigger} is incomplete: The buffer was incompletely grabbed" in str(
            error
        )
    assert rig.shoot(WAIT_S).frames[3].trigger_counter == 2 + count


def test_a_setting_that_somebody_changes_is_found_at_the_next_shot(rig):
    node(rig.cameras[4], "ExposureTime").SetValue(900.0)
    with pytest.raises(SeveralErrors) as caught:
        rig.shoot(WAIT_S)
    assert [error.camera for error in caught.value.exceptions] == [rig.cameras[4].name]
    assert "expected ExposureTime 500.0 as when it was armed, it is 900" in str(caught.value)
    rig.arm()
    assert len(rig.shoot(WAIT_S).frames) == 6


def test_a_camera_that_waits_for_its_line_is_a_missing_frame(recorded):
    """The emulation has no line that could be pulled; all but the leader stay silent."""
    rig = ready(recorded, trigger_source="Line1", leader=("head_2", "right"), exposure_output="Line2")
    with pytest.raises(SeveralErrors, match="5 of 6 cameras did not deliver") as caught:
        rig.shoot(0.3)
    assert "front_left/head_2/right" not in {error.camera for error in caught.value.exceptions}
    assert rig.cameras[0]._device.get("TriggerSource") == "Line1"
    assert rig.cameras[3]._device.get("LineSource") == "ExposureActive"
    rig.close()


def test_exposures_of_a_turning_wheel_come_without_arming_again(rig):
    camera = rig.cameras[0]
    assert [camera.trigger() for _ in range(6)] == [1, 2, 3, 4, 5, 6]
    assert [camera.fetch(WAIT_S).trigger_counter for _ in range(6)] == [1, 2, 3, 4, 5, 6]


def test_a_camera_that_is_not_there_is_told_with_those_that_are(recorded):
    rig = DRIVER.make(options(cameras={"head_1": ("0815-0000", "0815-0200")}), place(recorded, ("head_1",)))
    os.environ[EMULATED_CAMERAS] = "2"
    with pytest.raises(SeveralErrors) as caught:
        rig.connect()
    [error] = caught.value.exceptions
    assert isinstance(error, CameraConnectionError)
    assert "expected a camera '0815-0200', pylon sees 0815-0000, 0815-0001" in str(error)


def test_whoever_waits_for_a_frame_is_let_go_when_the_camera_is_closed(rig):
    camera = rig.cameras[0]
    device, waiting, errors = camera._device, threading.Event(), []
    retrieve = device.retrieve
    device.retrieve = lambda timeout_s: waiting.set() or retrieve(timeout_s)

    def fetch():
        try:
            camera.fetch(60.0)
        except CameraError as error:
            errors.append(error)

    thread = threading.Thread(target=fetch)
    thread.start()
    assert waiting.wait(10.0)
    camera.close()
    thread.join(10.0)
    assert not thread.is_alive()
    assert isinstance(errors[0], CameraConnectionError)
    camera.connect()
    camera.arm(CameraSettings(exposure_ms=0.5))
    assert camera.trigger() == 1
    assert camera.fetch(WAIT_S).trigger_counter == 1


def test_reconnecting_leaves_no_thread_no_file_and_no_memory(recorded):
    camera = DRIVER.make(options(), place(recorded)).cameras[0]

    def once():
        camera.connect()
        camera.arm(CameraSettings(exposure_ms=0.5))
        camera.trigger()
        camera.fetch(WAIT_S)
        camera.close()

    def held():
        gc.collect()
        status = Path("/proc/self/status").read_text()
        resident = int(next(line for line in status.splitlines() if line.startswith("VmRSS")).split()[1])
        return *(len(list(Path(f"/proc/self/{kind}").iterdir())) for kind in ("task", "fd")), resident

    for _ in range(20):
        once()
    threads, files, memory = held()
    for _ in range(60):
        once()
    after = held()
    assert (after[0], after[1]) == (threads, files)
    assert after[2] - memory < 1000  # kB; a new object of the library for each would be 2760


def test_pylon_s_cameras_are_seen(monkeypatch):
    monkeypatch.setenv(EMULATED_CAMERAS, "3")
    assert [one.serial_number for one in DRIVER.discover()] == ["0815-0000", "0815-0001", "0815-0002"]
    assert {one.model for one in DRIVER.discover()} == {"Emulation"}


@pytest.mark.parametrize("broken", [False, True])
@pytest.mark.parametrize("act", ["check", "make", "discover"])
def test_a_library_that_is_missing_or_broken_is_one_error_with_the_extra(recorded, monkeypatch, act, broken):
    if broken:
        monkeypatch.delitem(sys.modules, "pypylon.pylon", raising=False)
        monkeypatch.delattr("pypylon.pylon", raising=False)
        monkeypatch.setattr("pypylon.__path__", [str(recorded)])
        (recorded / "pylon.py").write_text("raise OSError('libpylonbase.so.12: cannot open')")
    else:
        monkeypatch.setitem(sys.modules, "pypylon", None)
    call = DRIVER.discover if act == "discover" else lambda: getattr(DRIVER, act)(options(), place(recorded))
    with pytest.raises(ConfigurationError, match=r"'truewheel\[pylon\]'") as caught:
        call()
    assert ("libpylonbase" in str(caught.value)) == broken


@pytest.mark.parametrize(
    ("changed", "error", "text"),
    [
        ({"cameras": {"head_1": ("40012345", "0815-0001")}}, ConfigurationError, r"cameras.head_1\[0\]"),
        ({"emulation": EmulationOptions(shots="none")}, (ConfigurationError, FormatError), "none"),
        ({"cameras": {**cameras(), "head_9": ("0815-0008", "0815-0009")}}, FormatError, "head 'head_9'"),
    ],
)
def test_mistakes_of_an_emulation_are_found_without_a_camera(recorded, changed, error, text):
    heads = ("head_1",) if "head_9" not in changed.get("cameras", ()) else ()
    with pytest.raises(error, match=text):
        DRIVER.check(options(**changed), place(recorded, heads))


def test_each_camera_is_of_the_common_kind(rig):
    assert all(isinstance(camera, GenICamCamera) for camera in rig.cameras)
    assert replace(rig.settings) == CameraSettings(exposure_ms=0.5)


@pytest.mark.parametrize("ahead_s", [0.0, 0.002])
def test_an_action_command_goes_to_the_network_of_the_cameras(recorded, monkeypatch, ahead_s):
    """The emulation has no network: what the library is given is looked at, and whether it takes it."""
    rig = ready(recorded)
    device, sent = rig.cameras[0]._device, []
    real = device._pylon

    def command(name):
        def made(*arguments):
            signature(getattr(real.GigETransportLayer, name)).bind(None, *arguments)
            return SimpleNamespace(IssueNoWait=lambda: sent.append((name, arguments)))

        return made

    kinds = ("ActionCommand", "ScheduledActionCommand")
    layer = SimpleNamespace(**{name: command(name) for name in kinds})
    opened = []
    factory = SimpleNamespace(CreateTl=lambda kind: opened.append(kind) or layer, ReleaseTl=opened.append)
    device._pylon = SimpleNamespace(TlFactory=SimpleNamespace(GetInstance=lambda: factory))
    monkeypatch.setattr(device, "_clock_now", lambda: 5_000_000_000)
    device.fire(Action(7, 8, 4, "10.0.0.255", ahead_s))
    device._pylon = real
    rig.close()
    when = (5_002_000_000,) if ahead_s else ()
    assert sent == [(kinds[bool(ahead_s)], (7, 8, 4, *when, "10.0.0.255"))]
    assert opened == ["BaslerGigE", layer]


def test_a_clock_that_cannot_be_asked_keeps_an_action_command_from_being_timed(recorded):
    rig = ready(recorded)
    with pytest.raises(LookupError, match="TimestampLatch or GevTimestampControlLatch"):
        rig.cameras[0]._device._clock_now()
    rig.close()
