"""What one shot says of each of its cameras: nothing is computed for it that a measurement does not need."""

from __future__ import annotations

import enum
import math

from alignment.values import SIDES, Refusal, WheelMeasurement
from sensors.shot import WheelShot

Figures = dict[str, dict["Figure", float]]
"""Of each camera, by its name."""


class Figure(enum.StrEnum):
    """What is watched of a camera, each with its unit.

    TEMPERATURE: of the camera. FAILURES: frames of a shot that were missing or bad. LINK: its speed. WIDTH:
    of the light lines, their sharpness. LIGHT: of the lines above the background, in a unit of its own. ROW:
    epipolar residual of its head.
    """

    TEMPERATURE = "temperature_c"
    FAILURES = "failures"
    LINK = "link_mbit"
    WIDTH = "line_width_px"
    LIGHT = "line_strength"
    ROW = "row_px"


def figures_of(shot: WheelShot | None, found: WheelMeasurement | Refusal | None) -> Figures:
    """Return the figures of a shot and of what was measured in it, as far as there are any."""
    out: Figures = {}
    if shot is None:
        return out
    names = {}
    for head in shot.heads:
        names[head.name] = dict(zip(SIDES, (head.left.camera, head.right.camera), strict=True))
        for frame in (head.left, head.right):
            out[frame.camera] = {}
            if frame.temperature_c is not None:
                _put(out[frame.camera], Figure.TEMPERATURE, frame.temperature_c)
    if not isinstance(found, WheelMeasurement):
        return out
    for quality in found.heads:
        for k, camera in enumerate(names.get(quality.name, {}).values()):
            if quality.line_width_px is not None:
                _put(out[camera], Figure.WIDTH, quality.line_width_px[k])
            if quality.line_strength is not None:
                _put(out[camera], Figure.LIGHT, quality.line_strength[k])
            if quality.row_px is not None:
                _put(out[camera], Figure.ROW, quality.row_px)
    return out


def _put(figures: dict[Figure, float], figure: Figure, value: float) -> None:
    # A driver says what it likes; what is no number says nothing.
    if math.isfinite(value) and abs(value) < 1e12:
        figures[figure] = float(value)
