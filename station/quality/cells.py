"""What a person reads of a value: decimals and unit follow from the name of its column."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from db.exports import MINUS

_UNITS = {
    "deg": "°", "arcmin": "′", "percent": "%", "ppm": "ppm", "mm": "mm", "um": "µm", "px": "px", "s": "s",
    "min": "min",
}  # fmt: skip
_DECIMALS = {"deg": 4, "arcmin": 3, "percent": 1, "mm": 3, "px": 3, "min": 1}
_INDICES = ("cp", "cpk", "pp", "ppk")
_CHANCES = ("p", "normality_p")
_DIGITS = 5


def heading(name: str) -> str:
    """The name of a column or figure in words, its unit in brackets."""
    words = name.split("_")
    if len(words) > 1 and words[-1] in _UNITS:
        return f"{' '.join(words[:-1])} [{_UNITS[words[-1]]}]"
    return " ".join(words)


def shown(name: str, value: object) -> str:
    """A value as a person reads it; a dash for none.

    Parameters
    ----------
    name
        Of its column or figure, with its unit: ``mean_deg`` has four decimals, ``cpk_low`` two.
    value
        Floats have the decimals of their name, or five digits where it has none, and never an exponent.
    """
    if value is None or value == "":
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if not isinstance(value, float | np.floating):
        return str(value)
    return _number(name.split("_"), float(value)) if math.isfinite(value) else "–"


def on_paper(name: str, value: object) -> str:
    """The same with a minus where numbers have one: for pages that nobody pipes into a program."""
    text = shown(name, value)
    number = isinstance(value, float | int | np.floating) and text.startswith("-")
    return MINUS + text[1:] if number else text


def is_number_column(values: Iterable[object]) -> bool:
    """Whether a column is one of numbers, which stand to the right."""
    known = [value for value in values if value is not None and value != ""]
    return bool(known) and all(
        isinstance(value, float | int | np.number) and not isinstance(value, bool) for value in known
    )


def _number(words: Sequence[str], value: float) -> str:
    name, unit = "_".join(words), words[-1]
    if name in _CHANCES:
        return "<0.0001" if 0.0 <= value < 1e-4 else _unsigned(f"{value:.4f}")
    if any(word in _INDICES for word in words):
        return _unsigned(f"{value:.2f}")
    if unit in _DECIMALS:
        # What has less than a tenth of the last decimal is told by its digits: it is not zero.
        decimals = _DECIMALS[unit]
        if value == 0.0 or abs(value) >= 0.5 * 10.0**-decimals:
            return _unsigned(f"{value:.{decimals}f}")
        return np.format_float_positional(value, precision=2, fractional=False, trim="-")
    if unit == "ppm":
        return f"{value:.0f}" if value >= 100 else np.format_float_positional(
            value, precision=3, fractional=False, trim="-"
        )  # fmt: skip
    return np.format_float_positional(value, precision=_DIGITS, fractional=False, trim="-")


def _unsigned(text: str) -> str:
    """A zero without the sign of what was rounded away."""
    return text.removeprefix("-") if not text.strip("-0.") else text
