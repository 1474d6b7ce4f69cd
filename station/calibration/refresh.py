"""`truewheel calibration refresh`: a calibration whose one changed camera is estimated anew from shots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from alignment.calibration import Moved, Movement, Refreshed, predict_angle_uncertainty, refresh
from alignment.counting import count_of
from alignment.errors import ConfigurationError
from alignment.units import ARCMIN
from alignment.values import MeasureSettings, RigCalibration
from sensors.formats import read_calibration_file, read_shot, write_calibration
from station.calibration.calibrate import calibration_id

FOCAL_SIGMA = 0.01
"""How far a refocused lens may have changed its focal length, relative."""
_COVERAGE_FACTOR = 2.0


LARGEST_U95_ARCMIN = 0.2
"""What angles may be uncertain by after a refresh, unless told otherwise."""


@dataclass(frozen=True, eq=False)
class RefreshedFile:
    """What came of a refresh.

    Attributes
    ----------
    found
        What the shots tell.
    old_u95, new_u95
        Expanded uncertainties (camber, toe), radians, that the calibration in force states, and the new one.
    refused
        Why nothing was written though a camera changed, and what to do; None otherwise.
    calibration
        As written; None when nothing was.
    """

    found: Refreshed
    old_u95: tuple[float, float]
    new_u95: tuple[float, float]
    refused: str | None
    calibration: RigCalibration | None

    @property
    def outcome(self) -> str:
        """``unchanged``, ``refused`` or ``refreshed``."""
        if self.calibration is not None:
            return "refreshed"
        return "unchanged" if self.refused is None else "refused"


def refresh_file(
    shots: Sequence[Path],
    calibration: Path,
    out: Path,
    now_utc: datetime,
    settings: MeasureSettings,
    *,
    focal: bool,
    largest_u95: float = LARGEST_U95_ARCMIN * ARCMIN,
) -> RefreshedFile:
    """Find the camera that changed; write the calibration with its new pose, where that is the better one.

    Parameters
    ----------
    shots
        Folders of shots of ordinary wheels, taken since the change.
    calibration
        File in force, with its covariance.
    out
        New file; nothing is written when no camera changed, nor what would be worse than the one in force.
    now_utc
        Time of the refresh, aware; part of the new calibration's id.
    settings
        Of the measurement.
    focal
        Whether the focal length may have changed too.
    largest_u95
        Largest expanded uncertainty of an angle that a refreshed calibration may state, radians.

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
            choice="out",
            expected="a new file",
            seen="one that is there",
            cure="Choose another name; what is there is not replaced",
        )
    file = read_calibration_file(calibration)
    known = file.calibration()
    images = [read_shot(shot, known).images for shot in shots]
    found = refresh(images, known, settings, Movement(focal=FOCAL_SIGMA if focal else 0.0))
    old_u95, new_u95 = expanded(known), expanded(found.calibration)
    if found.moved is None:
        return RefreshedFile(found, old_u95, new_u95, None, None)
    refused = judge_refreshed(found, old_u95, new_u95, largest_u95)
    if refused is not None:
        return RefreshedFile(found, old_u95, new_u95, refused, None)
    new = replace(found.calibration, id=calibration_id(found.calibration, now_utc))
    name = " ".join(found.moved.camera)
    write_calibration(
        out,
        new,
        method=f"{known.id}, {name} anew from {count_of(len(shots), 'wheel')}"[:200],
        created_utc=now_utc,
    )
    return RefreshedFile(found, old_u95, new_u95, None, new)


def expanded(calibration: RigCalibration) -> tuple[float, float]:
    """Return the expanded uncertainties (camber, toe), radians, that a calibration alone states."""
    camber, toe = predict_angle_uncertainty(calibration)
    return _COVERAGE_FACTOR * camber, _COVERAGE_FACTOR * toe


def judge_refreshed(
    found: Refreshed, old_u95: tuple[float, float], new_u95: tuple[float, float], largest_u95: float
) -> str | None:
    """None when a refreshed calibration is worth more than the one in force, else why it is not.

    What the one in force may be wrong by is what the refresh would change, and what it states.
    """
    assert found.moved is not None
    camera, new = " ".join(found.moved.camera), max(new_u95)
    change = float(np.abs(found.angle_change).max() + np.abs(found.angle_difference).max())
    cure = (
        "Calibrate the rig with the plate, or take more shots of different wheels; until then its angles may "
        "be off"
    )
    if new > largest_u95:
        return (
            f"{camera} changed, but angles would be uncertain by ±{new / ARCMIN:.2f}′ (95 %), allowed is "
            f"±{largest_u95 / ARCMIN:.2f}′. {cure}"
        )
    if new > change + max(old_u95):
        return (
            f"{camera} changed, but angles would be uncertain by ±{new / ARCMIN:.2f}′ (95 %), more than the "
            f"{change / ARCMIN:.2f}′ by which they would change: the calibration in force is the better one. "
            f"{cure}"
        )
    return None


def refreshed_as_json(done: RefreshedFile) -> dict[str, Any]:
    """Return what ``truewheel calibration refresh --json`` prints."""
    found, new = done.found, done.calibration
    old_camber, old_toe, camber, toe = (float(value) for value in np.degrees([*done.old_u95, *done.new_u95]))
    moved = _moved_as_json(found.moved)
    other = None
    if found.other is not None:
        camber_off, toe_off = (float(angle) / ARCMIN for angle in found.angle_difference)
        other = _moved_as_json(found.other) | {
            "camber_difference_arcmin": camber_off,
            "toe_difference_arcmin": toe_off,
        }
    return {
        "outcome": done.outcome,
        "reason": done.refused,
        "calibration_id": None if new is None else new.id,
        **moved,
        "certain": found.certain,
        "other": other,
        "wheels": found.wheels,
        "row_rms_px": found.row_rms_px,
        "contradiction": found.contradiction,
        "unseen_u95_deg": None
        if found.unseen is None
        else [float(np.degrees(_COVERAGE_FACTOR * each)) for each in found.unseen],
        "camber_change_arcmin": float(found.angle_change[0]) / ARCMIN,
        "toe_change_arcmin": float(found.angle_change[1]) / ARCMIN,
        "old_camber_u95_deg": old_camber,
        "old_toe_u95_deg": old_toe,
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
