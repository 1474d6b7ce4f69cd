"""Where the values of a gauge study come from: a file, or the result database."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Any

from alignment.errors import ConfigurationError, DegenerateInputError
from db.records import GaugeValueRecord, StoredGaugeStudy, StudyKind
from station.quality.gauge.file import GaugeRow, read_gauge_file
from station.quality.gauge.store import RADIANS, load_gauge_study, store_rows

GAUGE_COLUMNS: Mapping[StudyKind, tuple[str, ...]] = {
    StudyKind.TYPE1: ("value",),
    StudyKind.GRR: ("part", "value"),
    StudyKind.LINEARITY: ("reference", "value"),
    StudyKind.STABILITY: ("value",),
}
"""What a file of each study needs at least."""
DEGREES = "deg"


@dataclass(frozen=True)
class GaugeSource:
    """Values with what is known of them.

    Attributes
    ----------
    name
        For a person: the file, or the study with its UUID.
    rows
        The values; angles from the station in degrees.
    unit
        Of the values.
    plan
        Numbers that belong to the study, in the unit of the values: tolerance, reference.
    """

    name: str
    rows: Sequence[GaugeRow]
    unit: str
    plan: Mapping[str, Any]

    @contextmanager
    def named_in_errors(self) -> Iterator[None]:
        """Say in an error of the analysis whose values they were."""
        try:
            yield
        except DegenerateInputError as error:
            raise DegenerateInputError(
                file=self.name,
                field=error.field,
                expected=error.expected,
                seen=error.seen,
                cure=error.cure,
                remedy=error.remedy,
            ) from error

    def number(self, name: str, given: float | None) -> float | None:
        """A number of the command line, else of the study."""
        found = self.plan.get(name) if given is None else given
        return None if found is None else float(found)

    def required(self, name: str, given: float | None) -> float:
        """The same, for one that the study cannot do without.

        Raises
        ------
        ConfigurationError
            When neither has it.
        """
        found = self.number(name, given)
        if found is None:
            raise ConfigurationError(choice=name, expected="a number", seen="none")
        return found


def open_source(
    kind: StudyKind,
    file: Path | None,
    database: str | None,
    study: str | None,
    name: str | None,
    unit: str,
    plan: Mapping[str, float | None],
) -> GaugeSource:
    """Read the values; those of a file are stored first when a name is given, and then read back.

    Raises
    ------
    ConfigurationError
        When the choices contradict each other.
    FormatError
        For a file that is no table of values.
    StoreError
        When the database fails or has no such study.
    """
    if (file is None) == (study is None):
        raise ConfigurationError(
            choice="from file, study", expected="one of both", seen="none" if file is None else "both"
        )
    if database is None and (study is not None or name is not None):
        raise ConfigurationError(choice="database", expected="the database of the study", seen="none")
    if database is not None and file is not None and name is None:
        raise ConfigurationError(choice="name", expected="a name under which to keep the study", seen="none")
    if file is not None:
        rows = read_gauge_file(file, GAUGE_COLUMNS[kind])
        if database is None or name is None:
            return GaugeSource(str(file), rows, unit, plan)
        return source_of(store_rows(database, kind, name, rows, unit, plan, str(file)))
    assert database is not None
    assert study is not None
    return source_of(load_gauge_study(database, kind, study))


def source_of(stored: StoredGaugeStudy) -> GaugeSource:
    """A stored study as it is analysed: always from the stored values, so the figures can be had again."""
    plan, record = stored.record.plan, stored.record
    unit = str(plan.get("unit", ""))
    references = plan.get("references", {})
    in_degrees = unit == RADIANS

    def shown(value: float) -> Decimal:
        return Decimal(repr(math.degrees(value) if in_degrees else value))

    rows = [
        GaugeRow(
            value.part,
            value.appraiser,
            value.trial,
            shown(value.value),
            shown(references[value.part]) if value.part in references else None,
            value.utc,
        )
        for value in sorted(stored.values, key=_in_natural_order)
    ]
    numbers = {
        name: float(shown(plan[name]))
        for name in ("tolerance", "reference")
        if isinstance(plan.get(name), int | float)
    }
    return GaugeSource(
        f"study {record.name!r} ({record.uuid}), {record.characteristic}",
        rows,
        DEGREES if in_degrees else unit,
        numbers,
    )


def _in_natural_order(value: GaugeValueRecord) -> tuple[list[tuple[int, str]], str, int]:
    """Part 2 before part 10."""
    pieces = re.findall(r"\d+|\D+", value.part)
    numbered = [(int(piece), "") if piece.isdecimal() else (-1, piece) for piece in pieces]
    return numbered, value.appraiser, value.trial
