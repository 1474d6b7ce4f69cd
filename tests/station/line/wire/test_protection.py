"""End-to-end protection: the published vectors of AUTOSAR, and how counters are judged."""

from __future__ import annotations

import pytest
from e2e.crc import calculate_crc8
from hypothesis import given
from hypothesis import strategies as st

from station.line.wire.protection import Check, E2eParameters, Guard, Protector, protect

# The counter runs from 0 to 14.
COUNTERS = 15
MESSAGE = E2eParameters(data_id=0x123, max_delta=3)


@pytest.mark.parametrize(
    ("data", "crc"),
    [
        ("00000000", 0x59),
        ("F20183", 0x37),
        ("0FAA0055", 0x79),
        ("00FF5511", 0xB8),
        ("332255AABBCCDDEEFF", 0xCB),
        ("926B55", 0x8C),
        ("FFFFFFFF", 0x74),
    ],
)
def test_crc_against_the_table_of_the_autosar_crc_specification(data: str, crc: int) -> None:
    """SWS CRC Library, CRC-8 SAE J1850, table of examples."""
    assert calculate_crc8(bytes.fromhex(data)) == crc


@pytest.mark.parametrize(("counter", "frame"), [(0, "CC00000000000000"), (1, "9101000000000000")])
def test_frames_against_the_examples_of_the_autosar_e2e_specification(counter: int, frame: str) -> None:
    """PRS E2E Protocol, profile 1 with both bytes of data id 0x123 in the CRC, eight bytes of zeros."""
    data = bytearray(8)
    protect(data, 0x123, counter)
    assert data.hex().upper() == frame


def frame(counter: int, content: bytes = bytes(6), data_id: int = 0x123) -> bytearray:
    data = bytearray(2) + content
    protect(data, data_id, counter)
    return data


def judged(*counters: int) -> list[Check]:
    guard = Guard({"m": MESSAGE})
    return [guard.check("m", frame(counter)) for counter in counters]


def test_first_frame_only_sets_the_counter() -> None:
    assert judged(5, 6) == [Check.INITIAL, Check.OK]


def test_counter_wraps_after_fourteen() -> None:
    assert judged(13, 14, 0, 1) == [Check.INITIAL, Check.OK, Check.OK, Check.OK]


@pytest.mark.parametrize(
    ("step", "check"),
    [(0, Check.REPEATED), (1, Check.OK), (2, Check.SOME_LOST), (3, Check.SOME_LOST)]
    + [(step, Check.WRONG_SEQUENCE) for step in range(4, COUNTERS)],
)
@pytest.mark.parametrize("start", [0, 7, 14])
def test_steps_of_the_counter(start: int, step: int, check: Check) -> None:
    assert judged(start, (start + step) % COUNTERS) == [Check.INITIAL, check]


def test_after_a_jump_one_good_frame_must_come_before_the_next_counts() -> None:
    assert judged(0, 1, 9, 10, 11) == [
        Check.INITIAL,
        Check.OK,
        Check.WRONG_SEQUENCE,
        Check.SYNC,
        Check.OK,
    ]


def test_replayed_frame_does_not_count_and_does_not_disturb() -> None:
    assert judged(0, 1, 1, 2) == [Check.INITIAL, Check.OK, Check.REPEATED, Check.OK]


def test_only_what_is_right_counts() -> None:
    assert {check for check in Check if check.counts} == {Check.OK, Check.SOME_LOST}
    assert {check for check in Check if check.is_error} == {
        Check.REPEATED,
        Check.WRONG_SEQUENCE,
        Check.WRONG_CRC,
    }


@given(st.binary(min_size=6, max_size=6), st.integers(0, 63), st.integers(0, 14))
def test_every_single_flipped_bit_is_found(content: bytes, bit: int, counter: int) -> None:
    guard = Guard({"m": MESSAGE})
    guard.check("m", frame((counter - 1) % COUNTERS))
    data = frame(counter, content)
    data[bit // 8] ^= 1 << bit % 8
    assert guard.check("m", data) is Check.WRONG_CRC
    assert guard.check("m", frame(counter, content)) is Check.OK


@pytest.mark.parametrize("length", [0, 1])
def test_frame_too_short_to_be_protected(length: int) -> None:
    assert Guard({"m": MESSAGE}).check("m", bytes(length)) is Check.WRONG_CRC


def test_counter_fifteen_is_never_right() -> None:
    data = frame(15)
    assert data[1] == 15
    assert Guard({"m": MESSAGE}).check("m", data) is Check.WRONG_CRC


def test_frame_of_another_message_is_not_taken_for_this_one() -> None:
    assert Guard({"m": MESSAGE}).check("m", frame(0, data_id=0x124)) is Check.WRONG_CRC


def test_sender_counts_each_message_by_itself() -> None:
    protector = Protector({"a": MESSAGE, "b": E2eParameters(7)})
    counters = []
    for name in ("a", "a", "b", *("a",) * COUNTERS):
        data = bytearray(b"\0\xf0" + bytes(6))
        protector.protect(name, data)
        assert data[1] & 0xF0 == 0xF0, "the other half of the byte is the message's own"
        counters.append(data[1] & 0x0F)
    assert counters == [0, 1, 0, *range(2, COUNTERS), 0, 1]


def test_receiver_begins_anew_and_counts_what_it_saw() -> None:
    guard = Guard({"m": MESSAGE})
    for counter in (0, 1, 9):
        guard.check("m", frame(counter))
    guard.forget()
    assert [guard.check("m", frame(counter)) for counter in (10, 11)] == [Check.INITIAL, Check.OK]
    assert guard.counts[Check.INITIAL] == 2
    assert guard.counts[Check.OK] == 2
    assert guard.counts[Check.WRONG_SEQUENCE] == 1
