"""What a person who sets up a camera wants to know of an image: light, saturation, focus, light lines."""

from __future__ import annotations

import base64
from dataclasses import dataclass

import cv2
import numpy as np

from alignment.arrays import Array
from alignment.imaging import extract_light_lines, full_scale, line_brightness, saturated_share
from alignment.values import Image
from sensors.shot import WheelShot

BINS = 64
_SPARKS = " ▁▂▃▄▅▆▇█"
_SHOWN_BINS = 16
_LEAST_CONTRAST = 0.03  # of full scale; less shows no edge
_PICTURE_WIDTH, _QUALITY = 640, 80


@dataclass(frozen=True, eq=False)
class ImageFigures:
    """What one image is like.

    Attributes
    ----------
    camera
        Its name.
    width, height
        Pixels.
    full_scale
        Highest grey level that its camera delivers.
    histogram
        (BINS,) shares of the pixels, from black to full scale.
    dark, middle, bright
        Grey levels that 1 %, 50 % and 99.9 % of the pixels do not exceed, as shares of full scale.
    saturated
        Share of the pixels at full scale.
    edge_px
        Pixels over which the sharpest edges rise; smaller is sharper. None where there is no contrast.
    lines, brightness
        Number of light lines, and their light over the ground beside them as a share of full scale; None
        where there are none.
    """

    camera: str
    width: int
    height: int
    full_scale: int
    histogram: Array
    dark: float
    middle: float
    bright: float
    saturated: float
    edge_px: float | None
    lines: int | None
    brightness: float | None


def shot_figures(shot: WheelShot) -> tuple[ImageFigures, ...]:
    """Return the figures of all images of a shot, as the cameras delivered them."""
    return tuple(image_figures(frame.camera, frame.image) for frame in shot.frames)


def image_figures(camera: str, image: Image) -> ImageFigures:
    """Return the figures of an image (height, width)."""
    top = full_scale(image)
    counts, _ = np.histogram(image, BINS, (0, top + 1))
    dark, middle, bright = np.percentile(image, (1.0, 50.0, 99.9)) / top
    lines = extract_light_lines(image)
    if lines is not None and (lines.crowded or not lines.count):
        lines = None
    return ImageFigures(
        camera=camera,
        width=image.shape[1],
        height=image.shape[0],
        full_scale=top,
        histogram=counts / image.size,
        dark=float(dark),
        middle=float(middle),
        bright=float(bright),
        saturated=saturated_share(image),
        edge_px=edge_width(image),
        lines=None if lines is None else lines.count,
        brightness=None if lines is None else line_brightness(image, lines),
    )


def edge_width(image: Image) -> float | None:
    """Pixels over which the sharpest edges of an image rise from dark to bright; None without contrast.

    The image's contrast over its steepest slopes, after a light blur against noise. Whatever the exposure, it
    is smallest where the lens is in focus; two scenes are not to be compared by it.
    """
    smooth = cv2.GaussianBlur(image.astype(np.float32), (0, 0), 1.0)
    low, high = np.percentile(smooth, (5.0, 99.7))
    if high - low < _LEAST_CONTRAST * full_scale(image):
        return None
    x, y = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, scale=0.125), cv2.Sobel(smooth, cv2.CV_32F, 0, 1, scale=0.125)
    steepest = float(np.percentile(np.hypot(x, y), 99.7))
    return float(high - low) / steepest if steepest > 0.0 else None


def picture(image: Image, width: int = _PICTURE_WIDTH) -> bytes:
    """Return a JPEG of an image for a person, at most so wide; what is saturated is red."""
    top = full_scale(image)
    grey = np.rint(image.astype(np.float32) * np.float32(255.0 / top)).astype(np.uint8)
    colours = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
    colours[image >= top] = (0, 0, 255)
    if image.shape[1] > width:
        height = max(1, round(image.shape[0] * width / image.shape[1]))
        colours = cv2.resize(colours, (width, height), interpolation=cv2.INTER_AREA)
    good, data = cv2.imencode(".jpg", colours, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    assert good
    return data.tobytes()


def inline_picture(image: Image) -> str:
    """Return `picture` as the address of an image that a page carries within it."""
    return "data:image/jpeg;base64," + base64.b64encode(picture(image)).decode("ascii")


def sparkline(figures: ImageFigures) -> str:
    """Return the histogram as a line of text, black on the left; logarithmic, as most is dark."""
    bins = figures.histogram.reshape(_SHOWN_BINS, -1).sum(axis=1)
    heights = np.where(bins > 0.0, 1.0 + np.log10(np.maximum(bins, 1e-5)) / 5.0, 0.0)
    last = len(_SPARKS) - 1
    return "".join(
        _SPARKS[0] if share == 0.0 else _SPARKS[max(1, round(float(height) * last))]
        for share, height in zip(bins, heights, strict=True)
    )


def bars(figures: ImageFigures) -> list[float]:
    """Return the heights of the histogram's bars, 0 … 1, logarithmic over five decades."""
    shares = figures.histogram
    return [
        round(1.0 + float(np.log10(max(share, 1e-5))) / 5.0, 4) if share > 0.0 else 0.0 for share in shares
    ]


def figures_as_json(figures: ImageFigures) -> dict[str, object]:
    """Return the figures for programs."""
    return {
        "camera": figures.camera,
        "width": figures.width,
        "height": figures.height,
        "full_scale": figures.full_scale,
        "dark": figures.dark,
        "middle": figures.middle,
        "bright": figures.bright,
        "saturated": figures.saturated,
        "edge_px": figures.edge_px,
        "lines": figures.lines,
        "line_brightness": figures.brightness,
        "histogram": [float(share) for share in figures.histogram],
    }
