"""What errors of a calibration, and knocks since then, do to the signs by which a shot is judged.

The signs are few: five amounts of movement of each head's patch of the tyre (`HeadMoves`) and five numbers of
each head's row field (`RowFields`). Both answer errors of the cameras linearly; how, is predicted on a
nominal wheel, once for each calibration.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from alignment.arrays import Array
from alignment.calibration.prediction import (
    NominalWheel,
    head_derivatives,
    line_sensitivity,
    wheel_points,
)
from alignment.calibration.row_equations import camera_rows
from alignment.stereo.rows import TERMS, RowView
from alignment.values import SIDES, HeadCalibration, RigCalibration
from alignment.wheel.agreement import MOVES

_TURN, _SHIFT_MM = 1.5e-3, 0.25  # standard deviations of a knock, radians (5′) and millimetres
# What is assumed of a calibration that states no covariance: of the heads' patches a rise, a lean and a shift
# by about a hundredth of a millimetre, of each number of the row fields a fifth of a pixel.
_UNSTATED_RISE, _UNSTATED_LEAN, _UNSTATED_SHIFT, _UNSTATED_ROW = 0.007, 2e-4, 0.02, 0.2


@dataclass(frozen=True, eq=False)
class Knock:
    """One way in which a rig may have changed since its calibration: a camera or a whole head moved.

    Attributes
    ----------
    name, head
        In words, and the number of the head.
    signs
        (10 H, 6) change of the signs by a knock of one standard deviation about and along each axis.
    """

    name: str
    head: int
    signs: Array


@dataclass(frozen=True, eq=False)
class KnockModel:
    """What is to be expected of the signs of a rig of H heads.

    Attributes
    ----------
    covariance
        (10 H, 10 H) of all signs by the errors of the calibration: first the 5 H amounts of movement, then
        the 5 H numbers of the row fields.
    knocks
        What may have happened.
    row_weights
        (H, 5, 5) a row field f of a head has the mean square fᵀ W f over the view, pixels².
    """

    covariance: Array
    knocks: tuple[Knock, ...]
    row_weights: Array

    def beside_load(self, rise_mm: float) -> KnockModel:
        """What is to be expected where each head's patch of the tyre may rise by ±`rise_mm` besides, as what
        the shapes of a load do not follow makes it."""
        more = np.zeros(len(self.covariance))
        more[: MOVES * len(self.row_weights) : MOVES] = rise_mm**2
        return KnockModel(self.covariance + np.diag(more), self.knocks, self.row_weights)

    @cached_property
    def responses(self) -> Array:
        """(10 H, 6 K) `Knock.signs` of all, side by side."""
        return np.hstack([knock.signs for knock in self.knocks])


def knock_model(calibration: RigCalibration) -> KnockModel:
    """Predict the signs of a rig.

    Raises
    ------
    DegenerateInputError
        When a head does not see the nominal wheel.
    """
    wheel = NominalWheel()
    heads, size = len(calibration.heads), len(calibration.parameter_names)
    rows = camera_rows(calibration)
    response, weights = np.zeros(((MOVES + TERMS) * heads, size)), []
    for k, head in enumerate(calibration.heads):
        mine = slice(rows[2 * k].start, rows[2 * k + 1].stop)
        points = wheel_points(head, wheel)
        moves, fields, weight = _head_response(head, points)
        response[MOVES * k : MOVES * (k + 1), mine] = moves
        first = MOVES * heads + TERMS * k
        response[first : first + TERMS, mine] = fields
        weights.append(weight)
    if calibration.covariance is None:
        covariance = _unstated(heads)
    else:
        covariance = response @ calibration.covariance @ response.T
    scale = np.array([_TURN] * 3 + [_SHIFT_MM] * 3)
    knocks = []
    for k, head in enumerate(calibration.heads):
        columns = {
            f"{head.name} {side}": _camera_moves(calibration, 2 * k + s) for s, side in enumerate(SIDES)
        }
        for name, column in (*columns.items(), (head.name, _head_moves(calibration, k))):
            knocks.append(Knock(name, k, response @ (column * scale)))
    return KnockModel(covariance, tuple(knocks), np.array(weights))


def _head_response(head: HeadCalibration, points: Array) -> tuple[Array, Array, Array]:
    """(5, P) amounts and (5, P) row numbers by a head's parameters, (5, 5) mean products of the terms."""
    moves = line_sensitivity(head, points)
    amounts = np.zeros((MOVES, moves.shape[2]))
    place = np.column_stack([np.ones(len(points)), points[:, :2]])
    amounts[:3] = np.linalg.lstsq(place, moves[:, 2], rcond=None)[0]
    # A patch that shifts outward by d shows, where it slopes, a height that is less by slope · d.
    amounts[3:] = -moves[:, :2].mean(axis=0)
    by_point, by_camera = head_derivatives(head, points)
    # Of the four coordinates of a pair of pixels three tell the point; the fourth is the row difference.
    across = np.linalg.svd(by_point)[0][:, :, 3]
    across /= np.linalg.norm(across[:, :2], axis=1, keepdims=True)
    view = RowView.of(head)
    down = np.einsum("nea,a->ne", by_point[:, :2], view.frame.rectified_from_rig[1])
    across *= np.sign(np.einsum("ne,ne->n", across[:, :2], down))[:, None]
    differences = -np.einsum("ne,nep->np", across, by_camera)
    terms = view.terms(view.seen(0, head.left.project(points)))
    fields = np.linalg.lstsq(terms, differences, rcond=None)[0]
    return amounts, fields, terms.T @ terms / len(terms)


def _camera_moves(calibration: RigCalibration, camera: int) -> Array:
    """(P, 6) parameters by a turn of one camera about its own axes and a shift of it."""
    out = np.zeros((len(calibration.parameter_names), 6))
    first = camera_rows(calibration)[camera].start
    out[first : first + 6] = np.eye(6)
    return out


def _head_moves(calibration: RigCalibration, head: int) -> Array:
    """(P, 6) parameters by a turn of a head about its middle, rig axes, and a shift of it."""
    out = np.zeros((len(calibration.parameter_names), 6))
    cameras = calibration.heads[head].cameras
    middle = np.mean([camera.rig_from_camera.translation for camera in cameras], axis=0)
    for side, camera in enumerate(cameras):
        first = camera_rows(calibration)[2 * head + side].start
        x, y, z = camera.rig_from_camera.translation - middle
        out[first : first + 3, :3] = camera.rig_from_camera.rotation.T
        out[first + 3 : first + 6, :3] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
        out[first + 3 : first + 6, 3:] = np.eye(3)
    return out


def _unstated(heads: int) -> Array:
    """Covariance of the signs where a calibration states none."""
    moves = [_UNSTATED_RISE, _UNSTATED_LEAN, _UNSTATED_LEAN, _UNSTATED_SHIFT, _UNSTATED_SHIFT]
    deviations = np.array(moves * heads + [_UNSTATED_ROW] * (TERMS * heads))
    return np.diag(deviations**2)
