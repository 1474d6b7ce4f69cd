"""The images of one wheel as files, with everything to measure it again and what was found."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from alignment.values import MeasureSettings, WheelMeasurement
from alignment.wheel import SpinMeasurement
from db.records import CycleRecord, WheelOutcome, ZeroRecord
from sensors.formats import (
    ARCHIVED_CALIBRATION,
    ARCHIVED_FILE,
    ArchivedResult,
    archived_bytes,
    shot_files,
    write_folder,
)
from sensors.shot import SeriesPlace, WheelShot
from station.configuration import VehicleType
from station.cycle import Failure, MeasuredWith, WheelResult, axle_of
from station.store.libraries import environment


def write_wheel(folder: Path, record: CycleRecord, wheel: WheelResult, kind: VehicleType | None) -> str:
    """Write the images of a wheel into a new folder, whole or not at all.

    Parameters
    ----------
    folder
        Must not exist, or be empty.
    record
        Of its cycle.
    wheel
        With its images, and what it was measured with.
    kind
        Of the vehicle; None where it is not known.

    Returns
    -------
    str
        SHA-256 of the record of the folder, ``archived.json``.

    Raises
    ------
    FormatError
        When a value is out of the format's range, or the folder holds something or cannot be written.
    """
    made: dict[str, bytes] = {}

    def files() -> Iterator[tuple[str, bytes]]:
        contents: dict[str, Any] = {}
        for name, content in _images(wheel, folder):
            contents[name] = {"sha256": hashlib.sha256(content).hexdigest(), "bytes": len(content)}
            yield name, content
        made[ARCHIVED_FILE] = archived_bytes(_fields(record, wheel, kind) | {"files": contents}, folder)
        yield ARCHIVED_FILE, made[ARCHIVED_FILE]

    write_folder(folder, files())
    return hashlib.sha256(made[ARCHIVED_FILE]).hexdigest()


def found_of(
    measurement: WheelMeasurement | None, failure: Failure | None, spin: SpinMeasurement | None
) -> ArchivedResult:
    """Return what was found of a wheel, as it is archived and compared."""
    if measurement is None:
        assert failure is not None
        return ArchivedResult(
            outcome="refused" if failure.outcome is WheelOutcome.REFUSED else "fault",
            reason_code=failure.reason_code[:200],
            reason_text=failure.text[:2000],
        )
    unseen = measurement.unseen or (None, None)
    fields: dict[str, Any] = {
        "outcome": str(WheelOutcome.MEASURED),
        "camber": float(measurement.camber),
        "toe": float(measurement.toe),
        "camber_u": measurement.camber_u,
        "toe_u": measurement.toe_u,
        "points_used": int(measurement.points_used),
        "residual_rms_mm": float(measurement.residual_rms_mm),
        "method": measurement.method,
        "degraded": bool(measurement.degraded),
        "load_mm": _number(measurement.load_mm),
        "row_px": max((float(h.row_px) for h in measurement.heads if h.row_px is not None), default=None),
        "knock_evidence": _number(measurement.knock_evidence),
        "camber_unseen": _number(unseen[0]),
        "toe_unseen": _number(unseen[1]),
    }
    if spin is not None:
        names = ("run_out", "run_out_u", "high_spot", "high_spot_u", "covered_turn", "turned", "wander")
        fields |= {name: _number(getattr(spin, name)) for name in names} | {"shots_used": spin.shots_used}
    return ArchivedResult(**fields)


def _number(value: float | None) -> float | None:
    return None if value is None else float(value)


def _images(wheel: WheelResult, folder: Path) -> Iterator[tuple[str, bytes]]:
    """Every file but the record: images, what they are, and the calibration."""
    assert wheel.measured_with is not None
    for name, shot in zip(_folders(wheel), _shots(wheel), strict=True):
        for file, content in shot_files(shot, folder / name).items():
            yield (file if name == "." else f"{name}/{file}"), content
    document = json.dumps(wheel.measured_with.in_force.document, ensure_ascii=False, allow_nan=False)
    yield ARCHIVED_CALIBRATION, document.encode() + b"\n"


def _shots(wheel: WheelResult) -> tuple[WheelShot, ...]:
    assert wheel.shot is not None
    if wheel.exposures is None:
        return (wheel.shot,)
    phases = None if wheel.spin is None else wheel.spin.phases
    if phases is None or len(phases) != len(wheel.exposures):
        return wheel.exposures
    # From phases, which have no turn of their own; the series goes less than half a turn at a time.
    turns = _unwound(phases)

    def placed(shot: WheelShot, turn: float) -> WheelShot:
        place = shot.series or SeriesPlace(1, len(turns))
        return replace(shot, series=replace(place, turn=turn))

    return tuple(placed(shot, turn) for shot, turn in zip(wheel.exposures, turns, strict=True))


def _unwound(phases: tuple[float, ...]) -> list[float]:
    import numpy as np

    found = np.unwrap(np.asarray(phases, dtype=np.float64))
    return [float(turn) for turn in found - found[0]]


def _folders(wheel: WheelResult) -> tuple[str, ...]:
    if wheel.exposures is None:
        return (".",)
    return tuple(f"turn_{number:02d}" for number in range(1, len(wheel.exposures) + 1))


def _fields(record: CycleRecord, wheel: WheelResult, kind: VehicleType | None) -> dict[str, Any]:
    """The fields of the record but the files."""
    known = wheel.measured_with
    assert known is not None
    rules = known.rules
    return {
        "schema": "truewheel.archived/1",
        "cycle": str(record.uuid),
        "station": record.station,
        "wheel": wheel.wheel,
        "vin": None if record.vehicle is None else record.vehicle.vin,
        "vehicle_type": None if record.vehicle is None else record.vehicle.vehicle_type,
        "received_utc": record.received_utc,
        "software_version": record.software_version,
        "environment": environment(),
        "config_hash": record.config_hash,
        "measure": "tyre_plane" if rules is None else "spin_axis",
        **_tyre(wheel.wheel, kind),
        "series": None if rules is None else asdict(rules),
        "settings": settings_fields(known.settings, known.needs_place),
        "calibration_id": known.in_force.calibration.id,
        "zero": _zero_fields(known),
        "result": found_of(wheel.measurement, wheel.failure, wheel.spin).model_dump(mode="json"),
        "shots": _folders(wheel),
    }


def settings_fields(settings: MeasureSettings, needs_place: bool) -> dict[str, Any]:
    """Return the settings of a measurement as they are archived."""
    return asdict(settings) | {"needs_place": needs_place}


def _tyre(wheel: str, kind: VehicleType | None) -> dict[str, float | None]:
    if kind is None:
        return {"tyre_width_mm": None, "tyre_width_sigma_mm": None}
    axle = kind.axles.get(axle_of(wheel))
    own = None if axle is None else axle.tyre_width_mm
    width = kind.tyre_width_mm if own is None else own
    return {"tyre_width_mm": width, "tyre_width_sigma_mm": kind.tyre_width_sigma_mm}


def _zero_fields(known: MeasuredWith) -> Mapping[str, Any] | None:
    zero = known.zero
    return None if zero is None else {name: getattr(zero, name) for name in ZERO_FIELDS}


ZERO_FIELDS = tuple(
    name for name in ZeroRecord.__dataclass_fields__ if name not in ("rig", "calibration_id", "forced_reason")
)
"""Of a zero measurement, archived; its rig and calibration are the wheel's."""
