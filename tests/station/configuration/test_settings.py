from __future__ import annotations

import math
import shutil
from pathlib import Path
from typing import get_args

import pytest

from alignment.errors import ConfigurationError
from sensors.simulation.driver import SimulatedOptions
from sensors.simulation.rigs import RIG_SPECS
from sensors.simulation.tyre import MADE_SHAPES
from station.configuration.settings import read_configuration, station_model
from station.configuration.vehicle_types import VehicleType, read_vehicle_types
from station.rehearsal.simulation import SimulationConfig, read_simulation

CONFIGS = Path(__file__).parents[3] / "configs"


@pytest.fixture
def configs(tmp_path: Path) -> Path:
    folder = tmp_path / "configs"
    shutil.copytree(CONFIGS, folder)
    return folder


def change(path: Path, old: str, new: str) -> Path:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    return path


def refusal(path: Path) -> ConfigurationError:
    with pytest.raises(ConfigurationError) as caught:
        read_configuration(path)
    return caught.value


def test_shipped_configuration_is_valid() -> None:
    configuration = read_configuration(CONFIGS / "station.toml")
    assert [rig.name for rig in configuration.settings.rigs] == [
        "front_left",
        "front_right",
        "rear_left",
        "rear_right",
    ]
    assert [rig.side for rig in configuration.settings.rigs] == ["left", "right"] * 2
    assert configuration.settings.rigs[2].axle == "rear"
    assert configuration.settings.measure.settings().maximum_angle == pytest.approx(math.radians(10))
    assert configuration.settings.cameras.settings().exposure_ms == 5.0
    assert set(configuration.vehicle_types) == {1, 2}
    assert configuration.vehicle_types[2].guard_band is False
    assert read_simulation(CONFIGS / "simulation.toml") == SimulationConfig(
        pattern=read_simulation(CONFIGS / "simulation.toml").pattern
    )


def test_names_of_simulated_rigs_and_tyres_are_those_of_the_simulator() -> None:
    for model in (SimulatedOptions, SimulationConfig):
        assert set(get_args(model.model_fields["rig"].annotation)) == set(RIG_SPECS)
    assert set(get_args(SimulationConfig.model_fields["tyre"].annotation)) == set(MADE_SHAPES)


@pytest.mark.parametrize(
    ("old", "new", "field"),
    [
        ('plant = "Example plant"', 'plantt = "Example plant"', "station.plant"),
        ("timeout_s = 5.0", "timeout_s = 0.0", "database.timeout_s"),
        ("bitrate = 500_000", "bitrate = 5", "line.bitrate"),
        ("bitrate = 500_000", 'bitrate = "fast"', "line.bitrate"),
        ("minimum_points = 300", "minimum_points = 3", "measure.minimum_points"),
        ("[-60.0, 60.0]", "[60.0, -60.0]", "measure.depth_range_mm"),
        ("exposure_ms = 5.0", "exposure_ms = nan", "cameras.exposure_ms"),
        ('name = "front_left"', 'name = "front"', "rigs[0].name"),
        ('name = "front_left"', 'name = "front_right"', "rigs"),
        ("simulated = { seed = 1,", "simulated = { seed = -1,", "rigs[0].simulated.seed"),
        ("simulated = { seed = 1,", "simulatd = { seed = 1,", "rigs[0]"),
        ("simulated = { seed = 1,", 'recorded = { shots = "x",', "rigs[0]"),
        ('dbc = "line.dbc"', 'dbc = "other.dbc"', "line.dbc"),
        ('vehicle_types = "vehicles"', 'vehicle_types = "cars"', "vehicle_types"),
    ],
)
def test_wrong_station_field_is_named_with_its_file(configs: Path, old: str, new: str, field: str) -> None:
    error = refusal(change(configs / "station.toml", old, new))
    assert error.file == str(configs / "station.toml")
    assert field in str(error)


def test_recorded_rig_needs_its_calibration_and_one_driver(configs: Path) -> None:
    path = configs / "station.toml"
    line = "simulated = { seed = 1, camber_deg = -0.5, toe_deg = 0.1 }"
    change(path, line, 'recorded = { shots = "shots" }')
    assert "calibration" in str(refusal(path))
    change(path, 'recorded = { shots = "shots" }', f'recorded = {{ shots = "shots" }}\n{line}')
    assert "recorded and simulated" in str(refusal(path))


def test_syntax_error_and_missing_file_are_named(configs: Path) -> None:
    error = refusal(change(configs / "station.toml", "[station]", "[station"))
    assert "line" in str(error)
    assert "no such file" in str(refusal(configs / "none.toml"))
    assert str(configs) in str(refusal(configs))


@pytest.mark.parametrize(
    ("old", "new", "field"),
    [
        ("number = 1", "number = 70000", "number"),
        ("number = 1", "number = 2", "number"),
        ('name = "Compact"', 'name = "Van"', "name"),
        ("tolerance_deg = 0.5", "tolerance_deg = -0.5", "axles.front.camber.tolerance_deg"),
        ("tolerance_deg = 0.5", "tolerances_deg = 0.5", "axles.front.camber"),
        ("nominal_deg = -0.5, ", "", "axles.front.camber"),
        ("nominal_deg = -0.5,", "nominal_deg = -0.5, lower_deg = 0.0,", "axles.front.camber"),
        (
            "lower_deg = -0.5, upper_deg = 0.5",
            "lower_deg = 0.5, upper_deg = 0.5",
            "camber_difference.upper_deg",
        ),
        ("toe = { nominal_deg = 0.1, tolerance_deg = 0.1 }", "", "axles.front.toe"),
    ],
)
def test_wrong_vehicle_type_is_named_with_its_file(configs: Path, old: str, new: str, field: str) -> None:
    path = configs / "vehicles" / "compact.toml"
    change(path, old, new)
    error = refusal(configs / "station.toml")
    assert error.file is not None
    assert Path(error.file).parent == configs / "vehicles"
    assert field in str(error)


def test_folder_without_vehicle_types_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="one TOML file per vehicle type"):
        read_vehicle_types(tmp_path)


def test_limits_are_nominal_plus_minus_tolerance_or_lower_and_upper() -> None:
    kind = read_vehicle_types(CONFIGS / "vehicles")[1]
    camber = kind.axles["front"].camber.limits()
    assert (camber.low, camber.high) == pytest.approx((math.radians(-1.0), 0.0))
    assert kind.thrust_angle is not None
    assert kind.thrust_angle.limits().high == pytest.approx(math.radians(0.15))


def test_hash_follows_what_decides_results_and_nothing_else(configs: Path) -> None:
    path = configs / "station.toml"
    first = read_configuration(path).hash
    change(path, "sqlite:///../truewheel.db", "postgresql://user:secret@host/db")
    assert read_configuration(path).hash == first
    change(configs / "vehicles" / "van.toml", "0.75", "0.76")
    second = read_configuration(path).hash
    assert second != first
    change(configs / "line.dbc", 'VERSION "2"', 'VERSION "3"')
    third = read_configuration(path).hash
    assert third != second
    change(path, "minimum_points = 300", "minimum_points = 301")
    assert read_configuration(path).hash != third


def test_relative_database_file_is_beside_the_configuration(configs: Path) -> None:
    path = configs / "station.toml"
    assert read_configuration(path).database_url == f"sqlite:///{configs}/../truewheel.db"
    change(path, "sqlite:///../truewheel.db", "sqlite:////var/x.sqlite?a=b")
    assert read_configuration(path).database_url == "sqlite:////var/x.sqlite?a=b"
    change(path, "sqlite:////var/x.sqlite?a=b", "sqlite:///:memory:")
    assert read_configuration(path).database_url == "sqlite:///:memory:"
    change(path, "sqlite:///:memory:", "postgresql://host/x")
    assert read_configuration(path).database_url == "postgresql://host/x"


def test_every_field_of_every_file_has_a_sentence() -> None:
    def described(schema: dict[str, object]) -> list[str]:
        tables = [schema, *schema.get("$defs", {}).values()]  # type: ignore[attr-defined]
        return [
            name
            for table in tables
            for name, field in table.get("properties", {}).items()
            if not field.get("description")
        ]

    for model in (station_model({"simulated", "recorded"}), VehicleType, SimulationConfig):
        assert described(model.model_json_schema()) == []
