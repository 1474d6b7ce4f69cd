"""`truewheel camera health`: how the cameras of a station were, day by day."""

from __future__ import annotations

import math
from dataclasses import asdict, astuple
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Annotated

import typer

from alignment.errors import ConfigurationError
from station.commands.database import DatabaseOption
from station.commands.output import JsonFlag, print_json
from station.commands.selection import FromOption

if TYPE_CHECKING:
    from station.health import Trend

_MONTH_DAYS = 30.0
# From 1970 for a century: what lies beyond is no forecast.
_FIRST_DAY, _LAST_DAY = 0.0, 100 * 365.25


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
    limit: Annotated[
        list[str] | None,
        typer.Option(
            help="Say when a figure will reach a value: row_px=0.2. Several.",
            metavar="FIGURE=VALUE",
            show_default=False,
        ),
    ] = None,
    as_json: JsonFlag = False,
) -> None:
    """Show how the cameras were: temperature, failed shots, link, width and light of the lines, residual.

    Each figure as it was in the first shots after the calibration, as it is on the newest day, its extremes
    and its slope; what follows the camera's own temperature, per kelvin, and what drifts all the same. With
    --limit the day on which it will be reached, at the mean temperature, with 95 % confidence limits; nothing
    is said where the drift cannot be told from none. Without --from the last ninety days. A station warns of
    them by itself.
    """
    from db.queries import Filter, ResultReader, camera_trends, require_known, station_names
    from db.records import HOUR_S
    from station.health import trends
    from station.quality import print_table, read_time, terminal

    begin = read_time("from", from_time or "90d")
    assert begin is not None
    limits = _limits(limit or [])
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
                "trends": [_told(one, limits) for one in found],
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
    print_table(terminal(), [_row(one, limits) for one in found])


def _limits(given: list[str]) -> dict[str, float]:
    """Read ``row_px=0.2`` and its like.

    Raises
    ------
    ConfigurationError
        For another form, a figure that is none or is given twice, and a value that is no finite number.
    """
    from station.health import Figure

    found: dict[str, float] = {}
    for text in given:
        name, _, value = (part.strip() for part in text.partition("="))
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if name not in set(Figure) or name in found or not math.isfinite(number):
            raise ConfigurationError(
                choice="limit",
                expected=f"FIGURE=VALUE, each figure once, one of {', '.join(Figure)}, and a number",
                seen=f"'{text}'",
            )
        found[name] = number
    return found


def _reached(trend: Trend, limits: dict[str, float]) -> dict[str, str] | None:
    """Return the day on which a limit is reached, and its confidence limits; None when nobody can say.

    A limit that lies behind was reached, or is being left: the day says which.
    """
    if trend.figure not in limits or trend.drift is None:
        return None
    crossing = trend.drift.crossing(limits[trend.figure])
    if crossing is None or not all(_FIRST_DAY < day < _LAST_DAY for day in astuple(crossing)):
        return None
    return {name: _day(math.floor(day) * 24) for name, day in asdict(crossing).items()}


def _told(one: Trend, limits: dict[str, float]) -> dict[str, object]:
    """Return a trend as JSON has it."""
    return {
        "camera": one.camera,
        "figure": one.figure,
        "shots": one.shots,
        "first": one.first,
        "newest": one.newest,
        "minimum": one.minimum,
        "maximum": one.maximum,
        "per_month": one.per_month,
        "drift_per_month": None if one.drift is None else one.drift.slope * _MONTH_DAYS,
        "drift_per_month_deviation": None if one.drift is None else one.drift.slope_deviation * _MONTH_DAYS,
        "per_kelvin": None if one.drift is None else one.drift.per_kelvin,
        "per_kelvin_deviation": None if one.drift is None else one.drift.per_kelvin_deviation,
        "limit": limits.get(one.figure),
        "reached": _reached(one, limits),
        "days": [{"day": _day(start), "mean": mean} for start, mean in one.days],
    }


def _row(one: Trend, limits: dict[str, float]) -> dict[str, object]:
    """Return a trend as a person reads it."""
    row = {
        "camera": one.camera,
        "figure": one.figure,
        "shots": one.shots,
        "first": one.first,
        "newest": one.newest,
        "lowest": one.minimum,
        "highest": one.maximum,
        "per month": one.per_month,
        "drift per month": None if one.drift is None else one.drift.slope * _MONTH_DAYS,
        "per kelvin": None if one.drift is None else one.drift.per_kelvin,
    }
    return row | ({"limit reached": _in_words(_reached(one, limits))} if limits else {})


def _in_words(reached: dict[str, str] | None) -> str:
    return "" if reached is None else "{at} ({earliest} to {latest})".format(**reached)


def _day(start: int) -> str:
    return f"{datetime.fromtimestamp(start * 3600, UTC):%Y-%m-%d}"
