"""Wheels that stand on their tyres, from images to angles; heads that are knocked meanwhile."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from alignment.geometry.transforms import RigidTransform
from alignment.measure import measure_wheel
from alignment.units import ARCMIN
from alignment.values import MeasureSettings, Refusal, RefusalCode, WheelMeasurement
from station.commands.wheel import measurement_as_json
from tests import path_traced, rendered

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
LOADED = DATA / "path_traced_loaded"


def test_a_path_traced_wheel_with_a_bulge_is_measured() -> None:
    """It was refused as a moved head; without that gate camber was 1.55′ off, eighteen stated intervals."""
    if not (LOADED / "wheel_bulge").is_dir():
        pytest.skip(f"independent renderings not present: no {LOADED}")
    found = measure_wheel(
        path_traced.images(LOADED, "wheel_bulge"),
        path_traced.calibration(DATA / "path_traced"),
        MeasureSettings(),
    )
    assert isinstance(found, WheelMeasurement), found
    truth = path_traced.truth(LOADED, "wheel_bulge")
    camber, toe = found.camber - math.radians(truth.camber_deg), found.toe - math.radians(truth.toe_deg)
    assert abs(camber) < min(0.15 * ARCMIN, found.camber_u95)
    assert abs(toe) < min(0.06 * ARCMIN, found.toe_u95)
    assert found.warning is None
    assert found.load_mm is not None
    assert 0.3 < found.load_mm < 1.5


def test_a_loaded_wheel_is_measured_inside_its_interval() -> None:
    found = measure_wheel(rendered.loaded_images(), rendered.known_rig(), MeasureSettings())
    assert isinstance(found, WheelMeasurement), found
    assert abs(found.camber - rendered.CAMBER) < min(0.15 * ARCMIN, 1.3 * found.camber_u95)
    assert abs(found.toe - rendered.TOE) < min(0.1 * ARCMIN, 1.3 * found.toe_u95)
    assert found.load_mm is not None
    shown = measurement_as_json(found, "some", 1.0)
    assert shown["load_mm"] == found.load_mm


def test_a_wheel_in_the_air_shows_no_load_and_is_not_searched_for_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def searched(*_: object) -> None:
        raise AssertionError("an unloaded wheel must not pay for loads")

    monkeypatch.setattr("alignment.measure_heads.carry", searched)
    found = measure_wheel(rendered.images(), rendered.known_rig(), MeasureSettings())
    assert isinstance(found, WheelMeasurement), found
    assert found.load_mm is None
    assert measurement_as_json(found, "some", 1.0)["load_mm"] is None


@pytest.mark.parametrize("loaded", [False, True])
@pytest.mark.parametrize("head", [0, 1])
def test_a_head_that_was_knocked_is_told_with_load_and_without(head: int, loaded: bool) -> None:
    """A lean of 6′ across the direction in which a load is even."""
    knocked = rendered.moved(
        rendered.known_rig(), RigidTransform.from_rotvec(np.array([0.0, 1.8e-3, 0.0]), np.zeros(3)), head
    )
    images = rendered.loaded_images() if loaded else rendered.images()
    found = measure_wheel(images, knocked, MeasureSettings())
    if isinstance(found, Refusal):
        assert found.code in (RefusalCode.HEAD_MOVED, RefusalCode.TOO_FEW_POINTS)
        return
    unseen = (0.0, 0.0) if found.unseen is None else found.unseen
    assert abs(found.camber - rendered.CAMBER) < found.camber_u95 + unseen[0]
    assert abs(found.toe - rendered.TOE) < found.toe_u95 + unseen[1]
