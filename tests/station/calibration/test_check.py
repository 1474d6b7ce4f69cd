"""`truewheel calibration check`, and what the database keeps of an accepted calibration."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from alignment.calibration.check import CameraChange, PlateCheck, check_with_plate
from alignment.calibration.observations import CalibrationInput, cameras_of_rig
from alignment.errors import ConfigurationError
from alignment.geometry.cameras import PosedCamera
from alignment.units import ARCMIN
from alignment.values import (
    HeadCalibration,
    HeadQuality,
    Refusal,
    RefusalCode,
    RigCalibration,
    WheelMeasurement,
)
from db.records import CheckKind, CheckOutcome
from db.store import ResultStore
from sensors.formats import CalibrationFile, read_calibration_file, write_calibration
from sensors.formats.plate_session import write_plate_session
from station.calibration.check import CheckLimits, accept_calibration, judge_master, judge_plate
from station.calibration.master import MasterWheel
from station.cli import main
from station.studies.simulated_views import STAGES, observe, square_plate
from tests.station.calibrations import plate_session, true_rig

NOON = datetime(2026, 11, 22, 12, tzinfo=UTC)


def run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as ended:
        main([str(argument) for argument in arguments])
    return int(ended.value.code or 0)


def knocked(calibration: RigCalibration) -> RigCalibration:
    """What a calibration would be if the first head's right camera was turned a little."""
    first, *rest = calibration.heads
    pose = first.right.rig_from_camera.perturbed(np.array([0.0, 5e-4, 0.0]), np.zeros(3))
    right = PosedCamera(first.right.model, pose)
    return replace(
        calibration, id="cal-knocked", heads=(HeadCalibration(first.name, first.left, right), *rest)
    )


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One view of the plate by `true_rig`."""
    whole = plate_session()
    images = replace(whole, time_utc=NOON, views=tuple(v for v in whole.views if v.name == "middle"))
    folder = tmp_path_factory.mktemp("check") / "session"
    write_plate_session(folder, images)
    return folder


def written(path: Path, calibration: RigCalibration) -> CalibrationFile:
    write_calibration(path, calibration, method="test", created_utc=NOON)
    return read_calibration_file(path)


def test_a_true_calibration_is_within_tolerance_and_the_check_is_kept(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = written(tmp_path / "true.json", true_rig())
    url = f"sqlite:///{tmp_path / 'results.db'}"
    with ResultStore(url, create=True):
        pass
    assert run("calibration", "check", session, "--calibration", tmp_path / "true.json", "--json",
               "--database", url) == 0  # fmt: skip
    said = json.loads(capsys.readouterr().out)
    assert said["outcome"] == "within"
    assert said["kind"] == "plate_session"
    assert said["stored"] is True
    assert [f"{each['head']} {each['camera']}" for each in said["figures"]["cameras"]][:2] == [
        "head_1 left",
        "head_1 right",
    ]
    with ResultStore(url) as store:
        (check,) = store.calibration_checks(file.id)
        assert store.calibration(file.id) is not None
    assert check.utc == NOON
    assert check.as_found == said["figures"]
    assert check.as_left is None


def test_a_blurred_and_a_dark_camera_are_told_by_the_check(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Both were taken without a word."""
    whole = plate_session()
    (view,) = (v for v in whole.views if v.name == "middle")
    images = dict(view.images)
    images["head_1", "left"] = cv2.GaussianBlur(images["head_1", "left"], (0, 0), 3.0)
    dark = images["head_2", "right"]
    images["head_2", "right"] = np.rint(dark / 20.0).astype(dark.dtype)
    folder = tmp_path / "session"
    write_plate_session(folder, replace(whole, time_utc=NOON, views=(replace(view, images=images),)))
    written(tmp_path / "true.json", true_rig())
    run("calibration", "check", folder, "--calibration", tmp_path / "true.json")
    said = " ".join(capsys.readouterr().out.split())
    assert "warning: head_1 left: the marks' edges are blurred over 3." in said
    assert "warning: head_2 right: the marks stand out by only" in said
    assert said.count("warning:") == 2


def test_a_knocked_camera_is_out_of_tolerance_and_named(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    written(tmp_path / "knocked.json", knocked(true_rig()))
    assert run("calibration", "check", session, "--calibration", tmp_path / "knocked.json") == 1
    said = capsys.readouterr().out
    assert "OUT OF tolerance" in said
    assert "head_1 right" in said


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("--camber", "1", "--toe", "0"), "no certified angles with a plate session"),
        (("--camber", "1"), "both certified angles"),
    ],
)
def test_certified_angles_belong_to_a_master_wheel(
    session: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    arguments: tuple[str, ...],
    expected: str,
) -> None:
    written(tmp_path / "true.json", true_rig())
    assert run("calibration", "check", session, "--calibration", tmp_path / "true.json", *arguments) == 2
    assert expected in capsys.readouterr().err


def test_the_session_of_another_rig_is_bad_input(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    written(tmp_path / "other.json", replace(true_rig(), rig="rear_left"))
    assert run("calibration", "check", session, "--calibration", tmp_path / "other.json") == 2
    assert "expected 'rear_left', as in the calibration, found 'front_left'" in capsys.readouterr().err


def measured(camber: float, toe: float) -> WheelMeasurement:
    return WheelMeasurement(
        camber=camber,
        toe=toe,
        angle_covariance=np.diag([1.0, 1.0]) * (0.02 * ARCMIN) ** 2,
        normal=np.array([0.0, 0.0, 1.0]),
        centre=np.zeros(3),
        offset_mm=0.0,
        points_used=1000,
        residual_rms_mm=0.02,
        heads=(HeadQuality("head_1", 1000, 1000, 0.02),),
        method="tyre_plane/revolution",
    )


def judged_master(camber_off: float, toe_off: float, u: tuple[float, float] = (0.02, 0.02)) -> CheckOutcome:
    """Verdict on a master wheel measured so many arcminutes beside its certificate."""
    found = replace(
        measured(0.01 + camber_off * ARCMIN, -0.002 + toe_off * ARCMIN),
        angle_covariance=np.diag(np.square(u)) * ARCMIN**2,
    )
    return judge_master(found, MasterWheel(0.01, -0.002), CheckLimits())[0]


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("which", [0, 1])
def test_a_master_wheel_is_judged_by_each_of_its_angles(which: int, sign: float) -> None:
    """It was judged by toe alone where no test held camber beside its certificate."""
    # √(0.2² + (2 · 0.02)²)′ = 0.20396′ are allowed.
    for size, expected in ((0.2035, CheckOutcome.WITHIN), (0.2045, CheckOutcome.OUT)):
        off = [0.0, 0.0]
        off[which] = sign * size
        assert judged_master(*off) is expected
    # Its own uncertainty counts, twice and not the other angle's.
    u = [0.001, 0.001]
    u[which] = 0.2
    off = [0.0, 0.0]
    off[which] = sign * 0.44
    assert judged_master(*off, (u[0], u[1])) is CheckOutcome.WITHIN
    off[which] = sign * 0.45
    assert judged_master(*off, (u[0], u[1])) is CheckOutcome.OUT
    off = [0.0, 0.0]
    off[1 - which] = sign * 0.21
    assert judged_master(*off, (u[0], u[1])) is CheckOutcome.OUT


def judged_plate(
    camber: float = 0.0, toe: float = 0.0, seen: float = 0.05, left: float = 0.05
) -> tuple[CheckOutcome, str]:
    """Verdict where one camera stands out, angles in arcminutes, residuals before and after in pixels."""

    def change(side: str, rms_px: float, rms_left_px: float) -> CameraChange:
        none = (0.0, 0.0, 0.0)
        return CameraChange(("head_1", side), 100, rms_px, (0.0, 0.0), none, none, rms_left_px)

    cameras = (change("left", 0.05, 0.05), change("right", seen, left))
    return judge_plate(PlateCheck(cameras, seen, left, camber * ARCMIN, toe * ARCMIN), CheckLimits())


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("which", ["camber", "toe"])
def test_a_plate_is_judged_by_each_angle_to_a_fifth_of_an_arcminute(which: str, sign: float) -> None:
    """It was judged without toe where no test changed toe alone."""
    assert judged_plate(**{which: sign * 0.199})[0] is CheckOutcome.WITHIN
    outcome, reason = judged_plate(**{which: sign * 0.201})
    assert outcome is CheckOutcome.OUT
    assert f"{which} by {sign * 0.201:+.3f}′" in reason
    assert "allowed is ±0.200′" in reason


def test_a_lens_is_judged_by_what_is_left_once_its_camera_is_put_right() -> None:
    """A camera that moved without harm to the angles has large residuals and a good lens."""
    assert judged_plate(seen=5.0, left=0.199)[0] is CheckOutcome.WITHIN
    outcome, reason = judged_plate(seen=5.0, left=0.201)
    assert outcome is CheckOutcome.OUT
    assert "the marks of head_1 right do not fit, wherever it stands (0.201 px RMS, allowed 0.200)" in reason
    # What moved is named by what was seen, not by what is left.
    outcome, reason = judged_plate(toe=0.3, seen=2.0, left=0.01)
    assert "head_1 right (2.000 px RMS)" in reason


def test_a_plate_of_another_pitch_puts_the_check_out_and_names_the_pitch() -> None:
    true, plate = true_rig(), square_plate()
    data = observe(cameras_of_rig(true), plate, STAGES[:3], np.random.default_rng(6)).data
    wrong = replace(data, plate=replace(plate, points=1.02 * plate.points))
    outcome, reason = judge_plate(check_with_plate(wrong, true), CheckLimits())
    assert outcome is CheckOutcome.OUT
    assert "+2.00 %: a pitch of 15 mm would fit where 15.3 mm is stated" in reason
    assert judge_plate(check_with_plate(data, true), CheckLimits())[0] is CheckOutcome.WITHIN


@pytest.mark.parametrize("cause", ["lens", "turn"])
def test_a_changed_lens_and_a_turned_camera_are_told_apart(cause: str) -> None:
    true = true_rig()
    first, *rest = true.heads
    if cause == "lens":
        model = first.right.model
        changed = replace(first.right, model=replace(model, fx=1.004 * model.fx))
    else:
        turn = np.array([2e-3, 0.0, 0.0])
        changed = replace(
            first.right, rig_from_camera=first.right.rig_from_camera.perturbed(turn, np.zeros(3))
        )
    seen = replace(true, heads=(replace(first, right=changed), *rest))
    data = observe(cameras_of_rig(seen), square_plate(), STAGES[:3], np.random.default_rng(6)).data
    found = check_with_plate(data, true)
    outcome, reason = judge_plate(found, CheckLimits())
    assert outcome is CheckOutcome.OUT
    assert "head_1 right" in reason
    assert ("its lens was changed" in reason) == (cause == "lens")


@pytest.mark.parametrize(("off", "outcome"), [(0.15, CheckOutcome.WITHIN), (0.25, CheckOutcome.OUT)])
def test_a_master_wheel_is_judged_against_both_uncertainties(off: float, outcome: CheckOutcome) -> None:
    master = MasterWheel(0.01, -0.002)
    found, reason, figures = judge_master(
        measured(0.01 + 0.01 * ARCMIN, -0.002 - off * ARCMIN), master, CheckLimits()
    )
    assert found is outcome
    assert f"toe -{off:.3f}′" in reason
    assert figures["toe_deviation_arcmin"] == pytest.approx(-off)
    assert figures["toe_allowed_arcmin"] == pytest.approx(math.hypot(0.2, 0.04))


def test_a_refused_master_wheel_is_out_of_tolerance() -> None:
    refusal = Refusal(RefusalCode.HEAD_DARK, "head_1 left is dark")
    found, reason, figures = judge_master(refusal, MasterWheel(0.0, 0.0), CheckLimits())
    assert found is CheckOutcome.OUT
    assert "head_1 left is dark" in reason
    assert figures == {"code": "head_dark"}


def simulated_views() -> CalibrationInput:
    return observe(cameras_of_rig(true_rig()), square_plate(), STAGES[:2], np.random.default_rng(5)).data


def test_an_accepted_calibration_is_kept_with_what_was_found_and_what_was_left(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'results.db'}"
    with ResultStore(url, create=True):
        pass
    data = simulated_views()

    def accept(name: str, calibration: RigCalibration) -> Any:
        file = written(tmp_path / name, calibration)
        return accept_calibration(url, file, file.model_dump(mode="json", by_alias=True), data, NOON)

    first = accept("first.json", knocked(true_rig()))
    assert first.as_found is None
    assert first.predecessor_id is None
    second = accept("second.json", replace(true_rig(), id="cal-2"))
    assert second.predecessor_id == "cal-knocked"
    assert second.outcome is CheckOutcome.OUT
    assert second.as_found["residual_rms_px"] > 2 * second.as_left["residual_rms_px"]
    with ResultStore(url) as store:
        assert store.calibration_checks("cal-2") == (second,)
        in_force = store.calibration_in_force("front_left", NOON)
    assert in_force is not None
    assert in_force.id == "cal-2"
    assert first.kind is CheckKind.PLATE_SESSION


@pytest.mark.parametrize(
    ("camber", "toe", "slip"),
    [
        (0.8, 0.2, "the opposite sign of the camber"),
        (-0.8, -0.2, "the opposite sign of the toe"),
        (0.8, -0.2, "both signs turned round"),
        (0.2, -0.8, "camber and toe exchanged"),
    ],
)
def test_a_slip_in_the_certificate_is_not_blamed_on_the_rig(camber: float, toe: float, slip: str) -> None:
    """It was "calibrate the rig", and the check was stored as out of tolerance."""
    found = measured(math.radians(-0.8), math.radians(0.2))
    with pytest.raises(ConfigurationError, match=rf"camber, toe.*fit with {slip}.*nothing was stored"):
        judge_master(found, MasterWheel(math.radians(camber), math.radians(toe)), CheckLimits())


def test_a_rig_that_is_off_by_as_much_as_no_slip_explains_is_out() -> None:
    found = measured(math.radians(-0.8), math.radians(0.2))
    for camber in (0.79, -0.6):
        master = MasterWheel(math.radians(camber), math.radians(0.2))
        assert judge_master(found, master, CheckLimits())[0] is CheckOutcome.OUT


def test_a_small_angle_whose_sign_would_fit_is_still_a_rig_that_moved() -> None:
    found = measured(4.9 * ARCMIN, 0.0)
    assert judge_master(found, MasterWheel(-4.9 * ARCMIN, 0.0), CheckLimits())[0] is CheckOutcome.OUT


def test_a_tolerance_above_what_is_believed_of_a_zero_checks_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ("calibration", "check", tmp_path, "--calibration", tmp_path / "c.json", "--tolerance", 10.01)
    assert run(*command) == 2
    assert "--tolerance" in capsys.readouterr().err
