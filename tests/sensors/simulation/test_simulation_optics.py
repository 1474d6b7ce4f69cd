"""Optics do not move edges; noise and grey levels are what they say."""

from __future__ import annotations

import numpy as np
import pytest

from alignment.errors import DegenerateInputError
from sensors.simulation.optics import Optics, develop, integrate, sample_offsets


@pytest.mark.parametrize("samples", [1, 2, 3])
@pytest.mark.parametrize("centre", [20.0, 20.31, 19.5])
def test_a_line_stays_where_it_is(samples: int, centre: float) -> None:
    place = (np.arange(41)[:, None] + sample_offsets(samples)).ravel()
    line = np.exp(-(((place - centre) / 2.0) ** 2) / 2).astype(np.float32)
    light = integrate(np.tile(line, (10 * samples, 1)), samples, 0.7)
    assert light.shape == (10, 41)
    row = light[5].astype(float)
    assert (row * np.arange(41)).sum() / row.sum() == pytest.approx(centre, abs=1e-5)
    spread = (row * (np.arange(41) - centre) ** 2).sum() / row.sum()
    pixel = 1.0 / 12.0 * (1 - 1 / samples**2)
    assert spread == pytest.approx(4.0 + 0.49 + pixel, abs=0.02)


def test_noise_has_the_variance_of_electrons_and_reading() -> None:
    optics = Optics(full_well_e=10_000.0, read_noise_e=20.0, black_level=0.1, bits=16)
    light = np.full((400, 400), 0.25, dtype=np.float32)
    image = develop(light, optics, np.random.default_rng(1)).astype(float)
    per_electron = 65535 / 10_000
    assert image.mean() == pytest.approx((0.1 + 0.25) * 65535, rel=1e-3)
    assert image.std() == pytest.approx(np.sqrt(2500 + 400) * per_electron, rel=0.01)


def test_exposure_gain_and_saturation() -> None:
    optics = Optics(black_level=0.0)
    light = np.array([[0.0, 0.1, 0.2, 0.9]], dtype=np.float32)
    plain = develop(light, optics, None)
    assert plain.dtype == np.uint8
    assert plain.tolist() == [[0, 26, 51, 230]]
    assert develop(light, optics, None, exposure_ms=10.0).tolist() == [[0, 51, 102, 255]]
    assert develop(light, optics, None, gain_db=20 * np.log10(2.0)).tolist() == [[0, 51, 102, 255]]


def test_same_generator_same_noise() -> None:
    light = np.full((50, 60), 0.3, dtype=np.float32)
    first, second = (develop(light, Optics(), np.random.default_rng(7)) for _ in range(2))
    np.testing.assert_array_equal(first, second)
    assert (develop(light, Optics(), np.random.default_rng(8)) != first).any()


def test_odd_depths_are_refused() -> None:
    with pytest.raises(DegenerateInputError, match="8 or 16"):
        Optics(bits=12)
