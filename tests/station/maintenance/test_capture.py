"""Capturing a plate with the station's own cameras: bad views are not taken, and what is missing is told."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from alignment.calibration.gate import GateLimits
from alignment.errors import ConfigurationError
from alignment.values import Image
from sensors.camera import Frame
from sensors.formats.planned_views import PlannedView, plate_plan
from sensors.formats.plate import read_plate
from sensors.formats.plate_session import read_plate_session, write_plate_session
from sensors.shot import HeadFrames, WheelShot
from sensors.simulation.plate_session import PlateBeforeRig, PlatePosition, PlateSessionSpec
from sensors.simulation.simulated_rig import true_calibration
from station.maintenance.capture import PlateCapture, instruction, look_at_plate
from station.maintenance.coverage import coverage_of, what_is_missing, what_would_help
from tests.sensors.samples import TIME

PLATE = read_plate(Path(__file__).parents[3] / "configs" / "plates" / "rig.toml")
KEYS = (("head_1", "left"), ("head_1", "right"))


@cache
def images_at(planned: PlannedView) -> dict[tuple[str, str], Image]:
    """What the two cameras of one head see, without the other heads."""
    true = true_calibration("front_left", "left", "standard", 3)
    before = PlateBeforeRig.of(PlateSessionSpec(heads=("head_1",)), PLATE, true, np.random.default_rng(1))
    _, pose = before.put(PlatePosition(planned.name, planned.stage_mm, planned.tilt))
    return {key: before.image(key, pose, np.random.default_rng(2), before.spec.settings) for key in KEYS}


def shot_of(images: dict[tuple[str, str], Image]) -> WheelShot:
    left, right = (
        Frame(f"front_left/{head}/{side}", images[head, side], 1, 0.0, 0.0, 5.0) for head, side in KEYS
    )
    return WheelShot("front_left", TIME, (HeadFrames("head_1", left, right),))


class PlateBefore:
    """A rig that sees the plate in the positions it is given, one for each shot, the last one for ever."""

    name = "front_left"

    def __init__(
        self, *positions: PlannedView, spoil: Callable[[Image], Image] = lambda image: image
    ) -> None:
        self._positions = itertools.chain(positions, itertools.repeat(positions[-1]))
        self._spoil = spoil
        self.armed = self.shots = 0

    def arm(self) -> None:
        self.armed += 1

    def shoot_unlit(self) -> WheelShot:
        self.shots += 1
        return shot_of({key: self._spoil(image) for key, image in images_at(next(self._positions)).items()})


def blurred(image: Image) -> Image:
    return cv2.GaussianBlur(image, (0, 0), 3.5)


def dark(image: Image) -> Image:
    noise = np.random.default_rng(5).normal(0.0, 1.5, image.shape)
    return np.clip(np.rint(6 + (image.astype(float) - 6) * 0.15 + noise), 0, 255).astype(np.uint8)


def black(image: Image) -> Image:
    return np.full_like(image, 6)


def white(image: Image) -> Image:
    return np.full_like(image, 255)


Z0, LOW, HIGH, TILTED = plate_plan(4)


@pytest.mark.parametrize(
    ("spoil", "told"),
    [(blurred, "blurred"), (dark, "add light"), (black, "light"), (white, "saturated")],
)
def test_a_bad_view_is_not_taken_and_says_which_camera_and_why(
    spoil: Callable[[Image], Image], told: str
) -> None:
    capture = PlateCapture(PlateBefore(Z0, spoil=spoil), "left", PLATE)
    shot = capture.shoot(Z0)
    assert len(shot.problems) == 2
    assert all(problem.startswith("head_1 ") and told in problem.lower() for problem in shot.problems), shot
    with pytest.raises(ConfigurationError, match="a view without problems"):
        capture.keep(Z0, shot)
    assert capture.views == []


def test_on_the_stage_every_camera_sees_the_plate_and_by_hand_it_may_be_out_of_ones_sight() -> None:
    images = images_at(TILTED) | {KEYS[0]: black(images_at(TILTED)[KEYS[0]])}
    assert len(look_at_plate(shot_of(images), PLATE, by_all=True).problems) == 1
    by_hand = look_at_plate(shot_of(images), PLATE, by_all=False)
    assert by_hand.problems == ()
    assert list(by_hand.marks) == [KEYS[1]]


def test_a_view_is_taken_when_the_plate_was_moved_and_stands_still() -> None:
    moving = [replace(Z0, name=f"m{k}", stage_mm=(0.3 * k, 0.0, 0.0)) for k in range(1, 4)]
    rig = PlateBefore(*moving, Z0, Z0, Z0, LOW, LOW)
    capture = PlateCapture(rig, "left", PLATE)
    clock = lambda: 0.0  # noqa: E731
    capture.keep(Z0, capture.wait_still(Z0, 1.0, clock))
    assert rig.shots == 5, "three while it moved, two while it stood"
    capture.keep(LOW, capture.wait_still(LOW, 1.0, clock))
    assert rig.shots == 8, "one more of the view before, then two of this"


@pytest.mark.parametrize("spoil", [lambda image: image, blurred])
def test_a_plate_that_is_not_moved_or_never_good_is_given_up_in_time(
    spoil: Callable[[Image], Image],
) -> None:
    capture = PlateCapture(PlateBefore(Z0), "left", PLATE)
    capture.keep(Z0, capture.shoot(Z0))
    capture.rig = PlateBefore(Z0, spoil=spoil)
    seconds = itertools.count(0.0, 1.0)
    shot = capture.wait_still(LOW, 3.0, lambda: next(seconds))
    assert "no good view of the plate within 3 s" in shot.problems[0]
    assert ("was not moved" in shot.problems[0]) is (spoil is not blurred)


def captured(*views: PlannedView) -> PlateCapture:
    capture = PlateCapture(PlateBefore(*views), "left", PLATE, now=lambda: TIME)
    for view in views:
        capture.keep(view, capture.shoot(view))
    return capture


def test_what_is_written_is_a_plate_session_as_calibrate_reads_it(tmp_path: Path) -> None:
    capture = captured(Z0, TILTED)
    capture.keep(HIGH, capture.shoot(HIGH), (0.0, 0.0, 30.002))
    write_plate_session(tmp_path / "session", capture.session())
    read = read_plate_session(tmp_path / "session")
    assert (read.rig, read.side, read.time_utc) == ("front_left", "left", TIME)
    assert [None if view.stage_mm is None else view.stage_mm.tolist() for view in read.views] == [
        [0.0, 0.0, 0.0],
        None,
        [0.0, 0.0, 30.002],
    ]
    assert (read.views[0].images["head_1", "left"] == images_at(Z0)["head_1", "left"]).all()


def test_nothing_taken_is_no_session() -> None:
    with pytest.raises(ConfigurationError, match="at least one view"):
        PlateCapture(PlateBefore(Z0), "left", PLATE).session()


def test_what_the_calibration_will_ask_for_is_told_as_early_as_it_can_be() -> None:
    capture = captured(Z0)
    [few] = what_is_missing(capture.seen, capture.sizes(), PLATE.plate)
    assert "1 view so far" in few
    twice = captured(Z0, replace(Z0, name="again"), replace(Z0, name="more"))
    assert any("alike" in text for text in what_is_missing(twice.seen, twice.sizes(), PLATE.plate))
    whole = captured(Z0, LOW, HIGH, TILTED)
    assert what_is_missing(whole.seen, whole.sizes(), PLATE.plate) == ()
    assert what_would_help(whole.seen) == ()
    assert "no tilted view" in what_would_help(captured(Z0, LOW).seen)[0]


def test_where_in_an_image_marks_are_missing_is_named() -> None:
    capture = captured(Z0)
    seen = capture.seen[0]
    marks = seen.marks["head_1", "left"]
    left_half = marks.pixels[:, 0] < 420
    cut = replace(
        marks,
        marks=marks.marks[left_half],
        pixels=marks.pixels[left_half],
        covariance=marks.covariance[left_half],
    )
    views = [replace(seen, marks={("head_1", "left"): cut})] * 5
    sizes = {("head_1", "left"): (1280, 1024)}
    [coverage] = coverage_of(views, sizes)
    assert {"top right", "right", "bottom right"} <= set(coverage.missing)
    assert coverage.image_share < GateLimits().image_share
    [missing] = [m for m in what_is_missing(views, sizes, PLATE.plate) if "cover" in m]
    assert missing.startswith("head_1 left: marks cover")
    assert "right" in missing


def test_every_position_of_the_plan_is_said_in_words() -> None:
    said = [instruction(planned) for planned in plate_plan(9)]
    assert len(set(said)) == 9
    assert "z -30 mm" in said[1]
    assert "about its x axis" in said[3]
