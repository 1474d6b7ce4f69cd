"""Drivers of projectors that hang, raise or lie: the thread that measures a wheel always comes back."""

import threading

import pytest

from alignment.errors import ProjectorConnectionError, ProjectorError, ProjectorTimeoutError, SeveralErrors
from sensors.bounded import MOST_LEFT, CallBounds
from sensors.drivers.simulated import Faults
from sensors.projectors.guarded import GuardedProjector
from sensors.projectors.lit_rig import LitRig, RigLight
from tests.sensors.projectors.fakes import Lamp, ScriptedProjector
from tests.sensors.samples import StillClock
from tests.sensors.scripted import Patience
from tests.sensors.test_rig import make_rig

BOUNDS = CallBounds(call_s=10.0, trigger_s=4.0)
BOUND_OF = {"connect": 10.0, "light": 4.0, "dark": 4.0, "state": 10.0, "close": 10.0}
SWITCHES = ("light", "dark", "state")


@pytest.fixture
def lamp():
    lamp = Lamp()
    yield lamp
    lamp.hangs.clear()
    lamp.raises.clear()
    lamp.go_on.set()


@pytest.fixture
def patience(lamp):
    return Patience(lamp)


@pytest.fixture
def projector(lamp, patience):
    projector = GuardedProjector(ScriptedProjector(lamp), "front_left", lamp.make, BOUNDS, patience)
    yield projector
    lamp.hangs.clear()
    lamp.raises.clear()
    lamp.go_on.set()
    projector.close()
    for thread in threads():
        thread.join(5.0)
    assert not threads()


def threads():
    return [thread for thread in threading.enumerate() if thread.name.startswith("projector ")]


def do(projector, what):
    projector.connect()
    if what == "light":
        projector.light(0.5)
    elif what != "connect":
        getattr(projector, what)()


@pytest.mark.parametrize("what", BOUND_OF)
def test_a_call_that_hangs_is_left_within_its_bound_and_another_driver_object_lights(
    projector, lamp, patience, what
):
    """The call held the thread of the wheel, the cycle ended by its own bound, and no reset helped."""
    lamp.hangs.add(what)
    bound = f"its driver did not come back from {what} within {BOUND_OF[what]:g} s"
    with pytest.raises(ProjectorConnectionError, match=f"^projector of front_left: {bound}"):
        do(projector, what)
    assert patience.bounds_s == [BOUND_OF[what]]
    assert projector.left_behind == 1
    with pytest.raises(ProjectorConnectionError, match="did not come back"):
        projector.light(0.7)
    lamp.hangs.clear()
    hung = threads()
    projector.connect()
    projector.light(0.7)
    assert (lamp.share, lamp.made) == (0.7, 1)
    # The one that hung closes its driver object when it comes back, and ends.
    lamp.go_on.set()
    for thread in hung:
        thread.join(5.0)
    assert projector.left_behind == 0
    assert lamp.open == 1


def test_a_projector_that_hangs_again_and_again_leaves_few_threads_and_says_what_to_do(projector, lamp):
    lamp.hangs.add("connect")
    for _ in range(MOST_LEFT):
        with pytest.raises(ProjectorConnectionError, match="from connect within"):
            projector.connect()
    with pytest.raises(ProjectorConnectionError, match=r"from 3 calls\. Start the station anew"):
        projector.connect()
    assert len(threads()) == MOST_LEFT


def test_a_projector_of_which_there_is_one_object_is_waited_for(lamp, patience):
    projector = GuardedProjector(ScriptedProjector(lamp), "front_left", None, BOUNDS, patience)
    lamp.hangs.add("light")
    with pytest.raises(ProjectorConnectionError):
        do(projector, "light")
    with pytest.raises(ProjectorConnectionError, match=r"from light within 4 s, and still has not\. Cut"):
        projector.connect()
    lamp.hangs.clear()
    lamp.go_on.set()
    for thread in threads():
        thread.join(5.0)
    projector.connect()
    projector.light(0.5)
    projector.close()
    assert (lamp.share, lamp.open) == (0.5, 0)


@pytest.mark.parametrize("what", SWITCHES)
@pytest.mark.parametrize(
    ("raised", "kind", "text"),
    [
        (OSError("no such device"), ProjectorError, "its driver failed ({}): OSError: no such device"),
        (TimeoutError("late"), ProjectorTimeoutError, "its driver failed ({}): TimeoutError: late"),
        (ConnectionResetError("gone"), ProjectorConnectionError, "its driver failed ({})"),
        (ProjectorTimeoutError("lamp 7", "no answer", "Look"), ProjectorTimeoutError, "no answer. Look"),
        (SystemExit("bye"), ProjectorError, "its driver failed ({}): "),
    ],
)
def test_whatever_a_driver_raises_is_of_this_projector_and_it_is_reached_anew(
    projector, lamp, what, raised, kind, text
):
    """A driver that believed itself connected stayed as it was at every reset."""
    lamp.raises[what] = raised
    with pytest.raises(kind) as caught:
        do(projector, what)
    assert str(caught.value).startswith(f"projector of front_left: {text.format(what)}")
    lamp.raises.clear()
    lamp.calls.clear()
    projector.connect()
    assert lamp.calls == ["close", "connect"]
    projector.light(0.3)
    assert lamp.share == 0.3


def test_one_that_did_not_fail_is_left_alone_by_a_reset(projector, lamp):
    do(projector, "light")
    lamp.calls.clear()
    projector.connect()
    assert lamp.calls == ["connect"]


def test_a_state_that_is_none_is_told(projector, lamp):
    lamp.answer = {"lit": True}
    with pytest.raises(ProjectorError, match="expected a ProjectorState from its driver, found a dict"):
        do(projector, "state")


@pytest.mark.parametrize("what", ["light", "dark"])
def test_a_rig_whose_projector_hangs_comes_back_lets_no_camera_go_astray_and_works_again(
    projector, lamp, what
):
    rig = LitRig(make_rig(StillClock()), projector, RigLight(0.4, dark=True))
    rig.connect()
    rig.arm()
    lamp.hangs.add(what)
    with pytest.raises(ProjectorConnectionError, match=f"did not come back from {what}"):
        rig.shoot(1.0)
    lamp.hangs.clear()
    rig.connect()
    rig.arm()
    shot = rig.shoot(1.0)
    assert len(shot.frames) == len(shot.dark_frames) == 6
    assert lamp.share == 0.4
    rig.close()


def test_a_projector_that_hangs_while_it_connects_is_told_with_the_cameras_that_do_not(projector, lamp):
    rig = LitRig(make_rig(StillClock(), {1: Faults(unreachable=True)}), projector)
    lamp.hangs.add("connect")
    with pytest.raises(SeveralErrors) as caught:
        rig.connect()
    assert "projector of front_left: its driver did not come back from connect" in str(caught.value)
    assert "head_1/right" in str(caught.value)
