"""What a projector's light adds to an image: the exposure with it less one without it, next to each other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from alignment.errors import DegenerateInputError
from alignment.values import Image

_DEPTHS = (10, 12, 14, 16)
PEDESTAL_SHARE = 1.0 / 16.0
"""Of full scale: the grey level that stands for no light of the projector."""


def full_scale(image: Image) -> int:
    """Return the highest grey level that the camera of an image can deliver.

    255 for 8 bit. A 16-bit image may come from 10, 12, 14 or 16 bits, which stand at either end of its
    pixels: the lowest of their tops that no pixel exceeds.
    """
    if image.dtype == np.uint8:
        return 255
    tops = sorted({2**bits - 1 for bits in _DEPTHS} | {(2**bits - 1) << (16 - bits) for bits in _DEPTHS})
    highest = int(image.max()) if image.size else 0
    full: int = next(top for top in tops if top >= highest)
    return full


def saturated_share(image: Image) -> float:
    """Return the share of pixels at full scale."""
    return float(np.mean(image >= full_scale(image)))


def without_ambient(lit: Image, dark: Image) -> Image:
    """Subtract the light of sun and lamps: what both exposures show is gone, what the projector adds is left.

    A pixel becomes lit − dark + pedestal, `PEDESTAL_SHARE` of full scale: noise about nothing lies on both
    sides of the pedestal, so that nothing is bent upward where it would be cut off at zero (it is cut there
    all the same, far out). A pixel that either exposure saturates tells nothing of the difference: it stays
    at full scale, where a measurement counts it as saturated, and no other pixel is put there. The noise of
    both exposures is in the result: where they are alike its standard deviation is √2 of one exposure's,
    anywhere it is the root of the sum of both variances. Light that changed between the two exposures
    (flicker of lamps, a shadow that moved) is not taken off.

    Parameters
    ----------
    lit, dark
        (height, width), both 8 or both 16 bit, same exposure time and gain.

    Returns
    -------
    array
        (height, width), of the type of `lit`.

    Raises
    ------
    DegenerateInputError
        When they differ in size or type.
    """
    if lit.shape != dark.shape or lit.dtype != dark.dtype:
        raise DegenerateInputError(
            field="dark",
            expected=f"an image like the lit one, {lit.shape} {lit.dtype}",
            seen=f"{dark.shape} {dark.dtype}",
        )
    top = max(full_scale(lit), full_scale(dark))
    deep = lit.dtype == np.uint16
    out: NDArray[np.int16] | NDArray[np.int32] = lit.astype(np.int32) if deep else lit.astype(np.int16)
    np.subtract(out, dark, out=out)
    np.add(out, round(PEDESTAL_SHARE * top), out=out)
    saturated = (lit >= top) | (dark >= top)
    # Where no pixel is at full scale, that may be higher than it looks: nothing is cut off there.
    np.clip(out, 0, (top if saturated.any() else np.iinfo(lit.dtype).max) - 1, out=out)
    out[saturated] = top
    return out.astype(np.uint16) if deep else out.astype(np.uint8)
