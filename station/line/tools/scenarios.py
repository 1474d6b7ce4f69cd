"""Scenarios of the simulated controller: a file that says what to play, in which order, how often.

What can be played are the points of `station.line.tools.conformance`: each is a piece of a controller's day,
good or bad, and knows what a station must answer.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import Field, model_validator

from alignment.errors import DegenerateInputError
from sensors.formats import StrictModel
from station.configuration import read_toml
from station.line.tools.conformance import POINTS, point_named, try_point
from station.line.tools.trial import PointVerdict, Trial, Vehicles

_WheelName = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,40}$")]


class ScenarioVehicle(StrictModel):
    """The vehicle that stands at the station."""

    vin: str = Field(
        default="TWCHKX00000000001", pattern=r"^[\x20-\x7e]{17}$", description="Its VIN, 17 characters"
    )
    vehicle_type: int = Field(default=1, ge=0, le=65_535, description="Number of a type the station knows")
    unknown_type: int = Field(
        default=65_535, ge=0, le=65_535, description="Number of a type the station does not know"
    )
    wheels: tuple[_WheelName, ...] | None = Field(
        default=None, min_length=1, description="Wheels to measure; all without"
    )
    patience_s: float = Field(
        default=60.0, gt=0, le=3600, description="Longest time that a measurement takes, seconds"
    )

    def vehicles(self) -> Vehicles:
        """Return the value that the points use."""
        return Vehicles(self.vin, self.vehicle_type, self.unknown_type, self.patience_s, self.wheels)


class Scenario(StrictModel):
    """One scenario."""

    name: str = Field(min_length=1, max_length=80, description="Name for people")
    play: tuple[str, ...] = Field(min_length=1, max_length=100, description="What is played, in this order")
    times: int = Field(default=1, ge=1, le=1_000_000, description="How often")
    pause_s: float = Field(default=0.0, ge=0, le=3600, description="Rest after each, seconds")

    @model_validator(mode="after")
    def _is_known(self) -> Scenario:
        for name in self.play:
            if point_named(name) is None:
                raise DegenerateInputError(
                    field="play", expected=f"one of {', '.join(p.name for p in POINTS)}", seen=f"'{name}'"
                )
        return self


class ScenarioFile(StrictModel):
    """What a scenario file holds."""

    vehicle: ScenarioVehicle = Field(
        default=ScenarioVehicle(), description="The vehicle that stands at the station"
    )
    scenarios: tuple[Scenario, ...] = Field(min_length=1, max_length=1000, description="Played in order")


@dataclass(frozen=True)
class Played:
    """One play of a scenario."""

    scenario: str
    verdict: PointVerdict


def read_scenarios(path: Path) -> ScenarioFile:
    """Read a scenario file; errors as `station.toml.read_toml`."""
    return read_toml(ScenarioFile, path, "a scenario file")


def play_scenarios(file: ScenarioFile, trial: Trial) -> Iterator[Played]:
    """Play all scenarios of a file, in order."""
    rest = threading.Event()
    for scenario in file.scenarios:
        for _ in range(scenario.times):
            for name in scenario.play:
                point = point_named(name)
                assert point is not None
                yield Played(scenario.name, try_point(point, trial))
                rest.wait(scenario.pause_s)
