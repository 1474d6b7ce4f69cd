"""Assertions of the field, for tests here and in plants."""

from __future__ import annotations

from alignment.units import ARCMIN


def assert_angle_within(measured: float, expected: float, arcmin: float, what: str = "angle") -> None:
    """Fail unless two angles, radians, agree within so many arcminutes; the message gives the difference."""
    difference = (measured - expected) / ARCMIN
    assert abs(difference) <= arcmin, f"{what} differs by {difference:+.4f}′, allowed is {arcmin}′"
