"""What a plant's statistics are told: every key of a Q-DAS file against the record, to its digits."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from datetime import datetime, timedelta, timezone
from pathlib import Path
from uuid import UUID
from zoneinfo import ZoneInfo

import pytest

from db.exports.aqdef import write_aqdef
from db.exports.rows import AngleRow, angle_rows
from db.records import CycleOutcome, EventRecord, Severity, StoredCycle
from tests.db.example_records import cycle, wheel

BERLIN = timezone(timedelta(hours=1))
# Half an hour after midnight in Berlin, which is the day before in UTC.
RECEIVED = datetime(2026, 11, 22, 0, 30, 15, tzinfo=BERLIN)


@pytest.fixture
def rows() -> list[AngleRow]:
    measured = wheel(
        "front_left", camber=math.radians(-0.5123456789), camber_u=math.radians(0.012345),
        coverage_factor=3.0, camber_low=math.radians(-1.125), camber_high=math.radians(0.25),
        toe=math.radians(0.1), toe_u=math.radians(0.0023456), toe_low=math.radians(-0.0625),
        toe_high=math.radians(0.375),
    )  # fmt: skip
    record = cycle(
        UUID(int=9), received_utc=RECEIVED, measured_utc=RECEIVED + timedelta(seconds=8),
        wheels=(measured,), axles=(), vehicle_angles=None, outcome=CycleOutcome.OK,
    )  # fmt: skip
    return list(angle_rows(StoredCycle(record, RECEIVED + timedelta(days=1))))


def keys_of(path: Path) -> Mapping[str, str]:
    lines = path.read_text(encoding="utf-8-sig").splitlines()
    return {key: text for key, _, text in (line.partition(" ") for line in lines)}


def test_limits_nominal_decimals_and_unit_are_those_of_the_record(
    tmp_path: Path, rows: list[AngleRow]
) -> None:
    write_aqdef(tmp_path / "r.dfq", rows)
    found = keys_of(tmp_path / "r.dfq")
    expected = {
        "K0100": "2", "K1001/1": "compact", "K1011/1": "1", "K1081/1": "EOL-1",
        "K1014/1": "TRUEWHEEL00000001",
        "K2001/1": "front_left.camber", "K2002/1": "Camber front left", "K2002/2": "Toe front left",
        "K2022/1": "4", "K2142/1": "°", "K2004/1": "0",
        "K2110/1": "-1.125", "K2111/1": "0.25", "K2101/1": "-0.4375", "K2120/1": "1", "K2121/1": "1",
        "K2110/2": "-0.0625", "K2111/2": "0.375", "K2101/2": "0.15625",
        "K2401/1": "front_left", "K2402/1": "Truewheel EOL-1 front_left", "K2404/1": "0.0001",
    }  # fmt: skip
    assert {key: found[key] for key in expected} == expected


def test_value_has_its_digits_and_its_standard_uncertainty(tmp_path: Path, rows: list[AngleRow]) -> None:
    write_aqdef(tmp_path / "r.dfq", rows)
    found = keys_of(tmp_path / "r.dfq")
    assert (found["K0001/1"], found["K0001/2"]) == ("-0.5123456789", "0.1")
    # The standard uncertainty, not the expanded one, to six decimals.
    assert found["K0009/1"].startswith("u=0.012345; verdict=ok; calibration=cal-2026-11; cycle=")
    assert found["K0009/2"].startswith("u=0.002346; verdict=ok;")
    assert found["K0014/1"] == "TRUEWHEEL00000001"


@pytest.mark.parametrize(
    ("zone", "expected"),
    [(None, "21.11.2026/23:30:15"), ("UTC", "21.11.2026/23:30:15"), ("Europe/Berlin", "22.11.2026/00:30:15")],
)
def test_time_is_that_of_the_trigger_by_the_clock_that_was_asked(
    tmp_path: Path, rows: list[AngleRow], zone: str | None, expected: str
) -> None:
    """Without a zone a time that came with another offset was written by that one's clock."""
    write_aqdef(tmp_path / "r.dfq", rows, timezone=None if zone is None else ZoneInfo(zone))
    assert keys_of(tmp_path / "r.dfq")["K0004/1"] == expected


@pytest.mark.parametrize(
    ("changes", "present", "absent"),
    [
        ({"low_deg": None}, {"K2111/1": "0.25", "K2120/1": "0", "K2121/1": "1"}, ("K2110/1", "K2101/1")),
        ({"high_deg": None}, {"K2110/1": "-1.125", "K2120/1": "1", "K2121/1": "0"}, ("K2111/1", "K2101/1")),
        (
            {"low_deg": None, "high_deg": None}, {"K2120/1": "0", "K2121/1": "0"},
            ("K2110/1", "K2111/1", "K2101/1"),
        ),
    ],
)  # fmt: skip
def test_limit_that_is_not_there_is_no_limit_of_zero(
    tmp_path: Path,
    rows: list[AngleRow],
    changes: dict[str, None],
    present: dict[str, str],
    absent: tuple[str, ...],
) -> None:
    write_aqdef(tmp_path / "r.dfq", [replace(rows[0], **changes)])
    found = keys_of(tmp_path / "r.dfq")
    assert {key: found[key] for key in present} == present
    assert not set(absent) & set(found)


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (0.0, "0"),
        (-0.0, "0"),
        (-1e-12, "0"),
        (5e-5, "0.00005"),
        (10.0, "10"),
        (100.0, "100"),
        (-0.25, "-0.25"),
    ],
)
def test_numbers_never_have_an_exponent_nor_lose_a_digit(
    tmp_path: Path, rows: list[AngleRow], value: float, expected: str
) -> None:
    write_aqdef(tmp_path / "r.dfq", [replace(rows[0], value_deg=value)])
    assert keys_of(tmp_path / "r.dfq")["K0001/1"] == expected


@pytest.mark.parametrize(
    ("changes", "invalid"),
    [({}, False), ({"cycle_outcome": "nok"}, False), ({"cycle_outcome": "fault"}, True),
     ({"cycle_outcome": "aborted"}, True), ({"verdict": "not judged"}, True), ({"verdict": "nok"}, False)],
)  # fmt: skip
def test_value_that_nobody_judged_is_shown_and_not_counted(
    tmp_path: Path, rows: list[AngleRow], changes: dict[str, str], invalid: bool
) -> None:
    write_aqdef(tmp_path / "r.dfq", [replace(rows[0], **changes)])  # type: ignore[arg-type]
    assert keys_of(tmp_path / "r.dfq").get("K0002/1") == ("129" if invalid else None)


@pytest.mark.parametrize(("seconds", "seen"), [(-1, True), (0, True), (1, False)])
def test_event_belongs_to_the_value_that_follows_it(
    tmp_path: Path, rows: list[AngleRow], seconds: int, seen: bool
) -> None:
    event = EventRecord(
        RECEIVED + timedelta(seconds=seconds), "EOL-1", Severity.WARNING, "climate", "warm", "38 °C"
    )
    write_aqdef(tmp_path / "r.dfq", rows, [event])
    found = keys_of(tmp_path / "r.dfq")
    assert found.get("K0005/1") == ("2" if seen else None)
    assert ("warm: 38 °C" in found["K0009/1"]) is seen
