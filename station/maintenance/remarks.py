"""What is to be done about an image, in a sentence: too dark, saturated, without lines."""

from __future__ import annotations

from station.maintenance.figures import ImageFigures

MOST_SATURATED = 0.002
"""Share of the pixels at full scale from which light is too much."""
LEAST_BRIGHT = 0.08
"""Share of full scale that the brightest pixels of a usable image reach at least."""
LEAST_LINES = 0.1
"""Light of the lines over their ground, share of full scale, below which noise costs accuracy."""


def advice(figures: ImageFigures) -> str:
    """Return what to do about a camera's image; empty where nothing is to be done."""
    if figures.saturated > MOST_SATURATED:
        return f"{figures.saturated:.1%} of the pixels are saturated: shorten the exposure or dim the light"
    if figures.bright < LEAST_BRIGHT:
        return "hardly any light: take off the cap, switch on the light, lengthen the exposure"
    if figures.edge_px is None:
        return "hardly any contrast: check that something stands before the camera, and clean its window"
    if figures.brightness is not None and figures.brightness < LEAST_LINES:
        return "faint light lines: more light of the projector, or a longer exposure"
    return ""
