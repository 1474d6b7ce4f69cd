"""PDF certificate of one vehicle: every angle with its uncertainty, limits, verdict and what explains it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from uuid import UUID

from matplotlib.figure import Figure

from alignment.errors import InputError
from db.exports.drawing import BAD, GOOD, MINUS, PAGE_WIDTH_IN, REFERENCE, SERIES, in_style, signed
from db.exports.fonts import picture_text
from db.exports.pdf import Document
from db.exports.rows import AngleRow, angle_rows
from db.queries import VinHistory
from db.records import AngleVerdict, StoredCycle, Verdict

_EXPLAINED = (AngleVerdict.NOK, AngleVerdict.NOT_MEASURED, AngleVerdict.NOT_JUDGED)
_OUTCOMES = {
    "ok": "OK",
    "nok": "NOT OK",
    "fault": "NO VERDICT: station fault",
    "aborted": "NO VERDICT: aborted",
}


def write_vehicle_certificate(
    path: Path, history: VinHistory, *, created: datetime, cycle: UUID | None = None, source: str = ""
) -> UUID:
    """Write the certificate of a vehicle's newest cycle, or of the one given; return its UUID.

    Parameters
    ----------
    history
        Everything stored of the vehicle.
    created
        Aware time that stands on the certificate.
    source
        The database, as it is shown.

    Raises
    ------
    InputError
        When the vehicle has no cycle, or not this one.
    OSError
        When the file cannot be written.
    """
    stored = _chosen(history, cycle)
    record = stored.record
    rows = list(angle_rows(stored))
    kind = "" if record.vehicle is None else record.vehicle.vehicle_type
    document = Document(
        f"Wheel alignment {history.vin}", f"cycle {record.uuid}    made {_time(created)}", created
    )
    document.facts(
        [
            ("Vehicle", f"{history.vin}, {kind}"),
            ("Result", _OUTCOMES[record.outcome] + (f": {record.reason_text}" if record.reason_text else "")),
            ("Station", record.station),
            ("Triggered, stored", f"{_time(record.received_utc)}, {_time(stored.stored_utc)}"),
            ("Software, configuration", f"{record.software_version}, {record.config_hash}"),
            ("From", source),
        ]
    )
    document.heading("Angles")
    document.rows(
        ("angle", "value ± expanded uncertainty", "lower limit", "upper limit", "verdict"),
        [_angle(row) for row in rows],
    )
    reasons = [
        (_name(row), row.reason_text or row.reason_code or "") for row in rows if row.verdict in _EXPLAINED
    ]
    if reasons:
        document.rows(("angle", "why it is not ok"), reasons)
    if any(row.value_deg is not None and row.low_deg is not None for row in rows):
        document.picture(tolerance_picture(rows))
    document.paragraph(
        "Angles in degrees. Camber is positive when the top leans outboard, toe when the wheel points inward "
        "in front. Each angle has its own verdict; a wheel, an axle or the vehicle is not ok when one of its "
        "angles is not"
        + (
            "; limits are narrowed by the expanded uncertainty (ISO 14253-1)."
            if any(row.guard_band for row in rows)
            else "."
        )
    )
    _explain(document, history, stored)
    document.save(path)
    return record.uuid


@in_style
def tolerance_picture(rows: Sequence[AngleRow]) -> Figure:
    """Where each judged angle lies between its limits; bars are expanded uncertainties."""
    judged = [
        (row, row.value_deg, row.low_deg, row.high_deg)
        for row in rows
        if row.value_deg is not None and row.low_deg is not None and row.high_deg is not None
    ]
    figure = Figure(figsize=(PAGE_WIDTH_IN, 0.22 * len(judged) + 0.8), layout="constrained")
    ax = figure.subplots()
    ax.axvspan(-1, 1, color=GOOD, alpha=0.1)
    for line in (-1, 1):
        ax.axvline(line, color=BAD)
    ax.axvline(0, color=REFERENCE, linewidth=0.6)
    for number, (row, value, low, high) in enumerate(judged):
        half = (high - low) / 2
        at = (value - (high + low) / 2) / half
        width = (row.u95_deg or 0.0) / half
        # Far outside the place no longer matters, only the side.
        shown = min(max(at, -2.2), 2.2)
        outside = row.verdict == AngleVerdict.NOK
        ax.errorbar(
            shown, number, xerr=min(width, 2.0), fmt="D" if outside else "o",
            color=BAD if outside else SERIES[0], capsize=3,
        )  # fmt: skip
    ax.set(
        yticks=range(len(judged)),
        yticklabels=[picture_text(_name(row)) for row, *_ in judged],
        xlim=(-2.4, 2.4),
        xticks=(-1, 0, 1),
        xticklabels=("lower limit", "middle", "upper limit"),
    )
    ax.grid(visible=False)
    ax.invert_yaxis()
    return figure


def _chosen(history: VinHistory, cycle: UUID | None) -> StoredCycle:
    found = [stored for stored in history.cycles if cycle is None or stored.record.uuid == cycle]
    if not found:
        raise InputError(
            choice="vin" if cycle is None else "cycle",
            expected=f"a cycle of {history.vin!r}",
            seen="none" if cycle is None else f"none with UUID {cycle}",
        )
    return found[-1]


def _explain(document: Document, history: VinHistory, stored: StoredCycle) -> None:
    record = stored.record
    document.heading("Wheels")
    document.rows(
        ("wheel", "verdict", "method", "calibration", "points", "residual [mm]", "reason"),
        [
            (
                wheel.wheel.replace("_", " "),
                "–" if wheel.verdict is Verdict.NONE else str(wheel.verdict),
                wheel.method or str(wheel.outcome),
                _calibration(history, wheel.calibration_id),
                "" if wheel.points_used is None else str(wheel.points_used),
                "" if wheel.residual_rms_mm is None else f"{wheel.residual_rms_mm:.3f}",
                wheel.reason_text or ("a head was lost" if wheel.degraded else ""),
            )
            for wheel in record.wheels
        ],
    )
    used = {wheel.calibration_id for wheel in record.wheels}
    checks = [check for check in history.checks if check.calibration_id in used]
    if checks:
        document.heading("Checks of these calibrations")
        document.rows(
            ("time", "calibration", "against", "outcome"),
            [
                (_time(c.utc), c.calibration_id, str(c.kind).replace("_", " "), f"{c.outcome}: {c.reason}")
                for c in checks[-12:]
            ],
        )
    zero_ids = [wheel.zero_measurement_id for wheel in record.wheels if wheel.zero_measurement_id]
    zeros = [history.zeros[zero_id] for zero_id in zero_ids if zero_id in history.zeros]
    if zeros:
        document.heading("Zero measurements that were subtracted")
        document.rows(
            ("time", "rig", "master", "camber, toe measured less certified"),
            [
                (
                    _time(zero.record.measured_utc), zero.record.rig, zero.record.master,
                    f"{signed(math.degrees(zero.record.camber - zero.record.certified_camber), 4)}°, "
                    f"{signed(math.degrees(zero.record.toe - zero.record.certified_toe), 4)}°",
                )
                for zero in zeros
            ],
        )  # fmt: skip
    if history.events:
        document.heading("Events at the station around the measurement")
        document.rows(
            ("time", "kind", "text"),
            [(_time(e.utc), f"{e.severity} {e.code}", e.text) for e in history.events[:20]],
        )
    if len(history.cycles) > 1:
        document.heading("All cycles of this vehicle")
        document.rows(
            ("time", "station", "result", "cycle"),
            [
                (_time(c.record.received_utc), c.record.station, str(c.record.outcome), str(c.record.uuid))
                for c in history.cycles
            ],
        )


def _angle(row: AngleRow) -> tuple[str, str, str, str, str]:
    if row.value_deg is None:
        return _name(row), "–", "", "", row.verdict
    u = "" if row.u95_deg is None else f" ± {row.u95_deg:.4f}"
    limits = (
        "" if limit is None else f"{limit:.4f}".replace("-", MINUS) for limit in (row.low_deg, row.high_deg)
    )
    low, high = limits
    return _name(row), f"{signed(row.value_deg, 4)}{u}", low, high, row.verdict


def _calibration(history: VinHistory, identity: str | None) -> str:
    known = history.calibrations.get(identity or "")
    return (identity or "") + ("" if known is None else f", from {known.valid_from_utc:%Y-%m-%d}")


def _name(row: AngleRow) -> str:
    sign = row.thrust_sign if row.quantity == "thrust_angle" else None
    return row.name if sign is None else f"{row.name} ({sign.replace('_', ' ')})"


def _time(time: datetime) -> str:
    return f"{time.astimezone(UTC):%Y-%m-%d %H:%M:%S} UTC"
