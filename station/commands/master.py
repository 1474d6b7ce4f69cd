"""`truewheel master`: what a failed master check left, and who answers for it."""

from __future__ import annotations

from typing import Annotated

import typer

from alignment.counting import count_of
from station.commands.database import DatabaseOption
from station.commands.output import JsonFlag, print_json
from station.commands.outputs import ready_database
from station.commands.person import PersonOption

master_app = typer.Typer(
    no_args_is_help=True,
    help="Master checks: the vehicles that a failed one left in doubt. `truewheel report since-check` lists "
    "them.",
)


@master_app.command("release")
def release_command(
    database: DatabaseOption,
    station: Annotated[str, typer.Option(help="Identity of the station.", show_default=False)],
    person: PersonOption,
    reason: Annotated[
        str, typer.Option(help="Why these vehicles are good, for the record.", show_default=False)
    ],
    vin: Annotated[
        list[str] | None, typer.Option(help="Only this vehicle. Several.", show_default=False)
    ] = None,
    as_json: JsonFlag = False,
) -> None:
    """Close the doubt about vehicles: a person answers for them. No verdict changes.

    The station is ready again by a good master check alone.
    """
    from datetime import UTC, datetime

    from db.store import ResultStore
    from db.upkeep import release_doubts

    ready_database(database)
    with ResultStore(database) as store:
        released = release_doubts(store, station, person, reason, datetime.now(UTC), vin or ())
    if as_json:
        print_json({"station": station, "released": list(released), "figures": {"vehicles": len(released)}})
    else:
        typer.echo(f"released {count_of(len(released), 'vehicle')} of {station}: {', '.join(released)}")
