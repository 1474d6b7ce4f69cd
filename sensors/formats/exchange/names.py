"""What other programs call the matrix, the coefficients, the pose and the size of a camera."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from typing import NamedTuple

MATRIX = ("camera_matrix", "Camera_Matrix", "cameraMatrix", "CameraMatrix", "intrinsic_matrix", "K", "k")
DISTORTION = (
    "distortion_coefficients",
    "Distortion_Coefficients",
    "distortion_coefficents",
    "distCoeffs",
    "dist_coeffs",
    "DistCoeffs",
    "distortion_coeffs",
    "D",
    "d",
)
ROTATION = ("R", "rotation_matrix", "RotationMatrix")
TRANSLATION = ("T", "t", "translation_vector", "TranslationVector")
WIDTH = ("image_width", "image_Width", "width", "Width", "imageWidth")
HEIGHT = ("image_height", "image_Height", "height", "Height", "imageHeight")
RECTIFICATION = ("rectification_matrix", "R", "r")
PROJECTION = ("projection_matrix", "P", "p")

_MATRIX_STEMS = ("M", "K", "cameraMatrix", "camera_matrix", "CameraMatrix", "intrinsic_matrix", "mtx")
_DISTORTION_STEMS = (
    "D",
    "distCoeffs",
    "dist_coeffs",
    "distortion_coefficients",
    "DistCoeffs",
    "distCoeff",
    "distortion_coeffs",
    "distortion",
    "dist",
)
_SIDES = (
    ("1", "2"),
    ("_1", "_2"),
    ("L", "R"),
    ("_left", "_right"),
    ("_l", "_r"),
    ("Left", "Right"),
    ("0", "1"),
)
_BEFORE = (("left_", "right_"), ("LEFT.", "RIGHT."), ("left.", "right."))


class PairNames(NamedTuple):
    """The keys of the matrices and of the coefficients of a pair, the first camera's first."""

    matrix: tuple[str, str]
    distortion: tuple[str, str]


def _pairs(stems: tuple[str, ...]) -> tuple[tuple[str, str], ...]:
    behind = tuple((stem + first, stem + second) for (first, second), stem in product(_SIDES, stems))
    before = tuple((first + stem, second + stem) for (first, second), stem in product(_BEFORE, stems))
    return behind + before


_MATRIX_PAIRS = _pairs((*_MATRIX_STEMS,))
_DISTORTION_PAIRS = _pairs((*_DISTORTION_STEMS,))
IMPORTANT = frozenset(
    name
    for names in (MATRIX, DISTORTION, ROTATION, TRANSLATION, WIDTH, HEIGHT, ("cameras",))
    for name in names
) | {name for pairs in (_MATRIX_PAIRS, _DISTORTION_PAIRS) for pair in pairs for name in pair}
"""Keys that make a camera, by any of their names."""


def pair_in(values: Mapping[str, object]) -> PairNames | None:
    """Return the keys of the pair of cameras that a map describes; None when it describes none.

    Coefficients that are missing are named as they would be called beside these matrices.
    """
    for matrix in _MATRIX_PAIRS:
        if all(name in values and not isinstance(values[name], int | float | str) for name in matrix):
            break
    else:
        return None
    for distortion in _DISTORTION_PAIRS:
        if all(name in values for name in distortion):
            return PairNames(matrix, distortion)
    digits = tuple("".join(c for c in name if c.isdigit()) for name in matrix)
    return PairNames(matrix, (f"D{digits[0]}", f"D{digits[1]}"))
