"""`truewheel calibration check`: the calibration in force against a plate session or a master wheel."""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from alignment.believable import LARGEST_SHIFT, certificate_slip
from alignment.calibration import (
    CalibrationInput,
    PlateCheck,
    check_with_plate,
    image_warnings,
    worst_blur,
    worst_contrast,
)
from alignment.counting import count_of
from alignment.errors import ConfigurationError, FormatError, InputError
from alignment.measure import measure_wheel
from alignment.units import ARCMIN
from alignment.values import MeasureSettings, Refusal, RigCalibration, WheelMeasurement
from db.records import CalibrationCheckRecord, CalibrationRecord, CheckKind, CheckOutcome
from db.store import ResultStore
from sensors.formats import (
    SESSION_FILE,
    CalibrationFile,
    PlateSession,
    read_plate_session,
    read_shot,
    validate,
)
from sensors.shot import WheelShot
from station.calibration.master import MasterWheel
from station.calibration.observing import KnownCameras, observe_session
from station.figures import Progress


@dataclass(frozen=True)
class CheckLimits:
    """What a calibration must keep to stay in force.

    Attributes
    ----------
    angle
        Largest change of camber and toe, radians; for a master wheel the certificate's expanded uncertainty
        and the drift that is allowed, together. The default is three times what plate and stage at
        their tolerances make of a single view.
    rms_px
        Largest RMS residual of a camera, pixels, once its pose is corrected: more is a changed lens.
    """

    angle: float = 0.2 * ARCMIN
    rms_px: float = 0.2


@dataclass(frozen=True)
class Checked:
    """Result of a check.

    Attributes
    ----------
    kind, outcome, reason
        What it was, the verdict, and the sentence that explains it.
    utc
        When the images were taken.
    rig
        Name of the rig.
    figures
        JSON values: what was found.
    """

    kind: CheckKind
    outcome: CheckOutcome
    reason: str
    utc: datetime
    rig: str
    figures: dict[str, Any]


def check_folder(
    folder: Path,
    calibration: RigCalibration,
    master: MasterWheel | None,
    limits: CheckLimits,
    settings: MeasureSettings,
    progress: Progress,
) -> Checked:
    """Check a calibration with a recorded plate session, or with a shot of a master wheel.

    Parameters
    ----------
    folder
        Of either; ``session.json`` tells a plate session.
    calibration
        In force.
    master
        Certified angles; needed for a shot, and only for a shot.
    limits, settings
        Of the verdict, and of the measurement of a shot.
    progress
        Told how far a session is.

    Raises
    ------
    ConfigurationError
        When the certified angles are missing, or given with a plate session.
    FormatError
        When the folder cannot be read, or is of another rig.
    DegenerateInputError
        When the session's cameras are not those of the calibration, or it shows too few marks.
    """
    is_session = (folder / SESSION_FILE).exists()
    if is_session and master is not None:
        raise ConfigurationError(
            choice="camber, toe",
            expected="no certified angles with a plate session",
            seen="some",
            cure="Name the shot of the master wheel.",
        )
    if is_session:
        session = read_plate_session(folder)
        if session.rig != calibration.rig:
            raise FormatError(
                file=folder / SESSION_FILE,
                field="rig",
                expected=f"'{calibration.rig}', as in the calibration",
                seen=f"'{session.rig}'",
                cure="Name the calibration of this rig.",
            )
        return check_session(session, calibration, limits, progress)
    shot = read_shot(folder, calibration)
    if master is None:
        raise ConfigurationError(
            choice="camber, toe",
            expected="the certified angles of the master wheel",
            seen="none",
            cure="Copy them from its certificate, in degrees.",
        )
    return check_master_wheel(shot, calibration, master, limits, settings)


def check_session(
    session: PlateSession, calibration: RigCalibration, limits: CheckLimits, progress: Progress
) -> Checked:
    """Check with a plate session; an image without a recognised plate puts the check out of tolerance."""
    views, refusals = observe_session(session, progress, KnownCameras(calibration, np.eye(3)))
    if refusals:
        listed = "; ".join(f"view {view}, {' '.join(key)}: {why.reason}" for view, key, why in refusals[:3])
        more = f"; and {len(refusals) - 3} more images" if len(refusals) > 3 else ""
        reason = f"the plate was not recognised in {count_of(len(refusals), 'image')}: {listed}{more}"
        figures: dict[str, Any] = {"unrecognised_images": len(refusals)}
        return Checked(
            CheckKind.PLATE_SESSION, CheckOutcome.OUT, reason, session.time_utc, session.rig, figures
        )
    data = CalibrationInput(session.plate.plate, views, dict(session.sizes), session.stage_sigma_mm)
    found = check_with_plate(data, calibration)
    outcome, reason = judge_plate(found, limits)
    warnings = image_warnings(data)
    figures = plate_figures(found, limits) | {"warnings": list(warnings)}
    for each, entry in zip(found.cameras, figures["cameras"], strict=True):
        entry["blur_px"] = worst_blur(data, each.camera)[0]
        entry["contrast"] = worst_contrast(data, each.camera)[0]
    return Checked(CheckKind.PLATE_SESSION, outcome, reason, session.time_utc, session.rig, figures)


def judge_plate(found: PlateCheck, limits: CheckLimits) -> tuple[CheckOutcome, str]:
    """Verdict on a comparison with a plate, and the sentence that names what changed."""
    if found.scale_reason is not None:
        return CheckOutcome.OUT, found.scale_reason
    worst = max(found.cameras, key=lambda each: each.rms_px)
    angles = (
        f"a new calibration would change camber by {found.camber_change / ARCMIN:+.3f}′ and toe by "
        f"{found.toe_change / ARCMIN:+.3f}′, allowed is ±{limits.angle / ARCMIN:.3f}′"
    )
    blurred = [each for each in found.cameras if each.rms_left_px > limits.rms_px]
    if blurred:
        names = ", ".join(" ".join(each.camera) for each in blurred)
        return CheckOutcome.OUT, (
            f"the marks of {names} do not fit, wherever it stands ({blurred[0].rms_left_px:.3f} px RMS, "
            f"allowed {limits.rms_px:.3f}): its lens was changed, or the plate is another; calibrate the rig"
        )
    if max(abs(found.camber_change), abs(found.toe_change)) > limits.angle:
        return CheckOutcome.OUT, (
            f"{angles}; most moved the image of {' '.join(worst.camera)} ({worst.rms_px:.3f} px RMS); "
            "calibrate the rig"
        )
    return CheckOutcome.WITHIN, angles


def plate_figures(found: PlateCheck, limits: CheckLimits) -> dict[str, Any]:
    """Figures of a comparison with a plate, JSON values."""
    return {
        "residual_rms_px": found.rms_px,
        "corrected_rms_px": found.rms_left_px,
        "plate_scale": found.scale,
        "camber_change_arcmin": found.camber_change / ARCMIN,
        "toe_change_arcmin": found.toe_change / ARCMIN,
        "allowed_arcmin": limits.angle / ARCMIN,
        "allowed_rms_px": limits.rms_px,
        "cameras": [
            {
                "head": each.camera[0],
                "camera": each.camera[1],
                "marks": each.marks,
                "residual_rms_px": each.rms_px,
                "shift_px": list(each.shift_px),
                "turn_arcmin": [angle / ARCMIN for angle in each.turn],
                "move_mm": list(each.move_mm),
                "corrected_rms_px": each.rms_left_px,
            }
            for each in found.cameras
        ],
    }


def check_master_wheel(
    shot: WheelShot,
    calibration: RigCalibration,
    master: MasterWheel,
    limits: CheckLimits,
    settings: MeasureSettings,
) -> Checked:
    """Check with a shot of a master wheel; a wheel that is refused puts the check out of tolerance."""
    found = measure_wheel(shot.images, calibration, settings)
    outcome, reason, figures = judge_master(found, master, limits)
    return Checked(CheckKind.MASTER_WHEEL, outcome, reason, shot.time_utc, shot.rig, figures)


def judge_master(
    found: WheelMeasurement | Refusal, master: MasterWheel, limits: CheckLimits
) -> tuple[CheckOutcome, str, dict[str, Any]]:
    """Verdict, reason and figures: measured less certified against both expanded uncertainties.

    Raises
    ------
    ConfigurationError
        When the angles are far off their certificate, and fit it with a slip of the pen.
    """
    if isinstance(found, Refusal):
        return CheckOutcome.OUT, f"the master wheel was not measured: {found.reason}", {"code": found.code}
    _refuse_slip(found, master, limits)
    figures: dict[str, Any] = {}
    parts, within = [], True
    for name, value, u95, certified in (
        ("camber", found.camber, found.camber_u95, master.camber),
        ("toe", found.toe, found.toe_u95, master.toe),
    ):
        deviation, allowed = value - certified, math.hypot(u95, limits.angle)
        within &= abs(deviation) <= allowed
        parts.append(f"{name} {deviation / ARCMIN:+.3f}′ (allowed ±{allowed / ARCMIN:.3f}′)")
        figures |= {
            f"{name}_deg": math.degrees(value),
            f"{name}_certified_deg": math.degrees(certified),
            f"{name}_deviation_arcmin": deviation / ARCMIN,
            f"{name}_u95_arcmin": u95 / ARCMIN,
            f"{name}_allowed_arcmin": allowed / ARCMIN,
        }
    reason = f"measured less certified: {', '.join(parts)}"
    if within:
        return CheckOutcome.WITHIN, reason, figures
    return CheckOutcome.OUT, f"{reason}; check the wheel's seat, then calibrate the rig", figures


def _refuse_slip(found: WheelMeasurement, master: MasterWheel, limits: CheckLimits) -> None:
    """A slip of the pen that makes both angles fit to their tolerance is none of the rig's faults."""
    measured, certified = (found.camber, found.toe), (master.camber, master.toe)
    within = (math.hypot(found.camber_u95, limits.angle), math.hypot(found.toe_u95, limits.angle))
    off = [abs(m - c) for m, c in zip(measured, certified, strict=True)]
    slip = certificate_slip(measured, certified, within)
    if slip is None or max(off) <= LARGEST_SHIFT:
        return
    raise ConfigurationError(
        choice="camber, toe",
        expected=f"certified angles near the measured camber {math.degrees(found.camber):.3f}° and toe "
        f"{math.degrees(found.toe):.3f}°",
        seen=f"camber {math.degrees(master.camber):.3f}°, toe {math.degrees(master.toe):.3f}°",
        cure=f"They would fit with {slip}: check the certificate, in degrees; nothing was stored",
    )


def store_check(
    url: str, checked: Checked, calibration: CalibrationFile, document: dict[str, Any]
) -> CalibrationCheckRecord:
    """Store a check, and the calibration too when the database does not have it yet.

    Raises
    ------
    StoreError
        When the database cannot be used, or holds another calibration of this id.
    """
    record = CalibrationCheckRecord(
        utc=checked.utc,
        calibration_id=calibration.id,
        kind=checked.kind,
        outcome=checked.outcome,
        reason=checked.reason,
        as_found=checked.figures,
    )
    with ResultStore(url) as store:
        if store.calibration(calibration.id) is None:
            store.record_calibration(
                CalibrationRecord(calibration.id, calibration.rig, calibration.created_utc, document)
            )
        store.record_check(record)
    return record


def accept_calibration(
    url: str, calibration: CalibrationFile, document: dict[str, Any], data: CalibrationInput, utc: datetime
) -> CalibrationCheckRecord:
    """Store an accepted calibration with its figures as left, and those as found of the one it replaces.

    Parameters
    ----------
    url
        Database.
    calibration, document
        The new one, and the JSON document of its file.
    data
        What it was computed from.
    utc
        When the images were taken.

    Raises
    ------
    StoreError
        When the database cannot be used; neither calibration nor figures are stored then.
    """
    limits = CheckLimits()
    left = check_with_plate(data, calibration.calibration())
    with ResultStore(url) as store:
        before = store.calibration_in_force(calibration.rig, calibration.created_utc)
        found = None if before is None or before.id == calibration.id else _as_found(before, data)
        outcome, reason = (CheckOutcome.WITHIN, "the first calibration of its rig, or of other cameras")
        if found is not None:
            outcome, reason = judge_plate(found, limits)
        record = CalibrationCheckRecord(
            utc=utc,
            calibration_id=calibration.id,
            kind=CheckKind.PLATE_SESSION,
            outcome=outcome,
            reason=f"as found: {reason}",
            as_found=None if found is None else plate_figures(found, limits),
            as_left=plate_figures(left, limits),
            predecessor_id=before.id if before is not None and found is not None else None,
        )
        store.accept_calibration(
            CalibrationRecord(calibration.id, calibration.rig, calibration.created_utc, document), record
        )
    return record


def _as_found(before: CalibrationRecord, data: CalibrationInput) -> PlateCheck | None:
    """The calibration in force against the new views; None when the rig had other cameras then."""
    try:
        known = validate(CalibrationFile, dict(before.document), file=Path(f"calibration {before.id}"))
        return check_with_plate(data, known.calibration())
    except InputError:
        return None
