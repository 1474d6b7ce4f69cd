"""The house stays as decided: short modules, rooms without circles, faces that hold what they name."""

from __future__ import annotations

import importlib
import statistics
from pathlib import Path

import grimp
import pytest
from grimp import ImportGraph

from tools.house import PACKAGES, ROOT, arrows, circles, floors

LONGEST, MEDIAN = 500, 140


@pytest.fixture(scope="module")
def graph() -> ImportGraph:
    return grimp.build_graph(*PACKAGES, cache_dir=None)


def lengths(package: str) -> dict[Path, int]:
    return {
        path: len(path.read_text(encoding="utf-8").splitlines())
        for path in (ROOT / package).rglob("*.py")
        if "migrations" not in path.parts and path.name != "__init__.py"
    }


@pytest.mark.parametrize("package", PACKAGES)
def test_no_module_is_longer_than_a_person_holds_in_mind(package: str) -> None:
    assert not {str(path): n for path, n in lengths(package).items() if n > LONGEST}


def test_most_modules_of_the_station_are_short() -> None:
    assert statistics.median(lengths("station").values()) < MEDIAN


@pytest.mark.parametrize("package", PACKAGES)
def test_no_room_needs_a_room_that_needs_it(package: str, graph: ImportGraph) -> None:
    assert circles(arrows(graph, package)) == []


@pytest.mark.parametrize("package", PACKAGES)
def test_no_module_needs_a_module_that_needs_it(package: str, graph: ImportGraph) -> None:
    """The sources of gauge studies and their store imported each other."""
    modules = graph.find_descendants(package)
    out = {module: graph.find_modules_directly_imported_by(module) & modules for module in modules}
    assert circles(out) == []


def test_rooms_that_need_each_other_are_seen() -> None:
    """What the tests above stand on."""
    out = {"a": {"b"}, "b": {"c"}, "c": {"b"}, "d": {"a"}}
    assert circles(out) == [{"b", "c"}]
    assert floors(out) == 3
    assert floors({"a": {"b"}, "b": set()}) == 2


FACES = sorted(
    ".".join(path.parent.relative_to(ROOT).parts)
    for package in PACKAGES
    for path in (ROOT / package).rglob("__init__.pyi")
)


@pytest.mark.parametrize("room", FACES)
def test_a_face_holds_what_it_names(room: str) -> None:
    face = importlib.import_module(room)
    assert face.__all__
    for name in face.__all__:
        assert getattr(face, name) is not None
