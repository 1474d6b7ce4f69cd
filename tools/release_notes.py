"""Makes the notes of a release from CHANGELOG.md: `python -m tools.release_notes [VERSION]`.

What the changelog says of the version, word for word, and behind it what a plant asks before an upgrade: the
interface of the line, the database revision, the recorded formats. Without a version that of pyproject.toml;
`Unreleased` shows what the next one would say.
"""

from __future__ import annotations

import argparse
import re
import sys
import tomllib
from dataclasses import dataclass
from datetime import date

from station.running import Parts, parts_of_program
from tools.wheel import ROOT

UNRELEASED = "Unreleased"
_HEADING = re.compile(r"## \[?(?P<version>[^\s\]]+)\]?(?: [-–—] (?P<date>\S+))?")


@dataclass(frozen=True)
class Section:
    """What the changelog says of one version; the date None while it is not released."""

    version: str
    released: date | None
    text: str


def refusal(text: str) -> SystemExit:
    """Say what is wrong; the program ends with status 2."""
    print(f"tools.release_notes: {text}", file=sys.stderr)
    return SystemExit(2)


def sections(changelog: str) -> list[Section]:
    """Return the versions of a changelog as *Keep a Changelog* has it, in its order.

    Raises
    ------
    SystemExit
        When a heading of the second level names no version with its date, or one twice.
    """
    found: list[tuple[str, date | None, list[str]]] = []
    fenced = False
    for number, line in enumerate(changelog.splitlines(), start=1):
        fenced ^= line.startswith("```")
        if line.startswith("## ") and not fenced:
            version, released = _heading(line, number)
            if any(version == known for known, _, _ in found):
                raise refusal(
                    f"CHANGELOG.md, line {number}: expected each version once, found {version} again"
                )
            found.append((version, released, []))
        elif found:
            found[-1][2].append(line)
    return [Section(version, released, "\n".join(lines).strip()) for version, released, lines in found]


def _heading(line: str, number: int) -> tuple[str, date | None]:
    match = _HEADING.fullmatch(line.rstrip())
    try:
        if match is None:
            raise ValueError(line)
        version, stated = match["version"], match["date"]
        if (version == UNRELEASED) != (stated is None):
            raise ValueError(line)
        return version, None if stated is None else date.fromisoformat(stated)
    except ValueError:
        raise refusal(
            f"CHANGELOG.md, line {number}: expected `## {UNRELEASED}` or `## VERSION - YYYY-MM-DD`, found"
            f" '{line[:80]}'"
        ) from None


def notes(section: Section, parts: Parts) -> str:
    """Return the notes of a release as Markdown.

    Raises
    ------
    SystemExit
        When the changelog says nothing of the version.
    """
    if not section.text:
        raise refusal(
            f"CHANGELOG.md: expected what changed in {section.version}, found nothing under its heading"
        )
    when = f", {section.released.isoformat()}" if section.released else ""
    formats = ", ".join(f"`{text}`" for one in parts.formats.values() for text in one)
    return "\n".join(
        [
            f"# Truewheel {section.version}{when}",
            "",
            section.text,
            "",
            "### Before an upgrade",
            "",
            f"- Interface of the line: {parts.interface or 'unknown'}",
            f"- Database revision: {parts.database}",
            f"- Recorded formats that are read: {formats}",
            "",
        ]
    )


def main() -> None:
    """Print the notes of one version."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    parser = argparse.ArgumentParser(description="Print the notes of a release, from CHANGELOG.md.")
    parser.add_argument(
        "version", nargs="?", default=project["version"], help="or Unreleased [pyproject.toml's]"
    )
    asked = parser.parse_args().version
    known = sections((ROOT / "CHANGELOG.md").read_text(encoding="utf-8"))
    section = next((one for one in known if one.version == asked), None)
    if section is None:
        seen = ", ".join(one.version for one in known)
        raise refusal(f"CHANGELOG.md: expected a section of version {asked}, found those of {seen}")
    print(notes(section, parts_of_program()), end="")


if __name__ == "__main__":
    main()
