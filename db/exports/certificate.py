"""PDF certificate of one vehicle: every angle and length with uncertainty, limits and verdict, and why."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from uuid import UUID

from matplotlib.figure import Figure

from alignment.errors import InputError
from db.exports.corrected import CORRECTED_HEAD, corrected_rows, straight_ahead_words
from db.exports.drawing import BAD, GOOD, MINUS, PAGE_WIDTH_IN, REFERENCE, SERIES, in_style, signed
from db.exports.fonts import picture_text
from db.exports.pdf import Document
from db.exports.rows import AngleRow, angle_rows
from db.queries import VinHistory
from db.records import AngleVerdict, ConcessionRecord, StoredCycle, Unit, Verdict, WheelRecord

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
    ahead = straight_ahead_words(record)
    document = Document(
        f"Wheel alignment {history.vin}", f"cycle {record.uuid}    made {_time(created)}", created
    )
    document.facts(
        [
            ("Vehicle", f"{history.vin}, {kind}"),
            ("Result", _OUTCOMES[record.outcome] + (f": {record.reason_text}" if record.reason_text else "")),
            *_released(stored.concession),
            *([] if ahead is None else [("Straight ahead", ahead)]),
            *_doubt_facts(stored),
            ("Station", record.station),
            ("Triggered, stored", f"{_time(record.received_utc)}, {_time(stored.stored_utc)}"),
            ("Software, configuration", f"{record.software_version}, {record.config_hash}"),
            ("From", source),
        ]
    )
    for title, unit in (("Angles", Unit.DEGREES), ("Lengths and run-outs", Unit.MILLIMETRES)):
        values = [_value(row, unit) for row in rows if row.unit == unit]
        if values:
            document.heading(title)
            head = "angle" if unit is Unit.DEGREES else "length"
            document.rows(
                (head, "value ± expanded uncertainty", "lower limit", "upper limit", "verdict"), values
            )
    reasons = [
        (_name(row), row.reason_text or row.reason_code or "") for row in rows if row.verdict in _EXPLAINED
    ]
    kinds = {row.unit for row in rows}
    if reasons:
        document.rows(("angle" if len(kinds) < 2 else "angle or length", "why it is not ok"), reasons)
    if any(row.value is not None and row.low is not None and row.high is not None for row in rows):
        document.picture(tolerance_picture(rows))
    document.paragraph(
        f"Angles in degrees{', lengths in millimetres' if len(kinds) > 1 else ''}. Camber is positive when "
        "the top leans outboard, toe when the wheel points inward in front. "
        f"{_references(stored)}Each {'value' if len(kinds) > 1 else 'angle'} has its own verdict; a wheel, "
        "an axle or the vehicle is not ok when one of its "
        f"{'values' if len(kinds) > 1 else 'angles'} is not"
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
    """Where each judged value lies between its limits; bars are expanded uncertainties."""
    judged = [
        (row, row.value, row.low, row.high)
        for row in rows
        if row.value is not None and row.low is not None and row.high is not None
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
        width = (row.u95 or 0.0) / half
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


def _released(concession: ConcessionRecord | None) -> list[tuple[str, str]]:
    """The concession beside the result, which it does not change."""
    if concession is None:
        return []
    beyond = ", ".join(name.replace(".", " ").replace("_", " ") for name in concession.exceeded)
    said = f"by {concession.person}, {_time(concession.utc)}: {concession.reason}. Out of limits: {beyond}"
    return [("Released by concession", said)]


def _doubt_facts(stored: StoredCycle) -> list[tuple[str, str]]:
    """What failed master checks said against the result, and who or what has answered for it."""
    said = []
    for doubt in stored.doubts:
        wheel, end = doubt.record.wheel.replace("_", " "), doubt.closing
        text = f"{wheel}: {doubt.word} since {_time(doubt.record.utc)}: {doubt.record.reason}"
        if end is not None:
            text = (
                f"{wheel}: was in doubt since {_time(doubt.record.utc)} ({doubt.record.reason}); "
                f"{doubt.word} at {_time(end.utc)}: {end.reason}"
            )
        said.append(("Doubt after a failed master check" if end is None else "Doubt, closed", text))
    return said


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
                _remark(wheel),
            )
            for wheel in record.wheels
        ],
    )
    if corrected := corrected_rows(record):
        document.heading("Angles as measured, and as judged at straight ahead and design height")
        document.rows(CORRECTED_HEAD, corrected)
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


def _value(row: AngleRow, unit: Unit) -> tuple[str, str, str, str, str]:
    if row.value is None:
        return _name(row), "–", "", "", row.verdict
    u = "" if row.u95 is None else f" ± {row.u95:.{unit.decimals}f}"
    low, high = (
        "" if limit is None else f"{limit:.{unit.decimals}f}".replace("-", MINUS)
        for limit in (row.low, row.high)
    )
    return _name(row), f"{signed(row.value, unit.decimals)}{u}", low, high, row.verdict


def _remark(wheel: WheelRecord) -> str:
    """Why a wheel was not measured, or what was done with it."""
    if wheel.reason_text:
        return wheel.reason_text
    load = "" if wheel.load_mm is None else f"a load of {wheel.load_mm:.2f} mm was taken off"
    return "; ".join(part for part in ("a head was lost" if wheel.degraded else "", load) if part)


_END_POINTS = {
    "contact_centres": "contact centres", "wheel_centres": "wheel centres", "sidewalls": "sidewalls",
}  # fmt: skip


def _references(stored: StoredCycle) -> str:
    """What toes and thrust angle refer to, and between what lengths are measured."""
    geometry = stored.record.geometry
    if geometry is None:
        return ""
    against = "the vehicle's own centreline" if geometry.reference == "vehicle" else "the stand's axis"
    text = f"Individual toe and thrust angle are against {against}"
    if geometry.end_points is not None:
        text += f"; wheelbase, track and setback are between {_END_POINTS[geometry.end_points]}"
    return text + ". "


def _calibration(history: VinHistory, identity: str | None) -> str:
    known = history.calibrations.get(identity or "")
    return (identity or "") + ("" if known is None else f", from {known.valid_from_utc:%Y-%m-%d}")


def _name(row: AngleRow) -> str:
    sign = row.thrust_sign if row.quantity == "thrust_angle" else None
    return row.name if sign is None else f"{row.name} ({sign.replace('_', ' ')})"


def _time(time: datetime) -> str:
    return f"{time.astimezone(UTC):%Y-%m-%d %H:%M:%S} UTC"
