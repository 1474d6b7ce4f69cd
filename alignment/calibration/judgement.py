"""Does a shot fit its calibration? Signs of knocked cameras and of mixed pictures, weighed against noise.

Two kinds of signs tell. The points of all heads lie on one surface of revolution, so that no head's patch of
the tyre rises, leans or shifts against the others; and corresponding crosses of light lines lie on one row.
Errors of the calibration, noise and what tyres are not of revolution move these signs too, by amounts that
are known. Every camera and every head is asked in turn how much better a movement of it explains the signs
than these do: by the evidence ratio, which allows for the freedom that six unknowns have (Jeffreys 1939).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array
from alignment.calibration import judgement_kernels as kernels
from alignment.calibration.judgement_kernels import CLEAR, SUSPECT
from alignment.calibration.knocks import KnockModel
from alignment.stereo.rows import RowFields
from alignment.wheel.agreement import HeadMoves

__all__ = ["KNOCKED", "SUSPECT", "Judgement", "judge", "unjudged"]


_STEEP = 8.0  # power of the evidence ratio that makes belief: intact rigs hardly come near even odds
KNOCKED = 20.0
"""2 ln of the evidence ratio from which a shot is refused."""


@dataclass(frozen=True, eq=False)
class Judgement:
    """How well a shot fits its calibration.

    Attributes
    ----------
    evidence
        2 ln of the evidence that something moved over that nothing did, all possibilities
        together; None without signs.
    suspected
        Whether it is to be told.
    suspect
        The camera or head whose movement explains the signs best.
    head
        Number of its head.
    angles
        (2,) by how much camber and toe err if it is so, radians.
    covariance
        (2, 2) to add to that of the angles, radians²: the disagreement by its own size, as far as it is
        believed.
    unseen
        (2,) by how much a movement that no sign shows may change camber and toe, radians; None without
        signs. Of all movements of one camera or head by up to 10′ and 0.5 mm, the most that is not found
        with 95 % probability.
    row_px, row_sigma_px
        (H,) RMS over the view of each head's row field, and its standard deviation by noise and calibration,
        pixels; NaN where too few crosses were seen.
    """

    evidence: float | None
    suspected: bool
    suspect: str
    head: int
    angles: Array
    covariance: Array
    unseen: Array | None
    row_px: Array
    row_sigma_px: Array

    @property
    def knocked(self) -> bool:
        """Whether nothing but a knock, or mixed pictures, explain the shot."""
        return self.evidence is not None and self.evidence > KNOCKED


def unjudged(heads: int) -> Judgement:
    """Judgement of a shot that shows no signs, or of whose calibration nothing can be predicted."""
    unknown = np.full(heads, np.nan)
    return Judgement(None, False, "", 0, np.zeros(2), np.zeros((2, 2)), None, unknown, unknown)


def judge(
    moves: HeadMoves, rms: float, rows: RowFields, model: KnockModel, normal: Array, angles_by_tilt: Array
) -> Judgement:
    """Weigh the signs of one shot.

    Parameters
    ----------
    moves
        What the residuals say of movements of the heads.
    rms
        Of the residuals, millimetres.
    rows
        Row fields of the heads.
    model
        What the calibration allows.
    normal
        (3,) of the wheel, rig frame.
    angles_by_tilt
        (2, 2) change of camber and toe by a tilt of the normal along the fit's axes.
    """
    heads = len(rows.pairs)
    row_px, row_sigma_px, noise = kernels.row_figures(
        rows.pairs, rows.field, rows.information, model.covariance, model.row_weights
    )
    patches, amounts, leans = kernels.patch_signs(moves.normal, moves.target, rms, normal)
    answers, shown = kernels.whitened(patches, amounts, rows.field, noise, model.covariance, model.responses)
    if not shown:
        return unjudged(heads)
    # A surface that rises along x leans its normal the other way.
    turned = -angles_by_tilt @ leans @ model.responses[: amounts.shape[1]]
    strength, pull, along = kernels.knock_axes(answers, turned)
    twice_ln, explained, best, angles, squares, remains = kernels.together(
        *kernels.evidences(strength, pull, along)
    )
    suspected = twice_ln > SUSPECT and explained > CLEAR
    doubt = math.exp(min(max(0.5 * _STEEP * (SUSPECT - twice_ln), -300.0), 300.0))
    believed = 1.0 / (1.0 + doubt) if explained > CLEAR else 0.0
    return Judgement(
        evidence=twice_ln,
        suspected=suspected,
        suspect=model.knocks[best].name,
        head=model.knocks[best].head,
        angles=angles,
        # How well a size is known counts where it is taken for real.
        covariance=believed * (squares + remains if suspected else squares),
        unseen=kernels.unseen(strength, along),
        row_px=row_px,
        row_sigma_px=row_sigma_px,
    )
