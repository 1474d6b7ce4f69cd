"""Whether a wheel turned between exposures, by what its surface looks like: letters, marks and dirt move on.

Light lines, heads and whatever else stands still look the same in every exposure; a wheel that wanders shifts
them slowly. What a turning wheel shows differs from each exposure to the next by as much as from any other.
Noise is kept out: each image is halved into two of other pixels, and only what both halves show counts.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from alignment.arrays import Array, Singles
from alignment.values import StereoImages

_EVERY = 4  # pixels along a side, of which each half takes another one
_BLOCK = 4  # of these along a side; letters are larger
_SUDDEN = 1.5  # second differences in first ones, squared: 3 of what turned, below 0.5 of what wanders slowly
_DEVIATIONS = 6.0  # above which what differs is no noise
_FEWEST = 4


def look_of(images: Sequence[StereoImages]) -> Singles:
    """(2, P) how the left images of all heads look to each half of their pixels, coarsely; of mean 1."""
    halves = []
    for rows in (0, _EVERY // 2):
        parts = []
        for pair in images:
            half = np.ascontiguousarray(pair.left[rows::_EVERY, rows::_EVERY], dtype=np.float32)
            # Of the whole image, so that both halves have as many blocks whatever its size.
            height, width = (max(1, side // (_EVERY * _BLOCK)) for side in pair.left.shape)
            parts.append(cv2.resize(half, (width, height), interpolation=cv2.INTER_AREA).ravel())
        halves.append(np.concatenate(parts))
    looks = np.array(halves)
    out: Singles = looks / np.maximum(looks.mean(axis=1, keepdims=True), 1e-6)
    return out


def has_turned(looks: Sequence[Singles]) -> bool:
    """Tell whether the wheel of these looks, in the order of their exposures, turned all the time."""
    if len(looks) < _FEWEST:
        return False
    every: Array = np.array(looks, dtype=np.float64)  # (N, 2, P)
    first, second = np.diff(every, axis=0), np.diff(every, n=2, axis=0)
    moved = (first[:, 0] * first[:, 1]).mean(axis=0)
    sudden = (second[:, 0] * second[:, 1]).mean(axis=0)
    clear = float(moved.mean()) > _DEVIATIONS * float(moved.std()) / np.sqrt(moved.size)
    return bool(clear) and float(sudden.mean()) > _SUDDEN * float(moved.mean())
