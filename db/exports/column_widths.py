"""Widths of the columns of a table on paper: what the texts ask for, never less than their longest word."""

from __future__ import annotations

from collections.abc import Callable, Sequence

Width = Callable[[str], float]


def asked_widths(
    head: Sequence[str], rows: Sequence[Sequence[str]], head_width: Width, cell_width: Width, most: float
) -> tuple[list[float], list[float]]:
    """What every column would like to have, and the least that breaks no word of it.

    Parameters
    ----------
    head, rows
        Texts; `head` may be empty.
    head_width, cell_width
        Width of a text on one line.
    most
        The least width of a column is never more: a single word may have no end.

    Returns
    -------
    natural, least
        One width per column, in the unit of the functions.
    """
    columns = len(head) or len(rows[0])
    natural, least = [], []
    for column in range(columns):
        cells = {row[column] for row in rows}
        words = {word for cell in cells for word in cell.split(" ")}
        heads = [head_width(word) for word in head[column].split(" ")] if head else []
        longest_word = max([*map(cell_width, words), *heads])
        whole_head = head_width(head[column]) if head else 0.0
        natural.append(max([*map(cell_width, cells), whole_head]))
        least.append(min(longest_word, most))
    return natural, least


def fitted_widths(natural: Sequence[float], least: Sequence[float], room: float) -> list[float] | None:
    """Share the room of a line: narrow columns get all they ask for, wide ones alike; None if it is short.

    Parameters
    ----------
    natural, least
        As `asked_widths` says.
    room
        Width of the page.
    """
    if sum(natural) <= room:
        return list(natural)
    if sum(least) > room:
        return None
    low, high = 0.0, max(natural)
    for _ in range(40):
        most = (low + high) / 2
        if sum(map(max, least, (min(width, most) for width in natural))) > room:
            high = most
        else:
            low = most
    return [max(small, min(width, low)) for small, width in zip(least, natural, strict=True)]


def column_blocks(least: Sequence[float], room: float) -> list[list[int]]:
    """Columns of the tables that one too wide for a page becomes: below each other, the first repeated."""
    blocks: list[list[int]] = [[0]]
    for column in range(1, len(least)):
        block = blocks[-1]
        if len(block) > 1 and sum(least[other] for other in block) + least[column] > room:
            blocks.append(block := [0])
        block.append(column)
    return blocks
