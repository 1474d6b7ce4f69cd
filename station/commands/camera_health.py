"""`truewheel camera health`: how the cameras of a station were, day by day."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Annotated

import typer

from station.commands.database import DatabaseOption
from station.commands.output import JsonFlag, print_json
from station.commands.selection import FromOption


def camera_health(
    database: DatabaseOption,
    station: Annotated[
        str | None,
        typer.Option(help="Whose cameras; needed where there is more than one.", show_default=False),
    ] = None,
    camera: Annotated[
        str | None,
        typer.Option(
            help="Only this camera, or those whose names begin so: front_left, front_left/head_2.",
            show_default=False,
        ),
    ] = None,
    from_time: FromOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Show how the cameras were: temperature, failed shots, link, width and light of the lines, residual.

    Each figure as it was in the first shots after the calibration, as it is on the newest day, its extremes
    and its slope. Without --from the last ninety days. A station warns of them by itself.
    """
    from db.queries import Filter, ResultReader, camera_trends, require_known, station_names
    from db.records import HOUR_S
    from station.health import trends
    from station.quality import print_table, read_time, terminal

    begin = read_time("from", from_time or "90d")
    assert begin is not None
    with ResultReader(database) as reader:
        known = station_names(reader)
        if station is None and len(known) == 1:
            [station] = known
        name = "" if station is None else station
        require_known(reader, Filter(stations=(name,)))
        hour = int(begin.timestamp() // HOUR_S)
        found = trends(camera_trends(reader, name, camera=camera, from_hour=hour - hour % 24))
    if as_json:
        print_json(
            {
                "station": name,
                "trends": [
                    {
                        "camera": one.camera,
                        "figure": one.figure,
                        "shots": one.shots,
                        "first": one.first,
                        "newest": one.newest,
                        "minimum": one.minimum,
                        "maximum": one.maximum,
                        "per_month": one.per_month,
                        "days": [{"day": _day(start), "mean": mean} for start, mean in one.days],
                    }
                    for one in found
                ],
                "figures": {
                    "cameras": len({one.camera for one in found}),
                    "trends": len(found),
                    "shots": max((one.shots for one in found), default=0),
                },
            }
        )
        return
    if not found:
        typer.echo(f"nothing is stored of cameras of {name} since {begin:%Y-%m-%d}")
        return
    rows = [
        {
            "camera": one.camera,
            "figure": one.figure,
            "shots": one.shots,
            "first": one.first,
            "newest": one.newest,
            "lowest": one.minimum,
            "highest": one.maximum,
            "per month": one.per_month,
        }
        for one in found
    ]
    print_table(terminal(), rows)


def _day(start: int) -> str:
    return f"{datetime.fromtimestamp(start * 3600, UTC):%Y-%m-%d}"
