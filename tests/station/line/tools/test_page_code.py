"""C code, vectors and tables of `docs/line-interface.md` against the program: every frame is accepted."""

from __future__ import annotations

import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from station.line.wire.dbc import LineDatabase, load_line_database
from station.line.wire.protection import Guard, Protector, protect
from tests.station.line.line_bench import DBC
from tests.station.line.page import TEXT, PageCode, Receiver, Signal, messages, rows

DATABASE = load_line_database(DBC)
NAMES = sorted(DATABASE.protected)
PAGE_MESSAGES = messages()


@pytest.fixture(scope="module")
def code(tmp_path_factory: pytest.TempPathFactory) -> PageCode:
    return PageCode(tmp_path_factory.mktemp("page"))


def test_published_code_gives_the_published_vectors(code: PageCode) -> None:
    """The page said start value 0xFF and inverted at the end, in words and in C; its own vectors did not."""
    found = re.findall(r"`((?:[0-9A-F]{2} ){7}[0-9A-F]{2})`", TEXT.split("To test yours")[1].split("\n\n")[0])
    assert found == ["CC 00 00 00 00 00 00 00", "91 01 00 00 00 00 00 00"]
    assert code.protect(bytes(8), 0x123, 0) == (bytes.fromhex(found[0]), 1)
    assert code.protect(bytes(8), 0x123, 1) == (bytes.fromhex(found[1]), 2)
    vectors = rows("message | content | counter")
    assert len(vectors) == 6
    for name, _, counter, frame in vectors:
        data = bytes.fromhex(frame.strip("`"))
        message = PAGE_MESSAGES[name]
        assert code.crc(data, message.data_id) == data[0]
        assert code.protect(data, message.data_id, int(counter))[0] == data


def test_words_about_the_crc_are_those_of_the_code() -> None:
    section = " ".join(TEXT.split("## End-to-end protection")[1].split("```c")[0].split())
    polynomial, start = re.findall(
        r"polynomial (0x\w\w) .*start value (0x\w\w), and is not inverted", section
    )[0]
    crc = int(start, 16)
    for byte in (0x23, 0x01, *bytes(7)):
        crc ^= byte
        for _ in range(8):
            crc = ((crc << 1) ^ int(polynomial, 16)) & 0xFF if crc & 0x80 else crc << 1
    assert crc == 0xCC


@given(st.sampled_from(NAMES), st.binary(min_size=8, max_size=8), st.integers(0, 14))
def test_every_frame_that_the_library_packs_is_the_page_s_frame(
    code: PageCode, name: str, payload: bytes, counter: int
) -> None:
    data = bytearray(payload)
    protect(data, DATABASE.protected[name].data_id, counter)
    assert code.protect(payload, PAGE_MESSAGES[name].data_id, counter) == (
        bytes(data),
        (counter + 1) % 15,
    )


def test_controller_of_the_page_accepts_every_frame_of_a_station(code: PageCode) -> None:
    """Tried from the page alone, every frame was rejected."""
    protector = Protector(DATABASE.protected)
    for name in NAMES:
        receiver = Receiver()
        for number in range(40):
            data = bytearray([0, number & 0xF0, *[number * 7 % 256] * 6])
            protector.protect(name, data)
            assert code.counts(receiver, data, PAGE_MESSAGES[name]) == (number > 0), (name, number)


@given(
    st.sampled_from(["Status", "LiveAnglesRearLeft", "LiveAgeFrontRight", "GeometryYaw"]),
    st.lists(
        st.tuples(st.integers(0, 15), st.sampled_from(["good", "good", "good", "crc", "other message"])),
        max_size=25,
    ),
)
def test_page_s_receiver_judges_any_run_of_counters_as_the_station(
    code: PageCode, name: str, frames: list[tuple[int, str]]
) -> None:
    """The page's code had one largest step for all messages."""
    guard, receiver = Guard(DATABASE.protected), Receiver()
    for counter, kind in frames:
        data = bytearray(8)
        protect(data, DATABASE.protected[name if kind != "other message" else "Command"].data_id, counter)
        data[0] ^= kind == "crc"
        assert code.counts(receiver, data, PAGE_MESSAGES[name]) == guard.check(name, data).counts


def test_page_names_every_message_and_signal_where_the_dbc_has_it(database: LineDatabase) -> None:
    assert set(PAGE_MESSAGES) == set(database.protected)
    for dbc in database.definition.messages:
        page = PAGE_MESSAGES[dbc.name]
        assert (page.identifier, page.sender) == (dbc.frame_id, dbc.senders[0])
        assert set(page.signals) == set(database.signals(dbc.name))
        for signal in dbc.signals:
            if signal.name in page.signals:
                words = {number: str(word) for number, word in (signal.choices or {}).items()}
                expected = Signal(signal.start, signal.length, signal.is_signed, float(signal.scale), words)
                assert page.signals[signal.name] == expected, f"{dbc.name}.{signal.name}"


@settings(max_examples=300)
@given(st.sampled_from(NAMES), st.binary(min_size=8, max_size=8))
def test_bits_are_read_and_written_as_the_legend_says(code: PageCode, name: str, payload: bytes) -> None:
    """Raw values by the page's `start|length` and C code are those of the DBC's own reader."""
    message = DATABASE.definition.get_message_by_name(name)
    raw = message.decode(payload, decode_choices=False, scaling=False)
    data = bytearray(payload)
    for signal, place in PAGE_MESSAGES[name].signals.items():
        assert code.get(payload, place) == raw[signal]
        code.put(data, place, ~raw[signal])
        mask = ((1 << place.length) - 1) << place.start
        assert int.from_bytes(data, "little") == int.from_bytes(payload, "little") ^ mask
        code.put(data, place, int(raw[signal]))
        assert data == payload
