"""The judgement of a shot in plain arrays, as it is defined: what the compiled functions must agree with."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from alignment.calibration.judgement import Judgement, unjudged
from alignment.calibration.knocks import KnockModel
from alignment.stereo.rows import TERMS, RowFields
from alignment.wheel.agreement import MOVES, HeadMoves

Array = NDArray[np.float64]

SKIN_SHIFT_MM, SYSTEMATIC_PX = 0.015, 0.03
FEWEST_HEADS, NULL = 3, 7e-4
STEEP, CLEAR, FOUND, LARGEST, SUSPECT = 8.0, 14.0, 1.645, 2.0, 2.5
SIZES = np.array([1.0, 0.25, 0.0625, 0.016])


def judge(
    moves: HeadMoves, rms: float, rows: RowFields, model: KnockModel, normal: Array, angles_by_tilt: Array
) -> Judgement:
    """As `alignment.calibration.judgement.judge`."""
    heads = len(rows.pairs)
    signs, turn, noise, common = plain_signs(moves, rms, rows, heads, normal)
    row_px, row_sigma_px = row_figures(rows, model, heads)
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
    square = np.square(SIZES)[:, None]
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
    suspected = twice_ln > SUSPECT and explained > CLEAR
    believed = (explained > CLEAR) / (
        1.0 + np.exp(-np.clip(0.5 * STEEP * (twice_ln - SUSPECT), -300.0, 300.0))
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
        unseen=unseen(square * strength, strength, turned),
        row_px=row_px,
        row_sigma_px=row_sigma_px,
    )


def unseen(expected: Array, strength: Array, turned: Array) -> Array:
    """(2,) largest change of the angles that movements make which are not found with 95 % probability."""
    weight = expected / (1.0 + expected)
    freedom = weight.sum(axis=2)
    # One size of one knock alone must outweigh all that are asked.
    threshold = SUSPECT + 2.0 * np.log(freedom.size) + np.log1p(expected).sum(axis=2)
    above = np.maximum(threshold, CLEAR) - freedom
    # above = x − FOUND √(2 freedom + 4 x), solved for what a movement must add on the average.
    clear = FOUND**2
    root = np.sqrt(np.maximum(4.0 * clear * (above + clear) + 2.0 * clear * freedom, 0.0))
    least = np.maximum(above + 2.0 * clear + root, 1.0)
    held = weight * strength / least[:, :, None] + 1.0 / LARGEST**2
    most = np.einsum("kei,ksi->kse", np.square(turned), 1.0 / held)
    out: Array = np.sqrt(most.min(axis=1).max(axis=0))
    return out


def plain_signs(
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
    real = values > NULL if heads >= FEWEST_HEADS else np.zeros(size, dtype=np.bool_)
    basis = vectors[:, real] / (np.sqrt(values[real]) * max(rms, 1e-6))
    target = moves.target / unit
    patches = basis.T @ (target - free @ (common.T @ target))
    of_amounts = (basis.T @ normal) * unit @ tilted
    skin = np.tile([0.0, 0.0, 0.0, SKIN_SHIFT_MM**2, SKIN_SHIFT_MM**2], heads)
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
        noise[at, at] = np.linalg.inv(rows.information[k]) + SYSTEMATIC_PX**2 * np.eye(TERMS)
    together = np.zeros((MOVES, turn.shape[1]))
    together[:, :size] = free.T * unit @ tilted
    return signs, turn, noise, together


def row_figures(rows: RowFields, model: KnockModel, heads: int) -> tuple[Array, Array]:
    figures, deviations = np.full(heads, np.nan), np.full(heads, np.nan)
    for k in map(int, np.flatnonzero(rows.seen)):
        weight = model.row_weights[k]
        at = slice(MOVES * heads + TERMS * k, MOVES * heads + TERMS * (k + 1))
        allowed = np.linalg.inv(rows.information[k]) + model.covariance[at, at]
        figures[k] = np.sqrt(max(float(rows.field[k] @ weight @ rows.field[k]), 0.0))
        deviations[k] = np.sqrt(float(np.trace(weight @ allowed)) + SYSTEMATIC_PX**2)
    return figures, deviations


def misfits(moves: HeadMoves) -> Array:
    """As `HeadMoves.misfits`."""
    heads, size = len(moves.square), len(moves.target)
    unit = np.sqrt(np.maximum(np.einsum("kaa->ka", moves.square).reshape(size), 1e-30))
    # What all heads do together is the axis, which the fit has found already: it has no value here.
    inverse = np.linalg.pinv(moves.normal / np.outer(unit, unit), rcond=1e-6, hermitian=True)
    amounts = (np.einsum("ij,j->i", inverse, moves.target / unit) / unit).reshape(heads, MOVES)
    weight = moves.rings[:, :, 0]
    mean = np.einsum("rka,ka->r", moves.rings, amounts) / np.maximum(weight.sum(axis=1), 1e-12)
    explained = (
        np.einsum("kab,ka,kb->k", moves.square, amounts, amounts)
        - 2.0 * np.einsum("rka,ka,r->k", moves.rings, amounts, mean)
        + np.einsum("rk,r->k", weight, mean**2)
    )
    out: Array = np.sqrt(np.maximum(explained, 0.0) / np.maximum(weight.sum(axis=0), 1e-12))
    return out
