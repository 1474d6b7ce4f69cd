"""`truewheel calibration refresh`: a calibration whose one changed camera is estimated anew from shots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from alignment.calibration.gate import ARCMIN
from alignment.calibration.prediction import predict_angle_uncertainty
from alignment.calibration.refresh import Moved, Movement, Refreshed, refresh
from alignment.errors import ConfigurationError
from alignment.values import MeasureSettings, RigCalibration
from sensors.formats import read_calibration_file, read_shot, write_calibration
from station.calibrate import calibration_id

FOCAL_SIGMA = 0.01
"""How far a refocused lens may have changed its focal length, relative."""
_COVERAGE_FACTOR = 2.0


def refresh_file(
    shots: Sequence[Path],
    calibration: Path,
    out: Path,
    now_utc: datetime,
    settings: MeasureSettings,
    *,
    focal: bool,
) -> tuple[Refreshed, RigCalibration | None]:
    """Find the camera that changed; write the calibration with its new pose.

    Parameters
    ----------
    shots
        Folders of shots of ordinary wheels, taken since the change.
    calibration
        File in force, with its covariance.
    out
        New file; nothing is written when no camera changed.
    now_utc
        Time of the refresh, aware; part of the new calibration's id.
    settings
        Of the measurement.
    focal
        Whether the focal length may have changed too.

    Returns
    -------
    refreshed, calibration
        What was found, and the new calibration as written; None when no camera changed.

    Raises
    ------
    ConfigurationError
        When `out` exists: a calibration is not replaced by one from ordinary wheels.
    FormatError
        When a shot or the calibration cannot be read, or they do not belong together.
    DegenerateInputError
        When the shots do not tell: a plate is needed.
    """
    if out.exists():
        raise ConfigurationError(
            file=out,
            field="--out",
            expected="a new file",
            seen="one that is there",
            cure="Choose another name; what is there is not replaced",
        )
    file = read_calibration_file(calibration)
    known = file.calibration()
    images = [read_shot(shot, known).images for shot in shots]
    found = refresh(images, known, settings, Movement(focal=FOCAL_SIGMA if focal else 0.0))
    if found.moved is None:
        return found, None
    new = replace(found.calibration, id=calibration_id(found.calibration, now_utc))
    name = " ".join(found.moved.camera)
    write_calibration(
        out, new, method=f"{known.id}, {name} anew from {len(shots)} wheels"[:200], created_utc=now_utc
    )
    return found, new


def refreshed_as_json(found: Refreshed, new: RigCalibration | None) -> dict[str, Any]:
    """Return what ``truewheel calibration refresh --json`` prints."""
    camber, toe = (None, None)
    if found.calibration.covariance is not None:
        u = predict_angle_uncertainty(found.calibration)
        camber, toe = (float(np.degrees(_COVERAGE_FACTOR * each)) for each in u)
    moved = _moved_as_json(found.moved)
    other = None
    if found.other is not None:
        camber_off, toe_off = (float(angle) / ARCMIN for angle in found.angle_difference)
        other = _moved_as_json(found.other) | {
            "camber_difference_arcmin": camber_off,
            "toe_difference_arcmin": toe_off,
        }
    return {
        "outcome": "unchanged" if new is None else "refreshed",
        "calibration_id": None if new is None else new.id,
        **moved,
        "certain": found.certain,
        "other": other,
        "wheels": found.wheels,
        "row_rms_px": found.row_rms_px,
        "predicted_camber_u95_deg": camber,
        "predicted_toe_u95_deg": toe,
        "heads": [
            {
                "head": state.name,
                "pairs": state.pairs,
                "row_rms_px": state.row_rms_px,
                "excess": state.excess,
                "limit": state.limit,
                "changed": state.changed,
            }
            for state in found.heads
        ],
    }


def _moved_as_json(moved: Moved | None) -> dict[str, Any]:
    if moved is None:
        return {"camera": None, "share": None, "turn_arcmin": None, "move_mm": None, "focal_change": None}
    return {
        "camera": list(moved.camera),
        "share": moved.share,
        "turn_arcmin": [float(angle) / ARCMIN for angle in moved.step[:3]],
        "move_mm": [float(value) for value in moved.step[3:]],
        "focal_change": moved.focal_change,
    }
