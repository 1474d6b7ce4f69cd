"""Plots of studies, drawn from numbers of the size that a study finds: nothing covers anything."""

from __future__ import annotations

import math
from collections.abc import Callable
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from alignment.units import ARCMIN
from station.studies import (
    coverage,
    degraded,
    efficiency,
    knocked,
    lenz_tsai,
    line_endurance,
    marks,
    refresh,
    repeatability,
)
from tests.drawn import assert_clear

RNG = np.random.default_rng(2)


def _of(study: ModuleType, name: str = "_plot") -> Any:
    """What a study keeps for itself: a whole run would take minutes for one picture."""
    return getattr(study, name)


def _refresh() -> Figure:
    rigs = np.arange(1.0, 3.0)
    names = ("along", "across")
    values = {f"{name}_arcmin": np.array([0.01, -0.02]) for name in names}
    return _of(refresh)({"rig": rigs} | values | {f"{name}_u_arcmin": np.full(2, 0.1) for name in names})


def _knocked() -> Figure:
    rows = [
        {"outcome": outcome, "change_arcmin": 10.0**power, "evidence": 10.0 * power}
        for power in (-3, -1, 0, 1)
        for outcome in ("measured", "warned")
    ]
    return _of(knocked)(rows)


def _degraded() -> Figure:
    rows = [{"kind": kind} for kind in degraded.DISTURBANCES]
    errors = RNG.lognormal(-3.0, 1.0, (len(rows), 2))
    return _of(degraded)(rows, errors, 2.0 * errors)


def _lenz_tsai() -> Figure:
    levels = np.linspace(0.0, 2.0, 6)
    curves = {
        name: (np.outer(levels, np.arange(1.0, 1.0 + len(lenz_tsai.SCALE_ERRORS))), levels)
        for name in ("points", "pixels")
    }
    return _of(lenz_tsai)(levels, curves)


def _endurance() -> Figure:
    times = [
        SimpleNamespace(**dict.fromkeys(line_endurance.TIMES, 0.001 * (1 + number))) for number in range(50)
    ]
    memory = np.linspace(200.0, 210.0, 50).tolist()
    found = SimpleNamespace(times=times, station_rss_mb=memory, controller_rss_mb=memory)
    return _of(line_endurance)(found)


def _sweeps() -> Figure:
    rows = [
        {"factor": factor, "method": method, "value": value, "rms_px": 0.03 + 0.001 * value, "bound_px": 0.01}
        for factor, values in marks.SWEEPS.items()
        for value in values
        for method in _of(marks, "_DRAWN")
    ]
    return _of(marks, "_plot_sweeps")(rows)


@pytest.mark.parametrize(
    "draw",
    [
        lambda: _of(coverage)({name: RNG.normal(0.0, 1.0, (40, 2)) for name in ("revolution", "plane")}),
        lambda: _of(repeatability)(RNG.normal(0.0, 0.02, (25, 2))),
        lambda: _of(efficiency)(
            RNG.normal(0.0, 0.004 * ARCMIN, (60, 2)), np.array([0.0037, 0.0035]) * ARCMIN
        ),
        _refresh, _knocked, _degraded, _lenz_tsai, _endurance, _sweeps,
    ],
)  # fmt: skip
def test_no_legend_covers_data_and_no_number_another(draw: Callable[[], Figure]) -> None:
    """Tilts of hundredths of a minute stood on each other; legends lay on bars and points."""
    assert_clear(draw())


def test_rigs_and_repeats_are_counted_in_whole_numbers() -> None:
    """Between rig 1 and rig 2 the axis had 1.2, 1.4, 1.6 and 1.8."""
    [axes] = _refresh().axes
    assert all(math.isclose(tick, round(tick)) for tick in axes.get_xticks())
