"""The README's examples run as they stand; every command a document shows is one; links lead somewhere."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Any

import pytest
from typer.main import get_command

from station.cli import app, main

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_readme_s_commands_and_python_work_in_order(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    commands = re.findall(r"^\$ \.venv/bin/truewheel (.+)$", README, flags=re.MULTILINE)
    assert len(commands) == 2
    for command in commands:
        with pytest.raises(SystemExit) as end:
            main(command.split())
        assert end.value.code == 0, capsys.readouterr()
    assert "camber" in capsys.readouterr().out
    [example] = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    exec(compile(example, "README.md", "exec"), {})
    said = capsys.readouterr().out
    camber, toe = (float(re.search(rf"{name} ([-\d.]+) rad", said)[1]) for name in ("camber", "toe"))  # type: ignore[index]
    assert camber == pytest.approx(-0.8 * 3.14159265 / 180, abs=3e-5)
    assert toe == pytest.approx(0.15 * 3.14159265 / 180, abs=3e-5)


def test_every_link_of_the_documents_leads_somewhere() -> None:
    for document in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]:
        text = document.read_text(encoding="utf-8")
        for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", text):
            assert (document.parent / target).exists(), f"{document.name} links to {target}"


def test_every_make_target_that_the_readme_names_exists() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in set(re.findall(r"`?make ([a-z]+)`?", README)):
        assert re.search(rf"^{target}:", makefile, flags=re.MULTILINE), target


def documented_commands() -> list[tuple[str, str]]:
    """Each command line that a document shows, with the document's name; continued lines joined."""
    found = []
    for document in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]:
        text = document.read_text(encoding="utf-8").replace("\\\n", " ")
        for line in re.findall(r"^(?: {4}|\$ )?(?:\.venv/bin/)?truewheel (.+)$", text, flags=re.MULTILINE):
            found.append((document.name, line))
    return found


@pytest.mark.parametrize(("document", "line"), documented_commands())
def test_every_command_that_a_document_shows_is_understood(document: str, line: str) -> None:
    arguments = shlex.split(line, comments=True)
    command: Any = get_command(app)
    context = None
    while hasattr(command, "resolve_command"):
        context = command.make_context(command.name, arguments, parent=context)
        rest = [*context._protected_args, *context.args]
        _, command, arguments = command.resolve_command(context, rest)
    # Parsed with all checks of options, not run.
    command.make_context(command.name, arguments, parent=context)
