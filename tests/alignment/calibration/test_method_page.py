"""The method of docs/how-to/add-a-calibration-method.md, word for word, under the tests of all methods."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from types import ModuleType
from typing import Any

import pytest

from alignment.calibration.methods import ONE_CAMERA_METHODS
from tests.alignment.calibration import test_one_camera as contract
from tests.documents import snippets

PAGE = "docs/how-to/add-a-calibration-method.md"
METHOD, NAMING, TEST = snippets(PAGE, "python")
MODULE, NAME = "alignment.calibration.geometric", "geometric"
BAD = next(
    mark.args[1] for mark in contract.test_bad_points_are_named.pytestmark if mark.args[0] == ("bad", "says")
)


def run(text: str, space: dict[str, Any]) -> dict[str, Any]:
    exec(compile(text, PAGE, "exec"), space)
    return space


@pytest.fixture(autouse=True)
def method_of_the_page(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    module = ModuleType(MODULE)
    monkeypatch.setitem(sys.modules, MODULE, module)
    run(METHOD, module.__dict__)
    run(NAMING, {})
    assert NAME in ONE_CAMERA_METHODS
    yield
    del ONE_CAMERA_METHODS[NAME]


def test_method_of_the_page_passes_what_all_methods_must() -> None:
    contract.test_exact_points_give_the_true_camera(method=NAME)
    contract.test_a_camera_that_looks_straight_at_the_plate(NAME)
    contract.test_frame_of_the_points_may_lie_anywhere(NAME)
    for bad, says in BAD:
        contract.test_bad_points_are_named(NAME, bad, says)
    contract.test_points_of_one_plane_are_refused_with_the_cure(NAME)


def test_test_of_the_page_passes_and_can_fail() -> None:
    [check] = [value for name, value in run(TEST, {}).items() if name.startswith("test_")]
    check()
    ONE_CAMERA_METHODS[NAME] = ONE_CAMERA_METHODS["dlt"]
    with pytest.raises(AssertionError):
        check()
