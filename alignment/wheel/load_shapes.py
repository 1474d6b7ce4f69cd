"""How a tyre's sidewall gives way around the contact patch: shapes over the angle from there.

Two families, because neither stands for the other: the wave of a ring on an elastic foundation, which decays
and swings back (e⁻ᵃ cos(a − φ), a = |θ| / w; Gough's beam and Böhm's ring model, in Pacejka, Tire and Vehicle
Dynamics, ch. 9), and a Gaussian, which only decays; for broad shapes a third, which is smooth where the two
halves of the tyre meet again. What they have in common besides is evenness.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array

_PHASE, _PHASE_DEVIATION = 0.25 * math.pi, 0.35  # the ring's own phase is 45°


@dataclass(frozen=True)
class Shape:
    """A family of even functions of the angle, with what is believed of its parameters beforehand.

    Attributes
    ----------
    evaluate
        Values (n,) at angles (n,) from the contact, radians, and their derivatives (p, n) by the parameters.
    mean, deviation
        (p,) of the parameters: the logarithm of the width in radians, then the phase of a wave.
    """

    evaluate: Callable[[Array, Array], tuple[Array, Array]]
    mean: Array
    deviation: Array


def _gaussian(angle: Array, parameters: Array) -> tuple[Array, Array]:
    ratio = np.square(angle / math.exp(parameters[0]))
    value = np.exp(-0.5 * ratio)
    return value, (ratio * value)[None]


def _wave(angle: Array, parameters: Array) -> tuple[Array, Array]:
    near = np.abs(angle)
    # The ring is closed: the wave that went around the other way arrives, too.
    a = np.stack([near, 2.0 * math.pi - near]) / math.exp(parameters[0])
    fall, cosine, sine = np.exp(-a), np.cos(a - parameters[1]), np.sin(a - parameters[1])
    slopes = np.stack([a * fall * (cosine + sine), fall * sine])
    return (fall * cosine).sum(axis=0), slopes.sum(axis=1)


def _cosine_power(angle: Array, parameters: Array) -> tuple[Array, Array]:
    power = 2.0 * math.exp(-2.0 * parameters[0])
    logarithm = np.log(np.maximum(0.5 + 0.5 * np.cos(angle), 1e-12))
    value = np.exp(power * logarithm)
    return value, (-2.0 * power * logarithm * value)[None]


def gaussian(width_deg: float, spread: float) -> Shape:
    """Gaussian of a standard deviation of about `width_deg`, uncertain by a factor of e^±spread."""
    return Shape(_gaussian, np.array([math.log(math.radians(width_deg))]), np.array([spread]))


def wave(width_deg: float, spread: float) -> Shape:
    """Wave whose angle of decay is about `width_deg`, uncertain by a factor of e^±spread."""
    mean = np.array([math.log(math.radians(width_deg)), _PHASE])
    return Shape(_wave, mean, np.array([spread, _PHASE_DEVIATION]))


def cosine_power(width_deg: float, spread: float) -> Shape:
    """Power of the cosine of half the angle, as wide as a Gaussian of `width_deg` and smooth all around."""
    return Shape(_cosine_power, np.array([math.log(math.radians(width_deg))]), np.array([spread]))


BULGES = (gaussian(24.0, 0.25), wave(32.0, 0.2), wave(22.0, 0.2))
"""What the weight does: half widths of 18 to 38°. Waves have two starts, for a fit from one may not reach the
widths of the other."""

_HARMONICS = np.array([2.0, 3.0, 4.0, 5.0])
_HARMONIC_SHARE = 0.1  # of the shape, by which each may change it


def flexible(shape: Shape) -> Shape:
    """The shape and, beside it, small even harmonics: what no family of functions says exactly."""
    own = len(shape.mean)

    def evaluate(angle: Array, parameters: Array) -> tuple[Array, Array]:
        value, slopes = shape.evaluate(angle, parameters[:own])
        waves = np.cos(_HARMONICS[:, None] * angle)
        return value + parameters[own:] @ waves, np.vstack([slopes, waves])

    return Shape(
        evaluate,
        np.concatenate([shape.mean, np.zeros(len(_HARMONICS))]),
        np.concatenate([shape.deviation, np.full(len(_HARMONICS), _HARMONIC_SHARE)]),
    )


_SIDE_WIDTHS = (40.0, 56.0)
SIDE_SHIFTS = tuple(flexible(shape(width, 0.25)) for width in _SIDE_WIDTHS for shape in (cosine_power, wave))
"""What a side force does; broader. One by one, because the fits of broad shapes have several minima."""


def _odd(angle: Array, parameters: Array) -> tuple[Array, Array]:
    ratio = angle / math.exp(parameters[0])
    value = ratio * np.exp(-0.5 * np.square(ratio))
    return value, (value * (np.square(ratio) - 1.0))[None]


_ODD_WIDTH = np.array([math.log(math.radians(30.0))])
ODD, ODD_BESIDE_SIDE_FORCE = (Shape(_odd, _ODD_WIDTH, np.array([spread])) for spread in (0.01, 0.3))
"""What a longitudinal force does, about the width of a bulge; beside side force of a width that is less sure.
With a bulge alone a free width would hide a head that moved."""
