"""One vehicle with everything that explains it, and the vehicles since the last good master check."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any
from uuid import UUID

from alignment.errors import InputError
from db.exports import STEERED_WHEELS, USUAL_K, AngleRow, angle_rows
from db.queries import (
    DoubtedVehicle,
    Filter,
    ResultReader,
    VinHistory,
    doubted_vehicles,
    since_last_good_check,
    vin_history,
)
from db.records import StoredCycle, Unit, WheelRecord
from station.quality.concessions import exceeded_in_words
from station.quality.reports.report import Section, TableRow, shown_time

_LONGEST = 300
_OF_ANGLE = ("time", "angle", "value_deg", "u95_deg", "low_deg", "high_deg")
_OF_LENGTH = ("time", "length", "value_mm", "u95_mm", "low_mm", "high_mm")


def vin_sections(reader: ResultReader, vin: str) -> list[Section]:
    """All values of one VIN, and what they rest on.

    Raises
    ------
    InputError
        When nothing is stored of it.
    """
    history = vin_history(reader, vin)
    if not history.cycles:
        raise InputError(choice="vin", expected=f"a VIN in {reader.where}", seen=f"no cycle of {vin!r}")
    values = [row for stored in history.cycles for row in angle_rows(stored)]
    rows = [_value_row(row, "angle") for row in values if row.unit == Unit.DEGREES]
    lengths = [_value_row(row, "length") for row in values if row.unit == Unit.MILLIMETRES]
    wheels = [_wheel_row(stored, wheel) for stored in history.cycles for wheel in stored.record.wheels]
    cycles: list[TableRow] = [
        {
            "received": shown_time(stored.record.received_utc), "stored": shown_time(stored.stored_utc),
            "station": stored.record.station,
            "type": None if stored.record.vehicle is None else stored.record.vehicle.vehicle_type,
            "result": str(stored.record.outcome), "doubt": _doubts(stored),
            "reason": stored.record.reason_text,
            "released_by": None if stored.concession is None else stored.concession.person,
            "trigger": stored.record.trigger_sequence, "software": stored.record.software_version,
            "configuration": stored.record.config_hash, "cycle": str(stored.record.uuid),
        }
        for stored in history.cycles
    ]  # fmt: skip
    return [
        Section(
            "cycles",
            f"Cycles of {vin}",
            cycles,
            {"cycles": len(cycles)},
            brief=("received", "station", "result", "doubt", "reason", "released_by", "cycle"),
        ),
        Section(
            "angles",
            "Angles",
            rows,
            {"angles": len(rows)},
            brief=(
                "time",
                "angle",
                "value_deg",
                "u95_deg",
                "low_deg",
                "high_deg",
                "verdict",
                "doubt",
                "reason",
            ),
        ),
        Section(
            "lengths",
            "Lengths and run-outs",
            lengths,
            {"lengths": len(lengths)},
            brief=(*_OF_LENGTH, "verdict", "doubt", "reason"),
            empty="No length: the rigs stood in no common frame, and no wheel was turned.",
        ),
        Section(
            "wheels",
            "What stands behind the wheels",
            wheels,
            {"wheels": len(wheels)},
            "Load: by how much the weight on the tyre moved its sidewall, which was taken off. Phase of a "
            "run-out: where the tyre stood out farthest, 0° at the top, counter-clockwise seen from "
            "outboard. Share of the tyres: what of the variance of toe comes from the spread of tyre widths. "
            "Raw: as measured, where toe is that of straight ahead or angles are those of the design height.",
            brief=(
                "time",
                "wheel",
                "kind",
                "load_mm",
                "run_out_mm",
                "run_out_phase_deg",
                "toe_u95_deg",
                "tyre_share_percent",
                "straight_ahead",
                "toe_raw_deg",
                "camber_raw_deg",
                "ride_height_mm",
            ),
        ),
        *_explaining(history),
    ]


def _value_row(row: AngleRow, what: str) -> TableRow:
    """A value with everything that explains it; its columns carry its unit."""
    numbers: TableRow = {
        f"{name}_{row.unit}": value
        for name, value in (("value", row.value), ("u95", row.u95), ("low", row.low), ("high", row.high))
    }
    return {
        "time": shown_time(row.received_utc), "station": row.station, "result": row.cycle_outcome,
        what: row.characteristic, **numbers, "verdict": row.verdict,
        "doubt": row.doubt, "reason": row.reason_text, "part_verdict": row.part_verdict,
        "outcome": row.outcome,
        "method": row.method, "degraded": row.degraded, "reference": row.reference,
        "between": row.end_points, "straight_ahead": row.straight_ahead,
        "raw_deg": row.raw_deg, "ride_height": row.ride_height, "ride_height_mm": row.ride_height_mm,
        "calibration": row.calibration_id, "zero": row.zero_measurement_id,
        "points": row.points_used, "residual_mm": row.residual_rms_mm, "cycle": row.cycle,
    }  # fmt: skip


def _doubts(stored: StoredCycle) -> str | None:
    """What stands beside the result of a cycle, wheel by wheel; None without doubt."""
    said = [f"{doubt.record.wheel}: {doubt.word}" for doubt in stored.doubts]
    return ", ".join(said) or None


def _wheel_row(stored: StoredCycle, wheel: WheelRecord) -> TableRow:
    """Of what the angles of a wheel are, what was taken off, and what its toe's uncertainty is made of."""
    k = wheel.coverage_factor or USUAL_K
    phase, toe_u, tyre_u = wheel.run_out_phase, wheel.toe_u, wheel.toe_tyre_u
    steering = stored.record.steering
    steered = steering is not None and wheel.wheel in STEERED_WHEELS
    return {
        "time": shown_time(stored.record.received_utc), "wheel": wheel.wheel,
        "kind": None if wheel.kind is None else str(wheel.kind), "load_mm": wheel.load_mm,
        "run_out_mm": wheel.run_out,
        "run_out_u95_mm": None if wheel.run_out_u is None else k * wheel.run_out_u,
        "run_out_phase_deg": None if phase is None else math.degrees(phase),
        "toe_u95_deg": None if toe_u is None else math.degrees(k * toe_u),
        "tyre_share_percent": None if tyre_u is None or not toe_u else 100.0 * (tyre_u / toe_u) ** 2,
        "straight_ahead": steering.straight_ahead if steered and steering is not None else None,
        "toe_raw_deg": None if wheel.toe_raw is None else math.degrees(wheel.toe_raw),
        "camber_raw_deg": None if wheel.camber_raw is None else math.degrees(wheel.camber_raw),
        "ride_height": wheel.ride_height, "ride_height_mm": wheel.ride_height_mm,
        "design_height_mm": wheel.design_height_mm, "warning": wheel.warning,
        "cycle": str(stored.record.uuid),
    }  # fmt: skip


def since_check_sections(reader: ResultReader, where: Filter) -> list[Section]:
    """When the wheels of each station were last found good, and once every vehicle measured since."""
    checks: list[TableRow] = []
    found: dict[tuple[str, str], dict[str, Any]] = {}
    groups = since_last_good_check(reader, where)
    for group in groups:
        last = "never" if group.last_good_utc is None else shown_time(group.last_good_utc)
        wheels = ", ".join(group.wheels)
        since = group.vehicles
        checks.append(
            {"station": group.station, "wheels": wheels, "last_good_check": last, "vehicles": len(since)}
        )
        columns = (since.cycle, since.vin, since.vehicle_type, since.time, since.outcome)
        for cycle, vin, vehicle_type, time, outcome in zip(*columns, strict=True):
            row = found.get((group.station, cycle))
            if row is None:
                found[group.station, cycle] = {
                    "station": group.station, "vin": vin, "type": vehicle_type,
                    "received": f"{str(time)[:19].replace('T', ' ')} UTC", "result": outcome,
                    "wheels": wheels, "last_good_check": last, "cycle": str(UUID(cycle)),
                }  # fmt: skip
            else:
                row["wheels"] += f", {wheels}"
    rows = sorted(found.values(), key=lambda row: (row["station"], row["received"]))
    told = doubted_vehicles(reader, where)
    open_ones = {
        (each.doubt.record.station, str(each.doubt.record.cycle)) for each in told if each.doubt.open
    }
    for row in rows:
        row["in_doubt"] = (row["station"], row["cycle"]) in open_ones
    never = sum(len(group.wheels) for group in groups if group.last_good_utc is None)
    return [
        Section(
            "last_checks",
            "Last good master check of each wheel",
            checks,
            {"never_checked": never},
            empty="No wheel was measured.",
        ),
        Section(
            "since_check",
            "Vehicles since the last good master check",
            rows,
            {"vehicles_since_check": len({row["vin"] for row in rows})},
            "Each with the wheels that measured it and have not been found good since, and the earliest of"
            " their last good checks.",
            brief=("station", "last_good_check", "vin", "type", "result", "in_doubt", "wheels"),
            empty="No vehicle was measured since.",
        ),
        _doubted_section(told),
    ]


def _doubted_section(told: Sequence[DoubtedVehicle]) -> Section:
    """Every doubt on record, open ones first, with who or what has answered for it."""
    rows: list[TableRow] = [
        {
            "station": each.doubt.record.station, "vin": each.vin, "type": each.vehicle_type,
            "received": shown_time(each.received_utc), "result": each.outcome,
            "wheel": each.doubt.record.wheel, "doubt": each.doubt.word,
            "since": shown_time(each.doubt.record.utc), "failed_check": each.doubt.record.reason,
            "closed": None if each.doubt.closing is None else shown_time(each.doubt.closing.utc),
            "person": None if each.doubt.closing is None else each.doubt.closing.person,
            "closed_because": None if each.doubt.closing is None else each.doubt.closing.reason,
            "cycle": str(each.doubt.record.cycle),
        }
        for each in sorted(told, key=lambda each: not each.doubt.open)
    ]  # fmt: skip
    still = {(each.doubt.record.station, each.vin) for each in told if each.doubt.open}
    return Section(
        "doubted",
        "Vehicles in doubt after a failed master check",
        rows,
        {"vehicles_in_doubt": len(still), "doubts": len(rows)},
        "One row for each wheel whose rig failed a check. A doubt stands beside the verdict and does not"
        " change it; a good check with the same calibration and zero measurement closes it, or a person with"
        " a reason.",
        brief=("station", "vin", "received", "result", "wheel", "doubt", "closed_because"),
        empty="No vehicle.",
    )


def _explaining(history: VinHistory) -> list[Section]:
    calibrations: list[TableRow] = [
        {
            "calibration": record.id, "rig": record.rig, "valid_from": shown_time(record.valid_from_utc),
            "valid_until": shown_time(record.valid_until_utc),
        }
        for record in history.calibrations.values()
    ]  # fmt: skip
    checks: list[TableRow] = [
        {
            "time": shown_time(check.utc), "calibration": check.calibration_id,
            "against": str(check.kind), "outcome": str(check.outcome), "reason": check.reason,
            "as_found": _document(check.as_found), "as_left": _document(check.as_left),
        }
        for check in history.checks
    ]  # fmt: skip
    zeros: list[TableRow] = [
        {
            "zero": zero.record.id, "rig": zero.record.rig, "measured": shown_time(zero.record.measured_utc),
            "master": zero.record.master,
            "forced": zero.record.forced_reason,
            "revoked": None if zero.revocation is None else zero.revocation.reason,
        }
        for zero in history.zeros.values()
    ]  # fmt: skip
    stations: list[TableRow] = [
        {
            "station": station.station, "plant": station.plant, "label": station.label,
            "valid_from": shown_time(station.valid_from_utc), "software": station.software_version,
            "configuration": station.config_hash,
        }
        for station in history.stations
    ]  # fmt: skip
    released: list[TableRow] = [
        {
            "granted": shown_time(stored.record.utc), "person": stored.record.person,
            "reason": stored.record.reason, "out_of_limits": exceeded_in_words(stored.record.exceeded),
            "withdrawn": None if stored.withdrawal is None else shown_time(stored.withdrawal.utc),
            "withdrawn_by": None if stored.withdrawal is None else stored.withdrawal.person,
            "withdrawn_because": None if stored.withdrawal is None else stored.withdrawal.reason,
            "cycle": str(stored.record.cycle), "concession": str(stored.record.uuid),
        }
        for stored in history.concessions
    ]  # fmt: skip
    happened: list[TableRow] = [
        {
            "time": shown_time(event.utc), "station": event.station, "severity": str(event.severity),
            "source": event.source, "code": event.code, "text": event.text,
        }
        for event in history.events
    ]  # fmt: skip
    shots: list[TableRow] = [
        {
            "wheel": shot.record.wheel, "path": shot.record.path, "bytes": shot.record.bytes,
            "archived": shown_time(shot.record.archived_utc), "class": str(shot.record.retention),
            "removed": None if shot.removal is None else shown_time(shot.removal.utc),
        }
        for shot in history.shots
    ]  # fmt: skip
    found = (
        ("concessions", "Concessions, which change no verdict", released, "No concession."),
        ("calibrations", "Calibrations it rests on", calibrations, "No calibration."),
        ("checks", "Checks of these calibrations", checks, "No check."),
        ("zeros", "Zero measurements that were subtracted", zeros, "No zero measurement."),
        ("stations", "Stations as configured then", stations, "No station described itself."),
        ("events", "Events around the measurements", happened, "No event."),
        ("images", "Archived images", shots, "No image was kept."),
    )
    brief = {
        "checks": ("time", "calibration", "against", "outcome", "reason"),
        "concessions": ("granted", "person", "reason", "out_of_limits", "withdrawn"),
    }
    return [
        Section(name, title, rows, brief=brief.get(name, ()), empty=empty)
        for name, title, rows, empty in found
    ]


def _document(figures: Mapping[str, Any] | None) -> str | None:
    """Figures of a check on one line, cut where a table ends."""
    return None if figures is None else json.dumps(figures, ensure_ascii=False)[:_LONGEST]
