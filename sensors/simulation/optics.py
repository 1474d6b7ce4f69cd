"""From light on the chip to grey levels: lens blur, integration over the pixel, noise, quantisation.

Knows nothing of the scene. A scene hands over its radiance sampled at s × s points per pixel that lie
symmetrically about the pixel's centre (`sample_offsets`), so nothing here moves an edge: the blur is
symmetric and the pixel is the mean of its samples. Left out: vignetting of the camera's lens, stray light,
colour, rolling shutter, fixed-pattern noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from alignment.arrays import Array, Singles
from alignment.errors import DegenerateInputError
from alignment.values import Image


@dataclass(frozen=True)
class Optics:
    """What a camera makes of light.

    Attributes
    ----------
    blur_px
        Standard deviation of the lens's Gaussian point spread, pixels, the pixel's own area not included.
    full_well_e
        Electrons at the top of the range at 0 dB; more range means less shot noise.
    read_noise_e
        Standard deviation in the dark, electrons at 0 dB.
    black_level
        Share of the range that stands for no light.
    bits
        8, or 16.
    reference_exposure_ms
        Exposure at which radiance 1 fills the range, at 0 dB.
    """

    blur_px: float = 0.7
    full_well_e: float = 10_000.0
    read_noise_e: float = 12.0
    black_level: float = 0.025
    bits: int = 8
    reference_exposure_ms: float = 5.0

    def __post_init__(self) -> None:
        if self.bits not in (8, 16):
            raise DegenerateInputError(field="bits", expected="8 or 16", seen=str(self.bits))


def sample_offsets(samples: int) -> Array:
    """Offsets (samples,) of the samples of a pixel from its centre, along one axis, pixels."""
    return (np.arange(samples) + 0.5) / samples - 0.5


def integrate(radiance: Singles, samples: int, blur_px: float) -> Singles:
    """Light that each pixel collects: (s·H, s·W) radiance at the sample points → (H, W).

    The blur acts on the samples, then each pixel takes the mean of its own. Beyond the border the radiance is
    taken to continue as at the border.
    """
    light = radiance
    sigma = blur_px * samples
    if sigma > 0:
        size = 2 * int(np.ceil(4.0 * sigma)) + 1
        light = cv2.GaussianBlur(light, (size, size), sigma, borderType=cv2.BORDER_REPLICATE)  # type: ignore[assignment]
    if samples > 1:
        height, width = light.shape[0] // samples, light.shape[1] // samples
        light = cv2.resize(light, (width, height), interpolation=cv2.INTER_AREA)  # type: ignore[assignment]
    return light


def develop(
    light: Singles,
    optics: Optics,
    rng: np.random.Generator | None,
    exposure_ms: float = 5.0,
    gain_db: float = 0.0,
) -> Image:
    """Grey levels (H, W) of collected light; saturates at the top of the range; without `rng` no noise.

    Shot noise is Gaussian with the variance of the electrons, which is Poisson's to better than a percent at
    the counts that matter here.
    """
    top = 2**optics.bits - 1
    gain = np.float32(10.0 ** (gain_db / 20.0))
    electrons = light * np.float32(exposure_ms / optics.reference_exposure_ms * optics.full_well_e)
    if rng is not None:
        spread = np.sqrt(electrons + np.float32(optics.read_noise_e**2))
        spread *= rng.standard_normal(light.shape, dtype=np.float32)
        electrons = electrons + spread
    value = electrons * (gain * np.float32(top / optics.full_well_e)) + np.float32(optics.black_level * top)
    np.clip(value, 0.0, top, out=value)
    grey: Image = np.rint(value).astype(np.uint8 if optics.bits == 8 else np.uint16)
    return grey
