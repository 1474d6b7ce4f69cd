"""A GenICam camera's bad moments: settings it does not take, frames that are not whole, lines, networks."""

import threading
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from alignment.errors import (
    CameraConnectionError,
    CameraError,
    CameraTimeoutError,
    ConfigurationError,
    SeveralErrors,
)
from sensors.camera import CameraSettings
from sensors.drivers.driver import RigPlace
from sensors.drivers.genicam.device import NOTHING, Action
from sensors.drivers.genicam.options import ActionOptions, Region, check_options
from sensors.frames import FrameTolerance
from sensors.rig import Rig, StereoHead
from tests.sensors.camera_contract import CameraContract
from tests.sensors.drivers.stub_device import (
    HEIGHT,
    NAME,
    WIDTH,
    StubDevice,
    VendorError,
    camera_of,
    options,
)

TIME = datetime(2026, 3, 1, tzinfo=UTC)


class TestGenICamCamera(CameraContract):
    SHAPE = (HEIGHT, WIDTH)

    def make(self, clock, tmp_path):
        class Ticking(StubDevice):
            def put(self, number):
                self.seconds = clock.now
                super().put(number)

        return camera_of(Ticking())


def armed(device, settings=None, **changed):
    camera = camera_of(device, **changed)
    camera.connect()
    camera.arm(settings or CameraSettings())
    return camera


def shot_of(camera):
    camera.trigger()
    return camera.fetch(0.5)


def test_the_settings_in_force_are_those_that_the_camera_says():
    device = StubDevice()
    device.rounds["ExposureTime"] = lambda value: round(value / 3) * 3.0
    frame = shot_of(
        armed(
            device,
            CameraSettings(exposure_ms=0.5, gain_db=2.0),
            pixel_format="Mono12",
            packet_size=8192,
            features=(("LineSelector", "Line2"), ("LineMode", "Output")),
        )
    )
    assert frame.in_force.exposure_ms == frame.exposure_ms == 0.501
    assert (frame.in_force.gain_db, frame.in_force.bits) == (2.0, 12)
    assert frame.in_force.pixel_format == "Mono12"
    assert (frame.in_force.trigger_source, frame.in_force.packet_size) == ("Software", 8192)
    assert (frame.in_force.model, frame.in_force.serial_number) == ("stub", "4711")
    assert frame.in_force.others == (("LineMode", "Output"), ("LineSelector", "Line2"))
    assert frame.temperature_c == 41.5
    assert frame.image.dtype == np.uint16


def test_what_another_program_left_in_the_camera_is_taken_out():
    """A region, an automatic exposure or a frame rate that somebody tried out would move or alter images."""
    device = StubDevice()
    armed(device)
    found = device.features
    assert "UserSetLoad" in device.log
    assert [found[name] for name in ("OffsetX", "OffsetY", "Width", "Height")] == [0, 0, WIDTH, HEIGHT]
    assert (found["ExposureAuto"], found["AcquisitionMode"], found["TriggerMode"]) == (
        "Off",
        "Continuous",
        "On",
    )


def test_a_region_is_set_before_its_offset():
    device = StubDevice()
    armed(device, region=Region(x=2, y=1, width=4, height=3))
    assert [device.features[name] for name in ("OffsetX", "OffsetY", "Width", "Height")] == [2, 1, 4, 3]
    names = [entry[0] for entry in device.log if isinstance(entry, tuple)]
    assert names.index("Height") < len(names) - 1 - names[::-1].index("OffsetY")


@pytest.mark.parametrize(
    ("feature", "rounded", "changed"),
    [
        ("ExposureTime", lambda value: value * 1.02, {}),
        ("Gain", lambda value: value + 0.2, {}),
        ("GevSCPSPacketSize", lambda value: 1500, {"packet_size": 9000}),
        ("PixelFormat", lambda value: "Mono8", {"pixel_format": "Mono12"}),
        ("TriggerSource", lambda value: "Line1", {}),
        ("Width", lambda value: value - 1, {}),
        ("Gamma", lambda value: 0.7, {"features": (("Gamma", 1.0),)}),
    ],
)
def test_a_setting_that_the_camera_took_otherwise_is_an_error(feature, rounded, changed):
    device = StubDevice(Gamma=0.7)
    device.rounds[feature] = rounded
    with pytest.raises(CameraError, match=rf"{NAME}: expected {feature} .* as it was set, it is .*\. Set a"):
        armed(device, CameraSettings(gain_db=2.0), **changed)


def test_a_tolerance_lets_an_exposure_be_rounded():
    device = StubDevice()
    device.rounds["ExposureTime"] = lambda value: value * 1.02
    assert shot_of(armed(device, exposure_tolerance=0.03)).exposure_ms == pytest.approx(5.1)


@pytest.mark.parametrize(
    ("settings", "changed", "text"),
    [
        (CameraSettings(exposure_ms=5000.0), {}, r"ExposureTime to 5e.*|takes 10 to 1e\+06"),
        (CameraSettings(), {"features": (("Nonsense", 1),)}, "set Nonsense to 1, it has no such feature"),
        (CameraSettings(), {"trigger_source": "Line3", "ptp": True}, "says nothing|PTP"),
    ],
)
def test_a_setting_that_is_refused_is_told_with_what_it_takes(settings, changed, text):
    device = StubDevice(PtpStatus="Listening")
    with pytest.raises(CameraError, match=text):
        armed(device, settings, **changed)


def test_a_camera_without_gain_is_used_with_the_sensor_s_own_alone():
    device = StubDevice()
    del device.features["Gain"]
    assert shot_of(armed(device)).in_force.gain_db == 0.0
    with pytest.raises(CameraError, match="set Gain to 3"):
        armed(device, CameraSettings(gain_db=3.0))


@pytest.mark.parametrize(("feature", "value"), [("ExposureTime", 7000.0), ("Gain", 5.0)])
def test_an_exposure_or_gain_that_changed_later_is_found_at_the_next_frame(feature, value):
    device = StubDevice()
    camera = armed(device)
    shot_of(camera)
    device.features[feature] = value
    camera.trigger()
    with pytest.raises(CameraError, match=f"expected {feature} .* as when it was armed, it is {value:g}"):
        camera.fetch(0.5)
    camera.arm(CameraSettings())
    assert shot_of(camera).trigger_counter == 1


def test_any_other_setting_that_changed_later_is_found_within_as_many_frames_as_there_are_settings():
    device = StubDevice()
    camera = armed(device, packet_size=8192)
    device.features["GevSCPSPacketSize"] = 1500
    with pytest.raises(CameraError, match="GevSCPSPacketSize 8192 as when it was armed"):
        [shot_of(camera) for _ in range(8)]


@pytest.mark.parametrize(
    ("alters", "text"),
    [
        (lambda b: replace(b, problem="3 packets are missing"), "trigger 1 is incomplete: 3 packets"),
        (lambda b: replace(b, data=b.data[: WIDTH * HEIGHT - 1]), "expected 48 bytes .* its buffer has 47"),
        (lambda b: replace(b, data=NOTHING, width=0, height=0), "incomplete"),
        (lambda b: replace(b, pixel_format="Mono12"), "expected pixels of Mono8"),
        (lambda b: replace(b, frame_id=None), "has no number"),
    ],
)
def test_a_frame_that_is_not_whole_is_refused_and_its_buffer_given_back(alters, text):
    device = StubDevice()
    camera = armed(device)
    device.alters = alters
    camera.trigger()
    with pytest.raises(CameraError, match=text):
        camera.fetch(0.5)
    assert device.lent == 0
    device.alters = lambda buffer: buffer
    assert shot_of(camera).trigger_counter == 2


def test_a_frame_that_is_lost_on_the_way_leaves_a_gap_in_the_count():
    device = StubDevice()
    camera = armed(device)
    device.alters = lambda buffer: None
    camera.trigger()
    device.alters = lambda buffer: buffer
    assert shot_of(camera).trigger_counter == 2


@pytest.mark.parametrize("first", [0, 1])
def test_the_first_frame_is_of_the_first_trigger_with_every_transport(first):
    assert shot_of(armed(StubDevice(first_frame_id=first))).trigger_counter == 1


def test_a_ring_that_is_full_loses_frames_and_grows_no_further():
    device = StubDevice()
    camera = armed(device, buffers=2)
    for _ in range(5):
        camera.trigger()
    assert [camera.fetch(0.1).trigger_counter for _ in range(2)] == [1, 2]
    with pytest.raises(CameraTimeoutError):
        camera.fetch(0.0)


def test_a_trigger_amid_an_exposure_waits_until_the_camera_takes_it():
    device = StubDevice()
    camera = armed(device)
    device.log.clear()
    camera.trigger()
    camera.trigger()
    assert device.log == ["ready?", "TriggerSoftware"] * 2
    device.ready = False
    with pytest.raises(CameraError, match="expected to be ready for the next trigger within 2"):
        camera.trigger()


def test_a_camera_of_another_serial_number_is_refused():
    device = StubDevice(serial="9999")
    with pytest.raises(CameraConnectionError, match=r"expected the camera '4711', it answers with .* 9999"):
        camera_of(device).connect()
    assert not device.opened


def test_a_camera_that_was_exchanged_behind_its_name_is_refused():
    device = StubDevice(user_name="left eye")
    camera = camera_of(device, wanted="left eye")
    for _ in range(2):
        camera.connect()
        camera.close()
    device.seen = replace(device.seen, serial_number="9999")
    with pytest.raises(CameraConnectionError, match=r"expected the camera '4711', it answers with .* 9999"):
        camera.connect()


def test_a_camera_that_is_unplugged_is_lost_and_found_again():
    device = StubDevice()
    camera = armed(device)
    shot_of(camera)
    device.gone = True
    for act in (camera.trigger, lambda: camera.fetch(0.0), lambda: camera.arm(CameraSettings())):
        with pytest.raises(CameraConnectionError, match="connection was lost"):
            act()
    with pytest.raises(CameraConnectionError):
        camera.connect()
    device.gone = False
    camera.connect()
    camera.arm(CameraSettings())
    assert shot_of(camera).trigger_counter == 1


def test_a_library_that_raises_is_one_error_with_the_camera_s_name():
    device = StubDevice()
    camera = armed(device)
    device.execute = lambda name: (_ for _ in ()).throw(VendorError("0xE1000014\n  control channel"))
    with pytest.raises(
        CameraError, match=rf"{NAME}: its library failed \(trigger\): VendorError: 0xE1000014 "
    ):
        camera.trigger()


def test_whoever_waits_for_a_frame_is_let_go_when_the_camera_is_closed():
    device = StubDevice()
    camera = armed(device)
    waiting = threading.Event()
    errors = []
    retrieve = device.retrieve

    def retrieved(timeout_s):
        waiting.set()
        return retrieve(timeout_s)

    device.retrieve = retrieved

    def fetch():
        try:
            camera.fetch(60.0)
        except CameraError as error:
            errors.append(error)

    thread = threading.Thread(target=fetch)
    thread.start()
    assert waiting.wait(5.0)
    camera.close()
    thread.join(5.0)
    assert not thread.is_alive()
    assert isinstance(errors[0], CameraConnectionError)


def test_a_thousand_connections_leave_nothing_behind():
    device = StubDevice()
    camera = camera_of(device)
    before = threading.active_count()
    for _ in range(1000):
        camera.connect()
        camera.arm(CameraSettings())
        shot_of(camera)
        camera.close()
    assert (device.lent, len(device.ring), threading.active_count()) == (0, 0, before)


def rig_of(devices, **changed):
    chosen = options(cameras={"head_1": ("4711", "4712"), "head_2": ("4713", "4714")}, **changed)
    cameras = {
        (head, side): camera_of(
            device, chosen.leads(head, side), device.seen.serial_number, **changed, cameras=chosen.cameras
        )
        for (head, side), device in devices.items()
    }
    for (head, side), camera in cameras.items():
        camera.name = f"front_left/{head}/{side}"
    heads = [StereoHead(h, cameras[h, "left"], cameras[h, "right"]) for h in ("head_1", "head_2")]
    return Rig("front_left", heads, tolerance=FrameTolerance(device_time_s=0.02), now=lambda: TIME)


@pytest.fixture
def devices():
    places = [(head, side) for head in ("head_1", "head_2") for side in ("left", "right")]
    made = {place: StubDevice(str(4711 + n), model=f"stub {n}") for n, place in enumerate(places)}
    for number, device in enumerate(made.values()):
        # Each sees something else.
        device.alters = lambda b, n=number: replace(
            b, data=np.arange(len(b.data), dtype=np.uint8) + b.data + 16 * n
        )
    return made


def test_a_line_exposes_all_after_all_are_ready_for_it(devices):
    """Four commands one after the other are four moments; the leader's line is one."""
    leader = devices["head_2", "left"]
    leader.followers = [device for device in devices.values() if device is not leader]
    rig = rig_of(
        devices, trigger_source="Line1", leader=("head_2", "left"), exposure_output="Line2", features=()
    )
    rig.connect()
    rig.arm()
    leader.execute = lambda name, does=leader.execute: (
        [d.log.append("pulse") for d in devices.values()] and does(name)
    )
    order = []
    for camera in rig.cameras:
        trigger = camera.trigger
        camera.trigger = lambda c=camera, t=trigger: order.append(c.name) or t()
    for expected in (1, 2):
        shot = rig.shoot(0.5)
        assert {frame.trigger_counter for frame in shot.frames} == {expected}
    for device in devices.values():
        assert [what for what in device.log if what in ("ready?", "pulse")][1:] == ["ready?", "pulse"] * 2
    assert order[3] == order[7] == "front_left/head_2/left"
    sources = {place: device.features["TriggerSource"] for place, device in devices.items()}
    assert sources == {place: "Software" if place == ("head_2", "left") else "Line1" for place in devices}
    assert {device.log.count("TriggerSoftware") for device in leader.followers} == {0}
    assert {device.features["LineSource"] for device in devices.values()} == {"ExposureActive"}


def test_a_pulse_that_one_camera_missed_is_a_missing_frame_of_it(devices):
    leader = devices["head_1", "left"]
    leader.followers = [device for device in devices.values() if device is not leader][1:]
    rig = rig_of(devices, trigger_source="Line1", leader=("head_1", "left"), exposure_output="Line2")
    rig.connect()
    rig.arm()
    with pytest.raises(SeveralErrors) as caught:
        rig.shoot(0.05)
    assert [error.camera for error in caught.value.exceptions] == ["front_left/head_1/right"]
    assert "expected a frame of trigger 1 within 0.05 s, none at all" in str(caught.value)


def test_a_pulse_that_nobody_asked_for_is_told_by_the_camera_that_it_reached(devices):
    """A disturbed trigger line exposes one camera once too often: then it is one moment ahead."""
    leader = devices["head_1", "left"]
    leader.followers = [device for device in devices.values() if device is not leader]
    rig = rig_of(devices, trigger_source="Line1", leader=("head_1", "left"), exposure_output="Line2")
    rig.connect()
    rig.arm()
    rig.shoot(0.5)
    devices["head_2", "right"].seconds = 5.0
    devices["head_2", "right"].expose()
    for device in devices.values():
        device.seconds = 9.0
    with pytest.raises(SeveralErrors) as caught:
        rig.shoot(0.5)
    assert "head_2/right: a frame of another moment" in str(caught.value)
    rig.arm()
    assert rig.shoot(0.5).frames[0].trigger_counter == 1


def test_an_action_command_is_sent_once_and_exposes_all(devices):
    sender = devices["head_1", "left"]
    sender.followers = [device for device in devices.values() if device is not sender]
    keys = ActionOptions(device_key=7, group_key=8, group_mask=4, address="10.0.0.255")
    rig = rig_of(devices, trigger_source="Action1", action=keys)
    rig.connect()
    rig.arm()
    shot = rig.shoot(0.5)
    assert {frame.trigger_counter for frame in shot.frames} == {1}
    sent = [entry for device in devices.values() for entry in device.log if isinstance(entry, Action)]
    assert sent == [Action(7, 8, 4, "10.0.0.255")]
    assert all(("ActionDeviceKey", 7) in device.log for device in devices.values())
    assert {device.features["ActionGroupMask"] for device in devices.values()} == {4}


def test_a_frame_that_comes_twice_makes_the_shot_after_it_fail(devices):
    rig = rig_of(devices)
    rig.connect()
    rig.arm()
    rig.shoot(0.5)
    devices["head_1", "right"].put(1)
    with pytest.raises(SeveralErrors) as caught:
        rig.shoot(0.5)
    [error] = caught.value.exceptions
    assert error.camera == "front_left/head_1/right"
    assert "before the frame of trigger 2 it sent that of trigger 1 a second time" in str(error)


def place(*heads):
    return RigPlace("front_left", "left", heads, Path(), CameraSettings(), FrameTolerance())


@pytest.mark.parametrize(
    ("changed", "field"),
    [
        ({"cameras": {"head_1": ("1", "1")}}, "cameras"),
        ({"cameras": {"head_1": ("1", "2"), "head_2": ("3", "1")}}, "cameras"),
        ({"cameras": {"head_9": ("1", "2")}}, "cameras"),
        ({"leader": ("head_1", "left")}, "leader"),
        ({"leader": ("head_7", "left"), "trigger_source": "Line1"}, "leader"),
        ({"leader": ("head_1", "left"), "trigger_source": "Line1"}, "exposure_output"),
        (
            {"leader": ("head_1", "left"), "trigger_source": "Line1", "exposure_output": "Line1"},
            "exposure_output",
        ),
        ({"trigger_source": "Action1"}, "action"),
        ({"action": ActionOptions()}, "action"),
        ({"trigger_source": "Action1", "action": ActionOptions(ahead_ms=5.0)}, "action.ahead_ms"),
    ],
)
def test_options_that_contradict_each_other_are_found_without_a_camera(changed, field):
    with pytest.raises(ConfigurationError) as caught:
        check_options(options(**changed), place("head_1"))
    assert caught.value.field == field


@pytest.mark.parametrize(
    ("method", "within"),
    [
        ("arm", "start"),
        ("arm", "set"),
        ("trigger", "execute"),
        ("trigger", "wait_ready"),
        ("fetch", "retrieve"),
    ],
)
def test_a_camera_that_is_closed_amid_a_call_says_so_and_is_connected_again(method, within):
    device = StubDevice()
    camera = armed(device)
    call = getattr(device, within)

    def closed(*arguments):
        setattr(device, within, call)
        camera.close()
        raise VendorError("the handle is not valid")

    setattr(device, within, closed)
    with pytest.raises(CameraConnectionError, match="was closed amid a call"):
        getattr(camera, method)(*{"arm": (CameraSettings(exposure_ms=7.0),), "fetch": (0.1,)}.get(method, ()))
    camera.connect()
    with pytest.raises(CameraError, match="is not armed"):
        camera.trigger()
    camera.arm(CameraSettings())
    assert shot_of(camera).trigger_counter == 1


def test_a_gain_in_the_camera_s_own_steps_is_stored_as_such():
    device = StubDevice(GainRaw=200)
    del device.features["Gain"]
    assert shot_of(armed(device)).in_force.others == (("GainRaw", "200"),)


def test_a_device_that_fails_to_open_again_is_exchanged_for_a_new_one():
    used, fresh = StubDevice(), StubDevice()
    made = iter((used, fresh))
    camera = camera_of(used)
    camera._make = lambda: next(made)
    camera.connect()
    camera.close()
    used.gone = True
    with pytest.raises(CameraConnectionError):
        camera.connect()
    camera.connect()
    camera.arm(CameraSettings())
    assert shot_of(camera).trigger_counter == 1
    assert fresh.opened
