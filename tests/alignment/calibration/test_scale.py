"""A plate's pitch that is wrong by one factor is blamed on the plate, and never passes.

With a pitch wrong by 2 % the gate accepted: focal lengths take the scale up, residuals stay as they are, and
every camber and toe is wrong by 2 % of itself. Stage positions alone were far off, which nobody looked at.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from alignment.calibration.adjustment import adjust
from alignment.calibration.diagnosis import diagnose
from alignment.calibration.gate import CalibrationProblem
from alignment.calibration.observations import CalibrationInput
from alignment.calibration.scale import scale_in_moves, scale_sentence
from alignment.geometry.transforms import RigidTransform
from sensors.formats import PatternPlateFile, describe_plate
from station.studies.simulated_views import STAGES, observe, square_plate
from tests.alignment.calibration.test_gate import SETTINGS, judged, rig, seen

PITCH_MM = 15.0


@cache
def on_stage() -> CalibrationInput:
    return seen()


@cache
def with_tilts() -> CalibrationInput:
    """The stage went up and down only; three views are held by hand."""
    turns = ((20.0, 0.0, 0.0), (0.0, -20.0, 0.0), (-15.0, 15.0, 0.0))
    tilted = [RigidTransform.from_rotvec(np.radians(turn), np.array([1.0, 2.0, 3.0])) for turn in turns]
    return observe(rig(), square_plate(), [*STAGES[:5], *tilted], np.random.default_rng(3)).data


def plate_times(data: CalibrationInput, factor: float) -> CalibrationInput:
    return replace(data, plate=replace(data.plate, points=factor * data.plate.points))


def stage_times(data: CalibrationInput, factor: float) -> CalibrationInput:
    views = [v if v.stage_mm is None else replace(v, stage_mm=factor * v.stage_mm) for v in data.views]
    return replace(data, views=tuple(views))


@pytest.mark.parametrize("make", [on_stage, with_tilts])
@pytest.mark.parametrize("factor", [0.9, 0.98, 0.99, 1.005, 1.02, 1.1])
def test_a_pitch_wrong_by_some_per_cent_is_named_and_not_the_stage(make: object, factor: float) -> None:
    data = make()  # type: ignore[operator]
    answer = judged(plate_times(data, factor))
    assert answer.problem is CalibrationProblem.WRONG_INPUT
    assert "plate and stage disagree in every view by one common scale" in answer.reason
    assert "check the plate's pitch_mm and certificate first" in answer.reason
    said = float(answer.reason.split("scale, ")[1].split(" %")[0])
    assert said == pytest.approx(100.0 * (factor - 1.0), abs=0.1)
    assert f"where {factor * PITCH_MM:.4g} mm is stated" in answer.reason
    assert "view_" not in answer.reason


@pytest.mark.parametrize(
    ("slip", "factor", "words"),
    [
        (stage_times, 0.001, "metres taken for millimetres in the stage's positions"),
        (stage_times, 1.0 / 25.4, "inches taken for millimetres in the stage's positions"),
        (stage_times, 0.1, "centimetres taken for millimetres in the stage's positions"),
        (plate_times, 0.001, "metres taken for millimetres in the plate's pitch"),
        (plate_times, 0.1, "centimetres taken for millimetres in the plate's pitch"),
        (plate_times, 2.0, "a pitch counted over two marks"),
    ],
)
@pytest.mark.parametrize("make", [on_stage, with_tilts])
def test_another_unit_is_named(make: object, slip: object, factor: float, words: str) -> None:
    answer = judged(slip(make(), factor))  # type: ignore[operator]
    assert answer.problem is CalibrationProblem.WRONG_INPUT
    assert words in answer.reason


@pytest.mark.parametrize("sides", [("left", "right"), ("left",)])
def test_one_head_and_one_camera_alone_tell_the_pitch_too(sides: tuple[str, ...]) -> None:
    cameras = {key: camera for key, camera in rig().items() if key[0] == "head_1" and key[1] in sides}
    wrong = plate_times(seen(cameras=cameras), 1.02)
    reason = diagnose(wrong, SETTINGS, adjust(wrong, SETTINGS))
    assert reason is not None
    assert "plate and stage disagree in every view by one common scale" in reason
    pitch = float(reason.split("a pitch of ")[1].split(" mm")[0])
    assert pitch == pytest.approx(PITCH_MM, rel=2e-3)


def test_good_sessions_have_one_scale() -> None:
    for seed in range(12):
        data = observe(rig(), square_plate(), STAGES, np.random.default_rng([21, seed])).data
        assert scale_in_moves(adjust(data)) is None


def test_a_stage_that_only_goes_up_and_down_tells_nothing_of_the_pitch() -> None:
    heights = observe(rig(), square_plate(), STAGES[:5], np.random.default_rng(8)).data
    assert scale_in_moves(adjust(plate_times(heights, 1.02))) is None


@pytest.mark.parametrize("name", ["circles", "asymmetric_circles", "chessboard", "charuco"])
def test_a_plate_with_a_pitch_in_x_and_one_in_y_is_told_both_by_the_names_of_its_file(name: str) -> None:
    """The sentence named pitch_mm, which such a file does not have, and the mean of two pitches."""
    fields = {
        "schema": "truewheel.pattern-plate/1",
        "name": "theirs",
        "pattern": name,
        "columns": (-5, 5),
        "rows": (-4, 3),
        "pitch_x_mm": 10.0,
        "pitch_y_mm": 8.0 if "circles" in name else 10.0,
    }
    if "circles" in name:
        fields |= {"mark_diameter_mm": 5.0}
    if name == "circles":
        fields |= {"orientation": "stage"}
    if name == "charuco":
        fields |= {"dictionary": "DICT_4X4_250", "marker_mm": 7.5}
    plate = describe_plate(PatternPlateFile.model_validate(fields)).plate
    said = scale_sentence(plate, 1.25, "stage disagree", "the stage")
    y = (8.0, 6.4) if "circles" in name else (10.0, 8.0)
    assert (
        f"pitches of 8 mm in x and {y[1]:g} mm in y would fit where 10 mm in x and {y[0]:g} mm in y" in said
    )
    assert "check the plate's pitch_x_mm, pitch_y_mm and certificate first, then the stage" in said
    assert "pitch_mm" not in said
