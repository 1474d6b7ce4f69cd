"""Locates marks below the pixel: one interface, methods by name."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from alignment.errors import DegenerateInputError
from alignment.imaging import mark_ellipse as fit
from alignment.imaging.marks import Marks, RoughMarks, upper_factor
from alignment.values import Image

Method = Callable[[Image, RoughMarks], Marks]

_LEAST_SIGMA = 0.002  # pixels: what the model itself may be wrong by
_WORST_FIT = 0.2  # RMS residual over contrast of a mark that is believed
_SATURATED = 0.995  # of the largest grey level


def by_ellipse(image: Image, rough: RoughMarks) -> Marks:
    """Fit a blurred ellipse to the grey levels: the most exact method (`alignment.imaging.mark_ellipse`)."""
    factor = upper_factor(rough.shape)
    start = fit.start_values(image, rough.points, factor, rough.hole)
    table = fit.fit_ellipses(image, start, rough.hollow, rough.exposure.noise)
    contrast = np.abs(table[:, fit.GROUND] - table[:, fit.MARK])
    good = (table[:, fit.STEPS] > 0) & (table[:, fit.RMS] < _WORST_FIT * contrast)
    # What was taken for a dark mark must be dark: shading may fool the rough search, not the fit.
    good &= (table[:, fit.MARK] > table[:, fit.GROUND]) == rough.bright
    rows = np.flatnonzero(good)
    table = table[rows]
    u = np.zeros((len(rows), 2, 2))
    u[:, 0, 0], u[:, 0, 1], u[:, 1, 1] = table[:, fit.A], table[:, fit.B], table[:, fit.C]
    covariance = table[:, [fit.VXX, fit.VXY, fit.VXY, fit.VYY]].reshape(-1, 2, 2)
    brightest = np.maximum(table[:, fit.GROUND], table[:, fit.MARK])
    return Marks(
        points=table[:, [fit.CX, fit.CY]],
        covariance=covariance + _LEAST_SIGMA**2 * np.eye(2),
        shape=np.asarray(np.linalg.inv(np.swapaxes(u, 1, 2) @ u), dtype=np.float64),
        hollow=rough.hollow[rows],
        blur=table[:, fit.BLUR],
        contrast=contrast[rows],
        rough=rows,
        saturated=brightest >= _SATURATED * rough.exposure.limit,
        size=rough.size,
        exposure=rough.exposure,
        method="ellipse",
    )


METHODS: dict[str, Method] = {"ellipse": by_ellipse}


def locate_marks(image: Image, rough: RoughMarks, method: str = "ellipse") -> Marks:
    """Locate rough marks below the pixel.

    Parameters
    ----------
    image
        (height, width), one channel, 8 or 16 bit: the one in which the rough marks were found.
    rough
        From `find_marks`.
    method
        A name of `METHODS`.

    Raises
    ------
    DegenerateInputError
        When there is no such method, or the image is not the one of the rough marks.
    """
    if method not in METHODS:
        raise DegenerateInputError(
            field="method", expected=f"one of {', '.join(METHODS)}", seen=f"'{method}'"
        )
    if (image.shape[1], image.shape[0]) != rough.size:
        raise DegenerateInputError(
            field="image", expected=f"the {rough.size} image of the rough marks", seen=f"shape {image.shape}"
        )
    return METHODS[method](image, rough)
