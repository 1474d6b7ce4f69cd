"""Values of a gauge study, and the lines of an uncertainty budget, in CSV files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from decimal import Decimal
from pathlib import Path

from alignment.errors import FormatError
from alignment.statistics import Component, Contribution
from sensors.formats import read_table


@dataclass(frozen=True)
class GaugeRow:
    """One measured value.

    Attributes
    ----------
    part, appraiser, trial
        What was measured, by whom, and for the how-manieth time, from 1; appraiser empty where there is none.
    value
        As it stands in the file, no digit lost.
    reference
        Certified value of the part, where the file has it.
    utc
        When, where the file has it.
    """

    part: str
    appraiser: str
    trial: int
    value: Decimal
    reference: Decimal | None = None
    utc: datetime | None = None


def read_gauge_file(path: Path, required: Sequence[str] = ("part", "value")) -> list[GaugeRow]:
    """Read the columns ``part``, ``appraiser``, ``trial``, ``value``, ``reference``, ``time`` of a table.

    Without the column ``trial`` values count in the order of the file; without ``part`` a certified value is
    a part, else all are of one.

    Raises
    ------
    FormatError
        For a table that is none, with file, line and column; also for a trial of a part and appraiser that
        stands there twice.
    OSError
        When the file cannot be read.
    """
    rows: list[GaugeRow] = []
    lines: dict[tuple[str, str, int], int] = {}
    counts: dict[tuple[str, str], int] = {}
    for line in read_table(path, required):
        needs_reference = "reference" in required or line.has("reference")
        reference = line.decimal("reference") if needs_reference else None
        named = next((name for name in ("part", "reference") if name in line.cells), None)
        part = "1" if named is None else line.text(named)
        appraiser = line.text("appraiser") if line.has("appraiser") else ""
        counts[part, appraiser] = counts.get((part, appraiser), 0) + 1
        trial = line.count("trial") if "trial" in line.cells else counts[part, appraiser]
        key = (part, appraiser, trial)
        if key in lines:
            raise FormatError(
                file=path,
                field=f"line {line.number}, column trial",
                expected="each trial of a part and appraiser once",
                seen=f"trial {trial} of part {part!r} again, as in line {lines[key]}",
            )
        lines[key] = line.number
        utc = line.time("time") if line.has("time") else None
        rows.append(GaugeRow(part, appraiser, trial, line.decimal("value"), reference, utc))
    return rows


def read_budget_file(path: Path) -> list[Component]:
    """Read the columns ``contribution`` (letters of VDA 5), ``u`` and, where it is, ``source``.

    Errors as `read_gauge_file`.
    """
    found = []
    for line in read_table(path, ("contribution", "u")):
        kind = line.text("contribution").upper()
        if kind not in set(Contribution):
            raise line.error("contribution", f"one of {', '.join(Contribution)}", kind)
        u = float(line.decimal("u"))
        if u < 0:
            raise line.error("u", "a standard uncertainty, 0 or more", line.cells["u"])
        source = line.text("source") if line.has("source") else ""
        found.append(Component(Contribution(kind), u, source))
    return found


def without_appraiser(rows: Sequence[GaugeRow]) -> bool:
    """Whether a study has fewer than two appraisers: type 3, the one for an automatic station."""
    return len({row.appraiser for row in rows}) < 2
