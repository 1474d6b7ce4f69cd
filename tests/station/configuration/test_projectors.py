"""The light of a rig in the configuration, and rigs that are not calibrated yet."""

from __future__ import annotations

from pathlib import Path

import pytest

from alignment.errors import ConfigurationError
from station.configuration.settings import read_station

CONFIGS = Path(__file__).parents[3] / "configs"


def written(folder: Path, rig: str) -> Path:
    head = (CONFIGS / "station.toml").read_text().split("[[rigs]]")[0]
    path = folder / "station.toml"
    path.write_text(f'{head}\n[[rigs]]\nname = "front_left"\n{rig}\n')
    return path


SIMULATED = "simulated = { seed = 1 }\n"


def test_a_projector_is_named_after_its_driver(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        SIMULATED
        + '[rigs.projector]\nbrightness = 0.6\ndark = true\nserial = { port = "/dev/ttyUSB0", baud = 9600 }',
    )
    light = read_station(path).rigs[0].projector
    assert light is not None
    assert light.driver == "serial"
    assert light.options.model_dump() == {"port": "/dev/ttyUSB0", "baud": 9600, "timeout_s": 0.5}
    assert (light.light().brightness, light.light().dark) == (0.6, True)


def test_a_rig_needs_no_projector(tmp_path: Path) -> None:
    assert read_station(written(tmp_path, SIMULATED)).rigs[0].projector is None


@pytest.mark.parametrize(
    ("projector", "field", "seen"),
    [
        ("", "rigs[0].projector", "none"),
        ("none = {}\nserial = { port = 'x' }", "rigs[0].projector", "none and serial"),
        ("serial = {}", "rigs[0].projector.serial.port", ""),
        ("serial = { port = 'x', baud = 1 }", "rigs[0].projector.serial.baud", "1"),
        ("serial = { port = 'x', timeout_s = 60 }", "rigs[0].projector.serial.timeout_s", "60"),
        ("lazer = { port = 'x' }", "rigs[0].projector.lazer", "'lazer'"),
        ("none = {}\ndark = true", "rigs[0].projector.dark", "true"),
        ("none = {}\nbrightness = 0.5", "rigs[0].projector.brightness", "0.5"),
        ("serial = { port = 'x' }\nbrightness = 0", "rigs[0].projector.brightness", "0"),
        ("serial = { port = 'x' }\nbrightness = 1.5", "rigs[0].projector.brightness", "1.5"),
        ("simulated = { wear = 1 }", "rigs[0].projector.simulated.wear", "1"),
    ],
)
def test_a_mistake_in_the_light_names_its_field(
    projector: str, field: str, seen: str, tmp_path: Path
) -> None:
    path = written(tmp_path, f"{SIMULATED}[rigs.projector]\n{projector}")
    with pytest.raises(ConfigurationError) as caught:
        read_station(path)
    assert field in str(caught.value)
    assert seen in str(caught.value)


def test_a_rig_of_bare_cameras_names_its_heads_until_it_is_calibrated(tmp_path: Path) -> None:
    recorded = "recorded = { shots = 'shots' }\n"
    path = written(tmp_path, "heads = ['head_1', 'head_2']\n" + recorded)
    assert read_station(path).rigs[0].heads == ("head_1", "head_2")
    for wrong, told in (
        (recorded, "or the names of its heads until there is one"),
        ("heads = []\n" + recorded, "rigs[0].heads"),
        ("heads = ['a', 'a']\n" + recorded, "different names"),
        ("calibration = 'x.json'\nheads = ['a']\n" + recorded, "none beside the calibration"),
    ):
        with pytest.raises(ConfigurationError) as caught:
            read_station(written(tmp_path, wrong))
        assert told in str(caught.value)
