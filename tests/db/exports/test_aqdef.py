"""Q-DAS files, read back by an independent reader."""

from __future__ import annotations

import re
import warnings
from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from zoneinfo import ZoneInfo

import pytest
from aqdefreader import DfqFile, Part, read_dfq_file

from alignment.errors import ConfigurationError
from db.exports.aqdef import ENCODINGS, write_aqdef
from db.exports.rows import AngleRow, angle_rows
from db.records import EventRecord, StoredCycle
from tests.db.example_records import NOON, cycle, geometry


def read(path: Path) -> DfqFile:
    with warnings.catch_warnings():
        # The reader leaves its file to the garbage collector.
        warnings.simplefilter("ignore", ResourceWarning)
        return read_dfq_file(path)


def characteristics(part: Part) -> dict[str, dict[str, object]]:
    """What the independent reader found, by name: limits, unit, values in their order."""
    found = {}
    for characteristic in part.get_characteristics():
        name = str(characteristic.get_data("K2001"))
        found[name] = {key: characteristic.get_data(key) for key in characteristic.get_data_keys()} | {
            "values": [float(m.value) for m in characteristic.get_measurements()]
        }
    return found


def keyed_values(path: Path, encoding: str = "utf-8-sig") -> dict[int, list[dict[str, str]]]:
    """The value keys by characteristic; the independent reader drops K0014, which is the VIN."""
    found: dict[int, list[dict[str, str]]] = defaultdict(list)
    for line in path.read_text(encoding=encoding).splitlines():
        match = re.fullmatch(r"(K00\d\d)/(\d+) (.*)", line)
        if match:
            key, index, text = match[1], int(match[2]), match[3]
            if key == "K0001":
                found[index].append({})
            found[index][-1][key] = text
    return found


def close(text: object, degrees: float | None) -> bool:
    return degrees is not None and float(str(text)) == pytest.approx(degrees, abs=1e-10)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_independent_reader_finds_values_limits_and_names(
    tmp_path: Path, rows: list[AngleRow], events: list[EventRecord], encoding: str
) -> None:
    path = tmp_path / "results.dfq"
    counts = write_aqdef(path, rows, events, encoding=encoding)
    file = read(path)

    measured = [row for row in rows if row.value_deg is not None]
    assert (counts.files, counts.values) == ((path,), len(measured))
    assert file.part_count() == counts.parts == 2
    first, second = file.get_parts()
    assert first.get_data("K1001") == "Kompakt ü"
    assert first.get_data("K1081") == "Straße 7"
    assert (first.get_data("K1011"), second.get_data("K1011")) == (1, 2)
    assert second.get_data("K1014") == "WTEST000000000101"

    found = characteristics(first)
    mine = defaultdict(list)
    for row in measured:
        if row.vin != "WTEST000000000101":
            mine[row.characteristic].append(row)
    assert set(found) == set(mine)
    for name, of_angle in mine.items():
        assert found[name]["values"] == pytest.approx([row.value_deg for row in of_angle], abs=1e-10)
        assert found[name]["K2142"] == "°"
        for key, kind, limit in (
            ("K2110", "K2120", of_angle[0].low_deg),
            ("K2111", "K2121", of_angle[0].high_deg),
        ):
            assert found[name][kind] == (0 if limit is None else 1)
            assert (key not in found[name]) if limit is None else close(found[name][key], limit)
    toe = characteristics(second)["front_left.toe"]
    assert close(toe["K2111"], 0.15)


def test_every_value_carries_vin_time_text_and_events(
    tmp_path: Path, rows: list[AngleRow], events: list[EventRecord]
) -> None:
    path = tmp_path / "results.dfq"
    write_aqdef(path, rows, events, timezone=ZoneInfo("Europe/Berlin"))
    toe = next(
        values
        for index, values in sorted(keyed_values(path).items())
        if f"K2001/{index} front_left.toe" in path.read_text(encoding="utf-8-sig").splitlines()
    )
    mine = [row for row in rows if row.characteristic == "front_left.toe"][:7]
    assert [value["K0014"] for value in toe] == [row.vin for row in mine]
    assert toe[0]["K0004"] == "22.11.2026/13:00:00"
    assert all(f"cycle={row.cycle}" in value["K0009"] for row, value in zip(mine, toe, strict=True))
    assert "38 °C" in toe[2]["K0009"]
    # 2: a warning before it; 3: a VIN that came before; 1: another calibration.
    assert [value.get("K0005") for value in toe] == [None, None, "2", None, None, "3", "1"]
    # The cycle that ended in a fault is shown and not counted.
    assert [value.get("K0002") for value in toe] == [None] * 6 + ["129"]


def test_description_and_values_in_two_files(tmp_path: Path, rows: list[AngleRow]) -> None:
    counts = write_aqdef(tmp_path / "r.dfx", rows[:-2])
    assert [file.name for file in counts.files] == ["r.dfd", "r.dfx"]
    described = (tmp_path / "r.dfd").read_bytes()
    assert b"K0001" not in described
    assert described.splitlines()[0] == b"\xef\xbb\xbfK0100 " + str(counts.characteristics).encode()
    assert all(line.startswith(b"K00") for line in (tmp_path / "r.dfx").read_bytes()[3:].splitlines())
    together = tmp_path / "t.dfq"
    together.write_bytes(described + (tmp_path / "r.dfx").read_bytes()[3:])
    one = characteristics(read(together).get_part(0))
    write_aqdef(tmp_path / "one.dfq", rows[:-2])
    assert one == characteristics(read(tmp_path / "one.dfq").get_part(0))


def test_windows_character_set_keeps_its_letters_and_refuses_others(
    tmp_path: Path, rows: list[AngleRow]
) -> None:
    path = tmp_path / "r.dfq"
    write_aqdef(path, rows, encoding="windows-1252")
    text = path.read_bytes().decode("cp1252")
    assert "Kompakt ü" in text
    assert "K2142/1 °" in text
    written = path.read_bytes()
    chinese = [replace(row, vehicle_type="紧凑型") for row in rows]
    with pytest.raises(ConfigurationError, match="Use utf-8"):
        write_aqdef(path, chinese, encoding="windows-1252")
    # What was there stays, and nothing half-written is left.
    assert path.read_bytes() == written
    assert [file.name for file in tmp_path.iterdir()] == ["r.dfq"]
    write_aqdef(path, chinese, encoding="utf-8")
    assert read(path).get_part(0).get_data("K1001") == "紧凑型"


@pytest.mark.parametrize("nasty", ["a\nK1001/1 other", "b\x0fc\x14d", "e\u2028f", "g\x85h", "tab\tulator"])
def test_text_that_would_break_a_line_is_one_line(tmp_path: Path, rows: list[AngleRow], nasty: str) -> None:
    path = tmp_path / "r.dfq"
    counts = write_aqdef(path, [replace(row, station=nasty, vin=nasty, reason_code=nasty) for row in rows])
    file = read(path)
    assert file.part_count() == 2
    assert (
        sum(len(c["values"]) for part in file.get_parts() for c in characteristics(part).values())
        == counts.values
    )
    assert "\n" not in str(file.get_part(0).get_data("K1081"))
    assert str(file.get_part(0).get_data("K1001")) == "Kompakt ü"


def test_long_text_is_cut_where_the_format_ends(tmp_path: Path, rows: list[AngleRow]) -> None:
    path = tmp_path / "r.dfq"
    write_aqdef(path, [replace(row, vehicle_type="x" * 100) for row in rows])
    part = read(path).get_part(0)
    assert (len(str(part.get_data("K1001"))), len(str(part.get_data("K1002")))) == (30, 80)


def test_nothing_to_export_is_an_empty_file_of_its_kind(tmp_path: Path) -> None:
    counts = write_aqdef(tmp_path / "r.dfq", [])
    assert (counts.parts, counts.values) == (0, 0)
    assert (tmp_path / "r.dfq").read_bytes() == b"\xef\xbb\xbfK0100 0\r\n"


@pytest.mark.parametrize(("name", "encoding"), [("r.txt", "utf-8"), ("r", "utf-8"), ("r.dfq", "ebcdic")])
def test_other_endings_and_encodings_are_refused(tmp_path: Path, name: str, encoding: str) -> None:
    with pytest.raises(ConfigurationError):
        write_aqdef(tmp_path / name, [], encoding=encoding)
    assert set(ENCODINGS) == {"utf-8", "utf-16", "windows-1252"}


def test_lengths_are_in_millimetres_with_limits_of_their_own(tmp_path: Path) -> None:
    """Every characteristic said degrees, whatever it was."""
    stored = StoredCycle(cycle(geometry=geometry()), NOON)
    path = tmp_path / "lengths.dfq"
    rows = list(angle_rows(stored))
    assert write_aqdef(path, rows).values == len(rows)
    (part,) = read(path).get_parts()
    found = characteristics(part)
    track, base, yaw = (found[f"vehicle.{name}"] for name in ("track_front", "wheelbase_left", "yaw"))
    assert (track["K2002"], track["K2142"], track["values"]) == ("Track front vehicle", "mm", [1512.5])
    assert (close(track["K2110"], 1510.0), close(track["K2111"], 1515.0)) == (True, True)
    assert (track["K2022"], float(str(track["K2404"]))) == (3, 0.001)
    assert (base["K2120"], base["K2121"], base["values"]) == (0, 0, [2701.25])
    assert (yaw["K2142"], close(yaw["values"][0], 0.1)) == ("°", True)
