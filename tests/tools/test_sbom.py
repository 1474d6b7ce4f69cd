"""The bill of materials: everything that is pinned, what needs what, hashes where they are known."""

from __future__ import annotations

import hashlib
import json
import tomllib
import zipfile
from dataclasses import replace
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from cyclonedx.validation.json import JsonStrictValidator

from tools.sbom import SCHEMA, bill, hashes_of, packages, wheel_of
from tools.wheel import ROOT, locked

AT = datetime(2026, 11, 30, tzinfo=UTC)
LOCK = locked((ROOT / "requirements.lock").read_text(encoding="utf-8"))
PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


@cache
def found() -> list[Any]:
    return packages(PROJECT, LOCK)


def test_everything_that_is_pinned_is_listed_and_valid_by_the_library_s_schema() -> None:
    text = bill(PROJECT, found(), "0" * 40, AT, None)
    assert JsonStrictValidator(SCHEMA).validate_str(text) is None
    listed = json.loads(text)
    assert {(one["name"], one["version"]) for one in listed["components"]} == {
        (name.lower().replace("_", "-").replace(".", "-"), version) for name, version in LOCK.items()
    }
    assert all(one["purl"] == one["bom-ref"] for one in listed["components"])
    scopes = {one["name"]: one["scope"] for one in listed["components"]}
    # A station measures with these, a makers' camera needs that, and nobody ships the tests' tools.
    assert [scopes[name] for name in ("numpy", "llvmlite", "psycopg-binary")] == ["required"] * 3
    assert [scopes[name] for name in ("pypylon", "dask")] == ["optional"] * 2
    assert [scopes[name] for name in ("pytest", "cyclonedx-python-lib")] == ["excluded"] * 2
    needs = {one["ref"]: one.get("dependsOn", []) for one in listed["dependencies"]}
    assert f"pkg:pypi/llvmlite@{LOCK['llvmlite']}" in needs[f"pkg:pypi/numba@{LOCK['numba']}"]
    assert f"pkg:pypi/numba@{LOCK['numba']}" in needs["truewheel"]


def test_the_same_release_gives_the_same_bits_and_another_one_another_number() -> None:
    first = bill(PROJECT, found(), "0" * 40, AT, None)
    assert first == bill(PROJECT, reversed(found()), "0" * 40, AT, None)
    other = bill(PROJECT, found(), "1" * 40, AT, None)
    assert json.loads(first)["serialNumber"] != json.loads(other)["serialNumber"]


def test_hashes_of_wheel_and_packages_are_those_of_the_files(tmp_path: Path) -> None:
    wheel = tmp_path / f"numpy-{LOCK['numpy']}-cp311-cp311-manylinux2014_x86_64.whl"
    wheel.write_bytes(b"numpy")
    (tmp_path / "pyserial-3.5.tar.gz").write_bytes(b"serial")
    (tmp_path / "notes.txt").write_text("no package")
    known = hashes_of(tmp_path)
    assert set(known) == {("numpy", LOCK["numpy"]), ("pyserial", "3.5")}
    hashed = [replace(one, sha256=known.get((one.name, one.version), ())) for one in found()]
    listed = json.loads(bill(PROJECT, hashed, "0" * 40, AT, wheel))
    [numpy] = [one for one in listed["components"] if one["name"] == "numpy"]
    expected = [{"alg": "SHA-256", "content": hashlib.sha256(b"numpy").hexdigest()}]
    assert numpy["hashes"] == listed["metadata"]["component"]["hashes"] == expected
    assert sum("hashes" in one for one in listed["components"]) == 2


@pytest.mark.parametrize(
    ("lock", "said"),
    [
        ({**LOCK, "numpy": "1.0"}, "numpy: expected 1.0 of requirements.lock"),
        ({**LOCK, "no-such-package": "1"}, "no-such-package: expected 1 of requirements.lock, found none"),
        (
            {k: v for k, v in LOCK.items() if k != "llvmlite"},
            "expected llvmlite, which numba needs, found none",
        ),
        ({k: v for k, v in LOCK.items() if k != "numpy"}, "expected numpy, which"),
    ],
)
def test_a_lock_that_is_not_what_is_installed_makes_no_bill(
    lock: dict[str, str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as end:
        packages(PROJECT, lock)
    assert end.value.code == 2
    assert said in capsys.readouterr().err


def test_a_folder_without_packages_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for folder in (tmp_path, tmp_path / "none"):
        with pytest.raises(SystemExit) as end:
            hashes_of(folder)
        assert end.value.code == 2
    assert capsys.readouterr().err.count("expected a folder of downloaded packages") == 2


def test_a_wheel_of_another_commit_is_not_the_release_s(tmp_path: Path) -> None:
    assert wheel_of(tmp_path, PROJECT, "0" * 40) is None
    wheel = tmp_path / f"truewheel-{PROJECT['version']}-py3-none-any.whl"
    wheel.write_bytes(b"cut")
    assert wheel_of(tmp_path, PROJECT, "0" * 40) is None
    with zipfile.ZipFile(wheel, "w") as files:
        files.writestr("station/built.json", json.dumps({"commit": "0" * 40}))
    assert wheel_of(tmp_path, PROJECT, "0" * 40) == wheel
    assert wheel_of(tmp_path, PROJECT, "1" * 40) is None
