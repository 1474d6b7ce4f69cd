"""How bright the light lines of an image are: the figure by which a projector's wear is watched."""

from __future__ import annotations

import numpy as np

from alignment.imaging.ambient import full_scale
from alignment.imaging.lines import LightLines
from alignment.values import Image

_LOOKED_AT = 600  # points of an image; more do not change their median
_BESIDE = 3.5  # deviations of a line's profile: there its light is over


def line_brightness(image: Image, lines: LightLines) -> float | None:
    """Return the light of the lines over the ground beside them, median, as a share of full scale.

    It grows with projector, exposure and gain alike and falls with the blackness of the tyre, so one shot
    says little of the projector: medians over many wheels do. What falls on line and ground alike, and the
    pedestal of subtracted images, does not count. None where no line has ground on both sides.
    """
    every = max(1, len(lines.points) // _LOOKED_AT)
    points, tangents = lines.points[::every], lines.tangents[::every]
    reach = max(_BESIDE * lines.width, 3.0)
    across = np.column_stack([-tangents[:, 1], tangents[:, 0]]) * reach
    places = np.rint(np.stack([points - across, points, points + across])).astype(np.int64)
    height, width = image.shape
    inside = ((places >= 0) & (places < (width, height))).all(axis=(0, 2))
    if not inside.any():
        return None
    before, on, behind = image[places[:, inside, 1], places[:, inside, 0]].astype(np.float64)
    return float(np.median(on - (before + behind) / 2.0) / full_scale(image))
