"""Each thing is defined once: a public name stands for one thing, and one module defines it."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("alignment", "sensors", "db", "station")
EXCEPTIONS = {
    "STUDY": "what every study shows of itself, found by its name",
    "run": "what every study, and every program of a process, does",
    "main": "where a program begins",
    "DRIVER": "what the entry point of a camera driver names",
    "events": "the table, and the question that is asked of it",
    "gauge_studies": "the table, and the question that is asked of it",
}
"""Names that several modules may define, and why."""
COMPILERS = {"njit", "kernel", "part"}
"""Decorators of compiled functions: those are known by module and name, and no other room imports them."""


def defined(path: Path) -> Iterator[str]:
    """Public classes, functions and constants of a module, but for compiled functions."""
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.FunctionDef):
            calls = [each.func if isinstance(each, ast.Call) else each for each in node.decorator_list]
            if not COMPILERS & {each.id for each in calls if isinstance(each, ast.Name)}:
                yield node.name
        elif isinstance(node, ast.Assign):
            yield from (target.id for target in node.targets if isinstance(target, ast.Name))
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            yield node.target.id


def definitions() -> dict[str, list[str]]:
    """Modules that define each public name.

    The verbs of the command line are left out, which are called as what they do; migrations too, which stand
    still while the rest changes.
    """
    found = defaultdict(list)
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            room = path.relative_to(ROOT).parts[:2]
            if room in {("station", "commands"), ("db", "migrations")} or path == ROOT / "station" / "cli.py":
                continue
            for name in set(defined(path)):
                if not name.startswith("_"):
                    found[name].append(str(path.relative_to(ROOT)))
    return found


def test_a_public_name_is_defined_once() -> None:
    """`MasterWheel`, `Moments`, `ThrustSign`, `ARCMIN` and `Progress` were two to five, `Array` a hundred."""
    twice = {name: places for name, places in definitions().items() if len(places) > 1}
    assert {name: places for name, places in twice.items() if name not in EXCEPTIONS} == {}
    assert set(EXCEPTIONS) <= set(twice), "an exception that is none any more"


def test_the_scale_by_the_median_deviation_stands_in_one_module() -> None:
    factors = {1.4826, 0.6745}
    found = [
        f"{path.relative_to(ROOT)}:{node.lineno}"
        for package in PACKAGES
        for path in sorted((ROOT / package).rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and isinstance(node.value, float) and node.value in factors
    ]
    # The quartile of the image's noise keeps its rounding: all that was ever measured went through it.
    assert {place.partition(":")[0] for place in found} == {
        "alignment/imaging/extraction.py",
        "alignment/robust.py",
    }


def test_no_module_names_an_array_type_of_its_own() -> None:
    """A hundred modules began with ``Array = NDArray[np.float64]``."""
    found = [
        f"{path.relative_to(ROOT)}:{node.lineno}"
        for package in PACKAGES
        for path in sorted((ROOT / package).rglob("*.py"))
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, ast.Assign) and ast.unparse(node.value).startswith("NDArray[")
    ]
    assert {place.partition(":")[0] for place in found} == {"alignment/arrays.py", "alignment/values.py"}


def test_what_a_room_gives_is_no_module_of_it() -> None:
    """A face gave the function `posed` until somebody imported the module of that name."""
    faces = [face for package in PACKAGES for face in sorted((ROOT / package).rglob("__init__.pyi"))]
    assert faces
    given = {face: set(re.findall(r" as (\w+)$", face.read_text(encoding="utf-8"), re.M)) for face in faces}
    assert {
        str(face.parent.relative_to(ROOT)): clash
        for face, names in given.items()
        if (clash := names & {path.stem for path in face.parent.iterdir()})
    } == {}
