"""Refusals and warnings of a measurement in words: what was seen, and what to do."""

from __future__ import annotations

import math

from alignment.calibration.judgement import KNOCKED, Judgement
from alignment.prepared import PreparedRig
from alignment.stereo.correspondence import Candidates
from alignment.values import HeadCalibration, Image, MeasureSettings, Refusal, RefusalCode


def too_bright(head: HeadCalibration, side: str) -> Refusal:
    """Of a head most of whose light is at full scale."""
    return Refusal(
        RefusalCode.HEAD_SATURATED,
        f"{head.name} {side}: most of the light lines are at full scale; shorten the exposure "
        "or shield the station from the sun",
        head.name,
    )


def no_light(image: Image, head: HeadCalibration, side: str) -> Refusal:
    """Of a head that shows no light lines."""
    return Refusal(
        RefusalCode.HEAD_DARK,
        f"{head.name} {side}: no light lines (brightest pixel {int(image.max())}); check projector, "
        "lens cap, exposure, and that a wheel stands in front of the head",
        head.name,
    )


def no_match(candidates: Candidates, head: HeadCalibration, settings: MeasureSettings) -> Refusal:
    """Of a head whose light lines have no partners."""
    lo, hi = settings.depth_range_mm
    return Refusal(
        RefusalCode.NO_CORRESPONDENCE,
        f"{head.name}: only {len(candidates.points)} of {candidates.offered} line points have a partner "
        f"between z = {lo:g} and {hi:g} mm; check that left and right images are not swapped, that the head "
        "has not moved since its calibration, and that the wheel is in place",
        head.name,
    )


def _seen(judgement: Judgement) -> str:
    """Figures of a judgement, in words."""
    row, sigma = judgement.row_px[judgement.head], judgement.row_sigma_px[judgement.head]
    rows = f"its rows differ by {row:.2f} px, noise and calibration make {sigma:.2f}"
    if math.isnan(row):
        rows = "too few crosses of light lines for its rows"
    return f"evidence {judgement.evidence or 0.0:.0f}, refused above {KNOCKED:.0f}; {rows}"


def head_knocked(judgement: Judgement, rig: PreparedRig) -> Refusal:
    """Of a shot that nothing but a knock, or mixed pictures, explain."""
    name = rig.heads[judgement.head].name
    return Refusal(
        RefusalCode.HEAD_MOVED,
        f"{name} does not fit its calibration and the other heads: a movement of {judgement.suspect} would "
        f"explain it ({_seen(judgement)}); check that it has not been knocked and that all images are of one "
        "exposure, and calibrate again",
        name,
    )


def warning(judgement: Judgement, rig: PreparedRig) -> str:
    """In words, of a shot whose heads are suspect."""
    camber, toe = (60.0 * math.degrees(angle) for angle in judgement.angles)
    return (
        f"{rig.heads[judgement.head].name} is suspect: a movement of {judgement.suspect} would "
        f"explain the shot ({_seen(judgement)}) and change camber by {camber:+.2f}′ and toe by {toe:+.2f}′, "
        "which the uncertainty covers; check the calibration"
    )


def outside(what: str) -> Refusal:
    """Of a wheel that stands where none is measured; `what` says by what that was told."""
    return Refusal(
        RefusalCode.OUTSIDE_VOLUME,
        f"the wheel is outside the measuring volume: {what}; check its position and the calibration's rig",
    )
