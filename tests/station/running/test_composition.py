"""What a configuration says reaches the parts that it is about."""

from __future__ import annotations

import json
import shutil
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest

from alignment.errors import ConfigurationError, FormatError
from sensors.formats import write_calibration
from sensors.rig import Rig
from station.configuration.settings import read_configuration
from station.cycle.words.cycle import SERVED_MODES, Mode
from station.running.composition import open_station
from station.store.archive import ImageArchive
from station.store.opening import limits_of, open_archive, open_store
from tests.sensors.samples import calibration as sample_calibration
from tests.station.bench import TODAY

CONFIGS = Path(__file__).resolve().parents[3] / "configs"
CHANGES = (
    ("timeout_s = 5.0", "timeout_s = 3.0"),
    ("minimum_free_mb = 500", "minimum_free_mb = 7"),
    ("acknowledge_timeout_s = 2.0", "acknowledge_timeout_s = 4.0"),
    ("shoot_timeout_s = 60.0", "shoot_timeout_s = 11.0\nadjust_timeout_s = 50.0\nlive_max_age_s = 0.7"),
    ("measure_timeout_s = 120.0", "measure_timeout_s = 13.0"),
    ("calibration_max_age_days = 365", "calibration_max_age_days = 17"),
    ("coverage_factor = 2.0", "coverage_factor = 3.0"),
)


@pytest.fixture
def config(tmp_path: Path) -> Path:
    """The shipped station with one rig, its recorded shots and its calibration, every number changed."""
    folder = tmp_path / "configs"
    shutil.copytree(CONFIGS, folder)
    path = folder / "station.toml"
    text = path.read_text()
    for old, new in CHANGES:
        assert old in text
        text = text.replace(old, new, 1)
    text = text[: text.index("[[rigs]]")]
    text += '[archive]\nfolder = "images"\nmost_gb = 3.0\nordinary_days = 5.0\nevidence_days = 40.0\n\n'
    text += '[[rigs]]\nname = "front_left"\ncalibration = "cal.json"\nrecorded = { shots = "shots" }\n'
    path.write_text(text)
    write_calibration(
        folder / "cal.json", sample_calibration(rig="front_left"), method="test", created_utc=TODAY
    )
    return path


def test_every_bound_and_factor_of_the_configuration_reaches_the_cycle(
    config: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken: dict[str, Any] = {}

    class Taken(Exception):  # noqa: N818
        pass

    def take(*args: Any, **named: Any) -> None:
        taken.update(named, args=args)
        raise Taken

    class NoRig(Rig):
        def __init__(self) -> None:
            self.name = "front_left"
            self.heads = ()

        def connect(self) -> None:
            pass

        def close(self) -> None:
            pass

    monkeypatch.setattr("sensors.drivers.recorded.recorded_rig", lambda *args: NoRig())
    monkeypatch.setattr("station.running.composition.MeasuringCycle", take)
    (config.parent / "shots" / "one").mkdir(parents=True)
    (config.parent / "shots" / "one" / "shot.json").write_text("{}")
    with pytest.raises(Taken), open_station(read_configuration(config)):
        pass
    _, (position,), kinds, _, _, bounds, coverage_factor, _ = taken["args"]
    assert (bounds.measure_s, bounds.acknowledge_s, bounds.adjust_s) == (13.0, 4.0, 50.0)
    assert bounds.store_s == 6.0, "a commit is a few statements of three seconds each"
    assert coverage_factor == 3.0
    assert set(kinds) == {1, 2}
    assert position._shoot_timeout_s == 11.0
    assert position.in_force.valid_until_utc == TODAY + timedelta(days=17)
    assert position.in_force.valid_at(TODAY)
    assert not position.in_force.valid_at(TODAY + timedelta(days=17))
    assert not position.in_force.valid_at(TODAY - timedelta(seconds=1))
    names = [thread.name for thread in taken["threads"]]
    assert "line status" in names
    assert "image archive" in names
    assert any(name.startswith("line receive") for name in names)


def test_line_offers_the_mode_calibrate_only_where_its_images_have_a_folder(config: Path) -> None:
    from station.running.composition import line_options

    options = line_options(read_configuration(config))
    assert options.live_age_s == 0.7
    assert options.modes == SERVED_MODES - {Mode.CALIBRATE}
    config.write_text(config.read_text().replace("[cycle]", '[cycle]\nimage_folder = "plates"'))
    assert line_options(read_configuration(config)).modes == SERVED_MODES


@pytest.mark.parametrize(
    ("said", "error", "words"),
    [
        ({"rig": "rear_left"}, ConfigurationError, r"rigs\[0\]\.calibration.*a calibration of rig "),
        ({"side": "right"}, FormatError, "expected 'left', as the rig's name 'front_left' says"),
    ],
)
def test_calibration_of_another_rig_or_side_is_refused(
    config: Path, said: dict[str, str], error: type[Exception], words: str
) -> None:
    data = json.loads((config.parent / "cal.json").read_text())
    (config.parent / "cal.json").write_text(json.dumps(data | said))
    with pytest.raises(error, match=words), open_station(read_configuration(config)):
        pass


def test_archive_and_store_follow_the_configuration(config: Path) -> None:
    configuration = read_configuration(config)
    with open_store(configuration) as store:
        archive = open_archive(configuration, store)
        assert isinstance(archive, ImageArchive)
        policy = archive._policy
        assert (policy.most_bytes, policy.ordinary_days, policy.evidence_days) == (3_000_000_000, 5.0, 40.0)
        assert store.background._minimum_free_bytes == 7_000_000


def test_every_angles_limits_are_stored_under_its_own_name(config: Path) -> None:
    kind = read_configuration(config).vehicle_types[1]
    found = limits_of(kind)
    for axle, tolerances in kind.axles.items():
        for name in ("camber", "toe", "total_toe", "camber_difference"):
            tolerance = getattr(tolerances, name)
            if tolerance is not None:
                assert found[axle][name] == [tolerance.limits().low, tolerance.limits().high]
            else:
                assert name not in found[axle]
