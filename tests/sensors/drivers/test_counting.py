"""Frames are counted by the camera's own numbers, wherever these begin and wherever they wrap."""

import pytest

from sensors.drivers.genicam.counting import FrameIds


@pytest.mark.parametrize("first", [0, 1])
def test_the_first_number_is_the_first_trigger_and_a_gap_is_a_frame_that_was_lost(first):
    ids = FrameIds(first)
    assert [ids.counter(first + n) for n in (0, 1, 4, 4, 3)] == [1, 2, 5, 5, 4]


def test_after_65535_comes_1_and_never_0():
    ids = FrameIds(1)
    for number in range(1, 65_536):
        assert ids.counter(number) == number
    assert [ids.counter(number) for number in (1, 2, 65_535, 3)] == [65_536, 65_537, 65_535, 65_538]


def test_numbers_of_64_bits_go_on():
    ids = FrameIds(1)
    assert [ids.counter(n) for n in (60_000, 65_535, 65_536, 65_537, 200_000)] == [
        60_000,
        65_535,
        65_536,
        65_537,
        200_000,
    ]
    ids = FrameIds(0)
    assert [ids.counter(n) for n in (70_000, 3)] == [70_001, 4]


def test_a_frame_from_before_the_acquisition_counts_as_no_trigger():
    assert FrameIds(1).counter(0) == 0
