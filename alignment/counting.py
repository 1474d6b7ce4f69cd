"""Numbers of things, as a person says them."""

from __future__ import annotations


def count_of(number: int, thing: str, things: str | None = None) -> str:
    """Return a number with its noun: "1 view", "3 views"; `things` is a plural that is not made by an s."""
    return f"{number} {thing if number == 1 else things or f'{thing}s'}"
