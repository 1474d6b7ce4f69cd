"""What station and vehicle types may say of series: believable, and one clear error when not."""

from __future__ import annotations

import math
import shutil
from pathlib import Path

import pytest

from alignment.errors import ConfigurationError
from station.configuration.places import default_config
from station.configuration.settings import Configuration, read_configuration
from station.cycle.wheels.series import SeriesChoice
from station.running.composition import series_choice

SPIN = 'measure = "spin_axis"'


@pytest.fixture
def station(tmp_path: Path) -> Path:
    shutil.copytree(default_config(None, "station.toml").parent, tmp_path / "configs")
    return tmp_path / "configs" / "station.toml"


def changed(station: Path, cycle: str = "", kind: str = "") -> Configuration:
    """The example with other lines in [cycle], and others before the tables of the first vehicle type."""
    names = [line.split("=")[0].strip() for line in cycle.splitlines()]
    lines = station.read_text().splitlines()
    kept = [line for line in lines if line.split("=")[0].strip() not in names]
    kept.insert(kept.index("[cycle]") + 1, cycle)
    station.write_text("\n".join(kept))
    vehicle = sorted((station.parent / "vehicles").glob("*.toml"))[0]
    vehicle.write_text(vehicle.read_text().replace("[axles.front]", f"{kind}\n[axles.front]", 1))
    return read_configuration(station)


def test_single_exposures_are_measured_unless_somebody_says_otherwise(station: Path) -> None:
    read = changed(station)
    choice = series_choice(read.settings)
    assert choice == SeriesChoice("tyre_plane", 16, math.radians(600.0), 0.25)
    assert all(choice.plan(kind) is None for kind in read.vehicle_types.values())


def test_a_vehicle_type_takes_the_stations_numbers_and_may_have_its_own(station: Path) -> None:
    read = changed(station, 'measure = "spin_axis"\nexposures = 20', "exposures = 24\nleast_turn_deg = 300.0")
    plans = [series_choice(read.settings).plan(read.vehicle_types[number]) for number in (1, 2)]
    rules = [(plan.rules.exposures, math.degrees(plan.rules.least_turn)) for plan in plans if plan]
    assert sorted((n, round(turn)) for n, turn in rules) == [(20, 600), (24, 300)]


def test_one_vehicle_type_alone_may_be_measured_on_rollers_or_not(station: Path) -> None:
    read = changed(station, 'measure = "spin_axis"', 'measure = "tyre_plane"')
    plans = [series_choice(read.settings).plan(kind) for kind in read.vehicle_types.values()]
    assert sum(plan is None for plan in plans) == 1


@pytest.mark.parametrize(
    ("cycle", "kind", "said"),
    [
        ('measure = "axis"', "", "cycle.measure"),
        ("exposures = 11", "", "cycle.exposures"),
        ("exposures = 65", "", "cycle.exposures"),
        ("least_turn_deg = 119.0", "", "cycle.least_turn_deg"),
        ("exposures = 12\nleast_turn_deg = 1871.0", "", "at most 1870"),
        ("exposure_interval_s = -1.0", "", "cycle.exposure_interval_s"),
        (f"{SPIN}\nexposure_interval_s = 9.0\nmeasure_timeout_s = 100.0", "", "measure_timeout_s"),
        ("", "exposures = 11", "exposures"),
        ("", "least_turn_deg = 20000.0", "least_turn_deg"),
        ("least_turn_deg = 1871.0", "exposures = 12", "with the vehicle type"),
        ("exposure_interval_s = 3.0\nmeasure_timeout_s = 100.0", f"{SPIN}\nexposures = 60", "vehicle type"),
        ("", "run_out_radius_mm = 30.0", "run_out_radius_mm"),
    ],
)  # fmt: skip
def test_what_no_series_can_keep_is_one_clear_error(station: Path, cycle: str, kind: str, said: str) -> None:
    with pytest.raises(ConfigurationError) as error:
        changed(station, cycle, kind)
    assert said in str(error.value)
