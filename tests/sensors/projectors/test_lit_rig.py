"""The bad moments of a rig whose projector is a device of it."""

import numpy as np
import pytest

from alignment.errors import CameraConnectionError, ConfigurationError, ProjectorError, SeveralErrors
from sensors.drivers.simulated import Faults
from sensors.projectors.lit_rig import LitRig, RigLight
from sensors.projectors.none import UnspokenProjector
from tests.sensors.projectors.fakes import NotedProjector
from tests.sensors.samples import StillClock
from tests.sensors.test_rig import make_rig


def assert_let_go(rig):
    for camera in rig.rig.cameras:
        with pytest.raises(CameraConnectionError):
            camera.trigger()


BROKEN = ProjectorError("front_left", "broken")


def lit_rig(light=None, faults=None):
    clock = StillClock()
    projector = NotedProjector()
    return LitRig(make_rig(clock, faults), projector, light, clock), projector, clock


def test_it_is_lit_when_armed_and_let_go_with_its_cameras():
    rig, projector, _ = lit_rig(RigLight(0.4))
    rig.connect()
    rig.arm()
    shot = rig.shoot(1.0)
    rig.close()
    assert projector.log == [("connect",), ("light", 0.4), ("close",)]
    assert shot.dark == ()


def test_a_dark_exposure_is_the_next_trigger_while_the_projector_is_off():
    rig, projector, _ = lit_rig(RigLight(0.4, dark=True))
    rig.connect()
    rig.arm()
    first, second = rig.shoot(1.0), rig.shoot(1.0)
    assert projector.log[2:] == [("dark",), ("light", 0.4)] * 2
    assert [{f.trigger_counter for f in s.frames} for s in (first, second)] == [{1}, {3}]
    assert [{f.trigger_counter for f in s.dark_frames} for s in (first, second)] == [{2}, {4}]
    assert (first.number, second.number) == (1, 2)
    assert int(first.dark[0].left.image[0, 0]) - int(first.heads[0].left.image[0, 0]) == 10


def test_both_exposures_together_take_no_longer_than_the_bound():
    rig, _, clock = lit_rig(RigLight(dark=True), {0: Faults(delays_s={1: 0.7}, dropped=frozenset({2}))})
    rig.connect()
    rig.arm()
    with pytest.raises(SeveralErrors) as caught:
        rig.shoot(1.0)
    assert "head_1/left" in str(caught.value)
    assert clock.now - 100.0 <= 1.0 + 1e-9


def test_a_camera_that_fails_in_the_dark_leaves_the_wheel_lit():
    rig, projector, _ = lit_rig(RigLight(dark=True), {0: Faults(dropped=frozenset({2}))})
    rig.connect()
    rig.arm()
    with pytest.raises(SeveralErrors):
        rig.shoot(0.1)
    assert projector.log[-1] == ("light", 1.0)


@pytest.mark.parametrize("moment", ["light", "dark"])
@pytest.mark.parametrize("error", [BROKEN, OSError("broken")])
def test_a_projector_that_fails_is_an_error_of_its_rig(moment, error):
    rig, projector, _ = lit_rig(RigLight(dark=True))
    rig.connect()
    projector.failing[moment] = error

    def cycle():
        rig.arm()
        rig.shoot(1.0)

    with pytest.raises(ProjectorError, match=r"projector of front_left: .*broken"):
        cycle()


def test_cameras_and_projector_that_fail_to_connect_are_told_together():
    rig, projector, _ = lit_rig(faults={1: Faults(unreachable=True)})
    projector.failing["connect"] = BROKEN
    with pytest.raises(SeveralErrors) as caught:
        rig.connect()
    assert "projector of front_left: broken" in str(caught.value)
    assert "head_1/right" in str(caught.value)


def test_cameras_are_let_go_where_the_projector_does_not_connect():
    rig, projector, _ = lit_rig()
    projector.failing["connect"] = BROKEN
    with pytest.raises(ProjectorError):
        rig.connect()
    assert_let_go(rig)
    del projector.failing["connect"]
    rig.connect()
    rig.arm()
    assert np.any(rig.shoot(1.0).frames[0].image)


def test_a_projector_that_does_not_close_keeps_no_camera():
    rig, projector, _ = lit_rig()
    rig.connect()
    projector.failing["close"] = BROKEN
    with pytest.raises(ProjectorError):
        rig.close()
    assert_let_go(rig)


def test_no_dark_exposure_is_promised_of_a_projector_that_is_always_lit():
    with pytest.raises(ConfigurationError, match="dark"):
        LitRig(make_rig(StillClock()), UnspokenProjector("front_left"), RigLight(dark=True))


@pytest.mark.parametrize("brightness", [0.0, -0.1, 1.1, float("nan")])
def test_no_brightness_outside_its_range_is_taken(brightness):
    with pytest.raises(ConfigurationError, match="brightness"):
        RigLight(brightness)
