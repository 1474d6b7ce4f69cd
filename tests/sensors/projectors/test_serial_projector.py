"""The bad moments of a projector on a serial line; the other end is a pseudo-terminal."""

import time

import pytest

from alignment.errors import ProjectorError, ProjectorTimeoutError
from sensors.projectors.projector import ProjectorState
from sensors.projectors.serial import SerialOptions, SerialProjector
from tests.sensors.projectors.fakes import PretendedController


def projector(controller, timeout_s=0.2):
    return SerialProjector("front_left", SerialOptions(port=controller.port, timeout_s=timeout_s))


def test_it_is_lit_as_bright_as_told_and_dark_for_an_exposure():
    with PretendedController() as controller:
        light = projector(controller)
        light.connect()
        light.light(0.65)
        assert (controller.lit, controller.level) == (True, 65.0)
        assert light.state() == ProjectorState("Example,LP-3,1234,2.1", True, 0.65, 41.5, None)
        light.dark()
        assert not controller.lit
        light.light(0.65)
        light.close()
        assert light.connect() is None, "it can be connected again"
        assert not controller.lit, "it is left dark"
        light.close()


def test_a_port_that_is_not_there_names_the_rig_and_the_port():
    light = SerialProjector("front_left", SerialOptions(port="/dev/no-such-port"))
    with pytest.raises(ProjectorError, match=r"projector of front_left: .*/dev/no-such-port"):
        light.connect()


@pytest.mark.parametrize("answer", [None, "Exam"])
def test_one_that_falls_silent_is_given_up_within_the_bound(answer):
    with PretendedController({"LIGHT:LEVEL?": answer}) as controller:
        light = projector(controller, timeout_s=0.1)
        light.connect()
        began = time.monotonic()
        with pytest.raises(ProjectorTimeoutError, match=r"LIGHT:LEVEL\? within 0.1 s"):
            light.light(1.0)
        assert time.monotonic() - began < 2.0
        with pytest.raises(ProjectorError, match="not connected"):
            light.dark()
        controller.answers.clear()
        light.connect()
        light.light(1.0)
        assert controller.lit
        light.close()


@pytest.mark.parametrize(
    ("answers", "told"),
    [
        ({"LIGHT:LEVEL?": "60.0\n"}, "expected a brightness of 80.0%, it says 60.0%"),
        ({"LIGHT:LEVEL?": "bright\n"}, "expected a number in answer to LIGHT:LEVEL?, it said 'bright'"),
        ({"LIGHT:STATE?": "0\n"}, "expected it to be on, it says that it is not"),
        ({"LIGHT:LEVEL?": "nan\n"}, "expected a brightness of 80.0%"),
        ({"LIGHT:STATE?": "9" * 5000}, "it sends on and on"),
    ],
)
def test_light_that_is_not_as_told_is_a_fault(answers, told):
    with PretendedController(answers) as controller:
        light = projector(controller)
        light.connect()
        with pytest.raises(ProjectorError) as caught:
            light.light(0.8)
        assert told in str(caught.value)
        assert str(caught.value).startswith("projector of front_left: ")
        light.close()


class Unplugged:
    """A port whose cable is pulled."""

    def __init__(self):
        self.closed = False

    def write(self, data):
        raise OSError(5, "Input/output error")

    def read_until(self, expected=b"\n", size=None):
        raise OSError(5, "Input/output error")

    def reset_input_buffer(self):
        pass

    def close(self):
        self.closed = True


def test_one_that_is_unplugged_is_lost_with_its_place_and_lets_the_port_go():
    port = Unplugged()
    light = SerialProjector("rear_right", SerialOptions(port="COM1"), lambda options: port)
    with pytest.raises(ProjectorError, match=r"projector of rear_right: the line to it is lost: .*error"):
        light.connect()
    assert port.closed
