"""`truewheel --version`: every part is named, and what is damaged or absent is said and stops nothing."""

from __future__ import annotations

import json
from importlib.metadata import version
from pathlib import Path

import pytest

from db.connection import head_revision
from sensors.formats import SCHEMAS
from station.cli import main
from station.configuration import SHIPPED
from station.line.wire import INTERFACE_MAJOR
from station.running.parts import installed_version, kernel_table, parts_of_program


def said(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as end:
        main(list(arguments))
    out, err = capsys.readouterr()
    return int(end.value.code or 0), out, err


def test_every_part_has_its_version_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = said(capsys, "--version", "--json")
    assert status == 0
    parts = json.loads(out)
    assert parts["truewheel"] == version("truewheel")
    assert parts["interface"].startswith(f"{INTERFACE_MAJOR}.")
    assert parts["database"] == head_revision()
    assert set(parts["formats"]) == set(SCHEMAS)
    assert all(
        text.startswith(f"truewheel.{kind}/") for kind, texts in parts["formats"].items() for text in texts
    )
    assert all(parts["formats"].values())
    packages = {
        "numpy": "numpy", "opencv": "opencv-python-headless", "numba": "numba", "sqlalchemy": "sqlalchemy",
        "python-can": "python-can",
    }  # fmt: skip
    for name, package in packages.items():
        assert parts["libraries"][name] == version(package)
    assert {"cameras", "projectors"} == {one["drives"] for one in parts["drivers"]}
    assert len(parts["kernels"]["sha256"]) == 64
    assert parts["findings"] == []


def test_people_read_the_program_s_version_first(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = said(capsys, "--version")
    assert (status, out.splitlines()[0].split()) == (0, ["truewheel", version("truewheel")])
    for part in ("line interface", "database revision", "formats", "opencv", "python", "platform"):
        assert f"\n{part} " in out


@pytest.mark.parametrize("arguments", [("--json",), ("--json", "report", "all")])
def test_json_without_a_version_or_before_a_command_is_refused(
    arguments: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    status, out, err = said(capsys, *arguments)
    assert (status, out) == (2, "")
    assert "field '--json': expected it behind a command, or with --version" in err


@pytest.mark.parametrize("text", [None, "", "BO_ nonsense", 'VERSION ""\n'])
def test_a_damaged_interface_is_a_finding_and_all_else_is_told(text: str | None, tmp_path: Path) -> None:
    dbc = tmp_path / "line.dbc"
    if text is not None:
        dbc.write_text(text, encoding="utf-8")
    parts = parts_of_program(dbc)
    assert parts.interface is None
    assert len(parts.findings) == 1
    assert str(dbc) in parts.findings[0]
    assert parts.database == parts_of_program(SHIPPED / "line.dbc").database


def test_a_package_that_is_absent_has_no_version() -> None:
    assert installed_version("no-such-package-of-truewheel") is None


def test_the_table_of_compiled_functions_has_another_hash_when_it_is_another() -> None:
    table = {"measure_8": {"a.f": ("i8(i8)", "f8(f8)")}, "spin": {"a.f": ("i8(i8)",), "a.g": ("f8(f8)",)}}
    found = kernel_table(table)
    assert (found.functions, found.signatures) == (2, 3)
    assert kernel_table(dict(reversed(table.items()))) == found
    changed = {**table, "spin": {"a.f": ("i4(i4)",), "a.g": ("f8(f8)",)}}
    assert kernel_table(changed).sha256 != found.sha256
