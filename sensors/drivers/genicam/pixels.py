"""Pixel formats of one channel: from a camera's buffer to an image, in one pass over it.

Names and layouts are those of the GenICam Pixel Format Naming Convention 2.x (``…p``: pixels follow one
another bit by bit, the lowest bit first) and of GigE Vision 1.x (``…Packed``: two pixels in three bytes).
Values of 10 and 12 bit stay what they are, 0 to 1023 and 0 to 4095, in arrays of 16 bit: the measuring takes
the full scale from the image.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Literal, get_args

import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray

from alignment.values import Image

PixelFormat = Literal[
    "Mono8", "Mono10", "Mono10p", "Mono10Packed", "Mono12", "Mono12p", "Mono12Packed", "Mono16"
]
PIXEL_FORMATS: tuple[PixelFormat, ...] = get_args(PixelFormat)
BITS: Mapping[str, int] = MappingProxyType(
    {name: int("".join(filter(str.isdigit, name))) for name in PIXEL_FORMATS}
)
"""Significant bits of a pixel."""
_CODES = MappingProxyType(
    {
        0x01080001: "Mono8",
        0x01100003: "Mono10",
        0x010A0046: "Mono10p",
        0x010C0004: "Mono10Packed",
        0x01100005: "Mono12",
        0x010C0047: "Mono12p",
        0x010C0006: "Mono12Packed",
        0x01100007: "Mono16",
    }
)


_FREE = 3  # references to an array that is held by the pool alone: its list, the loop, the question


def name_of_format(code: int) -> str:
    """Return the name of a buffer's pixel format; of one that is not for images of one channel its code."""
    return _CODES.get(code & 0xFFFFFFFF, f"{code & 0xFFFFFFFF:#010x}")


def bytes_of_image(pixel_format: str, width: int, height: int, padding: int = 0) -> int:
    """Return how many bytes an image has in a buffer; `padding` is that of each line.

    Lines of packed pixels may begin in the middle of a byte.
    """
    if pixel_format.endswith("Packed"):
        return (width * height + 1) // 2 * 3
    if pixel_format.endswith("p"):
        return (width * height * BITS[pixel_format] + 7) // 8
    return height * (width * (1 if pixel_format == "Mono8" else 2) + padding)


Empty = Callable[[tuple[int, int], np.dtype[Any]], NDArray[Any]]
"""Returns an array to be filled, of a shape and type."""


class ImagePool:
    """Arrays that are filled again once nobody holds them: fresh memory costs more than copying into it.

    Parameters
    ----------
    most
        Arrays that are kept; whoever holds more gets fresh ones.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._kept: list[NDArray[Any]] = []

    def empty(self, shape: tuple[int, int], depth: np.dtype[Any]) -> NDArray[Any]:
        """Return an array of which nobody else holds a part; a view holds the array it is of."""
        for array in self._kept:
            if sys.getrefcount(array) == _FREE and array.shape == shape and array.dtype == depth:
                return array
        fresh = np.empty(shape, depth)
        # Images of another size, before the camera was set otherwise, make room.
        self._kept = [array for array in self._kept if array.shape == shape and array.dtype == depth]
        if len(self._kept) < self._most:
            self._kept.append(fresh)
        return fresh


def image_of(
    buffer: NDArray[np.uint8],
    pixel_format: str,
    width: int,
    height: int,
    padding: int = 0,
    empty: Empty = np.empty,
) -> Image:
    """Return an image of its own, which nothing shares, of what a buffer holds.

    Parameters
    ----------
    buffer
        (n,), at least `bytes_of_image`; what follows the image is left alone.
    pixel_format
        One of `PIXEL_FORMATS`.
    width, height
        Pixels.
    padding
        Bytes after each line; of unpacked formats alone.
    empty
        Returns the array that is filled.

    Returns
    -------
    Image
        (height, width), uint8 of Mono8, otherwise uint16 with the camera's own values.
    """
    if pixel_format.endswith("Packed"):
        return _packed_in_threes(buffer, BITS[pixel_format], width, height, empty)
    if pixel_format.endswith("p"):
        return _packed(buffer, BITS[pixel_format], width, height, empty)
    depth = np.dtype(np.uint8 if pixel_format == "Mono8" else "<u2")
    rows = buffer[: bytes_of_image(pixel_format, width, height, padding)].reshape(height, -1)
    found: Image = empty((height, width), depth)
    np.copyto(found.view(np.uint8), rows[:, : width * depth.itemsize])
    return found


def _packed(buffer: NDArray[np.uint8], bits: int, width: int, height: int, empty: Empty) -> Image:
    """Of 10 bits four pixels are in five bytes, of 12 two in three; each pixel touches two bytes."""
    together = 4 if bits == 10 else 2
    groups = -(-width * height // together)
    whole, size = _of_whole_groups(buffer, groups, together * bits // 8)
    pixels = empty((groups, together), np.dtype(np.uint16))
    for place in range(together):
        first, shift = divmod(place * bits, 8)
        pairs = as_strided(whole[first : first + 2].view("<u2"), (groups,), (size,), writeable=False)
        np.right_shift(pairs, shift, out=pixels[:, place])
    pixels &= (1 << bits) - 1
    return _cut(pixels, width, height)


def _packed_in_threes(buffer: NDArray[np.uint8], bits: int, width: int, height: int, empty: Empty) -> Image:
    """The upper eight bits of the first, the lower ones of both, the upper eight of the second."""
    groups = -(-width * height // 2)
    whole, size = _of_whole_groups(buffer, groups, 3)
    first, lower, second = (
        as_strided(whole[place:], (groups,), (size,), writeable=False) for place in range(3)
    )
    few = bits - 8
    pixels = empty((groups, 2), np.dtype(np.uint16))
    for place, (upper, rest) in enumerate(((first, lower), (second, lower >> 4))):
        np.left_shift(upper, few, out=pixels[:, place], dtype=np.uint16)
        pixels[:, place] |= rest & np.uint8((1 << few) - 1)
    return _cut(pixels, width, height)


def _of_whole_groups(buffer: NDArray[np.uint8], groups: int, size: int) -> tuple[NDArray[np.uint8], int]:
    """Return the bytes of so many groups; a last group that is cut short is filled up."""
    if len(buffer) >= groups * size:
        return buffer[: groups * size], size
    return np.pad(buffer, (0, groups * size - len(buffer))), size


def _cut(pixels: NDArray[np.uint16], width: int, height: int) -> Image:
    return pixels.ravel()[: width * height].reshape(height, width)
