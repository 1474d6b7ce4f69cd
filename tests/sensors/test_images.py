"""Image files: whole grey images pass unchanged, everything else is named and refused."""

import io
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image as Pillow
from PIL import TiffImagePlugin

from alignment.errors import FormatError
from sensors.formats import read_image, write_image
from sensors.formats.images import LARGEST_SIDE, encode_image

GREY8 = np.random.default_rng(1).integers(0, 256, (30, 40), dtype=np.uint8)
GREY16 = np.random.default_rng(2).integers(0, 65536, (30, 40), dtype=np.uint16)


def refused(path, *parts, **options):
    with pytest.raises(FormatError) as caught:
        read_image(path, **options)
    assert caught.value.file == str(path)
    for part in parts:
        assert part in str(caught.value)


def saved(path, image, **options):
    image.save(path, **options)
    return path


@pytest.mark.parametrize("suffix", ["png", "tif", "tiff", "PNG"])
@pytest.mark.parametrize("image", [GREY8, GREY16], ids=["8 bit", "16 bit"])
def test_images_read_back_to_the_last_bit(tmp_path, suffix, image):
    path = tmp_path / f"a.{suffix}"
    write_image(path, image)
    found = read_image(path, (40, 30))
    assert found.dtype == image.dtype
    assert found.flags.c_contiguous
    assert (found == image).all()


@pytest.mark.parametrize("suffix", ["png", "tif"])
@pytest.mark.parametrize("image", [GREY8, GREY16], ids=["8 bit", "16 bit"])
def test_images_written_by_opencv_are_read(tmp_path, suffix, image):
    path = tmp_path / f"a.{suffix}"
    cv2.imwrite(str(path), image)
    assert (read_image(path) == image).all()


@pytest.mark.parametrize("compression", [None, "tiff_lzw", "tiff_adobe_deflate", "packbits"])
@pytest.mark.parametrize("image", [GREY8, GREY16], ids=["8 bit", "16 bit"])
def test_compressed_tiff_is_read(tmp_path, compression, image):
    path = saved(tmp_path / "a.tif", Pillow.fromarray(image), compression=compression)
    assert (read_image(path) == image).all()


def test_a_tiff_of_the_other_byte_order_is_read(tmp_path):
    pixels = GREY16.astype(">u2").tobytes()
    entries = [
        (256, 4, 40),
        (257, 4, 30),
        (258, 3, 16 << 16),
        (259, 3, 1 << 16),
        (262, 3, 1 << 16),
        (273, 4, 200),
        (277, 3, 1 << 16),
        (278, 4, 30),
        (279, 4, len(pixels)),
    ]
    directory = struct.pack(">H", len(entries))
    directory += b"".join(struct.pack(">HHII", tag, kind, 1, value) for tag, kind, value in entries)
    content = (b"MM\x00*" + struct.pack(">I", 8) + directory + bytes(4)).ljust(200, b"\0") + pixels
    (tmp_path / "a.tif").write_bytes(content)
    found = read_image(tmp_path / "a.tif")
    assert found.dtype == np.uint16
    assert (found == GREY16).all()


@pytest.mark.parametrize("suffix", ["png", "tif"])
@pytest.mark.parametrize(
    ("mode", "seen"),
    [("RGB", "R/G/B"), ("RGBA", "R/G/B/A"), ("P", "P"), ("LA", "L/A")],
)
def test_colour_palette_and_transparency_are_refused(tmp_path, suffix, mode, seen):
    path = saved(tmp_path / f"colour.{suffix}", Pillow.fromarray(GREY8).convert(mode))
    refused(path, "expected an image of one channel, grey", f"channels {seen}", "never guessed")


def test_one_bit_images_are_refused(tmp_path):
    for suffix in ("png", "tif"):
        refused(
            saved(tmp_path / f"a.{suffix}", Pillow.fromarray(GREY8).convert("1")), "1 bits for each pixel"
        )


def test_float_images_are_refused(tmp_path):
    refused(saved(tmp_path / "a.tif", Pillow.fromarray(GREY8.astype(np.float32))), "32 bits for each pixel")


def test_an_inverted_tiff_is_refused(tmp_path):
    tags = TiffImagePlugin.ImageFileDirectory_v2()
    tags[262] = 0
    for image in (GREY8, GREY16):
        path = saved(tmp_path / "a.tif", Pillow.fromarray(image), tiffinfo=tags)
        content = path.read_bytes()
        at = content.find(struct.pack("<HHI", 262, 3, 1))
        path.write_bytes(content[: at + 8] + struct.pack("<H", 0) + content[at + 10 :])
        refused(path, "0 is white")


def test_a_turned_tiff_is_refused(tmp_path):
    tags = TiffImagePlugin.ImageFileDirectory_v2()
    tags[274] = 6
    refused(saved(tmp_path / "a.tif", Pillow.fromarray(GREY8), tiffinfo=tags), "expected rows from the top")


def test_several_pages_are_refused(tmp_path):
    page = Pillow.fromarray(GREY8)
    other = Pillow.fromarray(255 - GREY8)
    for name in ("a.tif", "a.png"):
        refused(
            saved(tmp_path / name, page, save_all=True, append_images=[other]),
            "expected one image",
            "2 pages",
        )


def test_another_size_is_refused_with_both_sizes(tmp_path):
    write_image(tmp_path / "a.png", GREY8)
    refused(tmp_path / "a.png", "expected an image of 30 × 40 pixels, found 40 × 30", expected_size=(30, 40))


@pytest.mark.parametrize(
    "content", [b"", b"text", b"\x89PNG\r\n\x1a\n", b"II*\x00", b"\xff\xd8\xff\xe0 JPEG"]
)
def test_what_is_no_image(tmp_path, content):
    (tmp_path / "a.png").write_bytes(content)
    refused(tmp_path / "a.png")


def test_a_jpeg_is_refused_whatever_its_name(tmp_path):
    Pillow.fromarray(GREY8).save(tmp_path / "a.png", format="JPEG")
    refused(tmp_path / "a.png", "PNG or TIFF, found another kind of file")


def test_a_missing_image(tmp_path):
    refused(tmp_path / "a.png", "no such file")


@pytest.mark.parametrize("image", [GREY8, GREY16], ids=["8 bit", "16 bit"])
def test_a_png_cut_at_any_byte_is_an_error_never_a_grey_stripe(tmp_path, image):
    content = encode_image(image)
    path = tmp_path / "cut.png"
    for length in range(0, len(content), 7):
        path.write_bytes(content[:length])
        refused(path)
    path.write_bytes(content[:-1])
    refused(path, f"a PNG cut short after {len(content) - 1} bytes")


@pytest.mark.parametrize("compression", [None, "tiff_lzw", "tiff_adobe_deflate"])
def test_a_cut_tiff_is_an_error(tmp_path, compression):
    # Lines that compress, as real images' background does: a decoder may run out of data late.
    image = np.tile(GREY16[:, :1], (4, 300))
    path = saved(tmp_path / "a.tif", Pillow.fromarray(image), compression=compression)
    content = path.read_bytes()
    for share in (0.02, 0.1, 0.5, 0.9, 0.99):
        path.write_bytes(content[: int(len(content) * share)])
        refused(path)


@given(st.integers(8, len(encode_image(GREY8)) - 1), st.integers(1, 255))
@settings(max_examples=80, deadline=None)
def test_a_changed_byte_anywhere_in_a_png_is_found(tmp_path_factory, position, change):
    content = bytearray(encode_image(GREY8))
    content[position] ^= change
    path = tmp_path_factory.getbasetemp() / "changed.png"
    path.write_bytes(content)
    with pytest.raises(FormatError):
        read_image(path)


@given(st.integers(0, 400), st.binary(min_size=1, max_size=8))
@settings(max_examples=150, deadline=None)
def test_a_damaged_tiff_is_read_or_refused_nothing_else(tmp_path_factory, position, content):
    stream = io.BytesIO()
    Pillow.fromarray(GREY8[:10, :10]).save(stream, format="TIFF")
    damaged = bytearray(stream.getvalue())
    damaged[position : position + len(content)] = content
    path = tmp_path_factory.getbasetemp() / "damaged.tif"
    path.write_bytes(damaged)
    try:
        assert read_image(path).ndim == 2
    except FormatError as error:
        assert "damaged.tif" in str(error)  # noqa: PT017


def test_a_png_that_claims_an_enormous_size_is_refused_without_the_memory(tmp_path):
    def chunk(kind, content):
        checked = kind + content
        return struct.pack(">I", len(content)) + checked + struct.pack(">I", zlib.crc32(checked))

    header = struct.pack(">IIBBBBB", 2**30, 2**30, 8, 0, 0, 0, 0)
    content = (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", header)
        + chunk(b"IDAT", zlib.compress(b""))
        + chunk(b"IEND", b"")
    )
    (tmp_path / "a.png").write_bytes(content)
    refused(tmp_path / "a.png")


@pytest.mark.parametrize("suffix", ["png", "tif"])
@pytest.mark.parametrize("upright", [False, True])
def test_the_longer_side_of_an_image_is_bounded(tmp_path, suffix, upright):
    """An image that is long and narrow is judged by its longer side."""
    for length, is_read in ((LARGEST_SIDE, True), (LARGEST_SIDE + 1, False)):
        shape = (length, 2) if upright else (2, length)
        path = saved(tmp_path / f"{length}.{suffix}", Pillow.fromarray(np.zeros(shape, np.uint8)))
        if is_read:
            assert read_image(path).shape == shape
        else:
            refused(path, f"at most {LARGEST_SIDE} pixels on a side", f"{shape[1]} × {shape[0]}")


def test_what_is_no_image_is_not_written(tmp_path):
    for wrong in (
        np.zeros((3, 4, 3), np.uint8),
        np.zeros((3, 4)),
        np.zeros((0, 4), np.uint8),
        np.zeros(4, np.uint8),
    ):
        with pytest.raises(FormatError, match="expected an image of shape"):
            write_image(tmp_path / "a.png", wrong)
    with pytest.raises(FormatError, match=r"ends in \.png"):
        write_image(tmp_path / "a.bmp", GREY8)
    assert list(tmp_path.iterdir()) == []


def test_a_window_of_an_image_is_written_as_it_is_seen(tmp_path):
    write_image(tmp_path / "a.png", GREY16[::2, ::-1])
    assert (read_image(tmp_path / "a.png") == GREY16[::2, ::-1]).all()


@pytest.mark.parametrize("bits", [10, 12, 14])
def test_a_tiff_with_packed_pixels_of_another_depth_is_named(tmp_path, bits):
    """Read as 16 bit, the values of 12 would fill a sixteenth of the range or be shifted."""
    width, height = 8, 4
    rows = bytes(-(-width * bits // 8) * height)
    entries = [(256, width), (257, height), (258, bits), (259, 1), (262, 1), (273, 8), (277, 1),
               (278, height), (279, len(rows))]  # fmt: skip
    table = struct.pack("<H", len(entries)) + b"".join(struct.pack("<HHII", t, 4, 1, v) for t, v in entries)
    path = tmp_path / "a.tif"
    path.write_bytes(struct.pack("<2sHI", b"II", 42, 8 + len(rows)) + rows + table + bytes(4))
    refused(path)


def with_chunk(content: bytes, kind: bytes, data: bytes) -> bytes:
    """A PNG with one more chunk behind its head."""
    chunk = len(data).to_bytes(4, "big") + kind + data + zlib.crc32(kind + data).to_bytes(4, "big")
    return content[:33] + chunk + content[33:]


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_a_grey_png_with_a_transparent_level_is_refused(tmp_path: Path, dtype: type) -> None:
    """It was read, though the page of formats says that transparency is refused."""
    path = tmp_path / "a.png"
    content = encode_image(np.full((4, 5), 7, dtype))
    path.write_bytes(with_chunk(content, b"tEXt", b"Comment\0x"))
    assert read_image(path).shape == (4, 5)
    path.write_bytes(with_chunk(content, b"tRNS", b"\0\0"))
    with pytest.raises(FormatError, match=r"expected an image without transparency, found .*tRNS"):
        read_image(path)


@pytest.mark.parametrize(
    ("dtype", "stated", "seen"),
    [
        (np.uint16, 2, "16-bit signed samples"),
        (np.uint8, 2, "8-bit signed samples"),
        (np.uint16, 1, None),
    ],
)
def test_samples_of_another_kind_in_a_tiff_are_named(
    tmp_path: Path, dtype: type, stated: int, seen: str | None
) -> None:
    """Signed samples were told as colours that are never guessed into grey."""
    path = tmp_path / "a.tif"
    Pillow.fromarray(np.full((4, 5), 7, dtype)).save(path, tiffinfo={339: stated})
    if seen is None:
        assert read_image(path).shape == (4, 5)
        return
    with pytest.raises(FormatError, match=f"unsigned, found {seen}"):
        read_image(path)
