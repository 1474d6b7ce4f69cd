"""Results judged straight ahead or at the design height: a replay compares what the rig measured."""

from __future__ import annotations

import math

import pytest

from station.replay.stored import _values
from tests.db.example_records import corrected_wheel, cycle, geometry, steering, wheel


def test_the_angles_as_measured_are_compared_and_not_the_judged_ones() -> None:
    """Every corrected wheel would have differed by its correction."""
    corrected = corrected_wheel()
    values, loose = _values(cycle(wheels=(corrected,), steering=steering()), corrected)
    assert (values["camber"], values["toe"]) == (corrected.camber_raw, corrected.toe_raw)
    assert (values["camber_u"], values["toe_u"]) == (corrected.camber_raw_u, corrected.toe_raw_u)
    assert loose == {}


@pytest.mark.parametrize(("name", "sign"), [("front_left", 1.0), ("front_right", -1.0)])
def test_in_the_vehicles_own_frame_the_yaw_is_taken_off_the_measured_toe(name: str, sign: float) -> None:
    corrected = corrected_wheel(name)
    values, loose = _values(cycle(wheels=(corrected,), geometry=geometry()), corrected)
    assert corrected.toe_raw is not None
    assert values["toe"] == pytest.approx(corrected.toe_raw - sign * math.radians(0.1))
    assert values["camber"] == corrected.camber_raw
    assert set(loose) == {"camber", "toe"}


def test_a_wheel_that_was_not_corrected_is_compared_as_ever() -> None:
    plain = wheel()
    values, _ = _values(cycle(wheels=(plain,)), plain)
    assert (values["camber"], values["toe"], values["toe_u"]) == (plain.camber, plain.toe, plain.toe_u)
