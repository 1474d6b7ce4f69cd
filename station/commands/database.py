"""`truewheel db`: the result database."""

from __future__ import annotations

from typing import Annotated

import typer

from station.commands.output import JsonFlag, print_json

db_app = typer.Typer(no_args_is_help=True, help="The result database.")

DatabaseOption = Annotated[
    str,
    typer.Option("--database", help="sqlite:///FILE or postgresql://USER@HOST/DATABASE.", show_default=False),
]


@db_app.command()
def migrate(database: DatabaseOption, as_json: JsonFlag = False) -> None:
    """Create the database, or bring it to this program's schema; nothing stored is lost."""
    from db import migrate as migration

    revision = migration.migrate(database)
    if as_json:
        print_json({"revision": revision})
    else:
        typer.echo(f"the database is at revision {revision}")
