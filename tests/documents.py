"""The README and the documents: their fenced snippets, so that each is run or proven by somebody."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
_FENCE = re.compile(r"^```([^\n`]*)\n(.*?)^```[ \t]*$", re.MULTILINE | re.DOTALL)


@dataclass(frozen=True)
class Fence:
    """A fenced snippet; `number` counts those of a language in a document."""

    document: Path
    line: int
    language: str
    number: int
    text: str

    @property
    def name(self) -> str:
        return f"{self.document.relative_to(ROOT)}:{self.line}"


def fences(document: Path) -> list[Fence]:
    """All fenced snippets of a document, in their order."""
    text = document.read_text(encoding="utf-8")
    found: list[Fence] = []
    for match in _FENCE.finditer(text):
        language = match[1].strip()
        number = sum(fence.language == language for fence in found)
        line = text.count("\n", 0, match.start()) + 1
        found.append(Fence(document, line, language, number, match[2]))
    marks = len(re.findall(r"^ *```", text, re.MULTILINE))
    assert marks == 2 * len(found), f"{document.name} has a fence that does not end, or is indented"
    return found


def snippets(document: str, language: str) -> list[str]:
    """Texts of a document's snippets in one language."""
    return [fence.text for fence in fences(ROOT / document) if fence.language == language]
