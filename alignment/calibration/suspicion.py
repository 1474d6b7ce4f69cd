"""Which movement would explain what shots and calibration disagree about: of one camera, or of a whole head.

Linear, before anything is estimated. No tyre is quite a body of revolution, so that rows and surfaces never
fit to their noise, and how badly they fit tells nothing. What tells is how much of the misfit one movement
explains, against what is left after it: the F statistic of the six numbers of a movement.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.stats import f as fisher

from alignment.arrays import Array
from alignment.calibration.prediction import angle_sensitivity
from alignment.calibration.row_equations import Equations, camera_rows
from alignment.values import RigCalibration

_Part = Literal["left", "right", "head"]

_FALSE_ALARM = 1e-5  # of a rig that has not changed
_NUMBERS = 6  # of a movement
FEWEST_WHEELS = 3
"""Fewer wheels do not tell a moved head from a tyre that is not round."""


@dataclass(frozen=True)
class Explanation:
    """A movement, and how well it explains what was seen.

    Attributes
    ----------
    head, part
        Number of the head, and which of its cameras moved; ``head`` when both moved as one body.
    gain
        F: squared misfit that it takes away, for each of its numbers, in units of the misfit that stays.
    rest
        Squared misfit that stays, in standard deviations of crosses, surfaces and calibration.
    unseen
        Camber and toe, radians, by which a movement of this kind may turn a wheel without showing in these
        shots: the likeliest one and its standard deviation, root of the sum of squares.
    """

    head: int
    part: _Part
    gain: float
    rest: float
    unseen: tuple[float, float]


def contradiction_limit(wheels: int) -> float:
    """Gain above which something moved, from so many wheels.

    How the wheels differ tells the noise of each equation, so that few of them know it badly.
    """
    return float(fisher.ppf(1.0 - _FALSE_ALARM, _NUMBERS, _NUMBERS * (wheels - 1)))


def explanations(
    calibration: RigCalibration, head: int, equations: Equations, allowed: Array
) -> tuple[Explanation, ...]:
    """Try each movement of one head.

    Parameters
    ----------
    calibration
        As in force, with its covariance.
    head
        Number of the head.
    equations
        Of its rows, and of the surfaces of wheels as the other heads see them.
    allowed
        (6, 6) covariance of a movement: rotation, radians, and shift, millimetres.
    """
    assert calibration.covariance is not None
    h, values = equations.derivatives, equations.values
    spread = h @ calibration.covariance @ h.T + np.eye(len(values))
    angles = angle_sensitivity(calibration)
    misfit = float(values @ np.linalg.solve(spread, values))
    out = []
    parts: tuple[_Part, ...] = ("left", "right", "head")
    for part in parts:
        basis = _moves(calibration, head, part)
        moves = h @ basis
        weighted = np.linalg.solve(spread, moves)
        right = weighted.T @ values
        told, before = moves.T @ weighted, np.linalg.inv(allowed)
        step = np.linalg.solve(told + before, right)
        taken = float(right @ step)
        noise = max(1.0, (misfit - taken) / len(values))
        turns = angles @ basis
        open_yet = np.einsum("ai,ij,aj->a", turns, np.linalg.inv(told / noise + before), turns)
        camber, toe = np.sqrt(open_yet + (turns @ step) ** 2)
        out.append(
            Explanation(head, part, taken / len(step) / noise, misfit - taken, (float(camber), float(toe)))
        )
    return tuple(out)


def is_whole_head(found: Sequence[Explanation], equations: int, clear: float) -> bool:
    """Whether the best explanation may be that both cameras of a head moved as one.

    Parameters
    ----------
    found
        Of all heads.
    equations
        How many each had.
    clear
        Difference of −2 log likelihood by which a single camera must be the better explanation.
    """
    best = max(found, key=lambda each: each.gain)
    mine = {each.part: each.rest for each in found if each.head == best.head}
    alone = min(mine["left"], mine["right"])
    noise = max(1.0, min(mine.values()) / equations)
    return best.part == "head" or (mine["head"] - alone) / noise < clear


def _moves(calibration: RigCalibration, head: int, part: _Part) -> Array:
    """(P, 6) change of all parameters of the calibration by the movement of a camera or a head.

    A camera turns about its own axes at its centre; a head about the rig's at the middle of its cameras.
    Shifts are in the rig frame.
    """
    rows = camera_rows(calibration)
    cameras = calibration.heads[head].cameras
    out = np.zeros((len(calibration.parameter_names), _NUMBERS))
    if part != "head":
        first = rows[2 * head + int(part == "right")].start
        out[first : first + 6] = np.eye(6)
        return out
    middle = 0.5 * (cameras[0].rig_from_camera.translation + cameras[1].rig_from_camera.translation)
    for side, camera in enumerate(cameras):
        first = rows[2 * head + side].start
        out[first : first + 3, :3] = camera.rig_from_camera.rotation.T
        # Column k is what a turn about axis k does to the arm.
        out[first + 3 : first + 6, :3] = np.cross(np.eye(3), camera.rig_from_camera.translation - middle).T
        out[first + 3 : first + 6, 3:] = np.eye(3)
    return out
