"""Straight ahead, ride heights and steering axes in exports and on certificates: measured beside judged."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from db.exports.aqdef import write_aqdef
from db.exports.rows import AngleRow, angle_rows
from db.exports.tables import write_csv, write_parquet
from db.records import OF_STEERING_AXIS, CycleOutcome, Quantity, StoredCycle, Verdict
from tests.db.example_records import NOON, corrected_wheel, cycle, steering, steering_axis, wheel
from tests.db.exports.test_aqdef_values import keys_of
from tests.db.exports.test_certificate_text import history, read

NO_ANGLE = "straight ahead not checked: the line told no angle of the steering wheel"


def unchecked(word: str = "not_checked", **changes: Any) -> dict[str, Any]:
    nothing = dict.fromkeys(
        ("steering_wheel", "steering_wheel_u", "steering_wheel_age_s", "steer", "steer_u")
    )
    offset = {f"steering_wheel_offset{end}": None for end in ("", "_u")}
    return {"straight_ahead": word, "reason_text": NO_ANGLE, **nothing, **offset, **changes}


def rows_of(**changes: Any) -> dict[str, AngleRow]:
    return {row.characteristic: row for row in angle_rows(StoredCycle(cycle(**changes), NOON))}


@pytest.fixture
def corrected() -> dict[str, AngleRow]:
    return rows_of(
        wheels=(corrected_wheel(), wheel("rear_left")), steering=steering(), steering_axes=(steering_axis(),)
    )


def test_measured_and_judged_values_stand_beside_each_other(corrected: dict[str, AngleRow]) -> None:
    toe, camber, rear = (corrected[f"{n}"] for n in ("front_left.toe", "front_left.camber", "rear_left.toe"))
    assert (toe.raw_deg, toe.raw_u_deg) == (math.degrees(-0.001), math.degrees(9e-6))
    assert camber.raw_deg == math.degrees(-0.004)
    assert (toe.straight_ahead, camber.straight_ahead, rear.straight_ahead) == ("checked", None, None)
    assert (toe.ride_height, toe.ride_height_mm, toe.design_height_mm) == ("corrected", 391.5, 380.0)
    assert (rear.raw_deg, rear.ride_height) == (None, None)
    offset = corrected["vehicle.steering_wheel_offset"]
    assert (offset.value_deg, offset.verdict) == (pytest.approx(math.degrees(0.0125)), "ok")
    assert offset.straight_ahead == "checked"
    stood = corrected["vehicle.steering_wheel"]
    assert (stood.value_deg, stood.verdict) == (pytest.approx(math.degrees(0.05)), "without limits")


def test_steering_axes_have_rows_of_their_wheels(corrected: dict[str, AngleRow]) -> None:
    told = {name: row for name, row in corrected.items() if row.quantity in set(OF_STEERING_AXIS)}
    assert set(told) == {f"front_left.{each}" for each in OF_STEERING_AXIS if each is not Quantity.LOCK_RIGHT}
    caster, trail = told["front_left.caster"], told["front_left.trail"]
    assert (caster.value_deg, caster.verdict) == (pytest.approx(math.degrees(0.105)), "ok")
    assert caster.method == "steering_axis"
    assert (trail.value_mm, trail.low_mm, trail.unit, trail.verdict) == (22.5, 15.0, "mm", "ok")
    assert corrected["vehicle.caster_difference"].verdict == "ok"
    assert corrected["vehicle.kpi_difference"].verdict == "without limits"


def test_an_axis_that_was_refused_says_why() -> None:
    values = {
        name: None
        for name in vars(steering_axis())
        if name.partition("_u")[0] in set(OF_STEERING_AXIS) and not name.endswith(("_low", "_high"))
    }
    lost = steering_axis(
        **values, verdict=Verdict.NONE, reason_code="sweep_too_small", reason_text="turn it farther"
    )
    fault = {"outcome": CycleOutcome.FAULT, "reason_code": "sweep_fault", "reason_text": "no axis"}
    found = rows_of(steering_axes=(lost,), **fault)
    caster = found["front_left.caster"]
    assert (caster.outcome, caster.verdict, caster.reason_code) == (
        "refused",
        "not measured",
        "sweep_too_small",
    )
    # What has no limits was not asked for.
    assert "front_left.kpi" not in found


def test_a_wheel_that_is_not_judged_says_why_and_not_that_its_calibration_is_at_fault() -> None:
    """The export said of every value without a verdict that no valid calibration stood behind it."""
    bad = wheel(verdict=Verdict.NONE, reason_code="straight_ahead", reason_text=NO_ANGLE)
    fault = {"outcome": CycleOutcome.FAULT, "reason_code": "steering_fault", "reason_text": NO_ANGLE}
    found = rows_of(wheels=(bad,), steering=steering(**unchecked("refused", verdict=Verdict.NONE)), **fault)
    toe = found["front_left.toe"]
    assert (toe.verdict, toe.reason_code, toe.reason_text) == ("not judged", "straight_ahead", NO_ANGLE)
    assert toe.straight_ahead == "refused"
    offset = found["vehicle.steering_wheel_offset"]
    assert (offset.value_deg, offset.outcome, offset.verdict) == (None, "fault", "not measured")
    assert offset.reason_text == NO_ANGLE


def test_tables_have_the_columns_with_their_types(tmp_path: Path, corrected: dict[str, AngleRow]) -> None:
    rows = list(corrected.values())
    write_csv(tmp_path / "r.csv", rows)
    with (tmp_path / "r.csv").open(newline="", encoding="utf-8") as stream:
        toe = next(
            line
            for line in csv.DictReader(stream)
            if (line["part"], line["quantity"]) == ("front_left", "toe")
        )
    assert float(toe["raw_deg"]) == math.degrees(-0.001)
    assert (toe["straight_ahead"], toe["ride_height"], toe["ride_height_mm"]) == (
        "checked",
        "corrected",
        "391.5",
    )
    write_parquet(tmp_path / "r.parquet", rows)
    table = pq.read_table(tmp_path / "r.parquet")
    assert table.column("raw_deg").to_pylist() == [row.raw_deg for row in rows]
    assert table.column("straight_ahead").to_pylist() == [row.straight_ahead for row in rows]


def test_the_transfer_format_says_that_straight_ahead_was_not_checked(tmp_path: Path) -> None:
    found = rows_of(
        wheels=(corrected_wheel(), wheel("front_right")), axles=(), vehicle_angles=None,
        steering=steering(**unchecked()),
    )  # fmt: skip
    write_aqdef(tmp_path / "r.dfq", found.values())
    keys = keys_of(tmp_path / "r.dfq")
    texts = {
        keys[key.replace("K0009", "K2001")]: text for key, text in keys.items() if key.startswith("K0009")
    }
    assert "straight ahead not checked" in texts["front_left.toe"]
    assert "straight ahead not checked" in texts["front_right.toe"]
    assert "straight ahead" not in texts["front_left.camber"]
    assert f"raw={math.degrees(-0.001):.6f}; ride height 391.5 mm corrected" in texts["front_left.toe"]
    # A length of the axis is a characteristic of its own, in millimetres.
    axes = rows_of(steering=steering(), steering_axes=(steering_axis(),))
    write_aqdef(tmp_path / "axes.dfq", axes.values())
    assert "front_left.trail" in keys_of(tmp_path / "axes.dfq").values()


def test_the_certificate_shows_measured_and_judged_and_how_the_steering_wheel_stood(tmp_path: Path) -> None:
    wheels = (corrected_wheel(), wheel("front_right", verdict=Verdict.NOK, toe=0.009))
    lines = read(tmp_path / "c.pdf", history(wheels=wheels, axles=(), steering=steering()))
    text = " ".join(lines)
    assert "Straight ahead" in text
    assert "the steering wheel stood at +2.86° ± 0.34°, positive to the left" in text
    assert "Angles as measured, and as judged at straight ahead and design height" in text
    assert any("front left 391.5 380.0" in line and "\u22120.0573°" in line for line in lines), lines
    assert any(line.startswith("vehicle steering wheel offset +0.7162 ± 0.4584") for line in lines), lines


@pytest.mark.parametrize(
    ("word", "judged"),
    [("not_checked", "front toe is as the wheels stood"), ("refused", "front toe is not judged")],
)
def test_the_certificate_says_that_straight_ahead_was_not_checked(
    tmp_path: Path, word: str, judged: str
) -> None:
    outcome = (
        {"outcome": CycleOutcome.FAULT, "reason_code": "x", "reason_text": "y"} if word == "refused" else {}
    )
    plain = tmp_path / "c.pdf"
    text = " ".join(
        read(plain, history(steering=steering(**unchecked(word, verdict=Verdict.NONE)), **outcome))
    )
    assert NO_ANGLE in text
    assert judged in text
