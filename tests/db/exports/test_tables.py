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
from db.records import StoredCycle
from tests.db.example_records import NOON, WHEELS, cycle, wheel


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
