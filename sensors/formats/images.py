"""Image files: 8- or 16-bit, one channel, PNG or TIFF, whole."""

from __future__ import annotations

import io
import struct
import zlib
from os import PathLike
from pathlib import Path

import numpy as np
from PIL import Image as Pillow
from PIL import UnidentifiedImageError
from PIL.TiffImagePlugin import TiffImageFile

from alignment.errors import FormatError
from alignment.file_limits import IMAGE
from alignment.values import Image
from sensors.formats.files import read_bytes, write_bytes

SUFFIXES = {".png": "PNG", ".tif": "TIFF", ".tiff": "TIFF"}
LARGEST_SIDE = 32_768
_KIND = "an 8- or 16-bit image of one channel, PNG or TIFF"
_PNG_START = b"\x89PNG\r\n\x1a\n"
_BITS_PER_SAMPLE, _PHOTOMETRIC, _ORIENTATION, _SAMPLE_FORMAT = 258, 262, 274, 339
_BLACK_IS_ZERO = 1


def read_image(path: str | PathLike[str], expected_size: tuple[int, int] | None = None) -> Image:
    """Read one image.

    Parameters
    ----------
    path
        PNG or TIFF.
    expected_size
        (width, height), pixels, when it is known, as a calibration gives it.

    Returns
    -------
    Image
        (height, width), uint8 or uint16, values as stored.

    Raises
    ------
    FormatError
        When the file is missing, no PNG or TIFF, damaged or cut short, has colours, a palette, transparency,
        another depth than 8 or 16 bits or several pages, or is of another size.
    """
    path = Path(path)
    content = read_bytes(path, _KIND, IMAGE)
    if content.startswith(_PNG_START):
        _check_png(path, content)
    try:
        with Pillow.open(io.BytesIO(content), formats=["PNG", "TIFF"]) as opened:
            _check_kind(path, opened)
            size = opened.size
            if expected_size is not None and size != tuple(expected_size):
                raise FormatError(
                    file=path,
                    expected=f"an image of {expected_size[0]} × {expected_size[1]} pixels",
                    seen=f"{size[0]} × {size[1]}",
                    cure="Use the calibration of these cameras, or images as the cameras deliver them",
                )
            pixels = np.array(opened)
    except FormatError:
        raise
    except UnidentifiedImageError as error:
        raise FormatError(file=path, expected=_KIND, seen="another kind of file") from error
    except Exception as error:  # a damaged file makes the decoders raise nearly anything
        raise FormatError(
            file=path, expected="an image that is whole", seen=f"damage: {error}", cure="Copy the file again"
        ) from error
    if pixels.dtype == np.uint8:
        return pixels.astype(np.uint8, copy=False)
    return np.ascontiguousarray(pixels.astype(np.uint16))


def encode_image(image: Image, kind: str = "PNG") -> bytes:
    """Return the bytes of a PNG or TIFF file, without loss.

    Parameters
    ----------
    image
        (height, width), uint8 or uint16.
    kind
        ``PNG`` or ``TIFF``.

    Raises
    ------
    FormatError
        When the array is no such image.
    """
    if image.ndim != 2 or image.dtype not in (np.uint8, np.uint16) or image.size == 0:
        raise FormatError(
            expected="an image of shape (height, width), uint8 or uint16",
            seen=f"shape {image.shape}, {image.dtype}",
        )
    stream = io.BytesIO()
    # The station waits for the archive. In sensor noise nothing comes twice but runs of one grey value: not
    # looking for more is faster by a fifth, and what is left is smaller by a fifth.
    options = {"compress_level": 1, "compress_type": zlib.Z_RLE} if kind == "PNG" else {}
    Pillow.fromarray(np.ascontiguousarray(image)).save(stream, format=kind, **options)
    return stream.getvalue()


def write_image(path: str | PathLike[str], image: Image) -> None:
    """Write one image, PNG or TIFF by the suffix, whole or not at all.

    Raises
    ------
    FormatError
        When the array is no image of one channel, the suffix is another, or the file cannot be written.
    """
    path = Path(path)
    kind = SUFFIXES.get(path.suffix.lower())
    if kind is None:
        raise FormatError(file=path, expected="a name that ends in .png, .tif or .tiff", seen=path.suffix)
    write_bytes(path, encode_image(image, kind))


def _check_png(path: Path, content: bytes) -> None:
    """Check that every chunk is there with its checksum: decoders show a cut image as a grey stripe."""
    position = len(_PNG_START)
    while True:
        if position + 12 > len(content):
            raise _damaged(path, f"cut short after {len(content)} bytes")
        length, kind = struct.unpack_from(">I4s", content, position)
        end = position + 12 + length
        if end > len(content):
            raise _damaged(path, f"cut short after {len(content)} bytes")
        (checksum,) = struct.unpack_from(">I", content, end - 4)
        if zlib.crc32(content[position + 4 : end - 4]) != checksum:
            raise _damaged(path, f"a wrong checksum at byte {position}")
        if kind == b"IHDR":
            _check_depth(path, content[position + 16])
        if kind == b"tRNS":
            raise FormatError(
                file=path,
                expected="an image without transparency",
                seen="a grey level that counts as transparent (chunk tRNS)",
                cure="Save the camera's own grey image",
            )
        if kind == b"IEND":
            return
        position = end


def _check_depth(path: Path, bits: int) -> None:
    if bits not in (8, 16):
        raise FormatError(file=path, expected=_KIND, seen=f"{bits} bits for each pixel")


def _check_samples(path: Path, bits: int, stated: object) -> None:
    """Refuse numbers of another kind than unsigned, which TIFF states apart from their depth."""
    kind = stated[0] if isinstance(stated, tuple) and stated else stated
    if kind not in (1, 4):  # 4 is "nothing said"
        name = {2: "signed samples", 3: "floating-point samples"}.get(kind if isinstance(kind, int) else 0)
        raise FormatError(
            file=path,
            expected=f"{_KIND}, unsigned",
            seen=f"{bits}-bit {name or 'samples of another kind'}",
            cure="Save what the camera counts, from 0 upward",
        )


def _check_kind(path: Path, opened: Pillow.Image) -> None:
    if isinstance(opened, TiffImageFile):
        bits = opened.tag_v2.get(_BITS_PER_SAMPLE, (1,))
        photometric = opened.tag_v2.get(_PHOTOMETRIC, _BLACK_IS_ZERO)
        if opened.tag_v2.get(_ORIENTATION, 1) != 1:
            raise FormatError(file=path, expected="rows from the top, columns from the left", seen="others")
        if len(bits) == 1:
            _check_depth(path, bits[0])
            _check_samples(path, bits[0], opened.tag_v2.get(_SAMPLE_FORMAT, (1,)))
            if photometric != _BLACK_IS_ZERO and opened.mode != "P":
                raise FormatError(file=path, expected="a TIFF in which 0 is black", seen="0 is white")
    if opened.mode not in ("L", "I;16", "I;16B"):
        raise FormatError(
            file=path,
            expected="an image of one channel, grey",
            seen=f"channels {'/'.join(opened.getbands())} ({opened.mode})",
            cure="Save the camera's own grey image; colours are never guessed into grey",
        )
    if getattr(opened, "n_frames", 1) != 1:
        raise FormatError(file=path, expected="one image", seen=f"{getattr(opened, 'n_frames', 1)} pages")
    if max(opened.size) > LARGEST_SIDE:
        raise FormatError(
            file=path,
            expected=f"at most {LARGEST_SIDE} pixels on a side",
            seen=f"{opened.size[0]} × {opened.size[1]}",
        )


def _damaged(path: Path, how: str) -> FormatError:
    return FormatError(
        file=path, expected="an image that is whole", seen=f"a PNG {how}", cure="Copy or record it again"
    )
