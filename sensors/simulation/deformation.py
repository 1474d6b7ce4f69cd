"""What a tyre's sidewall does besides standing there as a surface of revolution: it bulges, leans, wobbles.

A deformation moves each place of the sidewall along the tyre's axis, by millimetres and smoothly. What the
road does to a tyre (`TyreLoad`) stays where the road is while the wheel turns; what is uneven in tyre and rim
(`Wobble`) turns with them. Left out: the sidewall's movement along the radius, and the tread, which no head
sees.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates, spline_filter1d

from alignment.arrays import Array
from sensors.formats.truth import TyreLoad

ROW_STEP_MM = 2.0
_COLUMNS = 360
_FULL_WIDTH = 2.0 * math.sqrt(2.0 * math.log(2.0))  # at half height, of a Gaussian, in standard deviations
_WAVE_HALF = 1.0134811  # where exp(−x)(cos x + sin x) is one half
_TURNS = np.arange(-2, 3)  # of the whole circle, over which a ring's wave is summed
_RIM_BLEND_MM = 5.0


@dataclass(frozen=True)
class Wobble:
    """What is uneven in a wheel and turns with it, beside the tilt of the tyre against the spin axis.

    Attributes
    ----------
    second_mm, second_phase
        Second harmonic of the tyre: peak to peak at the tread, nothing at the bead; where in the tyre it
        stands out most, radians.
    rim_mm, rim_phase
        Axial run-out of the rim against the spin axis: peak to peak at the rim's edge; the direction in the
        wheel to which the rim's normal leans, radians.
    """

    second_mm: float = 0.0
    second_phase: float = 0.0
    rim_mm: float = 0.0
    rim_phase: float = 0.0


@dataclass(frozen=True)
class Contact:
    """Where the road is, as the tyre sees it.

    Attributes
    ----------
    angle
        Direction of the contact patch in the tyre frame, radians.
    forward
        +1 when the polar angle grows from the contact patch to the vehicle's front, −1 when to its rear.
    """

    angle: float
    forward: int


def angular_shapes(load: TyreLoad, angle: Array) -> tuple[Array, Array, Array]:
    """Bulge, side shift and longitudinal part, each with a maximum of 1, at angles from the contact patch.

    ``wave`` is how an endless ring on an elastic foundation answers a force at one place; on the closed ring
    the waves of all turns add up. Angles in radians, growing towards the vehicle's front.
    """
    width, side_width = math.radians(load.width_deg), math.radians(load.side_width_deg)

    def falling(angle: Array, sigma: float) -> tuple[Array, Array]:
        turned = np.asarray(angle)[..., None] + 2.0 * math.pi * _TURNS
        if load.shape == "gaussian":
            value = np.exp(-0.5 * (turned / sigma) ** 2)
            return value.sum(-1), (turned / sigma * value).sum(-1) * math.exp(0.5)
        x = np.abs(turned) / (0.5 * _FULL_WIDTH * sigma / _WAVE_HALF)
        fall = np.exp(-x)
        odd = np.sign(turned) * fall * np.sin(x) * (math.exp(math.pi / 4) * math.sqrt(2.0))
        return (fall * (np.cos(x) + np.sin(x))).sum(-1), odd.sum(-1)

    even, odd = falling(angle, width)
    if load.shape == "gaussian":
        side = (0.5 + 0.5 * np.cos(angle)) ** (2.0 / side_width**2)
    else:
        side = falling(angle, side_width)[0] / falling(np.zeros(1), side_width)[0]
    return even / falling(np.zeros(1), width)[0], side, odd


def radial_shapes(load: TyreLoad, share: Array) -> tuple[Array, Array]:
    """Profiles of the bulge and of the side shift, each with a maximum of 1.

    `share` is 0 at the rim's edge and 1 at the tread. The bulge is greatest about `load.crest`, the shift at
    the tread; neither moves the bead.
    """

    def bulge(s: Array) -> Array:
        ratio = load.crest / (1.0 - load.crest)
        bell = (s / load.crest) ** (2.0 * max(1.0, ratio))
        bell *= ((1.0 - s) / (1.0 - load.crest)) ** (2.0 * max(1.0, 1.0 / ratio))
        return (1.0 - load.tread) * bell + load.tread * _rise(s)

    s = np.clip(share, 0.0, 1.0)
    return bulge(s) / bulge(np.linspace(0.0, 1.0, 1001)).max(), _rise(s)


def _rise(share: Array) -> Array:
    """Return a smooth step from 0 to 1 between shares 0 and 1."""
    s = np.clip(share, 0.0, 1.0)
    return np.asarray(s * s * (3.0 - 2.0 * s))


def control_values(
    rim_edge_mm: float,
    first_mm: float,
    outer_mm: float,
    *,
    load: tuple[TyreLoad, Contact] | None = None,
    wobble: Wobble | None = None,
    lean: tuple[float, float] = (0.0, 0.0),
) -> Array:
    """Control values (rows over r from `first_mm`, columns over θ from −π) of a periodic bicubic B-spline.

    Parameters
    ----------
    rim_edge_mm, outer_mm
        Where the rubber begins, and where the height field ends.
    first_mm
        Radius of the first row; the others follow every `ROW_STEP_MM`, beyond `outer_mm`.
    load, wobble
        What deforms the tyre.
    lean
        Angle between tyre plane and spin axis, and its direction: what the rim does not share.
    """
    radius: Array = first_mm + ROW_STEP_MM * np.arange(
        math.ceil((outer_mm - first_mm) / ROW_STEP_MM) + 4, dtype=np.float64
    )
    angle = 2.0 * math.pi * (np.arange(_COLUMNS) / _COLUMNS - 0.5)
    share = (radius - rim_edge_mm) / (outer_mm - rim_edge_mm)
    field = np.zeros((len(radius), _COLUMNS))
    if load is not None:
        tyre_load, contact = load
        from_contact = (
            np.remainder(contact.forward * (angle - contact.angle) + math.pi, 2 * math.pi) - math.pi
        )
        even, side, odd = angular_shapes(tyre_load, from_contact)
        bell, rise = radial_shapes(tyre_load, share)
        field += np.outer(bell, tyre_load.bulge_mm * even + tyre_load.longitudinal_mm * odd)
        field += np.outer(rise, tyre_load.side_mm * side)
    if wobble is not None:
        field += np.outer(_rise(share), 0.5 * wobble.second_mm * np.cos(2.0 * (angle - wobble.second_phase)))
        inside = _rise((rim_edge_mm - radius) / _RIM_BLEND_MM)
        tilt = lean[0] * np.cos(angle - lean[1])
        tilt -= 0.5 * wobble.rim_mm / rim_edge_mm * np.cos(angle - wobble.rim_phase)
        field += np.outer(radius * inside, tilt)
    along_r = spline_filter1d(field, order=3, axis=0, mode="nearest")
    return np.ascontiguousarray(spline_filter1d(along_r, order=3, axis=1, mode="grid-wrap"))


def displaced(vertices: Array, values: Array, first_mm: float) -> Array:
    """Move vertices (N, 3) of the undeformed wheel as the control values say."""
    radius = np.hypot(vertices[:, 0], vertices[:, 1])
    turn = np.arctan2(vertices[:, 1], vertices[:, 0]) / (2.0 * math.pi) + 0.5
    places = np.array([(radius - first_mm) / ROW_STEP_MM, turn * values.shape[1]])
    moved = vertices.copy()
    moved[:, 2] += map_coordinates(values, places, order=3, mode="grid-wrap", prefilter=False)
    return moved
