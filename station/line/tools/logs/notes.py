"""What a reader of a log could not read, counted and told."""

from __future__ import annotations

from dataclasses import dataclass, field

_MOST_KINDS = 20


class DamageError(Exception):
    """A log cannot be read beyond a place; `where` is a line or a byte of the file."""

    def __init__(self, where: str, seen: str, cure: str | None = None) -> None:
        super().__init__(f"{where}: {seen}")
        self.where = where
        self.seen = seen
        self.cure = cure


@dataclass
class Notes:
    """What was passed over, by kind: how often, and where first; and what else is to be known.

    Attributes
    ----------
    skipped
        Frames that were lost: number and first place of each kind.
    remarks
        Sentences about the file as a whole.
    """

    skipped: dict[str, tuple[int, str]] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)

    def skip(self, where: str, what: str) -> None:
        """Count something that looks like a frame and cannot be read."""
        if what not in self.skipped and len(self.skipped) >= _MOST_KINDS:
            what = "something else"
        number, first = self.skipped.get(what, (0, where))
        self.skipped[what] = number + 1, first

    def remark(self, sentence: str) -> None:
        """Keep a sentence about the file, once."""
        if sentence not in self.remarks:
            self.remarks.append(sentence)

    @property
    def lost(self) -> int:
        """Number of frames that could not be read."""
        return sum(number for number, _ in self.skipped.values())

    def __str__(self) -> str:
        told = [
            f"{number} skipped: {what} (first at {first})" for what, (number, first) in self.skipped.items()
        ]
        return "; ".join([*told, *self.remarks])
