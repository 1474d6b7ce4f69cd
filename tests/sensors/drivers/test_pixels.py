"""Packed pixels are the same as unpacked ones, whatever the size of the image."""

import numpy as np
import pytest

from sensors.drivers.genicam.pixels import BITS, PIXEL_FORMATS, bytes_of_image, image_of, name_of_format

SIZES = [(8, 6), (5, 3), (7, 1), (1, 1), (2, 5), (1001, 3)]


def drawn(pixel_format, width, height):
    rng = np.random.default_rng(width * height)
    depth = np.uint8 if pixel_format == "Mono8" else np.uint16
    return rng.integers(0, 1 << BITS[pixel_format], (height, width), dtype=depth)


def packed(pixel_format, image):
    """Bit by bit, as the standards draw it; nothing of what unpacks."""
    values, bits = image.ravel().tolist(), BITS[pixel_format]
    if pixel_format.endswith("Packed"):
        few, found = bits - 8, bytearray()
        for first, second in zip(values[::2], [*values[1::2], 0][: (len(values) + 1) // 2], strict=True):
            lower = first & ((1 << few) - 1) | (second & ((1 << few) - 1)) << 4
            found += bytes([first >> few, lower, second >> few])
        return np.frombuffer(bytes(found), np.uint8)
    if pixel_format.endswith("p"):
        whole = sum(value << (bits * place) for place, value in enumerate(values))
        return np.frombuffer(whole.to_bytes((len(values) * bits + 7) // 8, "little"), np.uint8)
    return np.frombuffer(image.tobytes(), np.uint8)


@pytest.mark.parametrize(("width", "height"), SIZES)
@pytest.mark.parametrize("pixel_format", PIXEL_FORMATS)
def test_an_image_is_what_the_camera_packed(pixel_format, width, height):
    image = drawn(pixel_format, width, height)
    buffer = packed(pixel_format, image)
    assert bytes_of_image(pixel_format, width, height) == len(buffer)
    found = image_of(np.append(buffer, np.full(9, 0xA5, np.uint8)), pixel_format, width, height)
    assert found.dtype == image.dtype
    np.testing.assert_array_equal(found, image)
    assert found.flags.c_contiguous
    assert not np.shares_memory(found, buffer)


@pytest.mark.parametrize("pixel_format", ["Mono8", "Mono12", "Mono16"])
def test_what_fills_up_a_line_is_left_out(pixel_format):
    image = drawn(pixel_format, 7, 5)
    rows = np.frombuffer(image.tobytes(), np.uint8).reshape(5, -1)
    buffer = np.pad(rows, ((0, 0), (0, 3)), constant_values=0xEE).ravel()
    np.testing.assert_array_equal(image_of(buffer, pixel_format, 7, 5, padding=3), image)


@pytest.mark.parametrize("pixel_format", ["Mono10p", "Mono10Packed", "Mono12p", "Mono12Packed"])
def test_the_maker_s_own_converter_says_the_same(pixel_format):
    pylon = pytest.importorskip("pypylon.pylon", reason="pypylon is not installed")
    image = drawn(pixel_format, 16, 4)
    buffer = packed(pixel_format, image)
    theirs = pylon.PylonImage()
    theirs.AttachMemoryView(
        memoryview(buffer), getattr(pylon, f"PixelType_{pixel_format.replace('Packed', 'packed')}"), 16, 4, 0
    )
    np.testing.assert_array_equal(theirs.GetArray(), image)


def test_a_code_of_the_standard_is_its_name_and_a_colour_is_not_taken_for_one():
    assert name_of_format(0x010C0047) == "Mono12p"
    assert name_of_format(0x02180014) == "0x02180014"
