"""Each angle has its own verdict, from what its record holds: reports, tables, Q-DAS files, certificates."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path
from typing import Any
from uuid import UUID

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pypdf import PdfReader

from db.connection import migrate
from db.exports.rows import AngleRow, angle_rows
from db.queries import ResultReader
from db.records import (
    AngleVerdict,
    CycleOutcome,
    LimitSide,
    StoredCycle,
    VehicleRecord,
    Verdict,
    judge_angle,
    missed_limit,
)
from db.store import ResultStore
from station.configuration.vehicle_types import VehicleType
from station.cycle.answering.answers import axle_records, vehicle_record, wheel_records
from station.cycle.judging.evaluation import Evaluation, evaluate
from station.cycle.judging.verdict import Status
from station.cycle.wheels.positions import WheelResult
from station.cycle.words.failure import fault
from station.quality.selection import newest_vin
from tests.db.example_records import ANGLES, CALIBRATION, NOON, axle, cycle, refused_wheel, wheel
from tests.station.bench import WHEELS, measurement

Run = Callable[..., tuple[int, str, str]]
WORDS = {
    Status.OK: AngleVerdict.OK,
    Status.NOK: AngleVerdict.NOK,
    Status.UNJUDGED: AngleVerdict.WITHOUT_LIMITS,
    Status.UNSET: AngleVerdict.NOT_MEASURED,
    Status.INVALID: AngleVerdict.NOT_JUDGED,
}

tolerance = st.builds(
    lambda nominal, width: {"nominal_deg": nominal, "tolerance_deg": width},
    st.floats(-1, 1),
    st.floats(0.01, 1),
)
axles = st.fixed_dictionaries(
    {"camber": tolerance, "toe": tolerance},
    optional={"total_toe": tolerance, "camber_difference": tolerance},
)


@st.composite
def evaluations(draw: st.DrawFn) -> Evaluation:
    """Any vehicle type, values near their limits, calibrations that are not in force, wheels not measured."""
    kind = VehicleType.model_validate(
        {
            "number": 1, "name": "Car", "guard_band": draw(st.booleans()),
            "axles": {"front": draw(axles), "rear": draw(axles)},
        }
        | ({"thrust_angle": draw(tolerance)} if draw(st.booleans()) else {})
    )  # fmt: skip
    angle = st.floats(-math.radians(1.5), math.radians(1.5))
    results = []
    for name in WHEELS:
        measured = draw(st.integers(0, 9)) > 0
        results.append(
            WheelResult(
                name, CALIBRATION.id, draw(st.integers(0, 9)) > 0,
                measurement(draw(angle), draw(angle), draw(st.floats(1e-6, 2e-3))) if measured else None,
                None if measured else fault("camera_fault", "no image"),
            )
        )  # fmt: skip
    return evaluate(kind, results, draw(st.sampled_from([1.0, 2.0, 3.0])))


def stored(evaluation: Evaluation) -> StoredCycle:
    record = cycle(
        outcome=CycleOutcome.FAULT, reason_code="x", reason_text="x", wheels=wheel_records(evaluation),
        axles=axle_records(evaluation), vehicle_angles=vehicle_record(evaluation),
    )  # fmt: skip
    return StoredCycle(record, NOON)


@settings(max_examples=150, deadline=None)
@given(evaluation=evaluations())
def test_verdict_of_an_angle_is_the_one_that_the_station_gave_it(evaluation: Evaluation) -> None:
    rows = {row.characteristic: row for row in angle_rows(stored(evaluation))}
    for angle in evaluation.angles:
        name = "vehicle.thrust_angle" if angle.name == "thrust_angle" else angle.name
        if name in rows and angle.limits is None:
            # Whether its calibration was in force decided nothing, and is not kept.
            assert rows[name].verdict == AngleVerdict.WITHOUT_LIMITS
        elif name in rows:
            assert rows[name].verdict == WORDS[angle.status]
        else:
            # An axle or a vehicle of which a wheel is missing has no record.
            assert angle.status is Status.UNSET


@settings(max_examples=150, deadline=None)
@given(evaluation=evaluations())
def test_part_is_nok_exactly_when_one_of_its_angles_is(evaluation: Evaluation) -> None:
    parts: dict[str, list[AngleRow]] = {}
    for row in angle_rows(stored(evaluation)):
        parts.setdefault(row.part, []).append(row)
    for rows in parts.values():
        verdicts = {row.verdict for row in rows}
        assert {row.part_verdict for row in rows} == {rows[0].part_verdict}
        assert (rows[0].part_verdict == "nok") == ("nok" in verdicts)
        assert (rows[0].part_verdict == "ok") == ("ok" in verdicts and "nok" not in verdicts)
        for row in rows:
            assert (row.reason_text is None) == (row.reason_code is None) == (row.verdict == "ok")


@pytest.mark.parametrize("side", LimitSide)
@pytest.mark.parametrize("guard_band", [True, False, None])
def test_limits_are_met_or_missed_to_the_last_bit(side: LimitSide, guard_band: bool | None) -> None:
    low, high, u, k = -0.01, 0.01, 1e-4, 3.0
    margin = k * u if guard_band else 0.0
    edge, beyond = (low + margin, -math.inf) if side is LimitSide.LOW else (high - margin, math.inf)
    options: dict[str, Any] = {"guard_band": guard_band, "coverage_factor": k, "part": Verdict.NOK}
    assert judge_angle(edge, u, low, high, **options) == (AngleVerdict.OK, None)
    assert judge_angle(math.nextafter(edge, beyond), u, low, high, **options) == (AngleVerdict.NOK, side)
    # With the other limit alone it is inside.
    only = (None, high) if side is LimitSide.LOW else (low, None)
    assert judge_angle(math.nextafter(edge, beyond), u, *only, **options) == (AngleVerdict.OK, None)
    assert missed_limit(math.nan, low, high, 0.0) is LimitSide.LOW


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"value": None}, AngleVerdict.NOT_MEASURED),
        ({"low": None, "high": None}, AngleVerdict.WITHOUT_LIMITS),
        ({"low": None, "high": None, "part": Verdict.NONE}, AngleVerdict.WITHOUT_LIMITS),
        ({"part": Verdict.NONE}, AngleVerdict.NOT_JUDGED),
        ({"u": None}, AngleVerdict.NOT_JUDGED),
        ({"coverage_factor": None}, AngleVerdict.NOT_JUDGED),
        ({"part": Verdict.NOK}, AngleVerdict.OK),
    ],
)
def test_what_lacks_is_told_apart(changes: dict[str, Any], expected: AngleVerdict) -> None:
    values: dict[str, Any] = {
        "value": 0.0, "u": 1e-5, "low": -0.01, "high": 0.01, "guard_band": True, "coverage_factor": 2.0,
        "part": Verdict.OK,
    }  # fmt: skip
    assert judge_angle(**(values | changes))[0] is expected


VIN = "WANGLES0000000001"
EXPECTED = {
    "front_left.camber": ("ok", None),
    "front_left.toe": ("nok", "toe_high"),
    "front_right.camber": ("nok", "camber_low"),
    "front_right.toe": ("ok", None),
    "rear_left.camber": ("not measured", "head_dark"),
    "rear_left.toe": ("not measured", "head_dark"),
    "front.total_toe": ("ok", None),
    "front.camber_difference": ("without limits", "no_limits"),
    "vehicle.thrust_angle": ("without limits", "no_limits"),
    "vehicle.front_toe_left_to_thrust": ("without limits", "no_limits"),
    "vehicle.front_toe_right_to_thrust": ("without limits", "no_limits"),
}


@pytest.fixture(scope="module")
def database(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A vehicle with every kind of angle; its toe lies inside the limit and not inside the guard band."""
    url = f"sqlite:///{tmp_path_factory.mktemp('angles') / 'r.db'}"
    migrate(url)
    wheels = (
        wheel("front_left", verdict=Verdict.NOK, toe=math.radians(0.2) - 1e-5),
        wheel("front_right", verdict=Verdict.NOK, camber=-math.radians(1.25)),
        refused_wheel("rear_left"),
    )
    front = axle(
        "front",
        verdict=Verdict.OK,
        total_toe_low=-0.01,
        total_toe_high=0.01,
        guard_band=True,
        coverage_factor=2.0,
    )
    with ResultStore(url) as store:
        store.record_calibration(CALIBRATION)
        store.write_cycle(
            cycle(
                UUID(int=5), vehicle=VehicleRecord(VIN, "compact"), outcome=CycleOutcome.FAULT,
                reason_code="refused", reason_text="a wheel was refused", wheels=wheels, axles=(front,),
                vehicle_angles=ANGLES, measured_utc=NOON + timedelta(seconds=9),
            )
        )  # fmt: skip
    return url


def test_report_of_a_vehicle_tells_each_angle_its_verdict(database: str, run: Run) -> None:
    """The camber inside its limits was "nok" with its wheel, the angle without limits "ok" with its axle."""
    status, out, _ = run("report", "vin", "--vin", VIN, "--database", database, "--json")
    sections = {section["name"]: section["rows"] for section in json.loads(out)["sections"]}
    assert status == 0
    assert {row["angle"]: row["verdict"] for row in sections["angles"]} == {
        name: verdict for name, (verdict, _) in EXPECTED.items()
    }
    reasons = {row["angle"]: row["reason"] for row in sections["angles"]}
    assert reasons["front_right.camber"] == "below the limit -1.0000° by 0.2500°"
    assert reasons["front_left.toe"] == (
        "only 0.0006° inside the limit 0.2000°, less than the expanded uncertainty 0.0011°"
    )
    assert reasons["rear_left.toe"] == "head 2 sees no light: clean its window"
    assert reasons["front.camber_difference"] == "the vehicle type has no limits for this angle"
    assert reasons["front_left.camber"] is None
    _, out, _ = run("report", "vin", "--vin", VIN, "--database", database)
    assert "below the limit" in " ".join(out.split())


def test_table_has_verdict_and_reason_of_each_angle(database: str, run: Run, tmp_path: Path) -> None:
    assert run("export", "csv", "--database", database, "--out", tmp_path / "r.csv")[0] == 0
    with (tmp_path / "r.csv").open(newline="", encoding="utf-8") as stream:
        lines = list(csv.DictReader(stream))
    found = {f"{line['part']}.{line['quantity']}": line for line in lines}
    assert {name: (line["verdict"], line["reason_code"] or None) for name, line in found.items()} == EXPECTED
    assert (found["front_left.camber"]["part_verdict"], found["rear_left.toe"]["part_verdict"]) == (
        "nok",
        "none",
    )
    assert all(bool(line["reason_text"]) == (line["verdict"] != "ok") for line in lines)


def test_text_of_a_value_for_q_das_has_its_own_verdict(database: str, run: Run, tmp_path: Path) -> None:
    assert run("export", "aqdef", "--database", database, "--out", tmp_path / "r.dfq")[0] == 0
    lines = (tmp_path / "r.dfq").read_text(encoding="utf-8-sig").splitlines()
    names = {
        line.split()[0].partition("/")[2]: line.split()[1] for line in lines if line.startswith("K2001/")
    }
    texts = {names[line.split()[0].partition("/")[2]]: line for line in lines if line.startswith("K0009/")}
    assert set(texts) == {name for name, (verdict, _) in EXPECTED.items() if verdict != "not measured"}
    for name, text in texts.items():
        verdict, reason = EXPECTED[name]
        assert f"verdict={verdict};" in text
        assert (f"reason={reason};" in text) == (reason is not None)


def test_certificate_has_verdict_and_reason_of_each_angle(database: str, run: Run, tmp_path: Path) -> None:
    path = tmp_path / "c.pdf"
    assert run("export", "certificate", "--database", database, "--vin", VIN, "--out", path)[0] == 0
    said = [
        line.split() for line in PdfReader(path).pages[0].extract_text(extraction_mode="layout").splitlines()
    ]
    for name, (verdict, _) in EXPECTED.items():
        part, _, quantity = name.partition(".")
        text = next(
            row for row in (" ".join(words) for words in said)
            if row.startswith(f"{part} {quantity}".replace("_", " "))
        )  # fmt: skip
        assert text.endswith(f" {verdict}"), (name, text)
    assert "front right camber below the limit -1.0000° by 0.2500°" in [" ".join(words) for words in said]


def test_newest_vehicle_is_the_one_of_the_wheel_that_was_measured_last(tmp_path: Path) -> None:
    """The newest vehicle's right wheel was refused, so the newest right wheel is an older vehicle's."""
    url = f"sqlite:///{tmp_path / 'r.db'}"
    migrate(url)
    with ResultStore(url) as store:
        store.record_calibration(CALIBRATION)
        for number, names in enumerate((("front_left", "front_right"), ("front_left",)), start=1):
            time = NOON + timedelta(hours=number)
            store.write_cycle(
                cycle(
                    UUID(int=number), vehicle=VehicleRecord(f"W{number}", "compact"), received_utc=time,
                    measured_utc=time, wheels=tuple(wheel(name) for name in names), axles=(),
                    vehicle_angles=None,
                )
            )  # fmt: skip
    with ResultReader(url) as reader:
        assert newest_vin(reader) == "W2"
