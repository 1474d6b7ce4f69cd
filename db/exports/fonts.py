"""Which font shows a character: the one that comes with the plots, another one of this machine, or none.

A character without a glyph would be an empty box or nothing; it is named instead, by its code point:
``[U+7D27]``.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import matplotlib
from fontTools.ttLib import TTFont, TTLibError
from matplotlib.font_manager import findSystemFonts

_FOLDER = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
REGULAR, BOLD = _FOLDER / "DejaVuSans.ttf", _FOLDER / "DejaVuSans-Bold.ttf"
"""Latin, Greek, Cyrillic, Arabic, Hebrew and the signs of mathematics."""
_MOST_FONTS = 500
_LARGEST_BYTES = 64 << 20
# Fonts of boxes and blanks, which have a "glyph" for everything.
_PLACEHOLDERS = ("lastresort", "adobeblank", "notdef", "tofu")


@cache
def glyphs_of(path: Path) -> frozenset[int]:
    """Code points that a font shows; none of a file that is no font."""
    try:
        with path.open("rb") as stream, TTFont(stream, fontNumber=0, lazy=True) as font:
            return frozenset(font.getBestCmap() or ())
    except (TTLibError, OSError, ValueError, KeyError, AssertionError):
        return frozenset()


@cache
def other_fonts() -> tuple[Path, ...]:
    """The other fonts that may be asked: first those beside the plots, then those of the machine, by name."""
    found = [
        Path(name) for name in findSystemFonts() if Path(name).suffix.lower() in (".ttf", ".otf", ".ttc")
    ]
    of_machine = sorted(
        path
        for path in found
        if not any(word in path.name.lower() for word in _PLACEHOLDERS)
        and path.is_file()
        and path.stat().st_size <= _LARGEST_BYTES
    )
    return (REGULAR, _FOLDER / "STIXGeneral.ttf", *of_machine[:_MOST_FONTS])


def font_with(character: str) -> Path | None:
    """Another font that shows the character; None where no font here does."""
    return next((path for path in other_fonts() if ord(character) in glyphs_of(path)), None)


def printable(text: str) -> str:
    """The text on one line; what no paper can show becomes a blank."""
    return "".join(character if character.isprintable() else " " for character in text)


def named(character: str) -> str:
    """What stands for a character that no font shows."""
    return f"[U+{ord(character):04X}]"


def picture_text(text: str) -> str:
    """Text as pictures show it: characters without a glyph named, and a dollar a dollar, not mathematics."""
    known = glyphs_of(REGULAR)
    shown = (character if ord(character) in known else named(character) for character in printable(text))
    return "".join(shown).replace("$", r"\$")
