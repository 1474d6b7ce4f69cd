"""The studies by name; a study's module is loaded when it is asked for."""

from __future__ import annotations

from importlib import import_module
from typing import cast

from alignment.errors import ConfigurationError
from station.figures import Study

STUDIES = {
    "adjusting": "station.studies.adjusting",
    "correction": "station.studies.correction",
    "covariance": "station.studies.covariance",
    "coverage": "station.studies.coverage",
    "degraded": "station.studies.degraded",
    "efficiency": "station.studies.efficiency",
    "following": "station.studies.following",
    "knocked": "station.studies.knocked",
    "lenz-tsai": "station.studies.lenz_tsai",
    "line-endurance": "station.studies.line_endurance",
    "line-noise": "station.studies.line_noise",
    "line-power-loss": "station.studies.line_power_loss",
    "loaded-tyres": "station.studies.loaded_tyres",
    "marks": "station.studies.marks",
    "nonparallel-head": "station.studies.nonparallel_head",
    "parallel-head": "station.studies.parallel_head",
    "plates": "station.studies.plates",
    "refresh": "station.studies.refresh",
    "refresh-rates": "station.studies.refresh_rates",
    "repeatability": "station.studies.repeatability",
    "vehicle-budget": "station.studies.vehicle_budget",
    "vehicles": "station.studies.vehicles",
    "sweep": "station.studies.sweep",
    "spin-cycle": "station.studies.spin_cycle",
    "wheel-grid": "station.studies.wheel_grid",
}
"""Name and module; the module has the study under the name `STUDY`."""


def load_study(name: str) -> Study:
    """Return the study of that name.

    Raises
    ------
    ConfigurationError
        When there is none.
    """
    if name not in STUDIES:
        raise ConfigurationError(
            choice="name", expected=f"one of {', '.join(sorted(STUDIES))}, or 'all'", seen=f"'{name}'"
        )
    return cast("Study", import_module(STUDIES[name]).STUDY)
