"""A prepared rig: everything that follows from a calibration, computed once, and let go with it."""

from __future__ import annotations

import ast
import gc
import weakref
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import alignment
from alignment import measure_spin, prepared
from alignment.errors import DegenerateInputError
from alignment.geometry.transforms import RigidTransform
from alignment.measure import measure_wheel
from alignment.prepared import PreparedRig
from alignment.values import MeasureSettings, RefusalCode, RigCalibration, StereoImages, WheelMeasurement
from tests import rendered

SETTINGS = MeasureSettings()
TOLERANT = MeasureSettings(allow_lost_head=True)


def fresh() -> RigCalibration:
    """Calibration whose heads and covariance nobody else holds."""
    known = rendered.known_rig()
    return replace(known, heads=tuple(replace(head) for head in known.heads))


def parts(calibration: RigCalibration) -> list[weakref.ref[object]]:
    return [weakref.ref(part) for part in (calibration, *calibration.heads)]


def held(references: list[weakref.ref[object]]) -> int:
    gc.collect()
    return sum(reference() is not None for reference in references)


def with_dark_head() -> list[StereoImages]:
    images = list(rendered.images())
    images[1] = StereoImages(*(np.full_like(image, 5) for image in (images[1].left, images[1].right)))
    return images


@pytest.mark.parametrize("lost", [False, True])
def test_a_calibration_that_measured_is_let_go(lost: bool) -> None:
    """Sixteen calibrations and more stayed behind in hidden caches, those without a lost head among them."""
    calibration = fresh()
    references = parts(calibration)
    assert measure_wheel(with_dark_head() if lost else rendered.images(), calibration, TOLERANT)
    del calibration
    assert held(references) == 0


@pytest.mark.parametrize("lost", [False, True])
def test_a_prepared_rig_keeps_its_calibration_and_lets_it_go(lost: bool) -> None:
    rig = PreparedRig.of(fresh(), TOLERANT)
    references = parts(rig.calibration)
    assert measure_wheel(with_dark_head() if lost else rendered.images(), rig, TOLERANT)
    assert held(references) == len(references)
    del rig
    assert held(references) == 0


@pytest.mark.parametrize("lost", [False, True])
def test_a_prepared_rig_measures_as_its_calibration_does(lost: bool) -> None:
    images, calibration = with_dark_head() if lost else rendered.images(), fresh()
    rig = PreparedRig.of(calibration, TOLERANT)
    plain = measure_wheel(images, calibration, TOLERANT)
    assert isinstance(plain, WheelMeasurement)
    for _ in range(2):
        found = measure_wheel(images, rig, TOLERANT)
        assert isinstance(found, WheelMeasurement)
        assert (found.camber, found.toe, found.degraded) == (plain.camber, plain.toe, lost)
        assert (found.knock_evidence, found.unseen, found.heads) == (
            plain.knock_evidence,
            plain.unseen,
            plain.heads,
        )
        np.testing.assert_array_equal(found.angle_covariance, plain.angle_covariance)


@pytest.fixture
def computed(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """How often each part of a rig was computed."""
    numbers: Counter[str] = Counter()
    names = "epipolar_directions", "shared_views", "axis_covariance", "predicted_misfits", "knock_model"
    for name in names:

        def count(*given: object, name: str = name, of: object = getattr(prepared, name)) -> object:
            numbers[name] += 1
            return of(*given)  # type: ignore[operator]

        monkeypatch.setattr(prepared, name, count)
    for kind in (prepared.StereoGeometry, prepared.RowViews):

        def built(*given: object, kind: type = kind, of: object = kind.of) -> object:
            numbers[kind.__name__] += 1
            return of(*given)  # type: ignore[operator]

        monkeypatch.setattr(kind, "of", built)
    return numbers


def test_nothing_of_a_prepared_rig_is_computed_twice(computed: Counter[str]) -> None:
    rig = PreparedRig.of(fresh(), SETTINGS)
    assert not computed
    for _ in range(3):
        assert measure_wheel(rendered.images(), rig, SETTINGS)
    assert set(computed.values()) == {1}
    assert len(computed) == 7


def test_a_rig_without_its_lost_head_is_prepared_once(computed: Counter[str]) -> None:
    rig = PreparedRig.of(fresh(), TOLERANT)
    for _ in range(3):
        found = measure_wheel(with_dark_head(), rig, TOLERANT)
        assert isinstance(found, WheelMeasurement)
        assert found.degraded
    # Of the whole rig only what comes before the dark head is seen.
    assert computed == {
        "epipolar_directions": 2,
        "shared_views": 2,
        "StereoGeometry": 1,
        "RowViews": 1,
        "axis_covariance": 1,
        "predicted_misfits": 1,
        "knock_model": 1,
    }


def test_shots_of_a_turning_wheel_share_one_preparation(computed: Counter[str]) -> None:
    shots = [[StereoImages(pair.left.copy(), pair.right) for pair in rendered.images()] for _ in range(3)]
    for k, shot in enumerate(shots):
        shot[0].left[0, 0] = k
    found = measure_spin.measure_spin(shots, fresh(), SETTINGS)
    assert getattr(found, "code", None) is RefusalCode.TOO_FEW_SHOTS
    assert computed["knock_model"] == computed["shared_views"] == 1


def test_a_rig_prepared_for_another_depth_range_is_told() -> None:
    rig = PreparedRig.of(rendered.rig(), replace(SETTINGS, depth_range_mm=(-10.0, 10.0)))
    with pytest.raises(DegenerateInputError, match=r"depth_range_mm.*prepared for -10 to 10 mm"):
        measure_wheel(rendered.images(), rig, SETTINGS)


def test_heads_that_do_not_see_a_nominal_wheel_have_no_model_of_knocks() -> None:
    known = rendered.rig()
    aside = RigidTransform(np.eye(3), np.array([2000.0, 0.0, 0.0]))
    heads = tuple(
        replace(
            head,
            left=replace(head.left, rig_from_camera=aside @ head.left.rig_from_camera),
            right=replace(head.right, rig_from_camera=aside @ head.right.rig_from_camera),
        )
        for head in known.heads
    )
    rig = PreparedRig.of(replace(known, heads=heads, covariance=None), SETTINGS)
    assert rig.knock_model is None
    assert rig.angle_covariance is None


def is_cache(decorator: ast.expr) -> bool:
    named = decorator.func if isinstance(decorator, ast.Call) else decorator
    return ast.unparse(named).rpartition(".")[2] in {"lru_cache", "cache"}


def hidden_caches(source: str) -> list[str]:
    """Functions that are cached by something else than a number or a name."""
    out = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef) and any(map(is_cache, node.decorator_list)):
            given = [ast.unparse(each.annotation) if each.annotation else "" for each in node.args.args]
            if not set(given) <= {"int", "float", "str"}:
                out.append(node.name)
    return out


def test_nothing_in_the_mathematics_is_cached_out_of_sight() -> None:
    """A cache of a function lives as long as the program, with what it was given."""
    assert hidden_caches("@lru_cache(maxsize=4)\ndef f(rig: RigCalibration): ...") == ["f"]
    assert hidden_caches("@functools.cache\ndef f(path: str): ...") == []
    files = Path(next(iter(alignment.__path__))).rglob("*.py")
    found = {path.name: hidden_caches(path.read_text(encoding="utf-8")) for path in files}
    assert {name: functions for name, functions in found.items() if functions} == {}
