"""The DBC as delivered, and DBCs that lack something."""

from __future__ import annotations

import contextlib
import itertools
import os
import re
from pathlib import Path

import cantools
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from alignment.errors import ConfigurationError
from station.cycle.words.cycle import ErrorCode, Trigger
from station.line.interface import StationLine
from station.line.wire.bus import LineBus
from station.line.wire.dbc import LineDatabase, load_line_database
from station.line.wire.dbc_text import read_dbc
from station.line.wire.error_codes import MEANINGS
from tests.station.line.line_bench import DBC, Bench, Clock, FakeCanBus

TEXT = DBC.read_text(encoding="cp1252")


def changed(tmp_path: Path, pattern: str, replacement: str) -> Path:
    text, count = re.subn(pattern, replacement, TEXT, flags=re.MULTILINE)
    assert count > 0
    file = tmp_path / "changed.dbc"
    file.write_text(text, encoding="cp1252")
    return file


def without(tmp_path: Path, name: str) -> Path:
    """The DBC without one message and everything that is said of it."""
    message = re.search(rf"^BO_ (\d+) {name}:", TEXT, re.MULTILINE)
    assert message is not None
    number = message[1]
    pattern = rf"^BO_ {number} (?:.*\n(?: SG_.*\n)*)|^(?:CM_|BA_|VAL_)[^\n]* {number} [^\n]*\n"
    return changed(tmp_path, pattern, "")


MESSAGES = re.findall(r"^BO_ \d+ (\w+):", TEXT, re.MULTILINE)


@pytest.mark.parametrize("name", [name for name in MESSAGES if not name.startswith("AxleResult")])
def test_missing_message_is_named_with_the_file(tmp_path: Path, name: str) -> None:
    file = without(tmp_path, name)
    with pytest.raises(ConfigurationError) as caught:
        load_line_database(file)
    assert str(file) in str(caught.value)
    assert name in str(caught.value)


def test_station_without_any_axle_message(tmp_path: Path) -> None:
    file = changed(tmp_path, "AxleResult", "AxleAnswer")
    with pytest.raises(ConfigurationError, match="AxleResult"):
        load_line_database(file)


def test_no_wheel_at_all(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="WheelResult"):
        load_line_database(changed(tmp_path, r"\bWheel(Front|Rear)(Left|Right)\b", r"Bit\1\2"))


@pytest.mark.parametrize(
    ("pattern", "replacement", "field"),
    [
        (r"^ SG_ VehicleType .*\n|^.*\bVehicleType\b.*\n", "", "Command.VehicleType"),
        (
            r"(SG_ VehicleType : 32)\|16(@1\+ \(1,0\)) \[0\|65535\]",
            r"\1|8\2 [0|255]",
            "Command.VehicleType",
        ),
        (r"SG_ Camber : 24\|20@1- \(0.0001,0\)", "SG_ Camber : 24|20@1- (0.001,0)", "Camber"),
        (r"(SG_ Camber : 24\|20@1- \(0.0001,0\)) \[-15\|15\]", r"\1 [-5|5]", "Camber"),
        (r"(SG_ Camber : 24\|20@1- \(0.0001,0\)) \[-15\|15\]", r"\1 [0|0]", "reserved value 'invalid'"),
        (r'4 "aborted" ', "", "the words aborted"),
        (r' 4 "rear_right"', "", "ErrorDetail.Wheel"),
        (r"(BO_ 272 Command: 8 PLC\n) SG_ E2eCrc .*\n", r"\1", "Command.E2eCrc"),
        (r"SG_ E2eCounter : 8\|4@1", "SG_ E2eCounter : 9|3@1", "E2eCounter"),
        (
            r'^BA_ "E2EProfile" BO_ 305 1;',
            'BA_ "E2EProfile" BO_ 305 0;',
            "WheelResultFrontLeft, attribute E2EProfile",
        ),
        (r'^BA_ "E2EProfile" BO_ 305 1;\n', "", "WheelResultFrontLeft, attribute E2EProfile"),
        (r'(^BA_ "E2EDataId" BO_ 305) \d+', r"\1 22288", "attribute E2EDataId"),
        (r'-524288 "invalid"', '-524288 "void"', "the words invalid"),
        (r"^VAL_ \d+ State .*\n", "", "Status.State"),
        (r"BO_ 288 Status: 8", "BO_ 288 Status: 12", "12 bytes"),
        (r"\b304\b", "2147483952", "identifier 0x130"),
    ],
)
def test_signal_missing_or_too_small(tmp_path: Path, pattern: str, replacement: str, field: str) -> None:
    file = changed(tmp_path, pattern, replacement)
    with pytest.raises(ConfigurationError) as caught:
        load_line_database(file)
    assert field in str(caught.value)
    assert str(file) in str(caught.value)


@pytest.mark.parametrize(
    ("pattern", "replacement", "field", "seen"),
    [
        (r'^(BA_ "GenMsgCycleTime" BO_ 288) 100;', r'\1 "x";', "attribute GenMsgCycleTime", '"x"'),
        (r'^(BA_ "GenMsgCycleTime" BO_ 288) 100;', r"\1 x;", "attribute GenMsgCycleTime", "x"),
        (r'^(BA_ "GenMsgCycleTime" BO_ 288) 100;', r"\1 ;", "attribute GenMsgCycleTime", "nothing"),
        (r'^(BA_ "GenMsgCycleTime" BO_ 288) 100;', r"\1 70000;", "attribute GenMsgCycleTime", "70000"),
        (r'^(BA_ "GenMsgCycleTime" BO_ 288) 100;', r"\1 1e999;", "attribute GenMsgCycleTime", "1e999"),
        (r'^(BA_ "GenMsgCycleTime" BO_ 288) 100;', r"\1 1;", "attribute GenMsgCycleTime", "1"),
        (r'^(BA_ "GenMsgTimeoutTime" BO_ 272) 500;', r'\1 "x";', "attribute GenMsgTimeoutTime", '"x"'),
        (r'^(BA_ "E2EDataId" BO_ 272) \d+;', r'\1 "x";', "attribute E2EDataId", '"x"'),
        (r'^BA_ "E2EMaxDeltaCounter" BO_ 272 3;', 'BA_ "E2EMaxDeltaCounter" BO_ 272 15;', "MaxDelta", "15"),
        (r'^BA_ "InterfaceMajor" 3;', 'BA_ "InterfaceMajor" "two";', "attribute InterfaceMajor", '"two"'),
        (r'^(BA_DEF_DEF_ "E2EDataId") 0;', r'\1 "x";', "attribute E2EDataId", '"x"'),
        (r'^(BA_DEF_ BO_ "E2EDataId" INT) 0 65535;', r'\1 "x" 9;', "attribute E2EDataId", '"x" 9'),
        (r"^(BO_ 288 Status): 8 ", r"\1: 2000000000 ", "Status", "2000000000"),
        (r"^(BO_ 288 Status): 8 ", r'\1: "x" ', "Status", '"x"'),
        (r"^BO_ 288 (Status)", r"BO_ 99999999999 \1", "Status", "99999999999"),
        (r"SG_ Toe : 44\|20@", "SG_ Toe : 44|2000000000@", "Toe", "44|2000000000"),
        (r"SG_ Toe : 44\|20@", "SG_ Toe : 99999999999999999999|20@", "Toe", "99999999999999999999|20"),
    ],
)
def test_word_or_giant_where_a_number_belongs_is_named_with_its_line(
    tmp_path: Path, pattern: str, replacement: str, field: str, seen: str
) -> None:
    """A word was an error without a place, a giant length took all memory."""
    file = changed(tmp_path, pattern, replacement)
    with pytest.raises(ConfigurationError) as caught:
        load_line_database(file)
    said = str(caught.value)
    assert field in said
    assert seen in said
    lines = itertools.count(1), TEXT.splitlines(), file.read_text("cp1252").splitlines()
    line = next(number for number, before, after in zip(*lines, strict=False) if before != after)
    assert seen == "1" or f"line {line}" in said


@pytest.mark.parametrize(
    ("pattern", "replacement", "field"),
    [
        (r"\Z", '\nVAL_ 272 Sequence 5 "five" ;\n', "Command.Sequence"),
        (r"\Z", '\nVAL_ 272 WheelFrontLeft 0 "off" 1 "on" ;\n', "Command.WheelFrontLeft"),
        (r"(^VAL_ 272 WheelFrontLeft) .*", r'\1 1 "no" 0 "yes" ;', "Command.WheelFrontLeft"),
        (r'^(VAL_ 288 State .*)7 "adjusting"', r'\g<1>77 "adjusting"', "Status.State"),
        (r"SG_ Sequence : 16\|8@1\+ \(1,0\)", "SG_ Sequence : 16|8@1+ (0,0)", "Sequence"),
        (r"SG_ Sequence : 16\|8@1\+ \(1,0\)", "SG_ Sequence : 16|8@1+ (-1,255)", "Sequence"),
        (r"SG_ E2eCrc : 0\|8@1", "SG_ E2eCrc : 7|8@0", "E2eCrc"),
        (r'^BA_ "E2EDataId" BO_ 272 .*\n|^BA_DEF_DEF_ "E2EDataId".*\n', "", "Command, attribute E2EDataId"),
        (r"\Z", "\nBO_ 289 Other: 8 STATION\n", "0x121 twice"),
        (r"\Z", "\nBO_ 999 Status: 8 STATION\n", "Status"),
        (
            r'^BA_DEF_ BO_ "E2EProfile" ENUM "none","P01A";',
            'BA_DEF_ BO_ "E2EProfile" ENUM "P01A";',
            "E2EProfile",
        ),
    ],
)
def test_what_would_be_misread_is_refused(tmp_path: Path, pattern: str, replacement: str, field: str) -> None:
    """A word among a number's values broke the receiving; other words of a flag were always yes."""
    with pytest.raises(ConfigurationError) as caught:
        load_line_database(changed(tmp_path, pattern, replacement))
    assert field in str(caught.value)


@pytest.mark.parametrize(
    "content", [b"", b"\0" * 100, b"\x7fELF\x02\x01" + bytes(64), "VERSION \u4e2d".encode("utf-16"), b"\x81"]
)
def test_file_of_another_kind(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "binary.dbc"
    file.write_bytes(content)
    with pytest.raises(ConfigurationError, match=r"binary\.dbc"):
        load_line_database(file)


def test_pipe_folder_and_giant_are_refused_before_they_are_read(tmp_path: Path) -> None:
    pipe, giant = tmp_path / "pipe.dbc", tmp_path / "giant.dbc"
    os.mkfifo(pipe)
    with giant.open("wb") as file:
        file.truncate(20_000_000_000)
    for path, seen in (
        (pipe, "a pipe"),
        (tmp_path, "a folder"),
        (giant, "18.63 GiB"),
        (Path("/dev/zero"), "device"),
    ):
        with pytest.raises(ConfigurationError, match=seen):
            load_line_database(path)


_LINES = TEXT.splitlines(keepends=True)
_TOKENS = [m.span() for m in re.finditer(r'"[^"]*"|[-\w.]+|[|@+;:\[\](),]', TEXT)]
_JUNK = ['"x"', "x", "-1", "0", "1e999", "nan", "", '"', "2147483648", "16777215", "1.5", ";", "é", "\0"]
CUT = st.integers(0, len(TEXT)).map(lambda k: TEXT[:k])
WITHOUT_LINES = st.tuples(st.integers(0, len(_LINES) - 1), st.integers(1, 5)).map(
    lambda d: "".join(_LINES[: d[0]] + _LINES[d[0] + d[1] :])
)
TWICE = st.sampled_from(_LINES).map(lambda line: TEXT + line)
JUNK = st.tuples(st.sampled_from(_TOKENS), st.sampled_from(_JUNK)).map(
    lambda d: TEXT[: d[0][0]] + d[1] + TEXT[d[0][1] :]
)


@pytest.mark.slow(8)
@settings(max_examples=60)
@given(text=CUT | WITHOUT_LINES | TWICE | JUNK | JUNK | JUNK)
def test_any_damage_is_one_error_or_a_line_that_works(
    tmp_path_factory: pytest.TempPathFactory, text: str
) -> None:
    file = tmp_path_factory.getbasetemp() / "damaged.dbc"
    file.write_text(text, encoding="cp1252")
    database: LineDatabase | None = None
    with contextlib.suppress(ConfigurationError):
        database = load_line_database(file)
    if database is None:
        return
    with LineBus(FakeCanBus) as bus:
        line = StationLine(bus, database, Clock())
        bench = Bench(database, FakeCanBus(), bus, Clock(), line)
        bench.idle()
        bench.start(5)
        assert [type(command) for command in bench.commands()] == [Trigger]
        line.tick()
        line.close()


def test_a_dbc_that_was_edited_is_read_anew_and_the_one_read_before_stays_as_it_was(tmp_path: Path) -> None:
    """What was read is kept, by its text alone: a second of the same file, size and time is another."""
    file = tmp_path / "line.dbc"
    file.write_text(TEXT, encoding="cp1252")
    before = read_dbc(file)
    first = before.get_message_by_name("Status").frame_id
    assert TEXT.count(f"BO_ {first} Status") == 1
    time = file.stat().st_mtime_ns
    file.write_text(re.sub(rf"\b{first}\b", f"{first + 1}", TEXT), encoding="cp1252")
    os.utime(file, ns=(time, time))
    assert read_dbc(file).get_message_by_name("Status").frame_id == first + 1
    assert before.get_message_by_name("Status").frame_id == first
    copy = tmp_path / "copy.dbc"
    copy.write_text(TEXT, encoding="cp1252")
    assert read_dbc(copy) is before
    copy.write_text("no DBC", encoding="cp1252")
    for _ in range(2):
        with pytest.raises(ConfigurationError, match="a valid DBC"):
            read_dbc(copy)


def test_syntax_error_names_its_line(tmp_path: Path) -> None:
    number = next(k for k, line in enumerate(TEXT.splitlines(), 1) if line.startswith(" SG_ Toe "))
    file = changed(tmp_path, r"^ SG_ Toe : 44\|", " SG_ Toe : forty|")
    with pytest.raises(ConfigurationError, match=f"line {number}"):
        load_line_database(file)


def test_overlapping_signals_and_leftover_words(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="overlapping"):
        load_line_database(changed(tmp_path, r"SG_ Toe : 44\|", "SG_ Toe : 40|"))
    with pytest.raises(ConfigurationError, match="valid DBC"):
        load_line_database(changed(tmp_path, r"^VAL_ 288 State", "VAL_ 1999 State"))


def test_no_such_file(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"absent\.dbc"):
        load_line_database(tmp_path / "absent.dbc")


def test_a_further_axle_is_only_a_matter_of_the_dbc(tmp_path: Path) -> None:
    text = TEXT.replace(
        " SG_ VehicleType :",
        ' SG_ WheelTrailingLeft : 28|1@1+ (1,0) [0|1] "" STATION\n SG_ VehicleType :',
    ).replace('4 "rear_right"', '4 "rear_right" 5 "trailing_left"')
    stems = ("WheelUncertainty", "WheelAxis", "WheelResult", "LiveAngles", "LiveAge")
    for number, stem in enumerate(stems, 1000):
        source = re.search(rf"^BO_ (\d+) {stem}FrontLeft(: 8 STATION\n(?: SG_.*\n)+)", TEXT, re.MULTILINE)
        assert source is not None
        words = re.findall(rf"^VAL_ {source[1]} (.*\n)", TEXT, re.MULTILINE)
        text = text.replace("\nCM_ ", f"\nBO_ {number} {stem}TrailingLeft{source[2]}\nCM_ ", 1)
        text += "".join(f"VAL_ {number} {word}" for word in words)
        text += f'BA_ "E2EProfile" BO_ {number} 1;\nBA_ "E2EDataId" BO_ {number} {number};\n'
    file = tmp_path / "three_axles.dbc"
    file.write_text(text, encoding="cp1252")
    assert tuple(load_line_database(file).wheels)[-2:] == ("rear_right", "trailing_left")


def test_delivered_dbc_explains_everything(database: LineDatabase) -> None:
    raw = cantools.database.load_file(DBC)
    assert isinstance(raw, cantools.database.Database)
    assert [message.name for message in raw.messages] == MESSAGES
    for message in raw.messages:
        assert message.comment, message.name
        assert message.send_type in ("Cyclic", "CyclicAndEvent", "CyclicWhileActive")
        assert message.cycle_time
        assert message.senders in (["PLC"], ["STATION"])
        assert [(s.name, s.start, s.length) for s in message.signals[:2]] == [
            ("E2eCrc", 0, 8),
            ("E2eCounter", 8, 4),
        ]
        for signal in message.signals:
            assert signal.comment, f"{message.name}.{signal.name}"
            assert signal.unit, f"{message.name}.{signal.name}"
            assert signal.unit != "code" or signal.choices
            assert signal.receivers in (["PLC"], ["STATION"])
            assert signal.minimum is not None
            assert signal.maximum is not None
            assert signal.dbc is not None
            assert {"GenSigSendType", "GenSigCycleTime"} <= set(signal.dbc.attributes)
    assert database.cycle_time_s("Status") == 0.1
    assert database.cycle_time_s("StationInfo") == 1.0
    assert database.timeout_s("Command") == database.timeout_s("Status") == 0.5
    assert database.timeout_s("VehicleResult") is None
    of_3_0 = {"Vin1", "Vin2", "Vin3", "Command"}
    of_3_1 = {"SteeringWheel", "SweepStep", "RideHeightFront", "RideHeightRear"}
    assert set(database.messages_from("PLC")) == of_3_0 | of_3_1
    assert database.interface_version == (3, 2)
    assert set(database.protected) == set(MESSAGES)
    assert len({e2e.data_id for e2e in database.protected.values()}) == len(MESSAGES)


def test_words_of_the_error_codes_are_those_of_the_program() -> None:
    raw = cantools.database.load_file(DBC)
    assert isinstance(raw, cantools.database.Database)
    table = raw.get_message_by_name("Status").get_signal_by_name("ErrorCode").choices
    assert table is not None
    assert {str(word) for word in table.values()} == set(ErrorCode) == set(MEANINGS)


@pytest.mark.parametrize("encoding", ["cp1252", "utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize("ends", ["\n", "\r\n"])
def test_a_dbc_is_the_same_in_every_encoding_of_the_field(tmp_path: Path, encoding: str, ends: str) -> None:
    """A DBC in UTF-8 was read as code page 1252: its degree signs became two characters."""
    text = TEXT.replace('"deg"', '"°"')
    file = tmp_path / "line.dbc"
    file.write_bytes(text.replace("\n", ends).encode(encoding))
    found, known = ([s for m in read_dbc(each).messages for s in m.signals] for each in (file, DBC))
    wanted = [(signal.name, "°" if signal.unit == "deg" else signal.unit) for signal in known]
    assert [(signal.name, signal.unit) for signal in found] == wanted
