"""The words of the command line stay in `station.commands`: no other room names an option or a command."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from station.cli import commands

ROOT = Path(__file__).resolve().parents[1]
EXCEPTIONS = {
    "db/upkeep/backups.py": "options of pg_dump and pg_restore, which it runs",
    "station/running/parts.py": "options of git, which it runs",
    "station/line/tools/document_text.py": "page of the line interface, whose reader types these commands",
}
"""Modules that may name an option or a command outside of `station.commands`, and why."""

WORDS = re.compile(r"(?<![-\w])--[a-z{]|`truewheel ")
"""An option, also one put together (``--{name}``), or a command."""


def product() -> list[Path]:
    return [
        path
        for top in ("alignment", "sensors", "db", "station")
        for path in sorted((ROOT / top).rglob("*.py"))
        if not path.is_relative_to(ROOT / "station" / "commands") and path != ROOT / "station" / "cli.py"
    ]


def strings(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """The literals of a module that are no docstrings, with their lines; of formatted ones the whole text."""
    passed = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            passed |= {id(part) for part in node.values}
            parts = [str(part.value) if isinstance(part, ast.Constant) else "{}" for part in node.values]
            yield node.lineno, "".join(parts)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in passed:
            yield node.lineno, node.value


def test_no_inner_room_names_an_option_or_a_command() -> None:
    """Thirty-five messages said ``--study`` and the like: a screen would have shown it to an operator."""
    found: dict[str, list[str]] = {}
    for path in product():
        for line, text in strings(ast.parse(path.read_text(encoding="utf-8"))):
            if WORDS.search(text):
                found.setdefault(str(path.relative_to(ROOT)), []).append(f"line {line}: {text}")
    assert {name: texts for name, texts in found.items() if name not in EXCEPTIONS} == {}
    assert set(found) == set(EXCEPTIONS), "an exception that is none any more"


def choices() -> Iterator[tuple[str, str]]:
    """Every choice that an error of an inner room names, and where."""
    for path in product():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.keyword) or node.arg != "choice":
                continue
            for part in ast.walk(node.value):
                if isinstance(part, ast.Constant) and isinstance(part.value, str):
                    for choice in part.value.split(","):
                        yield choice.strip(), f"{path.relative_to(ROOT)}:{node.value.lineno}"


def test_every_choice_that_an_error_names_is_an_option_or_argument_of_a_command() -> None:
    def parameters(command: object) -> Iterator[str]:
        for parameter in getattr(command, "params", []):
            yield parameter.name
            yield from (name.removeprefix("--").replace("-", "_") for name in parameter.opts)
        for inner in getattr(command, "commands", {}).values():
            yield from parameters(inner)

    known = set(parameters(commands()))
    named = list(choices())
    assert len(named) > 30
    assert [(choice, where) for choice, where in named if choice.replace(" ", "_") not in known] == []
