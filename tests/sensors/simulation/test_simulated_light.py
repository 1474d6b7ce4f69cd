"""Simulated rigs in front of plates, under lamps and sun, and lit by a simulated projector."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from alignment.errors import ConfigurationError, ProjectorError
from alignment.imaging import observe_plate
from sensors.camera import CameraSettings
from sensors.drivers.driver import RigPlace
from sensors.formats.plate import read_plate
from sensors.frames import FrameTolerance
from sensors.projectors.lit_rig import LitRig, RigLight
from sensors.simulation.driver import DRIVER, SimulatedOptions
from sensors.simulation.projector_driver import SimulatedProjector

PLATES = Path(__file__).parents[3] / "configs" / "plates"
DRIVER_PLATE = read_plate(PLATES / "rig.toml")
PLACE = RigPlace("front_left", "left", (), PLATES, CameraSettings(), FrameTolerance())


def rig_of(**options):
    rig = DRIVER.make(SimulatedOptions(seed=3, **options), PLACE)
    rig.heads = rig.heads[:1]  # one head is enough, and six times cheaper
    return rig


def lit(rig, light=None, **projector):
    made = LitRig(rig, SimulatedProjector("front_left", rig, **projector), light)
    made.connect()
    made.arm()
    return made


def levels(shot):
    return [float(np.percentile(frame.image, 99.5)) for frame in shot.frames]


def test_a_projector_of_half_the_light_or_half_worn_lights_half():
    rig = rig_of(stays=True)
    full = levels(lit(rig).shoot(60.0))
    half = levels(lit(rig, RigLight(0.5)).shoot(60.0))
    worn = levels(lit(rig, wear=0.5).shoot(60.0))
    dark = levels(lit(rig).shoot_unlit(60.0))
    for a, b, c, d in zip(full, half, worn, dark, strict=True):
        assert b == pytest.approx((a + d) / 2, abs=2.0)
        assert b == pytest.approx(c, abs=2.0)
        assert a > 2 * d


def test_a_dark_exposure_shows_the_sun_and_not_the_lines():
    rig = rig_of(stays=True, sun={"level": 5.0, "radius_mm": 60.0})
    shot = lit(rig, RigLight(dark=True)).shoot(60.0)
    subtracted = shot.images[0].left.astype(float)
    without = replace(shot, dark=()).images[0].left.astype(float)
    sunny = shot.dark_frames[0].image > 60
    assert sunny.mean() > 0.01, "the sun is in the picture"
    assert np.median(subtracted[sunny]) == pytest.approx(16, abs=3)
    assert np.median(without[sunny]) > 60


def test_a_projector_that_does_not_answer_is_told_and_comes_back():
    rig = rig_of(stays=True)
    made = LitRig(rig, SimulatedProjector("front_left", rig))
    made.connect()
    made.projector.failing = True
    with pytest.raises(ProjectorError, match="projector of front_left"):
        made.arm()
    made.projector.failing = False
    made.connect()
    made.arm()


def test_every_arming_finds_the_plate_in_the_next_position_of_the_plan():
    rig = rig_of(plate={"file": "rig.toml"})
    plate = DRIVER_PLATE.seen_by("head_1")
    rig.connect()
    seen = []
    for _ in range(2):
        rig.arm()
        seen.append([observe_plate(rig.shoot(60.0).frames[0].image, plate) for _ in range(2)])
    (first, again), (second, _) = seen
    assert len(first.marks) > 90
    moved = {}
    for name, other in (("noise", again), ("stage", second)):
        _, a, b = np.intersect1d(first.marks, other.marks, return_indices=True)
        moved[name] = float(np.abs(first.pixels[a] - other.pixels[b]).max())
    assert moved["noise"] < 0.5
    assert moved["stage"] > 20.0


def test_a_gauge_frame_without_a_plate_for_the_rig_is_a_mistake():
    options = SimulatedOptions(seed=3, gauge={"frame": "gauge.toml"})
    DRIVER.check(options, PLACE)
    with pytest.raises(ConfigurationError, match="a plate for mid_left"):
        DRIVER.check(options, replace(PLACE, rig="mid_left"))


@pytest.mark.parametrize("what", [{"plate": {"file": "no.toml"}}, {"gauge": {"frame": "no.toml"}}])
def test_a_plate_that_is_not_described_is_found_without_rendering(what):
    with pytest.raises(ConfigurationError, match=r"no\.toml"):
        DRIVER.check(SimulatedOptions(seed=3, **what), PLACE)
