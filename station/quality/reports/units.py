"""Angles in degrees, lengths in millimetres: each table and picture of a report has one of both."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from alignment.statistics import Moments
from db.queries import Characteristic, CharacteristicMoments
from db.records import QUANTITIES, Unit
from station.quality.reports.report import Section


def unit_of(characteristic: Characteristic) -> Unit:
    """The unit in which people read a characteristic."""
    return QUANTITIES[characteristic.quantity].unit


def in_unit(value: float | None, unit: Unit) -> float | None:
    """A stored value, radians or millimetres, as people read it."""
    return None if value is None else unit.factor * value


def moments_in_unit(found: CharacteristicMoments) -> Moments:
    """The moments of stored values in the unit of their characteristic."""
    factor = unit_of(found.characteristic).factor
    # Of equal values rounding may leave squares in the sums; they have none.
    squares = found.m2 * factor**2 if found.maximum > found.minimum else 0.0
    return Moments(found.n, found.mean * factor, squares, found.minimum * factor, found.maximum * factor)


def by_unit(asked: Sequence[Characteristic], make: Callable[[Unit], Sequence[Section]]) -> list[Section]:
    """Sections of angles, and beside them those of lengths where these were asked for or have rows.

    Parameters
    ----------
    asked
        Characteristics; none means all.
    make
        Sections of one unit.
    """
    units = sorted({unit_of(each) for each in asked} or set(Unit))
    found = {unit: list(make(unit)) for unit in units}
    if len(units) == 1:
        return found[units[0]]
    lengths = found[Unit.MILLIMETRES]
    if not asked and not any(section.rows for section in lengths):
        return found[Unit.DEGREES]
    return found[Unit.DEGREES] + [
        replace(
            section,
            name=f"{section.name}_lengths",
            title=f"{section.title}: lengths",
            figures={f"lengths_{name}": value for name, value in section.figures.items()},
        )
        for section in lengths
    ]
