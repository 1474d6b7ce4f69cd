"""The names that a database knows: what may be asked for, and the refusal of what nobody has."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from sqlalchemy import select

from alignment.errors import InputError
from db.queries.filters import EVERYTHING, Characteristic, Filter, known_stations, matches
from db.queries.reader import ResultReader, question
from db.queries.summed import GroupBy, characteristic_moments, wheel_counts, yield_counts
from db.schema import cycles, plants, rigs, vehicle_type_limits, vehicles

_Names = Callable[[], Iterable[str]]
_TOLD = 20
_ROWS_FOR_EACH_VIN = 20


@dataclass(frozen=True)
class KnownNames:
    """Every name that a question can be about, each kind in the order of the alphabet.

    Attributes
    ----------
    stations
        That registered or have results.
    plants
        Of the stations.
    vehicle_types
        With results, or with limits at a station.
    wheels
        With results, and rigs of stations.
    characteristics
        That have values.
    vins
        Of the newest cycles, newest first.
    """

    stations: tuple[str, ...]
    plants: tuple[str, ...]
    vehicle_types: tuple[str, ...]
    wheels: tuple[str, ...]
    characteristics: tuple[Characteristic, ...]
    vins: tuple[str, ...]


def known_names(reader: ResultReader, newest: int = _TOLD) -> KnownNames:
    """Return what the database knows; VINs of the `newest` vehicles alone."""
    return KnownNames(
        _stations(reader),
        _plants(reader),
        _vehicle_types(reader),
        _wheels(reader),
        _characteristics(reader),
        newest_vins(reader, newest),
    )


def require_known(
    reader: ResultReader, where: Filter = EVERYTHING, characteristics: Sequence[Characteristic] = ()
) -> None:
    """Refuse a filter with a name that the database does not know: its answer would be an empty one.

    A name that is known and has no results in the period asked for is no mistake.

    Raises
    ------
    InputError
        Names those that exist.
    """
    _require("station", where.stations, lambda: _stations(reader))
    _require("plant", where.plants, lambda: _plants(reader))
    _require("type", where.vehicle_types, lambda: _vehicle_types(reader))
    _require("wheel", where.wheels, lambda: _wheels(reader))
    _require(
        "characteristic", [str(each) for each in characteristics], lambda: map(str, _characteristics(reader))
    )
    if where.vin is not None and not _has_vin(reader, where.vin):
        newest = newest_vins(reader, _TOLD)
        raise _unknown("vin", where.vin, newest, "the newest are " if newest else "")


def _require(choice: str, wanted: Iterable[str], known: _Names) -> None:
    asked = list(wanted)
    if not asked:
        return
    names = list(known())
    for name in asked:
        if name not in names:
            raise _unknown(choice, name, names)


def _unknown(choice: str, name: str, names: Sequence[str], what: str = "") -> InputError:
    alike = [known for known in names if known.casefold() == name.casefold()]
    close = alike or difflib.get_close_matches(name, names, 1)
    more = f", … ({len(names) - _TOLD} more)" if len(names) > _TOLD else ""
    told = f"{', '.join(names[:_TOLD])}{more}"
    return InputError(
        choice=choice,
        expected=f"one that is in the database: {what}{told}"
        if names
        else "one, and the database has none yet",
        seen=f"'{name}'" if name.isprintable() else ascii(name),
        cure=f"Did you mean '{close[0]}'?" if close else None,
    )


@question
def newest_vins(reader: ResultReader, newest: int) -> tuple[str, ...]:
    """Return the VINs of the newest vehicles, at most so many, newest first."""
    query = (
        select(vehicles.c.vin)
        .join(cycles, cycles.c.vehicle_id == vehicles.c.id)
        .order_by(cycles.c.id.desc())
        .limit(newest * _ROWS_FOR_EACH_VIN)
    )
    with reader.transaction() as connection:
        found = dict.fromkeys(connection.execute(query).scalars())
    return tuple(found)[:newest]


@question
def _has_vin(reader: ResultReader, pattern: str) -> bool:
    with reader.transaction() as connection:
        query = select(vehicles.c.id).where(matches(vehicles.c.vin, pattern)).limit(1)
        return connection.execute(query).first() is not None


@question
def _stations(reader: ResultReader) -> tuple[str, ...]:
    with reader.transaction() as connection:
        return tuple(known_stations(connection))


@question
def _plants(reader: ResultReader) -> tuple[str, ...]:
    with reader.transaction() as connection:
        return tuple(sorted(connection.execute(select(plants.c.name)).scalars()))


@question
def _vehicle_types(reader: ResultReader) -> tuple[str, ...]:
    counted = yield_counts(reader, by=(GroupBy.VEHICLE_TYPE,))
    found = {str(each.group[GroupBy.VEHICLE_TYPE]) for each in counted if each.group[GroupBy.VEHICLE_TYPE]}
    with reader.transaction() as connection:
        found |= set(connection.execute(select(vehicle_type_limits.c.vehicle_type).distinct()).scalars())
    return tuple(sorted(found))


@question
def _wheels(reader: ResultReader) -> tuple[str, ...]:
    found = {str(each.group[GroupBy.PART]) for each in wheel_counts(reader, by=(GroupBy.PART,))}
    with reader.transaction() as connection:
        found |= set(connection.execute(select(rigs.c.name).distinct()).scalars())
    return tuple(sorted(found))


def _characteristics(reader: ResultReader) -> tuple[Characteristic, ...]:
    return tuple(sorted({each.characteristic for each in characteristic_moments(reader)}))
