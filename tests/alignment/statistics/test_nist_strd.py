"""NIST Statistical Reference Datasets: analysis of variance, and univariate mean and standard deviation.

https://www.itl.nist.gov/div898/strd. The analysis-of-variance files are read where they are present; of the
univariate sets, which are in the public domain, the measured ones stand below and NumAcc1 to NumAcc4 follow
from their definition.
"""

from __future__ import annotations

import re
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest

from alignment.statistics.anova import one_way, two_way
from alignment.statistics.summary import Moments, deviations, merged, moments

NINE_DIGITS = 1e-9
ANOVA_SETS = ("SiRstv", "AtmWtAg", *(f"SmLs{number:02d}" for number in range(1, 10)))


@pytest.mark.parametrize("name", ANOVA_SETS)
def test_analysis_of_variance_has_the_certified_digits(name: str, published_data: Path) -> None:
    lines = (published_data / "nist_anova" / f"{name}.dat").read_text().splitlines()
    certified = [float(x) for line in lines[:60] for x in re.findall(r"\d\.\d{8,}E[+-]\d\d", line)]
    rows = [line.split() for line in lines[60:] if line.strip()]
    _, values = deviations([Decimal(row[1]) for row in rows])
    level = np.array([int(row[0]) for row in rows])

    found = one_way([values[level == each] for each in np.unique(level)])

    assert found.between.f is not None
    mine = (
        found.between.squares, found.between.mean_square, found.between.f,
        found.within.squares, found.within.mean_square, found.r_squared, found.residual_deviation,
    )  # fmt: skip
    assert mine == pytest.approx(certified, rel=NINE_DIGITS)


def test_doubles_with_nine_common_digits_keep_nine_of_the_rest() -> None:
    """Binary numbers are rounded before any statistics sees them: that, and no more, is lost."""
    groups = [1_000_000 + np.array([0.4 + 0.1 * (k % 2) if n else 0.4 for n in range(21)]) for k in range(9)]
    exact = [group - 1_000_000 for group in groups]
    assert one_way(groups).within.squares == pytest.approx(one_way(exact).within.squares, rel=1e-9)


# Michelso: speed of light in millions of metres per second, less 299, in thousandths. Lew: a beam.
# Mavro: transmittance less 2, in units of 0.00001.
MICHELSO = """
850 740 900 1070 930 850 950 980 980 880 1000 980 930 650 760 810 1000 1000 960 960 960 940 960
940 880 800 850 880 900 840 830 790 810 880 880 830 800 790 760 800 880 880 880 860 720 720 620
860 970 950 880 910 850 870 840 840 850 840 840 840 890 810 810 820 800 770 760 740 750 760 910
920 890 860 880 720 840 850 850 780 890 840 780 810 760 810 790 810 820 850 870 870 810 740 810
940 950 800 810 870
"""
LEW = """
-213 -564 -35 -15 141 115 -420 -360 203 -338 -431 194 -220 -513 154 -125 -559 92 -21 -579 -52 99
-543 -175 162 -457 -346 204 -300 -474 164 -107 -572 -8 83 -541 -224 180 -420 -374 201 -236 -531 83
27 -564 -112 131 -507 -254 199 -311 -495 143 -46 -579 -90 136 -472 -338 202 -287 -477 169 -124
-568 17 48 -568 -135 162 -430 -422 172 -74 -577 -13 92 -534 -243 194 -355 -465 156 -81 -578 -64
139 -449 -384 193 -198 -538 110 -44 -577 -6 66 -552 -164 161 -460 -344 205 -281 -504 134 -28 -576
-118 156 -437 -381 200 -220 -540 83 11 -568 -160 172 -414 -408 188 -125 -572 -32 139 -492 -321 205
-262 -504 142 -83 -574 0 48 -571 -106 137 -501 -266 190 -391 -406 194 -186 -553 83 -13 -577 -49
103 -515 -280 201 300 -506 131 -45 -578 -80 138 -462 -361 201 -211 -554 32 74 -533 -235 187 -372
-442 182 -147 -566 25 68 -535 -244 194 -351 -463 174 -125 -570 15 72 -550 -190 172 -424 -385 198
-218 -536 96
"""
MAVRO = """
180 170 180 190 180 170 150 140 150 150 170 180 180 190 190 210 200 160 140 130 130 150 150 160
150 140 130 140 150 140 150 160 150 160 190 200 200 210 220 230 240 250 270 260 260 260 270 260
250 240
"""


def _alternating(first: str, low: str, high: str) -> list[Decimal]:
    return [Decimal(first)] + [Decimal(low), Decimal(high)] * 500


UNIVARIATE = {
    "Michelso": (
        [299 + Decimal(text) / 1000 for text in MICHELSO.split()],
        299.8524,
        0.0790105478190518,
    ),
    "Lew": ([Decimal(text) for text in LEW.split()], -177.435, 277.332168044316),
    "Mavro": ([2 + Decimal(text) / 100_000 for text in MAVRO.split()], 2.001856, 0.000429123454003053),
    "NumAcc1": ([Decimal(10_000_001), Decimal(10_000_003), Decimal(10_000_002)], 10_000_002.0, 1.0),
    "NumAcc2": (_alternating("1.2", "1.1", "1.3"), 1.2, 0.1),
    "NumAcc3": (_alternating("1000000.2", "1000000.1", "1000000.3"), 1_000_000.2, 0.1),
    "NumAcc4": (_alternating("10000000.2", "10000000.1", "10000000.3"), 10_000_000.2, 0.1),
}


@pytest.mark.parametrize("name", UNIVARIATE)
def test_mean_and_deviation_have_the_certified_digits(name: str) -> None:
    numbers, mean, deviation = UNIVARIATE[name]
    reference, values = deviations(numbers)
    found = moments(values)
    assert reference + found.mean == pytest.approx(mean, rel=1e-15)
    assert found.deviation == pytest.approx(deviation, rel=NINE_DIGITS)


def test_moments_of_parts_add_up_to_those_of_the_whole() -> None:
    values = 1e6 + np.random.default_rng(3).normal(0.0, 1e-3, 1000)
    parts = [moments(part) for part in np.array_split(values, 7)]
    whole, together = moments(values), merged([*parts, Moments(0, 0.0, 0.0, 0.0, 0.0)])
    assert (together.n, together.low, together.high) == (whole.n, whole.low, whole.high)
    assert together.mean == pytest.approx(whole.mean, rel=1e-15)
    assert together.deviation == pytest.approx(whole.deviation, rel=1e-6)


def test_two_way_agrees_with_one_way_on_each_factor() -> None:
    cube = np.random.default_rng(4).normal(size=(4, 3, 5))
    found = two_way(cube)
    assert found.first.squares == pytest.approx(one_way(list(cube.reshape(4, 15))).between.squares)
    columns = cube.transpose(1, 0, 2).reshape(3, 20)
    assert found.second.squares == pytest.approx(one_way(list(columns)).between.squares)
    assert found.total.squares == pytest.approx(moments(cube.ravel()).squares)
    assert found.total.df == 59
