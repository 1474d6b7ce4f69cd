"""How cameras were over time."""

from __future__ import annotations

from sqlalchemy import ColumnElement, select

from db.queries.reader import ResultReader, question
from db.records import CameraFigure
from db.rows import figure_of
from db.schema import camera_history, stations


@question
def camera_trends(
    reader: ResultReader, station: str, *, camera: str | None = None, from_hour: int | None = None
) -> tuple[CameraFigure, ...]:
    """Figures of the cameras of a station, by camera, figure and time; of the first shots come first.

    Parameters
    ----------
    station
        Its name.
    camera
        Only of this one, or of those whose names begin so: a rig, a head.
    from_hour
        Hours and days from then on (whole hours since 1970); first shots in any case.
    """
    table = camera_history.c
    conditions: list[ColumnElement[bool]] = [stations.c.name == station]
    if camera is not None:
        conditions.append(table.camera.startswith(camera, autoescape=True))
    if from_hour is not None:
        conditions.append((table.start >= from_hour) | (table.hours == 0))
    query = select(camera_history).join(stations, stations.c.id == table.station_id).where(*conditions)
    query = query.order_by(table.camera, table.figure, table.hours, table.start)
    with reader.transaction() as connection:
        return tuple(figure_of(row) for row in connection.execute(query).mappings())
