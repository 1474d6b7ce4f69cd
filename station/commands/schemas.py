"""The JSON schemas of all files that this program reads, by name."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel

from alignment.errors import ConfigurationError
from sensors.formats import SCHEMAS
from station.configuration.settings import StationConfig
from station.configuration.vehicle_types import VehicleType


def schema_of(name: str) -> dict[str, Any]:
    """Return the JSON schema of a kind of file.

    Raises
    ------
    ConfigurationError
        When there is no such kind; the message lists all.
    """
    known: dict[str, type[BaseModel]] = {**SCHEMAS, "station": StationConfig, "vehicle-type": VehicleType}
    if name == "simulation":
        # Loads the renderer, which the others do without.
        from station.rehearsal.simulation import SimulationConfig

        known[name] = SimulationConfig
    if name not in known:
        raise ConfigurationError(
            field="NAME", expected=f"one of {', '.join([*known, 'simulation'])}", seen=f"'{name}'"
        )
    return known[name].model_json_schema(by_alias=True)
