"""Logs of other programs and damaged ones: read to the end or told where they end, never in silence."""

from __future__ import annotations

import contextlib
import itertools
import struct
from pathlib import Path

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from alignment.errors import ConfigurationError, FormatError
from station.line.tools.logs.asc import start_of
from station.line.tools.logs.reading import LogReading, read_log
from station.line.tools.monitor import recorded

START = 1764476000.0


def frame(number: int, *, after: float = 0.0) -> can.Message:
    return can.Message(
        timestamp=START + after + 0.1 * number,
        arbitration_id=0x110,
        is_extended_id=False,
        channel=0,
        data=number.to_bytes(8, "big"),
    )


def written(path: Path, frames: list[can.Message]) -> Path:
    assert len(list(recorded(frames, path))) == len(frames)
    return path


def text(path: Path, *lines: str, encoding: str = "utf-8", end: str = "\n") -> Path:
    path.write_bytes(end.join([*lines, ""]).encode(encoding))
    return path


def read(path: Path) -> tuple[list[can.Message], LogReading]:
    reading = read_log(path)
    return list(reading), reading


def facts(message: can.Message) -> tuple[object, ...]:
    return (
        message.arbitration_id, message.is_extended_id, message.is_remote_frame, message.is_fd,
        message.is_error_frame, message.is_rx, bytes(message.data),
    )  # fmt: skip


@st.composite
def messages(draw: st.DrawFn) -> can.Message:
    kind = draw(st.sampled_from(["data", "remote", "fd"]))
    extended = draw(st.booleans())
    common = {
        "arbitration_id": draw(st.integers(0, 0x1FFFFFFF if extended else 0x7FF)),
        "is_extended_id": extended,
        "is_rx": draw(st.booleans()),
        "channel": 0,
    }
    if kind == "remote":
        return can.Message(**common, is_remote_frame=True, dlc=draw(st.integers(0, 8)))
    length = draw(st.sampled_from([0, 1, 7, 8] if kind == "data" else [0, 8, 12, 64]))
    data = draw(st.binary(min_size=length, max_size=length))
    return can.Message(**common, data=data, is_fd=kind == "fd")


@given(
    st.sampled_from([".log", ".asc", ".blf"]),
    st.lists(messages(), min_size=1, max_size=20),
    st.lists(st.integers(0, 10_000_000), min_size=20, max_size=20),
)
def test_what_the_station_records_is_read_back_with_its_times(
    tmp_path_factory: pytest.TempPathFactory, ending: str, frames: list[can.Message], microseconds: list[int]
) -> None:
    for message, at in zip(frames, sorted(microseconds), strict=False):
        message.timestamp = round(START + 0.123456 + at / 1e6, 6)
    file = written(tmp_path_factory.mktemp("round") / f"a{ending}", frames)
    found, reading = read(file)
    assert [facts(each) for each in found] == [facts(each) for each in frames]
    assert reading.notes.lost == 0
    assert [each.timestamp for each in found] == pytest.approx([each.timestamp for each in frames], abs=2e-6)


def test_the_start_survives_a_detour_through_asc(tmp_path: Path) -> None:
    first = written(tmp_path / "a.log", [frame(n) for n in range(3)])
    second = written(tmp_path / "b.asc", read(first)[0])
    third = written(tmp_path / "c.log", read(second)[0])
    assert third.read_text().splitlines()[0].startswith("(1764476000.000000)")


@pytest.mark.parametrize("ending", [".log", ".asc", ".blf"])
def test_no_cut_of_a_log_is_silent(tmp_path: Path, ending: str) -> None:
    """A BLF file cut in half was 169 of 400 frames and exit status 0."""
    whole = written(tmp_path / f"whole{ending}", [frame(n) for n in range(300)]).read_bytes()
    for share in (0.213, 0.517, 0.911, 0.999):
        part = tmp_path / f"cut{ending}"
        part.write_bytes(whole[: int(share * len(whole))])
        reading = read_log(part)
        found: list[can.Message] = []
        told = ""
        try:
            found.extend(reading)
        except FormatError as error:
            told = str(error)
        assert told or reading.notes.lost or reading.notes.remarks
        # The last line of a text may end within a frame that then looks whole, which is remarked upon.
        sure = found[:-1] if reading.notes.remarks else found
        assert [facts(each) for each in sure] == [facts(frame(n)) for n in range(len(sure))]


def test_a_blf_file_cut_between_two_containers_is_told(tmp_path: Path) -> None:
    whole = written(tmp_path / "a.blf", [frame(n) for n in range(6000)]).read_bytes()
    second = whole.index(b"LOBJ", whole.index(b"LOBJ") + 4)
    (tmp_path / "a.blf").write_bytes(whole[:second])
    with pytest.raises(FormatError, match=r"cut short, after [1-9][0-9]* frames"):
        read(tmp_path / "a.blf")


def uncompressed(*objects: bytes) -> bytes:
    """A BLF file of one container that is not compressed, and of objects beside it."""
    content = b"".join(objects)
    container = struct.pack("<4sHHLL", b"LOBJ", 16, 1, 32 + len(content), 10) + struct.pack(
        "<H6xL4x", 0, len(content)
    )
    size = 144 + len(container) + len(content)
    header = struct.pack("<4sL8BQQLL8H8H", b"LOGG", 144, *(8 * [0]), size, size, len(objects), 0,
                         2025, 11, 0, 30, 4, 13, 20, 0, *(8 * [0]))  # fmt: skip
    return header.ljust(144, b"\0") + container + content


def blf_object(
    number: int = 0, *, size: int | None = None, version: int = 1, kind: int = 1, head: int = 32
) -> bytes:
    body = struct.pack("<HBBL8s", 1, 0, 8, 0x110, number.to_bytes(8, "big"))
    length = 32 + len(body) if size is None else size
    return (
        struct.pack("<4sHHLLLHHQ", b"LOBJ", head, version, length, kind, 2, 0, 0, 100_000_000 * number) + body
    )


@pytest.mark.parametrize("size", [0, 1, 15, 31, 2**31, 2**32 - 1])
def test_an_object_of_an_impossible_size_ends_the_reading(tmp_path: Path, size: int) -> None:
    """An object of no size was read again and again, for ever."""
    file = tmp_path / "a.blf"
    file.write_bytes(uncompressed(blf_object(0), blf_object(1, size=size), blf_object(2)))
    reading = read_log(file)
    assert facts(next(reading)) == facts(frame(0))
    with pytest.raises(FormatError, match=r"after 1 frame\b|cut short"):
        list(reading)


def test_frames_with_unknown_headers_are_counted_and_others_are_read(tmp_path: Path) -> None:
    file = tmp_path / "a.blf"
    file.write_bytes(
        uncompressed(
            blf_object(0), blf_object(1, version=3), blf_object(2, kind=65), blf_object(3, version=7)
        )
    )
    found, reading = read(file)
    assert [facts(each) for each in found] == [facts(frame(0))]
    assert reading.notes.lost == 2
    assert "version 3" in reading.summary
    assert "version 7" in reading.summary


def test_objects_outside_of_containers_are_frames_too(tmp_path: Path) -> None:
    file = tmp_path / "a.blf"
    whole = bytearray(uncompressed(blf_object(0)) + blf_object(1))
    struct.pack_into("<Q", whole, 16, len(whole))
    file.write_bytes(bytes(whole))
    assert [facts(each) for each in read(file)[0]] == [facts(frame(0)), facts(frame(1))]


@given(st.data())
def test_any_damage_of_a_blf_file_ends_with_frames_or_one_error(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    whole = bytearray(uncompressed(*(blf_object(n) for n in range(5))))
    for _ in range(data.draw(st.integers(1, 4))):
        whole[data.draw(st.integers(0, len(whole) - 1))] = data.draw(st.integers(0, 255))
    file = tmp_path_factory.mktemp("blf") / "a.blf"
    file.write_bytes(bytes(whole))
    reading = read_log(file)
    with contextlib.suppress(FormatError):
        list(reading)
    assert reading.frames <= 5


@given(st.binary(max_size=300), st.sampled_from([".log", ".asc", ".blf"]))
def test_any_bytes_end_with_frames_or_one_error(
    tmp_path_factory: pytest.TempPathFactory, content: bytes, ending: str
) -> None:
    file = tmp_path_factory.mktemp("any") / f"a{ending}"
    file.write_bytes(content)
    with pytest.raises(FormatError):
        list(read_log(file))


TRIGGER = "Begin Triggerblock Mon Dec 6 11:21:13.000 am 2021"
BUSMASTER = ("date Mon Dec 6 11:21:13 am 2021", "base hex  no internal events logged", "// version 7.1.0")
HEADER = ("date Mon Dec 6 11:21:13.000 am 2021", "base hex  timestamps absolute", "no internal events logged")
LINES = [f"   {0.1 * n:.6f} 1  110             Rx   d 8 " + (7 * "00 ") + f"{n:02X}" for n in range(1, 6)]


@pytest.mark.parametrize(
    ("header", "lines"),
    [
        (BUSMASTER, LINES),
        (HEADER, LINES),
        (HEADER[:2], LINES),
        (HEADER, [TRIGGER, "0.0 Start of measurement", *LINES, "End TriggerBlock"]),
        (HEADER, [line.replace("   0.1", "  -0.1").replace("   0.2", "  -0.05") for line in LINES]),
        (HEADER, [line.lower() for line in LINES]),
        (HEADER, ["// a comment", "", "0.05 1 Statistic: D 1 R 0 XD 0 XR 0 E 0 O 0 B 0.00%", *LINES]),
    ],
)  # fmt: skip
def test_headers_and_lines_of_the_field_lose_no_frame(
    tmp_path: Path, header: tuple[str, ...], lines: list[str]
) -> None:
    found, reading = read(text(tmp_path / "a.asc", *header, *lines, end="\r\n"))
    assert [each.data[7] for each in found] == [1, 2, 3, 4, 5]
    assert reading.notes.lost == 0
    times = [each.timestamp for each in found]
    assert times == sorted(times)


def test_relative_times_count_from_the_line_before(tmp_path: Path) -> None:
    lines = [line.replace(line.split()[0], "0.100000", 1) for line in LINES]
    lines.insert(2, "   0.050000 Start of something")
    found, _ = read(text(tmp_path / "a.asc", HEADER[0], "base hex  timestamps relative", *lines))
    steps = [after.timestamp - before.timestamp for before, after in itertools.pairwise(found)]
    assert steps == pytest.approx([0.1, 0.15, 0.1, 0.1], abs=1e-6)


def test_a_german_log_is_read_however_it_is_encoded(tmp_path: Path) -> None:
    header = ("date Mit Mär 11 09:15:02.123 2026", *HEADER[1:], "// Prüfstand Halle 3")
    times = [
        read(text(tmp_path / "a.asc", *header, *LINES, encoding=encoding))[0][0].timestamp
        for encoding in ("cp1252", "utf-8", "utf-8-sig", "utf-16")
    ]
    assert set(times) == {times[0]}
    assert times[0] == pytest.approx(start_of("Wed Mar 11 09:15:02.123 am 2026") + 0.1)  # type: ignore[operator]


@pytest.mark.parametrize(
    ("words", "same"),
    [
        ("Wed Mar 11 01:15:02.123 pm 2026", "Wed Mar 11 13:15:02.123 2026"),
        ("Wed Mar 11 12:15:02 am 2026", "Wed Mar 11 00:15:02 2026"),
        ("Mit Dez 9 09:15:02 2026", "Wed Dec 9 09:15:02 2026"),
        ("mer. déc. 9 09:15:02 2026", "Wed Dec 9 09:15:02 2026"),
        ("mer. juil. 8 09:15:02 2026", "Wed Jul 8 09:15:02 2026"),
    ],
)
def test_dates_in_other_words(words: str, same: str) -> None:
    assert start_of(words) == start_of(same) is not None


@pytest.mark.parametrize("words", ["Wed Foo 11 09:15:02 2026", "Wed Mar 41 09:15:02 2026", "yesterday", ""])
def test_a_date_that_is_none_is_told_and_loses_no_frame(tmp_path: Path, words: str) -> None:
    assert start_of(words) is None
    found, reading = read(text(tmp_path / "a.asc", f"date {words}", *HEADER[1:], *LINES))
    assert found[0].timestamp == pytest.approx(0.1)
    assert "times count from zero" in reading.summary


@pytest.mark.parametrize(
    "line",
    [
        " 0.25 Timestamp: 1714055256.0    ID: 18ff3127    X Rx    DL:  6    12 f3 3b 45 cc 6e",
        " 0.25 1  Speed             Rx   d 8 00 00 00 00 00 00 00 00",
        " 0.25 1  110             Rx   d 8 00 00 00",
        " 0.25 1  110             Rx   d 8 00 00 0",
        " 0.25 1  110             Rx   q 8 00 00 00 00 00 00 00 00",
        "one 1  110             Rx   d 8 00 00 00 00 00 00 00 00",
        " 0.25 CANFD 1 Rx 110  1 0 8",
    ],
)
def test_a_line_that_looks_like_a_frame_is_counted_and_told(tmp_path: Path, line: str) -> None:
    found, reading = read(text(tmp_path / "a.asc", *HEADER, *LINES[:2], line, *LINES[2:]))
    assert len(found) == 5
    assert reading.notes.lost == 1
    assert "line 6" in reading.summary


def test_flexible_and_decimal_lines(tmp_path: Path) -> None:
    line = (
        "0.5 CANFD   1 Rx        110                                   1 0 9 12 "
        + 12 * "AB "
        + "      0    0     3000        0        0        0        0        0"
    )
    [found], _ = read(text(tmp_path / "a.asc", *HEADER, line))
    assert found.is_fd
    assert found.bitrate_switch
    assert bytes(found.data) == 12 * b"\xab"
    plain = "0.5 1 272 Rx d 2 255 16"
    [found], _ = read(text(tmp_path / "b.asc", HEADER[0], "base dec  timestamps absolute", plain))
    assert (found.arbitration_id, bytes(found.data)) == (272, b"\xff\x10")


@pytest.mark.parametrize(
    "lines",
    [
        ("# recorded at line 3", "", "(1764476000.0) can0 110#9C00000000000000"),
        ("\ufeff(1764476000.0) can0 110#9C00000000000000",),
        ("(1764476000.000000) can0 110#9C.00.00.00.00.00.00.00 R",),
        ("(1764476000.000000) vcan-line.1 110#9C00000000000000 T extra",),
    ],
)
def test_candump_logs_of_the_field_are_read(tmp_path: Path, lines: tuple[str, ...]) -> None:
    [found], reading = read(text(tmp_path / "a.log", *lines))
    assert (found.arbitration_id, found.data[0], found.timestamp) == (0x110, 0x9C, START)
    assert reading.notes.lost == 0


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("  can0  110   [8]  9C 00 00 00 00 00 00 00", "candump -L"),
        (" (000.100) can0  RX - -  110   [8]  9C 00 00 00 00 00 00 00", "candump -L"),
        ("  can0  110   [8]  remote request", "candump -L"),
        ("(1764476000.0) can0 110#9C0", "was the file cut"),
        ("(1764476000.0) can0 11", "line 2"),
        ("date Mon Dec 6 11:21:13.000 am 2021", "line 2"),
    ],
)
def test_a_line_that_is_none_of_candump_is_named(tmp_path: Path, line: str, told: str) -> None:
    file = text(tmp_path / "a.log", "(1764476000.0) can0 110#9C00000000000000", line)
    with pytest.raises(FormatError) as caught:
        read(file)
    assert told in str(caught.value)
    assert "line 2" in str(caught.value)
    assert "after 1 frame" in str(caught.value)


def test_a_frame_of_can_xl_is_counted(tmp_path: Path) -> None:
    file = text(
        tmp_path / "a.log",
        "(1764476000.0) can0 110#9C00000000000000",
        "(1764476000.1) can0 00000123#81:00:12345678#1122334455",
    )
    found, reading = read(file)
    assert len(found) == reading.notes.lost == 1
    assert "CAN XL" in reading.summary


@pytest.mark.parametrize("ending", [".log", ".asc"])
def test_a_text_that_is_no_log_is_refused(tmp_path: Path, ending: str) -> None:
    """It was an empty log with exit status 0."""
    for number, lines in enumerate((["this is no log"], [], ["", ""], ["// nothing"])):
        with pytest.raises(FormatError, match=r"candump|ASC"):
            read(text(tmp_path / f"{number}{ending}", *lines))


@pytest.mark.parametrize("ending", [".log", ".asc", ".blf"])
def test_a_time_that_a_format_cannot_hold_is_one_error(tmp_path: Path, ending: str) -> None:
    far = text(tmp_path / "far.log", "(99999999999999.0) can0 110#5900000000000000")
    with pytest.raises(ConfigurationError, match=r"before the year 3000, found 1e\+14 s"):
        list(recorded(read_log(far), tmp_path / f"out{ending}"))


@pytest.mark.parametrize("time", ["inf", "nan", "1e999", "-inf"])
def test_a_time_that_is_no_number_is_counted(tmp_path: Path, time: str) -> None:
    line = f"{time} 1  110             Rx   d 8 59 00 00 00 00 00 00 00"
    found, reading = read(text(tmp_path / "a.asc", *HEADER, line, *LINES))
    assert len(found) == 5
    assert reading.notes.lost == 1
