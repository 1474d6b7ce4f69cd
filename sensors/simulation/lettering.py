"""Raised letters of a sidewall, as the control values of a smooth relief."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from alignment.arrays import Singles

STEP_MM = 0.3
_OVERSAMPLING = 4
_STROKE = 0.11  # of the letter height


@dataclass(frozen=True)
class Inscription:
    """One word on the sidewall.

    Attributes
    ----------
    text
        ASCII.
    radius_mm
        Of the middle of its letters.
    angle
        Of its middle in the tyre frame, radians.
    size_mm
        Height of a capital letter.
    relief_mm
        How far it stands out; negative is sunk.
    """

    text: str
    radius_mm: float
    angle: float
    size_mm: float
    relief_mm: float


def _glyphs(inscription: Inscription) -> Singles:
    """Coverage 0..1 of the word on a grid of `STEP_MM`, as read: rows downward, columns to the right."""
    pixels = inscription.size_mm / STEP_MM * _OVERSAMPLING
    face = cv2.FONT_HERSHEY_SIMPLEX
    thickness = max(1, round(pixels * _STROKE))
    scale = pixels / cv2.getTextSize("H", face, 1.0, 1)[0][1]
    (width, tall), below = cv2.getTextSize(inscription.text, face, scale, thickness)
    margin = 4 * _OVERSAMPLING + thickness
    rows = math.ceil((tall + below + 2 * margin) / _OVERSAMPLING)
    columns = math.ceil((width + 2 * margin) / _OVERSAMPLING)
    canvas = np.zeros((rows * _OVERSAMPLING, columns * _OVERSAMPLING), dtype=np.uint8)
    cv2.putText(canvas, inscription.text, (margin, margin + tall), face, scale, 255, thickness, cv2.LINE_AA)
    coverage = canvas.reshape(rows, _OVERSAMPLING, columns, _OVERSAMPLING).mean(axis=(1, 3)) / 255.0
    return np.asarray(coverage, dtype=np.float32)


def relief_map(inscriptions: Sequence[Inscription], inner_mm: float, outer_mm: float) -> Singles:
    """Control values (rows over radius, columns over angle) of the relief, millimetres.

    Row i stands at radius ``inner_mm + i·STEP_MM``, column j at angle ``2π j/columns − π``. Edges are
    smoothed so that the flanks of a letter are about a millimetre wide. Letters are upright where the outside
    of the tyre is up and read clockwise seen from outboard.
    """
    rows = math.ceil((outer_mm - inner_mm) / STEP_MM) + 1
    columns = round(math.pi * (inner_mm + outer_mm) / STEP_MM)
    relief = np.zeros((rows, columns), dtype=np.float32)
    for inscription in inscriptions:
        # Upward is outward and to the right is clockwise: both axes of the grid run the other way.
        word = _glyphs(inscription)[::-1, ::-1] * np.float32(inscription.relief_mm)
        stretch = (inner_mm + outer_mm) / (2.0 * inscription.radius_mm)
        patch = cv2.resize(word, (max(1, round(word.shape[1] * stretch)), word.shape[0]))
        top = round((inscription.radius_mm - inner_mm) / STEP_MM - patch.shape[0] / 2)
        first = round((inscription.angle / (2 * math.pi) + 0.5) * columns - patch.shape[1] / 2)
        kept = slice(max(0, -top), min(patch.shape[0], rows - top))
        target = np.ix_(
            np.arange(kept.start, kept.stop) + top, np.arange(first, first + patch.shape[1]) % columns
        )
        if kept.stop > kept.start:
            relief[target] += patch[kept]
    padded = np.concatenate([relief[:, -8:], relief, relief[:, :8]], axis=1)
    smooth = cv2.GaussianBlur(padded, (7, 7), 0.8, borderType=cv2.BORDER_CONSTANT)[:, 8:-8]
    return np.ascontiguousarray(smooth, dtype=np.float32)
