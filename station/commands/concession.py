"""`truewheel concession`: vehicles that are released although they are not ok."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from station.commands.database import DatabaseOption
from station.commands.output import JsonFlag, print_json, read_uuid

if TYPE_CHECKING:
    from db.records import StoredConcession

concession_app = typer.Typer(
    no_args_is_help=True,
    help="Concessions: a vehicle that is not ok is released by a person with a reason. The verdict stays; "
    "the concession stands beside it in reports, exports and certificates.",
)
VinArgument = Annotated[str, typer.Option(help="VIN of the vehicle.", show_default=False)]
PersonOption = Annotated[str, typer.Option(help="Who answers for it.", show_default=False)]
ReasonOption = Annotated[str, typer.Option(help="Why, for the record.", show_default=False)]


@concession_app.command("grant")
def grant_command(
    vin: VinArgument,
    person: PersonOption,
    reason: ReasonOption,
    database: DatabaseOption,
    cycle: Annotated[
        str | None,
        typer.Option(help="UUID of the cycle that was looked at.", show_default="the newest of the VIN"),
    ] = None,
    as_json: JsonFlag = False,
) -> None:
    """Release a vehicle whose newest result is NOK; any later measurement of it counts anew."""
    from datetime import UTC, datetime

    from station.quality import exceeded_in_words, grant

    wanted = None if cycle is None else read_uuid("--cycle", cycle)
    record = grant(database, vin, person, reason, datetime.now(UTC), wanted)
    if as_json:
        print_json(
            {
                "concession": str(record.uuid), "cycle": str(record.cycle), "person": record.person,
                "reason": record.reason, "exceeded": dict(record.exceeded),
            }
        )  # fmt: skip
        return
    typer.echo(f"{vin} is released by {record.person}, concession {record.uuid}")
    typer.echo(f"out of its limits, which stays its verdict: {exceeded_in_words(record.exceeded)}")


@concession_app.command("withdraw")
def withdraw_command(
    concession: Annotated[str, typer.Argument(help="UUID of the concession.", show_default=False)],
    person: PersonOption,
    reason: ReasonOption,
    database: DatabaseOption,
    as_json: JsonFlag = False,
) -> None:
    """Take a concession back: the vehicle is not released any more; both stay stored."""
    from datetime import UTC, datetime

    from station.quality import withdraw

    record = withdraw(database, read_uuid("CONCESSION", concession), person, reason, datetime.now(UTC))
    if as_json:
        print_json({"concession": str(record.concession), "withdrawn_utc": record.utc.isoformat()})
    else:
        typer.echo(f"concession {record.concession} is withdrawn by {record.person}")


@concession_app.command("list")
def list_command(vin: VinArgument, database: DatabaseOption, as_json: JsonFlag = False) -> None:
    """Show the concessions of a vehicle, withdrawn ones too, oldest first."""
    from db.queries import ResultReader, vin_history
    from station.quality import in_one_line

    with ResultReader(database) as reader:
        found = vin_history(reader, vin).concessions
    if as_json:
        print_json({"concessions": [_as_json(stored) for stored in found]})
        return
    for stored in found:
        typer.echo(in_one_line(stored))
    if not found:
        typer.echo(f"no concession of {vin}")


def _as_json(stored: StoredConcession) -> dict[str, Any]:
    record, ended = stored.record, stored.withdrawal
    return {
        "concession": str(record.uuid),
        "cycle": str(record.cycle),
        "utc": record.utc.isoformat(),
        "person": record.person,
        "reason": record.reason,
        "exceeded": dict(record.exceeded),
        "in_force": stored.in_force,
        "withdrawn_utc": None if ended is None else ended.utc.isoformat(),
        "withdrawn_by": None if ended is None else ended.person,
        "withdrawn_reason": None if ended is None else ended.reason,
    }
