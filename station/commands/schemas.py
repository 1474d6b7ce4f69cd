"""The JSON schemas of all files that this program reads, by name."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from pydantic import BaseModel

from alignment.errors import ConfigurationError, SeveralErrors, TruewheelError, told
from sensors.drivers.installed import CAMERAS, LoadedDriver, installed_drivers, load_driver
from sensors.formats import SCHEMAS
from sensors.projectors import PROJECTORS, LoadedProjector, load_projector
from station.configuration import StationConfig, VehicleType, station_model


def schema_of(name: str) -> dict[str, Any]:
    """Return the JSON schema of a kind of file.

    Raises
    ------
    ConfigurationError
        When there is no such kind; the message lists all.
    """
    known: dict[str, type[BaseModel]] = {**SCHEMAS, "station": StationConfig, "vehicle-type": VehicleType}
    if name == "station":
        # With the settings of every driver that is installed.
        known[name] = station_model(*_all_drivers())
    if name == "simulation":
        # Loads the renderer, which the others do without.
        from station.rehearsal import SimulationConfig

        known[name] = SimulationConfig
    if name not in known:
        raise ConfigurationError(
            field="NAME", expected=f"one of {', '.join([*known, 'simulation'])}", seen=f"'{name}'"
        )
    return known[name].model_json_schema(by_alias=True)


def _all_drivers() -> tuple[list[str], list[str]]:
    """Return the names of all installed drivers of cameras and of projectors, after loading each.

    A schema without one of them would be wrong.
    """
    cameras, projectors = (
        sorted({one.name for one in installed_drivers(kind)}) for kind in (CAMERAS, PROJECTORS)
    )
    loads: list[Callable[[], LoadedDriver | LoadedProjector]] = [
        *(partial(load_driver, name) for name in cameras),
        *(partial(load_projector, name) for name in projectors),
    ]
    failures: list[TruewheelError] = []
    for load in loads:
        try:
            _require_schema(load())
        except ConfigurationError as error:
            failures.append(error)
    if len(failures) == 1:
        raise failures[0]
    if failures:
        raise SeveralErrors(f"{len(failures)} drivers cannot be loaded", failures)
    return cameras, projectors


def _require_schema(loaded: LoadedDriver | LoadedProjector) -> None:
    try:
        loaded.driver.settings.model_json_schema(by_alias=True)
    except Exception as error:
        raise ConfigurationError(
            expected=f"settings of the driver '{loaded.installed.name}' that have a JSON schema",
            seen=f"{told(error)} ({loaded.installed})",
            cure=f"Ask the makers of {loaded.installed.package} for a version that fits truewheel",
        ) from error
