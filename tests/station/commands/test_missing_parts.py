"""A program that was installed in part: one sentence that names what is missing, and what to do."""

from __future__ import annotations

import builtins
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from db.connection import migrate
from station.cli import main


def without(name: str, error: BaseException) -> Callable[..., Any]:
    real = builtins.__import__

    def load(wanted: str, *arguments: Any, **options: Any) -> Any:
        if wanted.partition(".")[0] == name:
            raise error
        return real(wanted, *arguments, **options)

    return load


@pytest.mark.parametrize(
    ("package", "error", "arguments"),
    [
        (
            "pyarrow",
            ModuleNotFoundError("No module named 'pyarrow'", name="pyarrow"),
            ("export", "parquet", "--out", "a.parquet"),
        ),
        (
            "pyarrow",
            ImportError("libarrow.so.2400: cannot open"),
            ("export", "parquet", "--out", "a.parquet"),
        ),
    ],
)
def test_a_package_that_is_missing_is_named(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    package: str,
    error: ImportError,
    arguments: tuple[str, ...],
) -> None:
    url = f"sqlite:///{tmp_path / 'r.db'}"
    migrate(url)
    monkeypatch.chdir(tmp_path)
    for name in [name for name in sys.modules if name.partition(".")[0] == package]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(builtins, "__import__", without(package, error))
    with pytest.raises(SystemExit) as ended:
        main([*arguments, "--database", url])
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert str(error) in said
    assert "Install truewheel anew" in said
    assert "Traceback" not in said


def test_a_part_of_its_own_that_is_missing_is_a_defect(monkeypatch: pytest.MonkeyPatch) -> None:
    missing = ModuleNotFoundError("No module named 'db.exports'", name="db.exports")
    monkeypatch.delitem(sys.modules, "station.commands.schemas", raising=False)
    monkeypatch.setattr(builtins, "__import__", without("station", missing))
    with pytest.raises(ModuleNotFoundError):
        main(["schema", "shot"])
