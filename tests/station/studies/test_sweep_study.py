"""The study of sweeps of the steering in short."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from alignment.units import ARCMIN
from alignment.values import Refusal
from alignment.vehicle import steering_axis
from station.studies import sweep
from station.studies.steered_wheels import ShotNoise, even_steers, steered_vehicle, sweep_by_numbers


def silent(done: float, doing: str) -> None:
    assert 0.0 <= done <= 1.0
    assert doing


@pytest.mark.slow(40)
def test_sweeps_by_numbers_keep_the_goals() -> None:
    result = sweep.run(1, True, silent)
    assert not result.missed, [(str(goal), result.figures[goal.figure]) for goal in result.missed]
    assert result.figures["sweeps"] == sweep.SWEEPS
    assert result.figures["accused_of_moving"] < 0.01
    # What the load does anew in each exposure is gone.
    assert result.figures["shot_camber_u_arcmin"] < 0.01
    assert len(result.rows) == sweep.SWEEPS


def test_a_sweep_that_is_noisier_than_rigs_are_misses_the_goals() -> None:
    """The study can fail: with ten times the noise of a shot kingpin inclination is off by minutes."""
    own = np.diag([0.05 * ARCMIN, 0.05 * ARCMIN, 0.002, 0.002, 0.002]) ** 2
    noise = [ShotNoise(0.0, own, None, 1.0, np.zeros(2))]
    steers = even_steers(math.radians(10.0), 41)
    rng = np.random.default_rng(3)
    off = []
    for k in range(20):
        one = sweep_by_numbers(steered_vehicle(1, k % 2), steers, noise, np.zeros((41, 5, 0)), 0.0, rng)
        found = steering_axis(one.series, one.stand, None, one.run_out)
        assert not isinstance(found, Refusal), found
        off.append(abs(found.value("kpi") - math.radians(one.truth.kpi_deg)) / ARCMIN)
    assert np.quantile(off, 0.95) > 2.0


def test_a_sweep_without_its_run_out_is_off_by_the_roll() -> None:
    one = sweep.exact_sweep(steered_vehicle(1, 0), even_steers(math.radians(10.0), 41))
    blind = steering_axis(one.series, replace(one.stand, rolls=0.0))
    assert not isinstance(blind, Refusal)
    assert abs(blind.value("caster") - math.radians(one.truth.caster_deg)) > 1e-6
