"""The place of a wheel from exposure to exposure: a slow wander, or a jump."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from alignment.arrays import Array
from alignment.values import Refusal, RefusalCode

_WANDER_MM, _NOISE_MM = 1.5, 0.35  # of one coordinate; tyres are not round, and their run-out turns
_SWINGS = 1.5  # of the wander in the time of all exposures
_DEVIATIONS = 6.0
_LONGEST_WANDER_MM = 12.0


def jump_of_place(centres: Array, at: Array, counted: Sequence[int]) -> Refusal | None:
    """Refuse an exposure whose wheel stands elsewhere than those before and after it say.

    Each place is compared with what the others say of it (Gaussian process, left out one by one; Rasmussen
    and Williams, Gaussian Processes for Machine Learning, 5.4.2).

    Parameters
    ----------
    centres
        (N, 3) of the wheel, millimetres.
    at, counted
        (N,) when each was taken, in exposures, and how its exposure is called.
    """
    count = len(centres)
    apart = (at[:, None] - at[None]) * (2.0 * _SWINGS / count)
    covariance = _WANDER_MM**2 * np.sinc(apart) + _NOISE_MM**2 * np.eye(count)
    off = centres - np.median(centres, axis=0)
    precision = np.linalg.inv(covariance)
    rest = (precision @ off) / np.diag(precision)[:, None]
    deviations = np.linalg.norm(rest, axis=1) * np.sqrt(np.diag(precision))
    worst = int(deviations.argmax())
    far = float(np.linalg.norm(np.ptp(centres, axis=0)))
    if deviations[worst] > _DEVIATIONS:
        return Refusal(
            RefusalCode.ANOTHER_WHEEL,
            f"at exposure {counted[worst]} the wheel stands {np.linalg.norm(rest[worst]):.1f} mm from where "
            "those before and after it say; another wheel came, or it was pushed; measure again",
        )
    if far > _LONGEST_WANDER_MM:
        return Refusal(
            RefusalCode.NOT_SLOW,
            f"the wheel wanders by {far:.1f} mm, at most {_LONGEST_WANDER_MM:g} mm are one on its rollers; "
            "check that the vehicle is held",
        )
    return None
