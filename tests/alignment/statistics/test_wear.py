"""A projector that fades over months, before tyres that differ more than it does."""

import numpy as np
import pytest

from alignment.errors import DegenerateInputError
from alignment.statistics.wear import WearState, projector_wear


def wheels(per_year, days=360.0, number=2000, scatter=0.25, seed=4):
    """Brightness of wheels whose tyres scatter, under a lamp that keeps this share in a year."""
    rng = np.random.default_rng(seed)
    when = np.sort(rng.uniform(0.0, days, number))
    return when, 0.3 * per_year ** (when / 360.0) * np.exp(rng.normal(0.0, scatter, number))


@pytest.mark.parametrize(
    ("per_year", "state"),
    [(1.0, WearState.GOOD), (0.85, WearState.GOOD), (0.6, WearState.WORN), (0.3, WearState.SPENT)],
)
def test_a_lamp_that_fades_is_told_though_tyres_differ_by_a_quarter(per_year, state):
    wear = projector_wear(*wheels(per_year))
    assert wear.state is state
    assert wear.share == pytest.approx(per_year ** (346 / 360), abs=3.5 * wear.share_u)
    assert wear.share_u < 0.06


def test_it_says_when_the_warning_will_come():
    wear = projector_wear(*wheels(0.85, number=20_000))
    assert wear.worn_in_days == pytest.approx(360 * np.log(0.7) / np.log(0.85) - 360, rel=0.25)
    assert "worn in" in wear.reason


def test_no_end_is_foretold_of_a_lamp_that_does_not_fade():
    for seed in range(20):
        assert projector_wear(*wheels(1.0, seed=seed)).worn_in_days is None


def test_the_order_of_the_wheels_does_not_matter():
    when, light = wheels(0.6)
    mixed = np.random.default_rng(1).permutation(len(when))
    assert projector_wear(when[mixed], light[mixed]) == projector_wear(when, light)


@pytest.mark.parametrize(("days", "number"), [(360.0, 100), (20.0, 2000), (360.0, 0), (0.0, 1)])
def test_too_few_wheels_or_too_short_a_time_tell_nothing(days, number):
    wear = projector_wear(*wheels(0.3, days, number))
    assert wear.state is WearState.UNKNOWN
    assert wear.share is None


def test_lines_that_are_gone_are_spent():
    when, light = wheels(1.0)
    light[when > 340.0] = 0.0
    assert projector_wear(when, light).state is WearState.SPENT


@pytest.mark.parametrize("light", [[0.3], [0.3, np.nan], [0.3, -0.1]])
def test_figures_that_are_none_are_refused(light):
    with pytest.raises(DegenerateInputError):
        projector_wear([1.0, 2.0], light)
