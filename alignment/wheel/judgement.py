"""Does a shot fit its calibration? Signs of knocked cameras and of mixed pictures, weighed against noise.

Two kinds of signs tell. The points of all heads lie on one surface of revolution, so that no head's patch of
the tyre rises, leans or shifts against the others; and corresponding crosses of light lines lie on one row.
Errors of the calibration, noise and what tyres are not of revolution move these signs too, by amounts that
are known. Every camera and every head is asked in turn how much better a movement of it explains the signs
than these do: by the evidence ratio, which allows for the freedom that six unknowns have (Jeffreys 1939).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from alignment.calibration.knocks import KnockModel
from alignment.stereo.rows import TERMS, RowFields
from alignment.wheel.agreement import MOVES, HeadMoves

Array = NDArray[np.float64]

# What tyres do to the signs: light shifts a place on a bend or on shining rubber by hundredths of a mm.
_SKIN_SHIFT_MM = 0.015
_SYSTEMATIC_PX = 0.03  # what crosses of one shot have in common: the projector's lines, gloss
_FEWEST_HEADS = 3  # whose patches say more than that two of them meet on some surface
_NULL = 7e-4  # of an amount's own information, below which amounts are the profile's, which is free
_STEEP = 8.0  # power of the evidence ratio that makes belief: intact rigs hardly come near even odds
_CLEAR = 14.0  # squared deviations that a movement must explain: where little is seen, evidence is even
_SIZES = np.array([1.0, 0.25, 0.0625, 0.016])  # of knocks, in those that `KnockModel` tells of
_FOUND = 1.645  # deviations by which a movement must be clear of the warning: found in 95 of 100 shots
_LARGEST = 2.0  # knock that is asked after, in those that `KnockModel` tells of: 10′, 0.5 mm
SUSPECT, KNOCKED = 2.5, 20.0
"""2 ln of the evidence ratio from which a shot is measured with a warning, and from which it is refused."""


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
    signs, turn, noise, common = _signs(moves, rms, rows, heads, normal)
    row_px, row_sigma_px = _row_figures(rows, model, heads)
    if not len(signs):
        return unjudged(heads)
    spread = noise + turn @ model.covariance @ turn.T
    spread.flat[:: len(spread) + 1] *= 1.0 + 1e-9
    inverse = np.linalg.inv(spread)
    responses = np.array([turn @ knock.signs for knock in model.knocks])
    # A surface that rises along x leans its normal the other way.
    angles = np.array([-angles_by_tilt @ (common @ knock.signs)[1:3] for knock in model.knocks])
    weighted = responses.transpose(0, 2, 1) @ inverse
    # Along the eigenvectors of its information a knock of any size is six knocks, each by itself.
    strength, axes = np.linalg.eigh(weighted @ responses)
    strength = np.maximum(strength, 0.0)[:, None, :]
    pull = np.einsum("kas,s,kab->kb", weighted, signs, axes)[:, None, :]
    square = np.square(_SIZES)[:, None]
    kept = square / (1.0 + square * strength)
    evidence = (kept * pull**2 - np.log1p(square * strength)).sum(axis=2)
    errors = np.einsum("kea,kab,ksb->kse", angles, axes, kept * pull)
    explained = float((kept * pull**2).sum(axis=2).max())
    ratio = np.exp(np.minimum(0.5 * evidence, 300.0)) / evidence.size
    total = float(ratio.sum())
    share = ratio / total
    turned = angles @ axes
    sizes = np.einsum("ks,kse,ksf->ef", share, errors, errors)
    twice_ln = 2.0 * float(np.log(total))
    suspected = twice_ln > SUSPECT and explained > _CLEAR
    believed = (explained > _CLEAR) / (
        1.0 + np.exp(-np.clip(0.5 * _STEEP * (twice_ln - SUSPECT), -300.0, 300.0))
    )
    best = int(share.sum(axis=1).argmax())
    covariance = believed * sizes
    if suspected:  # how well a size is known counts where it is taken for real
        covariance += believed * np.einsum("ks,ksb,keb,kfb->ef", share, kept, turned, turned)
    return Judgement(
        evidence=twice_ln,
        suspected=suspected,
        suspect=model.knocks[best].name,
        head=model.knocks[best].head,
        angles=np.einsum("s,se->e", share[best], errors[best]) / share[best].sum(),
        covariance=covariance,
        unseen=_unseen(square * strength, strength, turned),
        row_px=row_px,
        row_sigma_px=row_sigma_px,
    )


def _unseen(expected: Array, strength: Array, turned: Array) -> Array:
    """(2,) largest change of the angles that movements make which are not found with 95 % probability.

    A movement a along the axes explains Σ w (√λ a + z)² of the signs, z being their noise: a noncentral χ²,
    taken as normal with its mean and variance. Each assumed size finds what lifts that above its own
    threshold; a movement passes unseen only where all sizes miss it.

    Parameters
    ----------
    expected
        (K, S, 6) λ of each axis times the square of each assumed size.
    strength
        (K, 1, 6) λ, squared deviations by a movement of one unit.
    turned
        (K, 2, 6) change of the angles by it, radians.
    """
    weight = expected / (1.0 + expected)
    freedom = weight.sum(axis=2)
    # One size of one knock alone must outweigh all that are asked.
    threshold = SUSPECT + 2.0 * np.log(freedom.size) + np.log1p(expected).sum(axis=2)
    above = np.maximum(threshold, _CLEAR) - freedom
    # above = x − _FOUND √(2 freedom + 4 x), solved for what a movement must add on the average.
    clear = _FOUND**2
    root = np.sqrt(np.maximum(4.0 * clear * (above + clear) + 2.0 * clear * freedom, 0.0))
    least = np.maximum(above + 2.0 * clear + root, 1.0)
    held = weight * strength / least[:, :, None] + 1.0 / _LARGEST**2
    most = np.einsum("kei,ksi->kse", np.square(turned), 1.0 / held)
    out: Array = np.sqrt(most.min(axis=1).max(axis=0))
    return out


def _signs(
    moves: HeadMoves, rms: float, rows: RowFields, heads: int, wheel: Array
) -> tuple[Array, Array, Array, Array]:
    """Signs that can be seen (S,), what of all signs they are (S, 10 H), and their noise (S, S).

    At last (5, 10 H), what the fit takes all signs for that all heads do together.
    """
    size = heads * MOVES
    unit = np.sqrt(np.maximum(np.diag(moves.normal), 1e-30))
    normal = moves.normal / np.outer(unit, unit)
    # What all heads do together is the axis, which the fit has found already.
    common = np.tile(np.eye(MOVES), (heads, 1)) * unit[:, None]
    of_common = normal @ common
    free = of_common @ np.linalg.pinv(common.T @ of_common, rcond=1e-8, hermitian=True)
    # Along the wheel's axis a patch rises by its shift across the rig's, too.
    tilted = np.eye(size)
    for k in range(0, size, MOVES):
        tilted[k, k + 3 : k + 5] = -wheel[:2] / wheel[2]
    normal = normal - free @ of_common.T
    values, vectors = np.linalg.eigh(normal)
    real = values > _NULL if heads >= _FEWEST_HEADS else np.zeros(size, dtype=np.bool_)
    basis = vectors[:, real] / (np.sqrt(values[real]) * max(rms, 1e-6))
    target = moves.target / unit
    patches = basis.T @ (target - free @ (common.T @ target))
    of_amounts = (basis.T @ normal) * unit @ tilted
    skin = np.tile([0.0, 0.0, 0.0, _SKIN_SHIFT_MM**2, _SKIN_SHIFT_MM**2], heads)
    n = len(patches)
    seen = np.flatnonzero(rows.seen)
    turn = np.zeros((n + TERMS * len(seen), (MOVES + TERMS) * heads))
    noise = np.zeros((len(turn), len(turn)))
    turn[:n, :size] = of_amounts
    noise[:n, :n] = np.eye(n) + (of_amounts * skin) @ of_amounts.T
    signs = np.concatenate([patches, rows.field[seen].ravel()])
    for number, k in enumerate(map(int, seen)):
        at = slice(n + TERMS * number, n + TERMS * (number + 1))
        turn[at, size + TERMS * k : size + TERMS * (k + 1)] = np.eye(TERMS)
        noise[at, at] = np.linalg.inv(rows.information[k]) + _SYSTEMATIC_PX**2 * np.eye(TERMS)
    together = np.zeros((MOVES, turn.shape[1]))
    together[:, :size] = free.T * unit @ tilted
    return signs, turn, noise, together


def _row_figures(rows: RowFields, model: KnockModel, heads: int) -> tuple[Array, Array]:
    figures, deviations = np.full(heads, np.nan), np.full(heads, np.nan)
    for k in map(int, np.flatnonzero(rows.seen)):
        weight = model.row_weights[k]
        at = slice(MOVES * heads + TERMS * k, MOVES * heads + TERMS * (k + 1))
        allowed = np.linalg.inv(rows.information[k]) + model.covariance[at, at]
        figures[k] = np.sqrt(max(float(rows.field[k] @ weight @ rows.field[k]), 0.0))
        deviations[k] = np.sqrt(float(np.trace(weight @ allowed)) + _SYSTEMATIC_PX**2)
    return figures, deviations
