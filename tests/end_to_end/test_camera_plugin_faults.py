"""Packages with camera drivers that are not what they should be: one clear error each, status 2."""

from __future__ import annotations

import itertools
import os
import re
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from tests.end_to_end.conftest import CONFIGS, Ended, Truewheel, change
from tests.plugins import install

_numbers = itertools.count()
SIMULATED = "simulated = { seed = 1, camber_deg = -0.5, toe_deg = 0.1 }"
OWN = ["genicam", "pylon", "recorded", "simulated"]
"""Drivers of this program."""
SOUND = """
from pydantic import Field, field_validator
from sensors.drivers import CameraDriver, RigDriver, StrictModel

class Settings(StrictModel):
    port: int = Field(ge=1, le=9, description="Port of the camera")
    pair: tuple[int, int] = Field(default=(1, 2), description="Two numbers")

def make(settings, place):
    raise AssertionError("never called by a check")

DRIVER = CameraDriver(Settings, make)
"""


class Plugins:
    """Installs packages for one test; each has a module of its own name, so that nothing is left over."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self._folder = folder
        self._monkeypatch = monkeypatch

    def __call__(self, text: str, name: str = "acme", target: str = "{}:DRIVER", package: str = "") -> str:
        module = f"acme_driver_{next(_numbers)}"
        package = package or f"{module.replace('_', '-')}"
        folder = self._folder / package
        install(folder, package, {name: target.format(module)}, {module: text})
        self._monkeypatch.syspath_prepend(str(folder))
        return f"{target.format(module)} of {package} 1.0"


@pytest.fixture
def plugins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Plugins:
    return Plugins(tmp_path / "packages", monkeypatch)


@pytest.fixture
def acme(replay: Path) -> Path:
    """A station whose one rig is driven by the driver acme."""
    change(replay, 'recorded = { shots = "shots", at_end = "repeat" }', "acme = { port = 3 }")
    return replay


def refused(ended: Ended) -> str:
    assert ended.status == 2, ended
    assert ended.err.startswith("truewheel: ")
    assert len(ended.err.strip().splitlines()) == 1, ended.err
    return ended.err


def checked(truewheel: Truewheel, config: Path) -> str:
    return refused(truewheel("config", "check", config))


def test_unknown_driver_is_told_once_with_those_that_are_installed_and_the_cure(
    truewheel: Truewheel, configs: Path
) -> None:
    path = configs / "station.toml"
    path.write_text(path.read_text().replace("simulated = {", "vimba = {"))
    said = checked(truewheel, path)
    assert (
        "field 'rigs[0].vimba': expected an installed camera driver (genicam, pylon, recorded, simulated)"
        in said
    )
    assert "`truewheel camera list`" in said
    assert said.count("vimba") == 2
    path.write_text(path.read_text().replace("vimba = {", "simulatd = {"))
    assert "Did you mean 'simulated'?" in checked(truewheel, path)


def test_unknown_driver_is_told_together_with_the_other_mistakes_of_the_file(
    truewheel: Truewheel, configs: Path
) -> None:
    path = change(configs / "station.toml", SIMULATED, "vimba = { serial = 1 }")
    change(path, 'name = "front_right"', 'name = "front"')
    said = checked(truewheel, path)
    assert "rigs[0].vimba" in said
    assert "rigs[1].name" in said


@pytest.mark.parametrize("key", ['"a b"', "_x", "copy", "model_config", "driver", "cameras", '""', '"ä"'])
def test_driver_of_a_strange_name_is_unknown_like_any_other(
    truewheel: Truewheel, configs: Path, key: str
) -> None:
    path = change(configs / "station.toml", SIMULATED, f"{key} = {{ seed = 1 }}")
    assert "expected an installed camera driver" in checked(truewheel, path)


def test_misspelt_field_beside_the_driver_is_no_driver(truewheel: Truewheel, configs: Path) -> None:
    path = change(configs / "station.toml", SIMULATED, f'{SIMULATED}\ncalibraton = "x.json"')
    assert "Did you mean 'calibration'?" in checked(truewheel, path)
    change(path, 'calibraton = "x.json"', "")
    change(path, SIMULATED, "simulated = 5")
    assert "rigs[0].simulated': expected a table of fields" in checked(truewheel, path)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("import no_such_vendor_sdk", "ModuleNotFoundError: No module named 'no_such_vendor_sdk'"),
        ("raise RuntimeError('licence expired')", "RuntimeError: licence expired"),
        ("raise SystemExit(0)", "SystemExit: 0"),
        ("raise KeyError('HOME')", "KeyError: 'HOME'"),
        ("raise OSError(2, 'No such file', 'libvendor.so')", "libvendor.so"),
        ("def", "SyntaxError"),
        ("raise ValueError('three\\nlines\\n' + 9999 * 'x')", "ValueError: three lines xxx"),
        ("x = 1", "has no attribute 'DRIVER'"),
        ("DRIVER = 5", "an object of type 'int' instead of a CameraDriver"),
        (SOUND + "\nDRIVER = CameraDriver", "an object of type 'type' instead of"),
        (
            SOUND + "\nDRIVER = CameraDriver(dict, make)",
            "that descends from sensors.formats",
        ),
        (SOUND + "\nDRIVER = CameraDriver(Settings, None)", "expected a function, found None"),
        (SOUND + "\nDRIVER = RigDriver(Settings, make, check=7)", "expected a function, found 7"),
        (
            SOUND
            + "\nclass Loose(StrictModel, extra='allow'):\n    pass\nDRIVER = CameraDriver(Loose, make)",
            "Loose with extra='allow'",
        ),
    ],
)
def test_plugin_that_does_not_load_is_one_clear_error(
    truewheel: Truewheel, acme: Path, plugins: Plugins, text: str, words: str
) -> None:
    """Only ImportError was thought of at first; a package may raise anything, or hold anything."""
    declared = plugins(text)
    for command in (("config", "check", acme), ("run", "--config", acme)):
        said = refused(truewheel(*command))
        assert f"{acme}, field 'rigs[0].acme': expected a camera driver 'acme'" in said
        assert declared in said
        assert words in said
    said = refused(truewheel("schema", "station"))
    assert declared in said


@pytest.mark.parametrize("target", ["no_such_module:DRIVER", "{}", "not a target", "{}:DRIVER.deeper", ":x"])
def test_entry_point_that_leads_nowhere_is_one_clear_error(
    truewheel: Truewheel, acme: Path, plugins: Plugins, target: str
) -> None:
    declared = plugins(SOUND, target=target)
    assert declared in checked(truewheel, acme)


def test_two_packages_with_a_driver_of_one_name_are_both_named(
    truewheel: Truewheel, acme: Path, plugins: Plugins
) -> None:
    first, second = plugins(SOUND), plugins(SOUND)
    said = checked(truewheel, acme)
    assert first in said
    assert second in said
    assert "Uninstall all of them but one" in said
    assert truewheel("config", "check", CONFIGS / "station.toml").status == 0, "it names neither"
    ended = truewheel("camera", "list")
    assert ended.status == 2
    assert "expected one package that brings the camera driver 'acme'" in ended.err
    assert ended.out.count("acme ") == 2
    ended = truewheel("camera", "list", "--json")
    assert ended.status == 2
    assert len(ended.json["findings"]) == 1
    assert [one["name"] for one in ended.json["drivers"]] == ["acme", "acme", *OWN]


def test_driver_that_takes_the_name_of_the_simulator_does_not_get_its_place(
    truewheel: Truewheel, plugins: Plugins
) -> None:
    declared = plugins(SOUND, name="simulated")
    assert declared in checked(truewheel, CONFIGS / "station.toml")


@pytest.mark.parametrize("name", ["calibration", "name", "Acme", "my camera"])
def test_driver_of_a_name_that_no_rig_can_hold_is_listed_as_a_finding(
    truewheel: Truewheel, configs: Path, plugins: Plugins, name: str
) -> None:
    declared = plugins(SOUND, name=name)
    ended = truewheel("camera", "list")
    assert ended.status == 2
    assert f"'{name}' ({declared})" in ended.err
    if name not in ("calibration", "name"):
        path = change(configs / "station.toml", SIMULATED, f"'{name}' = {{ port = 3 }}")
        assert f"'{name}' ({declared})" in checked(truewheel, path)


def test_settings_of_a_foreign_driver_are_checked_like_all_others(
    truewheel: Truewheel, acme: Path, plugins: Plugins
) -> None:
    plugins(SOUND)
    assert truewheel("config", "check", acme).status == 0
    for table, words in (
        ("{ port = 30 }", "field 'rigs[0].acme.port': expected a number of at most 9"),
        ('{ port = "3" }', "field 'rigs[0].acme.port'"),
        (
            "{ prot = 3, port = 3 }",
            "field 'rigs[0].acme.prot': expected no such field, found 3. Did",
        ),
        ("{ port = 3, pair = [1, 2, 3] }", "field 'rigs[0].acme.pair"),
        ("{}", "field 'rigs[0].acme.port': expected a value"),
    ):
        text = acme.read_text()
        change(acme, "{ port = 3 }", table)
        assert words in checked(truewheel, acme)
        acme.write_text(text)
    change(acme, "{ port = 3 }", "{ port = 3, pair = [4, 5] }")
    assert truewheel("config", "check", acme).status == 0
    change(acme, 'calibration = "shots/001/calibration.json"', "")
    assert "rigs[0].calibration" in checked(truewheel, acme)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            SOUND
            + "\ndef check(settings, rig):\n    return {}['x']\nDRIVER = CameraDriver(Settings, make, check)",
            "rigs[0].acme': expected cameras from the driver 'acme'",
        ),
        (
            f"{SOUND}\nclass Odd(Settings):\n    @field_validator('port')\n    @classmethod\n"
            "    def odd(cls, value):\n        return {}[value]\nDRIVER = CameraDriver(Odd, make)",
            "rigs[0].acme': expected settings that the driver 'acme' can check, found KeyError: 3",
        ),
    ],
)
def test_check_of_a_driver_that_fails_is_one_clear_error(
    truewheel: Truewheel, acme: Path, plugins: Plugins, text: str, words: str
) -> None:
    plugins(text)
    assert words in checked(truewheel, acme)


def test_settings_that_cannot_be_written_or_described_are_one_clear_error(
    truewheel: Truewheel, acme: Path, plugins: Plugins
) -> None:
    plugins(
        f"{SOUND}\nfrom typing import Annotated\nfrom pydantic import BeforeValidator\n"
        "class Odd(StrictModel, arbitrary_types_allowed=True):\n"
        "    port: Annotated[object, BeforeValidator(lambda value: object())] = Field(description='Port')\n"
        "DRIVER = CameraDriver(Odd, make)"
    )
    assert "expected settings of camera drivers that can be written as JSON" in checked(truewheel, acme)
    plugins(
        f"{SOUND}\nclass Vendor: pass\n"
        "class Odd(StrictModel, arbitrary_types_allowed=True):\n    port: Vendor\n"
        "DRIVER = CameraDriver(Odd, make)",
        name="vendor",
    )
    said = refused(truewheel("schema", "station"))
    assert "settings of the driver 'vendor' that have a JSON schema" in said


@pytest.mark.parametrize(
    ("made", "words"),
    [
        ("raise OSError('no licence')", "OSError: no licence"),
        (
            "return None",
            "expected a camera for front_left/head_1/left, with the methods of",
        ),
        ("return QueuedCamera", "expected a camera of the name front_left/head_1/left"),
        ("return Camera('left')", "type 'Camera' of the name 'left'"),
        ("raise ConfigurationError(field='port', expected='a free port', seen='3')", "rigs[0].acme.port"),
    ],
)
def test_driver_that_makes_no_camera_keeps_the_station_from_starting(
    truewheel: Truewheel, acme: Path, plugins: Plugins, made: str, words: str
) -> None:
    plugins(
        f"{SOUND}\n"
        "from alignment.errors import ConfigurationError\nfrom sensors.drivers import QueuedCamera\n"
        "class Camera(QueuedCamera):\n    def _open(self): pass\n    def _expose(self, *_): pass\n"
        f"def make(settings, place):\n    {made}\nDRIVER = CameraDriver(Settings, make)"
    )
    said = refused(truewheel("run", "--config", acme))
    assert words in said
    assert "rigs[0].acme" in said


def test_rig_driver_that_makes_no_rig_keeps_the_station_from_starting(
    truewheel: Truewheel, acme: Path, plugins: Plugins
) -> None:
    plugins(f"{SOUND}\nDRIVER = RigDriver(Settings, lambda settings, rig: 'rig')")
    assert "expected a Rig for front_left from its driver, found an object of type 'str'" in refused(
        truewheel("run", "--config", acme)
    )


def test_driver_that_is_not_configured_is_never_imported(truewheel: Truewheel, plugins: Plugins) -> None:
    plugins("raise SystemExit('imported all the same')")
    assert truewheel("config", "check", CONFIGS / "station.toml").status == 0
    assert "acme" in truewheel("camera", "list").out


def test_a_driver_that_sees_cameras_shows_them(truewheel: Truewheel, plugins: Plugins) -> None:
    found = "lambda: [SeenCamera('4711', 'A-1', '10.0.0.7', 'left eye')]"
    plugins(
        f"{SOUND}\nfrom sensors.drivers import SeenCamera\n"
        f"DRIVER = CameraDriver(Settings, make, discover={found})"
    )
    seen = {"driver": "acme", "serial_number": "4711", "model": "A-1", "address": "10.0.0.7"}
    assert seen | {"user_name": "left eye"} in truewheel("camera", "list", "--json").json["cameras"]
    assert re.search(r"acme +4711 +A-1 +left eye +10\.0\.0\.7\n", truewheel("camera", "list").out)
    assert truewheel("camera", "list", "--drivers", "--json").json["cameras"] == []


@pytest.mark.parametrize(
    ("found", "words"),
    [
        ("lambda: 1 / 0", "ZeroDivisionError"),
        ("lambda: ['4711']", "not all that it found are a SeenCamera"),
        ("lambda: exit(5)", "SystemExit: 5"),
        ("lambda: print('ACME 3.1') or []", None),
    ],
)
def test_a_driver_that_fails_to_look_is_told_and_the_others_look(
    truewheel: Truewheel, plugins: Plugins, found: str, words: str | None
) -> None:
    plugins(f"{SOUND}\nDRIVER = CameraDriver(Settings, make, discover={found})")
    ended = truewheel("camera", "list", "--json")
    assert ended.status == 0
    assert [one["name"] for one in ended.json["drivers"]] == ["acme", *OWN]
    [*notes] = [note for note in ended.json["notes"] if note.startswith("acme: ")]
    assert len(notes) == (words is not None)
    assert words is None or words in notes[0]


def test_a_driver_that_hangs_while_it_looks_is_left(
    truewheel: Truewheel, plugins: Plugins, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("station.commands.camera._SEARCH_S", 0.2)
    # The makers' libraries take longer than that to load.
    monkeypatch.setattr("sensors.drivers.genicam.producer.DRIVER", None)
    monkeypatch.setattr("sensors.drivers.pylon.driver.DRIVER", None)
    plugins(
        f"import threading\n{SOUND}\nEND = threading.Event()\n"
        "DRIVER = CameraDriver(Settings, make, discover=lambda: END.wait(60) or [])"
    )
    ended = truewheel("camera", "list", "--json")
    assert "acme: cameras were not found within 0.2 s" in ended.json["notes"]
    for name, module in list(sys.modules.items()):
        if name.startswith("acme"):
            getattr(module, "END", threading.Event()).set()


def test_station_without_simulated_rigs_loads_no_simulator(replay: Path) -> None:
    program = (
        "import sys; from pathlib import Path; from station.running.checking import check_configuration\n"
        f"print(check_configuration(Path({str(replay)!r}))[1])\n"
        "print([name for name in sys.modules if name.startswith('sensors.simulation')])"
    )
    ended = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=120
    )
    assert ended.stdout.splitlines() == ["[]", "[]"]


def test_what_a_plugin_prints_does_not_spoil_the_one_object_on_standard_output(
    truewheel: Truewheel, acme: Path, plugins: Plugins
) -> None:
    plugins(f"print('ACME camera SDK 3.1')\n{SOUND}")
    ended = truewheel("config", "check", acme, "--json")
    assert ended.json["findings"] == []


def test_version_of_a_foreign_driver_is_part_of_the_hash(
    truewheel: Truewheel, acme: Path, plugins: Plugins, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hashes = []
    for version in ("1.0", "1.1"):
        folder = tmp_path / version
        module = f"acme_versions_{version.replace('.', '_')}"
        install(folder, "acme", {"acme": f"{module}:DRIVER"}, {module: SOUND}, version)
        with monkeypatch.context() as patch:
            patch.syspath_prepend(str(folder))
            hashes.append(truewheel("config", "check", acme, "--json").json["hash"])
    assert len(set(hashes)) == 2


@pytest.mark.parametrize("text", [b"[truewheel.cameras]\nbroken\n", b"[truewheel.cameras]\n\xff = x:y\n"])
def test_package_whose_entry_points_cannot_be_read_is_named(tmp_path: Path, text: bytes) -> None:
    """Pydantic and others look for plug-ins as they are imported: a traceback that named nothing."""
    install(tmp_path, "acme-camera", {}, {})
    file = tmp_path / "acme_camera-1.0.dist-info" / "entry_points.txt"
    file.write_bytes(text)
    ended = subprocess.run(
        [sys.executable, "-m", "station.cli", "camera", "list"],
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    said = refused(Ended(ended.returncode, ended.stdout, ended.stderr))
    assert str(file) in said
    assert "Install that package anew, or remove it" in said
