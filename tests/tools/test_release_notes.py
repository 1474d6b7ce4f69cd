"""Notes of a release: the changelog's words, and a changelog that cannot be read is said to be so."""

from __future__ import annotations

from datetime import date

import pytest

from station.running import parts_of_program
from tools.release_notes import Section, notes, sections
from tools.wheel import ROOT

CHANGELOG = """# Changelog

Whatever stands here.

## Unreleased

- Next.

## 0.2.0 - 2026-12-01

### Gained

- A thing.

```
## no heading
```

## [0.1.0] - 2026-11-01

"""


def test_each_version_has_its_own_words() -> None:
    unreleased, second, first = sections(CHANGELOG)
    assert unreleased == Section("Unreleased", None, "- Next.")
    assert (second.version, second.released) == ("0.2.0", date(2026, 12, 1))
    assert second.text == "### Gained\n\n- A thing.\n\n```\n## no heading\n```"
    assert (first.version, first.text) == ("0.1.0", "")


@pytest.mark.parametrize(
    "heading",
    ["## 0.3.0", "## Unreleased - 2026-01-01", "## 0.3.0 - yesterday", "## 0.3 0 - 2026-01-01", "## "],
)
def test_a_heading_that_is_no_version_with_its_date_is_refused(
    heading: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as end:
        sections(f"# Changelog\n\n{heading}\n")
    assert end.value.code == 2
    assert "CHANGELOG.md, line 3: expected" in capsys.readouterr().err


def test_a_version_twice_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        sections("## 0.2.0 - 2026-12-01\n- a\n## [0.2.0] - 2026-12-02\n- b\n")
    assert "line 3: expected each version once" in capsys.readouterr().err


def test_a_version_without_words_makes_no_notes(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        notes(sections(CHANGELOG)[-1], parts_of_program())
    assert "0.1.0, found nothing" in capsys.readouterr().err


def test_notes_of_the_project_s_own_changelog_hold_all_of_it() -> None:
    known = sections((ROOT / "CHANGELOG.md").read_text(encoding="utf-8"))
    parts = parts_of_program()
    text = notes(known[0], parts)
    assert known[0].text in text
    assert f"Database revision: {parts.database}" in text
    assert f"Interface of the line: {parts.interface}" in text
