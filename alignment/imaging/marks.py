"""What is known of the round marks of one image: roughly after detection, to hundredths of a pixel after."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from alignment.arrays import Array, Index, Mask


@dataclass(frozen=True)
class Exposure:
    """How an image is exposed, so that a missing plate can be explained.

    Attributes
    ----------
    dark, bright
        Grey levels that 1 % of the pixels are below and above.
    limit
        Largest grey level of the image's type, or that the image reaches, whichever means white.
    saturated
        Fraction of the pixels at `limit`.
    noise
        Standard deviation of the noise between neighbouring pixels, grey levels.
    edge
        Grey levels between neighbouring pixels at the steepest edges (99.9 % are flatter).
    """

    dark: float
    bright: float
    limit: float
    saturated: float
    noise: float
    edge: float


@dataclass(frozen=True, eq=False)
class RoughMarks:
    """Round marks, located to about a tenth of a pixel.

    Attributes
    ----------
    points
        (N, 2) centres, pixels.
    shape
        (N, 2, 2) symmetric matrices S of the outlines, pixels²: an outline is pᵀ S⁻¹ p = 1 about its centre.
    hole
        (N,) size of a ring mark's middle over its outline; 0 for full marks.
    bright
        True when the marks are brighter than their ground.
    size
        (width, height) of the image, pixels.
    exposure
        Of the image.
    """

    points: Array
    shape: Array
    hole: Array
    bright: bool
    size: tuple[int, int]
    exposure: Exposure

    def __len__(self) -> int:
        return len(self.points)

    @property
    def hollow(self) -> Mask:
        """(N,) True for ring marks."""
        result: Mask = self.hole > 0.0
        return result


@dataclass(frozen=True, eq=False)
class Marks:
    """Round marks located by one of the methods; rough marks that it could not locate are left out.

    Attributes
    ----------
    points
        (N, 2) centres of the imaged outlines, pixels; the projection of a circle's centre lies a little
        beside it (`alignment.imaging.mark_bias`).
    covariance
        (N, 2, 2) of `points`, pixels²: the image's noise and misfit; not the plate's errors.
    shape
        (N, 2, 2) as in `RoughMarks`.
    hollow
        (N,) True for ring marks.
    blur
        (N,) standard deviation of the edge's blur, pixels; 0 where the method does not find it.
    contrast
        (N,) grey levels between mark and ground.
    rough
        (N,) rows of the rough marks that these are.
    saturated
        (N,) True where mark or ground is at the limit of the image's range.
    size, exposure
        As in `RoughMarks`.
    method
        Name of the method.
    """

    points: Array
    covariance: Array
    shape: Array
    hollow: Mask
    blur: Array
    contrast: Array
    rough: Index
    saturated: Mask
    size: tuple[int, int]
    exposure: Exposure
    method: str

    def __len__(self) -> int:
        return len(self.points)

    def only(self, rows: Index) -> Marks:
        """Return some of the marks."""
        names = ("points", "covariance", "shape", "hollow", "blur", "contrast", "rough", "saturated")
        return replace(self, **{name: getattr(self, name)[rows] for name in names})

    @property
    def semi_axes(self) -> Array:
        """(N, 2) smaller and larger half axis of the outlines, pixels."""
        axes: Array = np.sqrt(np.linalg.eigvalsh(self.shape))
        return axes


def upper_factor(shape: Array) -> Array:
    """Upper triangular U (N, 2, 2) with S⁻¹ = Uᵀ U for shapes S (N, 2, 2): |U p| = 1 on the outline."""
    inverse = np.linalg.inv(shape)
    lower = np.linalg.cholesky(inverse)
    factor: Array = np.swapaxes(lower, 1, 2)
    return factor
