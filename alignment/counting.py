"""Numbers of things, as a person says them."""

from __future__ import annotations

from collections.abc import Iterable


def count_of(number: int, thing: str, things: str | None = None) -> str:
    """Return a number with its noun: "1 view", "3 views"; `things` is a plural that is not made by an s."""
    return f"{number} {thing if number == 1 else things or f'{thing}s'}"


def listed(things: Iterable[object]) -> str:
    """Return things with commas between: "head_1, head_2"; "none" when there are none."""
    return ", ".join(map(str, things)) or "none"
