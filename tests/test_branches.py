"""The coverage gate shuts: a branch that its module's own tests leave out is found."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
MODULE = """
def verdict(value, limit):
    if value is None:{pragma}
        return "none"
    return "ok" if value <= limit else "nok"
"""
TESTS = """
from deciding import verdict

def test_{name}():
    assert [verdict(value, 1) for value in {values}]
"""


@pytest.mark.parametrize(
    ("values", "module", "pragma", "shut"),
    [
        ("(0, 2, None)", "deciding", "", False),
        ("(0, 2)", "deciding", "", True),
        ("(0, 2)", "deciding", "  # pragma: no cover", True),
        ("(0, 2, None)", "renamed", "", True),
        ("(0, 2, None, 'text')", "deciding", "", True),
    ],
    ids=["all", "a branch", "a branch with an excuse", "a module that is gone", "a test that fails"],
)
def test_gate_shuts_when_anything_is_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, values: str, module: str, pragma: str, shut: bool
) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "tools"))
    branches = importlib.import_module("branches")
    (tmp_path / "deciding.py").write_text(MODULE.format(pragma=pragma))
    (tmp_path / "test_deciding.py").write_text(TESTS.format(name="values", values=values))
    said = branches.left_out(module, ["test_deciding.py"], tmp_path)
    assert bool(said) is shut, said


def test_modules_and_tests_of_the_gate_exist(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "tools"))
    branches = importlib.import_module("branches")
    for module, tests in branches.DECIDING.items():
        assert (ROOT / f"{module.replace('.', '/')}.py").is_file()
        assert all((ROOT / test).is_file() for test in tests)
    assert branches.main(["no.such.module"]) == 2
    sys.modules.pop("branches")
