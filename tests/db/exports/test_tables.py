"""CSV and Parquet: every angle, equal values, nothing half-written."""

from __future__ import annotations

import csv
import math
from datetime import UTC, datetime
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from db.exports.rows import AngleRow, angle_rows
from db.exports.tables import TABLE_COLUMNS, write_csv, write_parquet
from db.records import OF_GEOMETRY, CycleOutcome, GeometryRecord, StoredCycle, Verdict, WheelKind
from tests.db.example_records import NOON, WHEELS, cycle, geometry, wheel


def test_every_angle_of_a_cycle_is_a_row(cycles: list[StoredCycle]) -> None:
    found = {row.characteristic: row for row in angle_rows(cycles[0])}
    record = cycles[0].record
    assert len(found) == 2 * len(record.wheels) + 2 * len(record.axles) + 3
    left = record.wheels[0]
    toe = found["front_left.toe"]
    assert left.toe is not None
    assert toe.value_deg == math.degrees(left.toe)
    assert (toe.method, toe.calibration_id) == (left.method, left.calibration_id)
    assert record.vehicle_angles is not None
    thrust = found["vehicle.thrust_angle"]
    assert thrust.value_deg == math.degrees(record.vehicle_angles.thrust_angle)
    assert thrust.thrust_sign == record.vehicle_angles.thrust_sign
    refused = {row.characteristic: row for row in angle_rows(cycles[6])}["front_right.toe"]
    assert (refused.value_deg, refused.outcome, refused.reason_code is None) == (None, "refused", False)


def test_csv_holds_the_same_values(tmp_path: Path, rows: list[AngleRow]) -> None:
    path = tmp_path / "r.csv"
    assert write_csv(path, rows) == len(rows)
    with path.open(newline="", encoding="utf-8") as stream:
        found = list(csv.DictReader(stream))
    assert list(found[0]) == list(TABLE_COLUMNS)
    for line, row in zip(found, rows, strict=True):
        assert (float(line["value_deg"]) if line["value_deg"] else None) == row.value_deg
        assert (line["vin"], line["vehicle_type"], line["station"]) == (row.vin, "Kompakt ü", "Straße 7")
        assert datetime.fromisoformat(line["received_utc"]) == row.received_utc


def test_parquet_holds_the_same_values_with_types(tmp_path: Path, rows: list[AngleRow]) -> None:
    path = tmp_path / "r.parquet"
    assert write_parquet(path, rows) == len(rows)
    table = pq.read_table(path)
    assert table.column_names == list(TABLE_COLUMNS)
    assert table.schema.field("received_utc").type == pa.timestamp("us", tz="UTC")
    assert table.schema.field("value_deg").type == pa.float64()
    for name in TABLE_COLUMNS:
        expected = [getattr(row, name) for row in rows]
        assert table.column(name).to_pylist() == expected


def test_nothing_to_export_leaves_an_empty_table(tmp_path: Path) -> None:
    assert write_parquet(tmp_path / "r.parquet", []) == 0
    assert pq.read_table(tmp_path / "r.parquet").num_rows == 0
    assert write_csv(tmp_path / "r.csv", []) == 0
    assert (tmp_path / "r.csv").read_text().strip() == ",".join(TABLE_COLUMNS)


def test_failed_export_leaves_the_old_file(tmp_path: Path, rows: list[AngleRow]) -> None:
    path = tmp_path / "r.csv"
    path.write_text("old")

    def broken() -> object:
        yield rows[0]
        raise OSError("the database went away")

    for write in (write_csv, write_parquet):
        with pytest.raises(OSError, match="went away"):
            write(path, broken())  # type: ignore[arg-type]
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
    assert rows[0].received_utc.tzinfo is UTC


def test_wheel_that_lost_a_head_is_told_by_a_column_of_its_own(tmp_path: Path) -> None:
    wheels = [
        wheel(name, degraded=lost, method="x/degraded")
        for name, lost in zip(WHEELS, (True, False, None, False), strict=True)
    ]
    rows = list(angle_rows(StoredCycle(cycle(wheels=tuple(wheels)), NOON)))
    told = {row.part: row.degraded for row in rows}
    assert [told[name] for name in WHEELS] == [True, False, None, False]
    assert {told["front"], told["vehicle"]} == {None}
    write_parquet(tmp_path / "r.parquet", rows)
    column = pq.read_table(tmp_path / "r.parquet").column("degraded")
    assert column.type == pa.bool_()
    assert column.to_pylist() == [row.degraded for row in rows]


def vehicle_with_lengths(**changes: object) -> StoredCycle:
    """A wheel that was turned, and a vehicle in a frame of its own."""
    turned = wheel(
        kind=WheelKind.SPIN_AXIS, load_mm=0.4, run_out=1.2, run_out_u=0.03, run_out_high=1.0,
        run_out_phase=math.radians(30.0), run_out_phase_u=0.02, toe_tyre_u=6e-6, verdict=Verdict.NOK,
    )  # fmt: skip
    narrow = geometry(
        verdict=Verdict.NOK, track_front_high=1512.6, setback_rear_low=-1.0, setback_rear_high=0.5
    )
    values = {"wheels": (turned,), "geometry": narrow, "outcome": CycleOutcome.NOK, **changes}
    return StoredCycle(cycle(**values), NOON)


def test_lengths_have_rows_with_verdicts_of_their_own_in_millimetres() -> None:
    found = {row.characteristic: row for row in angle_rows(vehicle_with_lengths())}
    front, rear, base = (found[f"vehicle.{n}"] for n in ("track_front", "setback_rear", "wheelbase_left"))
    assert (front.unit, front.value_mm, front.u_mm, front.value_deg) == ("mm", 1512.5, 0.0625, None)
    assert (front.low_mm, front.high_mm, front.u95_mm, front.u95_deg) == (1510.0, 1512.6, 0.125, None)
    # Inside, but not by its uncertainty.
    assert (front.verdict, front.reason_code) == ("nok", "track_front_high")
    assert front.reason_text == (
        "only 0.100 mm inside the limit 1512.600 mm, less than the expanded uncertainty 0.125 mm"
    )
    assert (rear.verdict, rear.reason_text) == ("nok", "above the limit 0.500 mm by 0.250 mm")
    assert (base.verdict, base.end_points, base.name) == (
        "without limits", "contact_centres", "vehicle wheelbase left",
    )  # fmt: skip
    yaw = found["vehicle.yaw"]
    assert (yaw.unit, yaw.verdict, yaw.value_deg) == ("deg", "ok", pytest.approx(0.1))
    assert set(found) >= {f"vehicle.{quantity}" for quantity in OF_GEOMETRY}


def test_a_vehicle_that_was_not_wholly_measured_has_lengths_that_were_not() -> None:
    limits = {"track_front_low": 1510.0, "track_front_high": 1515.0}
    nothing = GeometryRecord(reference="vehicle", guard_band=True, coverage_factor=2.0, **limits)
    stored = vehicle_with_lengths(
        geometry=nothing, outcome=CycleOutcome.FAULT, reason_code="head_dark", reason_text="head 2 is dark",
        vehicle_angles=None, axles=(),
    )  # fmt: skip
    found = [row for row in angle_rows(stored) if row.part == "vehicle"]
    assert [(row.quantity, row.verdict, row.reason_code) for row in found] == [
        ("track_front", "not measured", "head_dark")
    ]


def test_run_out_kind_load_and_the_share_of_tyre_widths_are_told() -> None:
    found = {row.characteristic: row for row in angle_rows(vehicle_with_lengths())}
    run_out, toe, thrust = (
        found[name] for name in ("front_left.run_out", "front_left.toe", "vehicle.thrust_angle")
    )
    assert (run_out.value_mm, run_out.low_mm, run_out.high_mm) == (1.2, None, 1.0)
    assert (run_out.verdict, run_out.reason_code) == ("nok", "run_out_high")
    assert run_out.run_out_phase_deg == pytest.approx(30.0)
    assert (toe.kind, toe.load_mm, toe.reference) == ("spin_axis", 0.4, "vehicle")
    assert toe.tyre_u_deg == pytest.approx(math.degrees(6e-6))
    assert thrust.tyre_u_deg == pytest.approx(math.degrees(3e-6))
    # A wheel that was not turned has no run-out that could be missing.
    assert "rear_left.run_out" not in {row.characteristic for row in angle_rows(StoredCycle(cycle(), NOON))}
