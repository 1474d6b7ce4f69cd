"""Whether plate and stage mean the same millimetre: a wrong pitch fits the images, and turns every angle.

A plate whose marks are stated a factor k too far apart looks like one before cameras of another focal length.
Only the stage's moves in the plate's plane tell, or tilted views; heights of the stage do not. It makes
a rig whose x and y are stretched against z, so that camber and toe are wrong by that share of themselves.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from alignment.arrays import Array
from alignment.calibration.adjustment import Adjustment, AdjustmentSettings, adjust
from alignment.calibration.observations import CalibrationInput
from alignment.errors import DegenerateInputError
from alignment.imaging.pattern import PatternKind
from alignment.imaging.plate import Plate

_SIGMAS = 4.0
_LEAST = 5e-4  # of an angle of 2° that is 0.06′, as much as a calibration may cost
_UNITS = {
    25.4: "inches taken for millimetres in the stage's positions",
    1.0 / 25.4: "inches taken for millimetres in the plate's pitch",
    10.0: "centimetres taken for millimetres in the stage's positions",
    0.1: "centimetres taken for millimetres in the plate's pitch",
    1000.0: "metres taken for millimetres in the stage's positions",
    0.001: "metres taken for millimetres in the plate's pitch",
    2.0: "a pitch counted over two marks",
    0.5: "half of the pitch",
}
_SAME_UNIT = 0.03
_LEAST_AGAINST_CAMERAS = 2e-3  # what a refocused lens of every camera alike would make is less
_MOST_AGAINST_CAMERAS = 0.25  # with more the marks fit nowhere
_UNEXPLAINED = 0.05  # of the cameras' squared movements; more is no scale


def scale_in_moves(adjustment: Adjustment) -> float | None:
    """How many times too far apart the plate's marks are stated, against the stage, by its moves.

    Returns
    -------
    float or None
        The factor; None where it is 1 within its uncertainty, or no move tells.
    """
    data = adjustment.data
    rows = [v for v, view in enumerate(data.views) if view.stage_mm is not None]
    if not rows or data.stage_sigma_mm <= 0.0:
        return None
    stage = np.array([data.views[v].stage_mm for v in rows])
    moved = adjustment.stage_correction_mm[rows]
    ones = np.ones((len(rows), 1))
    # What cameras may lean together makes the corrections in the plane a straight line in the height.
    for axes, common in (([0, 1], np.column_stack([ones, stage[:, 2]])), ([2], ones)):
        free = np.column_stack([stage[:, axes], moved[:, axes]])
        free = free - common @ np.linalg.lstsq(common, free)[0]
        moves, corrections = free[:, : len(axes)].ravel(), free[:, len(axes) :].ravel()
        size = float(moves @ moves)
        if size <= 0.0:
            continue
        excess = float(moves @ corrections) / size
        if abs(excess) > max(_SIGMAS * data.stage_sigma_mm / math.sqrt(size), _LEAST):
            return 1.0 + excess
    return None


def stated_scale(
    data: CalibrationInput,
    adjustment: Adjustment | None,
    refit: Callable[[CalibrationInput], Adjustment | None],
) -> tuple[float, str] | None:
    """Find the one factor by which the plate's marks are stated too far apart, against the stage.

    Parameters
    ----------
    data
        What contradicts itself, or seems not to.
    adjustment
        What came of it; None where nothing did.
    refit
        Adjusts changed data; None where they contradict themselves.

    Returns
    -------
    tuple or None
        The factor and the sentence that says it; None when no common factor is off.
    """
    if all(view.stage_mm is None for view in data.views):
        return None
    as_stated = refit(data)
    if as_stated is not None and scale_in_moves(as_stated) is None:
        return None  # where nothing tells the scale, every scale fits
    found = [None if adjustment is None else scale_in_moves(adjustment), _scale_of_tilted(data)]
    for factor in (*found, *_UNITS):
        if factor is None or factor <= 0.0 or abs(factor - 1.0) <= _LEAST:
            continue
        fitted = refit(_shrunk(data, factor))
        if fitted is not None and scale_in_moves(fitted) is None:
            return factor, scale_sentence(
                data.plate, factor, "stage disagree in every view", "the unit of the stage"
            )
    return None


def _scale_of_tilted(data: CalibrationInput) -> float | None:
    """The factor from distances between the plate's places when the stage is not asked; views need tilts."""
    free = tuple(replace(view, stage_mm=None) for view in data.views)
    try:
        found = adjust(replace(data, views=free), AdjustmentSettings())
    except DegenerateInputError:
        return None
    rows = [v for v, view in enumerate(data.views) if view.stage_mm is not None]
    here = np.array([found.rig_from_plate[v].translation for v in rows])
    said = np.array([data.views[v].stage_mm for v in rows])
    first, second = np.triu_indices(len(rows), 1)
    seen, stage = (np.linalg.norm(x[first] - x[second], axis=1) for x in (here, said))
    return float(seen @ stage / (stage @ stage)) if stage @ stage > 0.0 else None


def _shrunk(data: CalibrationInput, factor: float) -> CalibrationInput:
    return replace(data, plate=replace(data.plate, points=data.plate.points / factor))


def common_scale(before: Array, after: Array, sigma: float) -> float | None:
    """How many times too far apart a plate's marks are stated, against cameras that are known.

    A plate before known lenses that is stated a factor too large seems as much farther away: all cameras
    seem to have moved from their middle, or towards it, by one share, which no knock does.

    Parameters
    ----------
    before, after
        (C, 3) centres of the cameras as they are known and as the plate shows them, rig frame, millimetres.
    sigma
        Standard uncertainty of each coordinate of the latter, millimetres.

    Returns
    -------
    float or None
        The factor; None where it is 1 within its uncertainty, or does not explain how the cameras seem to
        have moved.
    """
    known, seen = before - before.mean(axis=0), after - after.mean(axis=0)
    size = float(np.square(known).sum())
    if size <= 0.0:
        return None
    excess = float((known * (seen - known)).sum()) / size
    if abs(excess) <= max(_SIGMAS * sigma / math.sqrt(size), _LEAST_AGAINST_CAMERAS):
        return None
    rest = float(np.square(seen - (1.0 + excess) * known).sum())
    explained = abs(excess) <= _MOST_AGAINST_CAMERAS and rest <= _UNEXPLAINED * excess * excess * size
    return 1.0 + excess if explained else None


def scale_sentence(plate: Plate, factor: float, against: str, then: str) -> str:
    """Say by how much the plate's marks are stated too far apart, what pitch would fit, and what to check.

    Parameters
    ----------
    plate
        As stated.
    factor
        Of the pitch.
    against
        What the plate disagrees with, and where.
    then
        What to check after the plate.
    """
    unit = next((text for known, text in _UNITS.items() if abs(factor / known - 1.0) < _SAME_UNIT), None)
    by = f"{100.0 * (factor - 1.0):+.2f} %" if 0.5 < factor < 2.0 else f"a factor of {factor:.4g}"
    stated, fitting = _pitches(plate, 1.0), _pitches(plate, factor)
    what, field, verb = "a pitch", "pitch_mm", "is"
    if plate.pattern.kind is not PatternKind.RING_MARKS:
        what, field, verb = "pitches", "pitch_x_mm, pitch_y_mm", "are"
    return (
        f"plate and {against} by one common scale, {by}: "
        f"{what} of {fitting} would fit where {stated} {verb} stated"
        + ("" if unit is None else f", as would {unit}")
        + f"; check the plate's {field} and certificate first, then {then}"
    )


def _pitches(plate: Plate, factor: float) -> str:
    """The pitch of a plate over a factor, in words; in x and y where its file has both."""
    indices = plate.indices - plate.indices.mean(axis=0)
    points = plate.points[:, :2]
    if plate.pattern.kind is PatternKind.RING_MARKS:
        return f"{float((indices * points).sum() / np.square(indices).sum()) / factor:.4g} mm"
    along = np.linalg.lstsq(indices.astype(np.float64), points - points.mean(axis=0))[0]
    x, y = (f"{abs(float(along[axis, axis])) / factor:.4g} mm in {name}" for axis, name in enumerate("xy"))
    return f"{x} and {y}"
