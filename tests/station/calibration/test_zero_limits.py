"""A zero measurement that would turn every later wheel by degrees is not believed.

A certified camber with the wrong sign was stored without a word, and every wheel after it was turned by 1.6°.
"""

from __future__ import annotations

import json
import math
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import sensors.formats
import station.calibration.zero
import station.commands.zero
from alignment.errors import ConfigurationError, Deed, Remedy
from alignment.units import ARCMIN
from alignment.values import MeasureSettings, WheelMeasurement
from db.store import ResultStore
from sensors.formats import write_calibration
from station.calibration.master import MasterWheel
from station.calibration.zero import measure_zero
from station.cli import main
from station.configuration.settings import StationConfig, read_configuration
from tests.end_to_end.conftest import CONFIGS
from tests.station.bench import measurement
from tests.station.calibrations import true_rig

NOON = datetime(2026, 11, 22, 12, tzinfo=UTC)
MEASURED = (math.radians(-0.8), math.radians(0.2))
RIG = replace(true_rig(), id="cal-zero")


@pytest.fixture(autouse=True)
def master(monkeypatch: pytest.MonkeyPatch) -> None:
    """A master wheel that is measured at −0.8° and 0.2°, without images."""
    found = replace(measurement(), camber=MEASURED[0], toe=MEASURED[1], angle_covariance=1e-12 * np.eye(2))
    assert isinstance(found, WheelMeasurement)
    monkeypatch.setattr(station.calibration.zero, "measure_wheel", lambda *_: found)
    shot = SimpleNamespace(images=(), time_utc=NOON)
    monkeypatch.setattr(station.calibration.zero, "read_shot", lambda *_: shot)
    monkeypatch.setattr(sensors.formats, "read_shot", lambda *_: shot)
    monkeypatch.setattr(station.commands.zero, "compiled_for_images", lambda *_: None)


def measured(camber: float, toe: float, u: float = 0.0, **more: object) -> object:
    wheel = MasterWheel(camber, toe, u, "M-17")
    return measure_zero([Path("shot")], RIG, MeasureSettings(), wheel, **more)  # type: ignore[arg-type]


@pytest.mark.parametrize("angle", [0, 1])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_the_limit_counts_for_each_angle_and_in_both_directions(angle: int, sign: float) -> None:
    for off, believed in ((9.99, True), (10.01, False)):
        certified = list(MEASURED)
        certified[angle] += sign * off * ARCMIN
        if believed:
            record = measured(*certified)
            assert record.forced_reason is None  # type: ignore[attr-defined]
            continue
        with pytest.raises(ConfigurationError, match=r"certified angles within 10′ of the measured camber"):
            measured(*certified)


def test_a_station_may_believe_more_or_less() -> None:
    near = MEASURED[0], MEASURED[1] + 5.0 * ARCMIN
    with pytest.raises(ConfigurationError, match="within 2′"):
        measured(*near, largest=2.0 * ARCMIN)
    assert measured(*near, largest=6.0 * ARCMIN)


@pytest.mark.parametrize(
    ("certified", "words"),
    [
        ((0.8, 0.2), "It would fit with the opposite sign of the camber"),
        ((-0.8, -0.2), "It would fit with the opposite sign of the toe"),
        ((0.8, -0.2), "It would fit with both signs turned round"),
        ((0.2, -0.8), "It would fit with camber and toe exchanged"),
        ((-0.01396, 0.00349), "It would fit with radians taken for degrees"),
        ((2.0, 2.0), "Check master wheel, certificate and calibration"),
    ],
)
def test_the_slip_that_explains_it_is_named(certified: tuple[float, float], words: str) -> None:
    with pytest.raises(ConfigurationError, match=words) as caught:
        measured(*map(math.radians, certified))
    assert caught.value.remedy == Remedy(Deed.FORCE)


def test_arcminutes_given_as_degrees_are_named() -> None:
    """−0.8° and 0.2° are −48′ and 12′."""
    with pytest.raises(ConfigurationError, match="arcminutes taken for degrees"):
        measure_zero(
            [Path("shot")],
            RIG,
            MeasureSettings(maximum_angle=math.radians(60.0)),
            MasterWheel(math.radians(-48.0), math.radians(12.0), name="M-17"),
        )


def test_a_certificate_less_certain_than_what_is_believed_is_a_wrong_unit() -> None:
    assert measured(*MEASURED, u=4.99 * ARCMIN)
    with pytest.raises(
        ConfigurationError, match=r"certified u95.*below .*10′, found 10\.02′.*degrees are asked"
    ):
        measured(*MEASURED, u=5.01 * ARCMIN)


def test_the_reason_is_kept_only_where_force_was_needed() -> None:
    record = measured(MEASURED[0] + 0.01, MEASURED[1], forced_reason="new hub")
    assert record.forced_reason == "new hub"  # type: ignore[attr-defined]
    assert measured(*MEASURED, forced_reason="new hub").forced_reason is None  # type: ignore[attr-defined]


def run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as ended:
        main([str(argument) for argument in arguments])
    return int(ended.value.code or 0)


def test_on_the_command_line_nothing_is_stored_until_it_is_forced_with_a_reason(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_calibration(tmp_path / "c.json", RIG, method="test", created_utc=NOON)
    database = ("--database", f"sqlite:///{tmp_path / 'results.db'}")
    assert run("db", "migrate", *database) == 0
    known = ("zero", "measure", "shot", "--calibration", tmp_path / "c.json", "--toe", 0.2, *database)
    capsys.readouterr()

    assert run(*known, "--camber", 0.8) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert "camber 0.800°, -96′ off" in said.err
    assert "opposite sign of the camber" in said.err
    for wrong in (("--force",), ("--reason", "because"), ("--force", "--reason", "  ")):
        assert run(*known, "--camber", 0.8, *wrong) == 2
        assert "a forced zero measurement says why" in capsys.readouterr().err
    with ResultStore(database[1]) as kept:
        assert kept.zeros() == ()

    assert run(*known, "--camber", 0.8, "--force", "--reason", "bent on purpose", "--json") == 0
    assert json.loads(capsys.readouterr().out)["forced_reason"] == "bent on purpose"
    assert run("zero", "list", *database) == 0
    assert "FORCED: bent on purpose" in capsys.readouterr().out
    assert run("zero", "list", *database, "--json") == 0
    (listed,) = json.loads(capsys.readouterr().out)["zero_measurements"]
    assert (listed["forced_reason"], listed["in_force"]) == ("bent on purpose", True)


def test_the_limit_is_the_configuration_s(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert read_configuration(CONFIGS / "station.toml").settings.zero.largest_arcmin == 10.0
    assert StationConfig.model_fields["zero"].default.largest_arcmin == 10.0
    config = CONFIGS / "station.toml"
    write_calibration(tmp_path / "c.json", RIG, method="test", created_utc=NOON)
    database = ("--database", f"sqlite:///{tmp_path / 'results.db'}")
    assert run("db", "migrate", *database) == 0
    known = ("zero", "measure", "shot", "--calibration", tmp_path / "c.json", "--toe", 0.3, *database)
    assert run(*known, "--camber", -0.8, "--config", config) == 0
    strict = tmp_path / "configs"
    strict.mkdir()
    for name in ("line.dbc", "vehicles"):
        (strict / name).symlink_to(CONFIGS / name)
    (strict / "station.toml").write_text(
        (CONFIGS / "station.toml").read_text().replace("largest_arcmin = 10.0", "largest_arcmin = 5.5")
    )
    capsys.readouterr()
    assert run(*known, "--camber", -0.8, "--config", strict / "station.toml") == 2
    assert "within 5.5′" in capsys.readouterr().err
