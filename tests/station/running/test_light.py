"""A projector in a station: made with its rig, and a fault of its place when it fails."""

from __future__ import annotations

from datetime import timedelta
from pathlib import Path

import pytest

from alignment.errors import ConfigurationError, ProjectorError
from alignment.values import MeasureSettings
from sensors.projectors.guarded import GuardedProjector
from sensors.projectors.lit_rig import LitRig
from sensors.simulation.simulated_rig import SimulatedRig
from station.configuration.settings import read_configuration
from station.cycle.wheels.positions import CalibrationInForce, WheelPosition
from station.cycle.words.cycle import ErrorCode, Outcome
from station.running.cameras import make_rig, open_rig
from station.running.checking import check_configuration
from station.running.light import with_light
from tests.sensors.projectors.fakes import NotedProjector
from tests.sensors.samples import StillClock
from tests.sensors.samples import calibration as sample_calibration
from tests.sensors.test_rig import make_rig as six_cameras
from tests.station.bench import TODAY, measurement, open_bench

CONFIGS = Path(__file__).parents[3] / "configs"


def station(folder: Path, rig: str) -> Path:
    text = (CONFIGS / "station.toml").read_text().split("[[rigs]]")[0]
    text = text.replace('"line.dbc"', f'"{CONFIGS}/line.dbc"').replace('"vehicles"', f'"{CONFIGS}/vehicles"')
    path = folder / "station.toml"
    path.write_text(f'{text}\n[[rigs]]\nname = "front_left"\n{rig}\n')
    return path


def test_a_simulated_projector_lights_the_simulated_wheel(tmp_path: Path) -> None:
    path = station(
        tmp_path, "simulated = { seed = 1 }\n[rigs.projector]\nbrightness = 0.5\nsimulated = { wear = 0.2 }"
    )
    configuration = read_configuration(path)
    rig = make_rig(configuration, 0, None)
    assert isinstance(rig, SimulatedRig)
    lit = with_light(configuration, 0, rig)
    assert isinstance(lit, LitRig)
    lit.connect()
    lit.arm()
    assert rig.lamp == pytest.approx(0.4)
    lit.close()
    assert rig.lamp == 0.0


def test_a_rig_without_a_projector_stays_as_it_is(tmp_path: Path) -> None:
    configuration = read_configuration(station(tmp_path, "simulated = { seed = 1 }"))
    rig = make_rig(configuration, 0, None)
    assert with_light(configuration, 0, rig) is rig


def test_a_projector_that_fails_amid_a_cycle_is_a_fault_that_names_its_place() -> None:
    rig = LitRig(six_cameras(StillClock()), NotedProjector())
    rig.connect()
    rig.arm()
    rig.shoot = lambda timeout_s: (_ for _ in ()).throw(ProjectorError("front_left", "lamp broken"))  # type: ignore[method-assign]
    calibration = sample_calibration(rig="front_left", covariance=False)
    known = CalibrationInForce(calibration, TODAY - timedelta(days=1), 30.0, {"id": "x"})
    position = WheelPosition(rig, known, lambda *_: measurement(), MeasureSettings(), 1.0, now=lambda: TODAY)
    failure = position.run().failure
    assert failure is not None
    assert failure.error_code is ErrorCode.CAMERA_FAULT
    assert failure.text == "projector of front_left: lamp broken"


def test_a_rig_that_is_not_calibrated_shows_its_cameras_and_measures_nothing(tmp_path: Path) -> None:
    path = station(tmp_path, "heads = ['head_1']\nrecorded = { shots = '.' }")
    configuration = read_configuration(path)
    with pytest.raises(ConfigurationError, match=r"rigs\[0\].calibration.*Capture a plate session"):
        open_rig(configuration, 0)
    _, findings = check_configuration(path)
    assert any("rigs[0].calibration" in str(finding) for finding in findings)


def test_while_cameras_are_commissioned_the_rest_of_their_settings_is_checked(tmp_path: Path) -> None:
    """The missing calibration was refused first: a mistake beside it showed only when the cameras opened."""
    path = station(tmp_path, "heads = ['head_1']\nrecorded = { shots = '.' }")
    _, findings = check_configuration(path, uncalibrated=True)
    [finding] = findings
    assert "expected a folder of recorded shots" in str(finding)


def test_a_projector_lost_between_two_cycles_is_a_fault_until_a_reset_and_the_other_wheels_go_on() -> None:
    with open_bench() as bench:
        bench.rigs["front_left"].arm_error = ProjectorError("front_left", "no answer", "Check its cable")
        bench.trigger(1)
        outcomes = bench.line.outcomes
        assert outcomes["front_left"] is Outcome.FAULT
        assert outcomes["rear_left"] is not Outcome.FAULT
        assert bench.line.status.error_code is ErrorCode.CAMERA_FAULT
        [cycle] = bench.store.cycles
        [text] = [wheel.reason_text for wheel in cycle.wheels if wheel.wheel == "front_left"]
        assert "projector of front_left: no answer. Check its cable" in str(text)


def test_a_foreign_projector_is_bounded_and_a_simulated_one_needs_no_thread(
    tmp_path: Path,
) -> None:
    bounds = {}
    for driver in ("serial = { port = '/dev/none' }", "simulated = {}", "none = {}"):
        path = station(tmp_path, f"simulated = {{ seed = 1 }}\n[rigs.projector]\n{driver}")
        configuration = read_configuration(path)
        lit = with_light(configuration, 0, make_rig(configuration, 0, None))
        assert isinstance(lit, LitRig)
        bounds[driver.split()[0]] = isinstance(lit.projector, GuardedProjector)
    assert bounds == {"serial": True, "simulated": False, "none": False}
