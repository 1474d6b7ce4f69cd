"""Rows of `camera_history`: added to while their hour and day last, thinned with age."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from sqlalchemy import Connection, RowMapping, bindparam, delete, select

from db.records import CameraFigure, CameraSerial
from db.rows.writing import row_id
from db.schema import camera_history, camera_serials, stations

_KEY = ("camera", "figure", "hours", "start")
_VALUES = ("n", "mean", "minimum", "maximum")
KEPT_HOURS = {1: 24 * 60, 24: 24 * 365 * 10}
"""How long hours and days are kept, in hours; the first shots after a calibration stay."""


def add_figures(connection: Connection, station: str, added: Iterable[CameraFigure]) -> None:
    """Join figures of spans with what is stored of them, and let go what is older than it is kept."""
    new: dict[tuple[str, str, int, int], CameraFigure] = {}
    for figure in added:
        known = new.get(figure.which)
        new[figure.which] = figure if known is None else known.joined(figure)
    if not new:
        return
    station_id = row_id(connection, stations, name=station)
    mine = camera_history.c.station_id == station_id
    stored: dict[tuple[str, str, int, int], CameraFigure] = {}
    # Few spans at a time, of all cameras; one by one, for which alone SQLite takes the index.
    for hours, start in {(figure.hours, figure.start) for figure in new.values()}:
        span = mine, camera_history.c.hours == hours, camera_history.c.start == start
        rows = connection.execute(select(camera_history).where(*span)).mappings()
        stored |= {found.which: found for found in map(figure_of, rows)}
    fresh = [_plain(figure, _KEY, _VALUES) for key, figure in new.items() if key not in stored]
    joined = [stored[key].joined(figure) for key, figure in new.items() if key in stored]
    if fresh:
        connection.execute(camera_history.insert(), [row | {"station_id": station_id} for row in fresh])
    if joined:
        same = [camera_history.c[name] == bindparam(f"its_{name}") for name in _KEY]
        changes = [
            _plain(figure, _VALUES) | {f"its_{name}": getattr(figure, name) for name in _KEY}
            for figure in joined
        ]
        connection.execute(camera_history.update().where(mine, *same), changes)
    _forget(connection, station_id, [figure.start for figure in new.values() if figure.hours == 1])


def _plain(figure: CameraFigure, *names: Sequence[str]) -> dict[str, str | int | float]:
    return {name: getattr(figure, name) for group in names for name in group}


def first_figures(connection: Connection, station: str) -> tuple[CameraFigure, ...]:
    """Of the first shots after each calibration of a station's cameras."""
    query = (
        select(camera_history)
        .join(stations, stations.c.id == camera_history.c.station_id)
        .where(stations.c.name == station, camera_history.c.hours == 0)
    )
    return tuple(figure_of(row) for row in connection.execute(query).mappings())


def _forget(connection: Connection, station_id: int, hours: Sequence[int]) -> None:
    if not hours:
        return
    # By the newest hour that is stored, not by a clock that may be wrong today.
    for span, kept in KEPT_HOURS.items():
        old = camera_history.c.hours == span, camera_history.c.start < max(hours) - kept
        connection.execute(delete(camera_history).where(camera_history.c.station_id == station_id, *old))


def figure_of(row: RowMapping) -> CameraFigure:
    """The record of a row."""
    return CameraFigure(**{name: row[name] for name in (*_KEY, *_VALUES)})


def add_serials(connection: Connection, station: str, added: Iterable[CameraSerial]) -> None:
    """Store which camera was seen first with each calibration; what is stored stays."""
    known = {(one.camera, one.calibration_id) for one in serials(connection, station)}
    new = [one for one in added if (one.camera, one.calibration_id) not in known]
    if new:
        station_id = row_id(connection, stations, name=station)
        rows = {
            (one.camera, one.calibration_id): {
                "station_id": station_id,
                "camera": one.camera,
                "calibration_id": one.calibration_id,
                "serial": one.serial,
            }
            for one in reversed(new)
        }
        connection.execute(camera_serials.insert(), [*rows.values()])


def serials(connection: Connection, station: str) -> tuple[CameraSerial, ...]:
    """Which cameras were seen first with each calibration of a station."""
    table = camera_serials.c
    query = (
        select(table.camera, table.calibration_id, table.serial)
        .join(stations, stations.c.id == table.station_id)
        .where(stations.c.name == station)
    )
    return tuple(CameraSerial(*row) for row in connection.execute(query))
