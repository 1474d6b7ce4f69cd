"""The bad moments of a rig of six cameras."""

import re
from dataclasses import replace
from datetime import datetime

import numpy as np
import pytest

from alignment.errors import (
    CameraConnectionError,
    CameraError,
    CameraTimeoutError,
    ConfigurationError,
    DegenerateInputError,
    SeveralErrors,
)
from sensors.camera import Frame
from sensors.drivers.simulated import Faults, SimulatedCamera
from sensors.rig import Rig, StereoHead
from sensors.shot import HeadFrames, WheelShot
from tests.sensors.samples import TIME, StillClock


class Numbered:
    """Image whose pixels say camera and trigger."""

    def __init__(self, number):
        self.number = number

    def image(self, trigger_counter):
        return np.full((4, 5), 10 * trigger_counter + self.number, np.uint8)


def make_rig(clock, faults=None):
    """Six simulated cameras, numbered 0 to 5; `faults` by number."""
    faults = faults or {}
    cameras = [
        SimulatedCamera(
            f"front_left/head_{number // 2 + 1}/{('left', 'right')[number % 2]}",
            Numbered(number),
            faults.get(number),
            clock=clock,
            sleep=clock.sleep,
        )
        for number in range(6)
    ]
    heads = [StereoHead(f"head_{i + 1}", cameras[2 * i], cameras[2 * i + 1]) for i in range(3)]
    return Rig("front_left", heads, clock=clock, now=lambda: TIME)


@pytest.fixture
def clock():
    return StillClock()


def ready(clock, faults=None):
    rig = make_rig(clock, faults)
    rig.connect()
    rig.arm()
    return rig


def test_a_shot_holds_six_frames_of_one_trigger_in_order(clock):
    rig = ready(clock)
    rig.shoot(1.0)
    shot = rig.shoot(1.0)
    assert shot.rig == "front_left"
    assert shot.time_utc == TIME
    assert [head.name for head in shot.heads] == ["head_1", "head_2", "head_3"]
    assert [int(f.image[0, 0]) for f in shot.frames] == [20, 21, 22, 23, 24, 25]
    assert {f.trigger_counter for f in shot.frames} == {2}
    assert [int(pair.right[0, 0]) for pair in shot.images] == [21, 23, 25]


def test_dead_cameras_are_all_named_in_one_message_and_the_others_let_go(clock):
    rig = make_rig(clock, {1: Faults(unreachable=True), 4: Faults(unreachable=True)})
    with pytest.raises(SeveralErrors) as caught:
        rig.connect()
    assert caught.value.message == "rig front_left: 2 of 6 cameras did not connect"
    assert [e.camera for e in caught.value.exceptions] == [
        "front_left/head_1/right",
        "front_left/head_3/left",
    ]
    for camera in rig.cameras:
        with pytest.raises(CameraConnectionError):
            camera.trigger()


def test_a_camera_that_comes_back_connects_at_the_next_attempt(clock):
    rig = make_rig(clock, {3: Faults(unreachable=True)})
    with pytest.raises(SeveralErrors, match="1 of 6"):
        rig.connect()
    rig.cameras[3].faults = Faults()
    rig.connect()
    rig.arm()
    assert len(rig.shoot(1.0).frames) == 6


def test_a_late_camera_within_the_bound_is_waited_for(clock):
    rig = ready(clock, {2: Faults(delays_s={1: 0.3})})
    shot = rig.shoot(1.0)
    assert clock.now == pytest.approx(100.3)
    assert {f.trigger_counter for f in shot.frames} == {1}


def test_silent_cameras_together_take_no_longer_than_the_bound(clock):
    rig = ready(clock, {n: Faults(dropped=frozenset({1})) for n in range(6)})
    with pytest.raises(SeveralErrors, match="6 of 6 cameras did not deliver") as caught:
        rig.shoot(0.5)
    assert clock.now - 100.0 <= 0.5 + 1e-9
    assert all(isinstance(e, CameraTimeoutError) for e in caught.value.exceptions)
    assert "expected a frame of trigger 1 within 0.5 s, none at all" in str(caught.value)


def test_the_frame_that_came_too_late_is_not_taken_for_the_next_trigger(clock):
    rig = ready(clock, {5: Faults(delays_s={1: 0.9})})
    with pytest.raises(SeveralErrors) as caught:
        rig.shoot(0.5)
    assert "head_3/right" in str(caught.value)
    clock.sleep(1.0)
    shot = rig.shoot(0.5)
    assert int(shot.heads[2].right.image[0, 0]) == 25
    assert {f.trigger_counter for f in shot.frames} == {2}


def test_a_stale_frame_in_place_of_the_new_one_is_a_timeout_that_says_what_was_seen(clock):
    rig = ready(clock, {0: Faults(stale=frozenset({2}))})
    rig.shoot(0.5)
    with pytest.raises(SeveralErrors) as caught:
        rig.shoot(0.5)
    assert len(caught.value.exceptions) == 1
    assert "expected a frame of trigger 2 within 0.5 s, last seen one of trigger 1" in str(caught.value)


def test_left_and_right_out_of_step_are_refused_until_the_rig_is_armed_again(clock):
    rig = ready(clock)
    rig.cameras[1].trigger()
    with pytest.raises(SeveralErrors) as caught:
        rig.shoot(0.5)
    (error,) = caught.value.exceptions
    assert isinstance(error, CameraError)
    assert "head_1/right: out of step: expected to count trigger 1, it counted 2" in str(error)
    assert "Arm the rig again" in str(error)
    rig.arm()
    assert len(rig.shoot(0.5).frames) == 6


def test_a_frame_of_a_later_trigger_is_out_of_step(clock):
    rig = ready(clock)
    camera = rig.cameras[0]
    trigger, counter = camera.trigger, iter([1])
    camera.trigger = lambda: (trigger(), trigger(), camera.fetch(0.0), next(counter))[-1]
    with pytest.raises(SeveralErrors) as caught:
        rig.shoot(0.5)
    assert "out of step: expected a frame of trigger 1, it sent one of trigger 2" in str(caught.value)


def test_a_camera_lost_in_the_run_and_a_silent_one_are_reported_together(clock):
    rig = ready(clock, {0: Faults(lost_at=1), 3: Faults(dropped=frozenset({1}))})
    with pytest.raises(SeveralErrors, match="2 of 6 cameras did not deliver") as caught:
        rig.shoot(0.5)
    kinds = {e.camera: type(e) for e in caught.value.exceptions}
    assert kinds == {
        "front_left/head_1/left": CameraConnectionError,
        "front_left/head_2/right": CameraTimeoutError,
    }


def test_cameras_that_cannot_be_armed_are_all_named(clock):
    rig = make_rig(clock)
    with pytest.raises(SeveralErrors, match="6 of 6 cameras did not take their settings"):
        rig.arm()


def test_a_failing_close_does_not_hide_why_connect_failed(clock):
    rig = make_rig(clock, {0: Faults(unreachable=True)})

    def broken():
        raise CameraError("front_left/head_3/right", "does not let go")

    rig.cameras[5].close = broken
    with pytest.raises(SeveralErrors, match="1 of 6 cameras did not connect"):
        rig.connect()
    with pytest.raises(SeveralErrors) as caught:
        rig.close()
    assert "1 of 6 cameras did not close; camera front_left/head_3/right: does not let go" in str(
        caught.value
    )


def test_a_rig_needs_heads_and_names_that_differ(clock):
    one, two = make_rig(clock).heads[:2]
    for heads in ([], [one, one], [one, StereoHead("head_2", two.left, one.right)]):
        with pytest.raises(ConfigurationError, match="front_left"):
            Rig("front_left", heads)


def test_a_shot_refuses_frames_of_different_triggers():
    image = np.zeros((4, 5), np.uint8)
    left, right = Frame("a", image, 1, 0.0, 0.0, 1.0), Frame("b", image, 2, 0.0, 0.0, 1.0)
    with pytest.raises(DegenerateInputError, match=r"head_1\.trigger_counter.*found 1 and 2"):
        HeadFrames("head_1", left, right)
    head = HeadFrames("head_1", left, left)
    with pytest.raises(DegenerateInputError, match="time_utc"):
        WheelShot("rig", datetime(2026, 3, 1), (head,))
    with pytest.raises(DegenerateInputError, match="heads"):
        WheelShot("rig", TIME, (head, head))


class _Vendor(SimulatedCamera):
    """A driver whose makers have errors and frames of their own."""

    def __init__(self, name, clock, **spoilt):
        super().__init__(name, Numbered(0), clock=clock, sleep=clock.sleep)
        self.spoilt = spoilt

    def _do(self, what):
        spoilt = self.spoilt.get(what)
        if isinstance(spoilt, BaseException):
            raise spoilt

    def connect(self):
        self._do("connect")
        super().connect()

    def arm(self, settings):
        self._do("arm")
        super().arm(settings)

    def trigger(self):
        self._do("trigger")
        return super().trigger()

    def fetch(self, timeout_s):
        self._do("fetch")
        frame = super().fetch(timeout_s)
        return self.spoilt["frame"](frame) if "frame" in self.spoilt else frame


def vendor_rig(clock, **spoilt):
    cameras = [_Vendor("front_left/head_1/left", clock, **spoilt), _Vendor("front_left/head_1/right", clock)]
    return Rig("front_left", [StereoHead("head_1", *cameras)], clock=clock, now=lambda: TIME)


@pytest.mark.parametrize("what", ["connect", "arm", "trigger", "fetch"])
@pytest.mark.parametrize(
    ("raised", "kind"),
    [
        (RuntimeError("GC_ERR_TIMEOUT\n(-1011)"), CameraError),
        (KeyError("exposure"), CameraError),
        (OSError(19, "No such device"), CameraError),
        (ConnectionResetError("peer"), CameraConnectionError),
        (TimeoutError(), CameraTimeoutError),
    ],
)
def test_whatever_a_driver_raises_is_a_failure_of_its_camera(clock, what, raised, kind):
    """Errors of a driver's own makers went through the cycle as a defect of the program."""
    rig = vendor_rig(clock, **{what: raised})

    def use():
        rig.connect()
        rig.arm()
        rig.shoot(1.0)

    with pytest.raises(SeveralErrors) as caught:
        use()
    [error] = caught.value.exceptions
    assert isinstance(error, kind)
    assert error.camera == "front_left/head_1/left"
    if kind is not CameraTimeoutError:
        assert type(raised).__name__ in str(error)
    assert "\n" not in str(error)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda frame: None, "found nothing"),
        (lambda frame: frame.image, "found a ndarray"),
        (lambda frame: replace(frame, image=frame.image.astype(float)), "an image of type float64"),
        (lambda frame: replace(frame, image=np.dstack(3 * [frame.image])), r"an image of shape \(4, 5, 3\)"),
        (lambda frame: replace(frame, image=frame.image[:0]), r"an image of shape \(0, 5\)"),
        (lambda frame: replace(frame, image=[[1]]), "found a list in place of an image"),
        (lambda frame: replace(frame, camera="left"), "a frame of camera left"),
        (lambda frame: replace(frame, trigger_counter="1"), "a trigger counter '1'"),
        (lambda frame: replace(frame, device_time_s=float("nan")), "times nan"),
        (lambda frame: replace(frame, device_time_s="now"), "TypeError"),
    ],
)
def test_frame_that_is_none_is_a_failure_of_its_camera(clock, spoil, words):
    rig = vendor_rig(clock, frame=spoil)
    rig.connect()
    rig.arm()
    with pytest.raises(SeveralErrors) as caught:
        rig.shoot(1.0)
    [error] = caught.value.exceptions
    assert error.camera == "front_left/head_1/left"
    assert re.search(words, str(error))


def test_driver_that_sends_old_frames_for_ever_does_not_hold_up_the_shot(clock):
    """The rig went on fetching for as long as frames of earlier triggers came."""
    rig = vendor_rig(clock)
    rig.connect()
    rig.arm()

    def again(timeout_s):
        return Frame("front_left/head_1/left", np.ones((4, 5), np.uint8), 0, 1.0, clock(), 5.0)

    rig.heads[0].left.fetch = again
    with pytest.raises(SeveralErrors) as caught:
        rig.shoot(1.0)
    assert "it sent one more of trigger 0" in str(caught.value)
