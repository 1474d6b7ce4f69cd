"""Do the heads see the same wheel? What is left over once each head's points may move as a body.

Where a head moved since its calibration, its patch of the tyre stands in the wrong place. The common surface
leans to meet it, and the little that remains looks like noise; but it is not: one small shift and turn of
the patch explains it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from alignment.wheel.revolution import RevolutionFit

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_RING = 2.0  # mm; width of the rings whose mean height is left free, which stands for the profile
_MOST = 4000  # points; more tell nothing new


def head_misfits(points: Array, head: Index, heads: int, fit: RevolutionFit) -> Array:
    """Part of the residuals that a movement of each head explains, RMS over its points, (H,) millimetres.

    A few thousandths where calibration and heads are as they should be. It does not see a turn about the
    wheel's axis, which changes no height, nor a common movement of all heads.

    Parameters
    ----------
    points
        (N, 3) as they were given to `fit_revolution`.
    head
        (N,) whose they are, numbers from 0; each must have points with weight.
    heads
        How many there are.
    fit
        The result.
    """
    used = np.flatnonzero(fit.weights > 0)
    used = used[:: max(1, len(used) // _MOST)]
    weight, head = fit.weights[used], head[used]
    # Sums without BLAS: its threads would spin on and take the cores from the next images.
    x, y = np.einsum("ni,ai->an", points[used] - fit.centre, fit.tilt_axes)
    radius = np.hypot(x, y)
    # Spline coefficient k stands at knot k − 1; their differences are slopes halfway between.
    knots = fit.knots_start + fit.knots_step * (np.arange(len(fit.profile) - 1) - 0.5)
    slope = np.interp(radius, knots, np.diff(fit.profile) / fit.knots_step) / radius
    ring = ((radius - radius.min()) / _RING).astype(np.int64)
    total = np.maximum(np.bincount(ring, weight), 1e-12)

    def without_rings(values: Array) -> Array:
        means: Array = np.bincount(ring, weight * values) / total
        return np.asarray(values - means[ring], dtype=np.float64)

    # A patch may rise, lean two ways, and shift two ways along the slope of the sidewall.
    moves = (np.ones_like(x), x, y, slope * x, slope * y)
    design = np.column_stack([without_rings((head == k) * move) for k in range(heads) for move in moves])
    design /= np.maximum(np.abs(design).max(axis=0), 1e-12)
    residuals = without_rings(fit.residuals[used])
    weighted = design * weight[:, None]
    normal = np.einsum("ni,nj->ij", weighted, design)
    right = np.einsum("ni,n->i", weighted, residuals)
    # What all heads do together is the axis, which the fit has found already: it has no value here.
    amounts = np.linalg.pinv(normal, rcond=1e-6, hermitian=True) @ right
    explained = np.einsum("ni,i->n", design, amounts)
    square = np.bincount(head, weight * explained**2, heads)
    out: Array = np.sqrt(square / np.maximum(np.bincount(head, weight, heads), 1e-12))
    return out
