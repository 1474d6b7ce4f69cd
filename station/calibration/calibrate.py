"""From the images of a plate to the calibration of a rig: marks, lens model, adjustment, gate."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from datetime import datetime
from enum import StrEnum

from alignment.calibration import (
    Adjustment,
    AdjustmentSettings,
    CalibrationInput,
    CalibrationProblem,
    CameraKey,
    GateJudgement,
    GateLimits,
    ModelChoice,
    Start,
    adjust,
    as_rig_calibration,
    choose_model,
    content_digest,
    heads_then_poses,
    judge_calibration,
    judge_failure,
    judge_input,
    start_values,
)
from alignment.errors import DegenerateInputError
from alignment.imaging import PlateRefusal
from alignment.values import RigCalibration, nominal_vehicle_from_rig
from sensors.formats import PlateSession
from station.calibration.observing import MARKS_SHARE, observe_session
from station.figures import Progress

"""Told the fraction that is done, 0 … 1, and what goes on."""

CANDIDATES = ("division", "brown5", "brown8", "thin_prism", "tilted")
"""Lens models of which cross-validation chooses."""
_CHOICE_SHARE = 0.4  # of the time, for the progress


class Method(StrEnum):
    """How a rig is calibrated."""

    JOINT = "joint"
    HEADS_THEN_POSES = "heads-then-poses"


@dataclass(frozen=True)
class CalibrateSettings:
    """Choices of a calibration.

    Attributes
    ----------
    method
        Joint adjustment, or each head alone and then their poses.
    model
        Lens model; None lets cross-validation choose.
    adjustment
        Of the joint adjustment; its `model` is not used.
    limits
        Of the gate.
    """

    method: Method = Method.JOINT
    model: str | None = None
    adjustment: AdjustmentSettings = field(default_factory=AdjustmentSettings)
    limits: GateLimits = field(default_factory=GateLimits)


@dataclass(frozen=True, eq=False)
class Calibrated:
    """What came out.

    Attributes
    ----------
    judgement
        The gate's answer, or why no plate was found.
    calibration
        None when refused.
    data
        The observations; None where a plate was not recognised.
    adjustment
        The joint adjustment, by which either method is judged; None where there was none.
    choice
        How the lens model was chosen; None where it was given.
    rms_px
        RMS length of the residuals of the method, pixels.
    refusals
        Images in which the plate was not recognised, by view, head and side.
    """

    judgement: GateJudgement
    calibration: RigCalibration | None = None
    data: CalibrationInput | None = None
    adjustment: Adjustment | None = None
    choice: ModelChoice | None = None
    rms_px: float | None = None
    refusals: tuple[tuple[str, CameraKey, PlateRefusal], ...] = ()


def calibrate_session(
    session: PlateSession, settings: CalibrateSettings, now_utc: datetime, progress: Progress
) -> Calibrated:
    """Calibrate a rig from a plate session.

    Parameters
    ----------
    session
        Images and plate.
    settings
        Choices.
    now_utc
        Time of the calibration, aware; part of its id.
    progress
        Told how far it is.

    Raises
    ------
    DegenerateInputError
        When the session lacks a camera of a head.
    """
    views, refusals = observe_session(session, progress)
    if refusals:
        return Calibrated(_not_recognised(refusals), refusals=tuple(refusals))
    data = CalibrationInput(session.plate.plate, views, dict(session.sizes), session.stage_sigma_mm)
    before = judge_input(data, settings.limits)
    if not before:
        return Calibrated(before, data=data)
    try:
        start = start_values(data, "brown5")
        choice = None if settings.model else _choose(data, settings, start, progress)
        model = settings.model or (choice.model if choice else "brown5")
        progress(MARKS_SHARE + _CHOICE_SHARE, f"adjustment, lens model {model}")
        adjustment = adjust(data, replace(settings.adjustment, model=model), start)
        return _calibrated(session, settings, now_utc, adjustment, choice)
    except DegenerateInputError as error:
        return Calibrated(judge_failure(data, error, settings.adjustment), data=data)


def _calibrated(
    session: PlateSession,
    settings: CalibrateSettings,
    now_utc: datetime,
    adjustment: Adjustment,
    choice: ModelChoice | None,
) -> Calibrated:
    vehicle_from_rig = nominal_vehicle_from_rig(session.side)
    joint = adjustment.rig_calibration("joint", session.rig, session.side, vehicle_from_rig)
    judgement = judge_calibration(adjustment, joint, settings.limits)
    calibration, rms = joint, adjustment.rms_px
    if settings.method is Method.HEADS_THEN_POSES:
        apart = heads_then_poses(adjustment.data, replace(settings.adjustment, model=adjustment.model))
        # Its own uncertainty is not known: the joint covariance is that of another estimate.
        calibration = as_rig_calibration(
            adjustment.data, apart.cameras, None, "apart", session.rig, session.side, vehicle_from_rig
        )
        rms = apart.rms_px
        judgement = replace(judgement, camber_u95=None, toe_u95=None)
    named = replace(calibration, id=calibration_id(calibration, now_utc)) if judgement else None
    return Calibrated(judgement, named, adjustment.data, adjustment, choice, rms)


def calibration_id(calibration: RigCalibration, now_utc: datetime) -> str:
    """Identity of a calibration: its rig, its time, and a digest of what it says of cameras and rig."""
    digest = content_digest(calibration, in_vehicle=True)
    return f"{calibration.rig}-{now_utc:%Y%m%dT%H%M%S}-{digest[:8]}"


def _not_recognised(refusals: list[tuple[str, CameraKey, PlateRefusal]]) -> GateJudgement:
    sentences = [f"view {view}, {' '.join(key)}: {refusal.reason}" for view, key, refusal in refusals]
    shown = sentences[:3]
    if len(sentences) > len(shown):
        shown.append(f"and {len(sentences) - len(shown)} more images")
    return GateJudgement(CalibrationProblem.PLATE_NOT_RECOGNISED, "; ".join(shown))


def _choose(
    data: CalibrationInput, settings: CalibrateSettings, start: Start, progress: Progress
) -> ModelChoice:
    tried = 0

    def tell(model: str) -> None:
        nonlocal tried
        progress(MARKS_SHARE + _CHOICE_SHARE * tried / len(CANDIDATES), f"lens model {model}")
        tried += 1

    return choose_model(data, settings.adjustment, CANDIDATES, start, tell)
