"""`truewheel db`: the result database."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from station.commands.output import GOAL_MISSED, JsonFlag, print_json

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


@db_app.command()
def check(
    database: DatabaseOption,
    days: Annotated[
        float, typer.Option(min=0.0, help="Compare sums with the results of so many days before the newest.")
    ] = 7.0,
    everything: Annotated[bool, typer.Option("--all", help="Compare the sums of all days.")] = False,
    as_json: JsonFlag = False,
) -> None:
    """Look for damage, gaps, missing records and sums that disagree; changes nothing."""
    from db.check import check_database

    report = check_database(database, None if everything else days)
    if as_json:
        print_json(
            {
                "revision": report.revision,
                "findings": list(report.findings),
                "figures": {
                    "cycles": report.cycles,
                    "wheels": report.wheels,
                    "cycles_not_in_sums": report.behind,
                    "records_to_ship": report.pending,
                    "findings": len(report.findings),
                },
            }
        )
    else:
        typer.echo(f"revision {report.revision}: {report.cycles:,} cycles, {report.wheels:,} wheels")
        if report.pending:
            typer.echo(f"{report.pending:,} records wait to be shipped")
        if report.behind:
            typer.echo(f"{report.behind:,} cycles are not in the sums yet: run `truewheel db sums`")
        for finding in report.findings:
            typer.echo(finding)
        typer.echo("nothing is wrong" if not report.findings else f"{len(report.findings)} findings")
    if report.findings:
        raise typer.Exit(GOAL_MISSED)


@db_app.command()
def backup(
    database: DatabaseOption,
    out: Annotated[Path, typer.Option(help="New file for the copy.", show_default=False)],
    as_json: JsonFlag = False,
) -> None:
    """Copy the database as it is now, while stations go on writing."""
    from db.backup import backup as make

    make(database, out)
    size = out.stat().st_size
    if as_json:
        print_json({"file": str(out), "figures": {"bytes": size}})
    else:
        typer.echo(f"wrote {out}, {size / 1e6:.1f} MB")


@db_app.command()
def restore(
    file: Annotated[Path, typer.Argument(help="A copy that `truewheel db backup` made.", show_default=False)],
    database: DatabaseOption,
    as_json: JsonFlag = False,
) -> None:
    """Make a database out of a copy; there must be none, or an empty one. Then migrate it if need be."""
    from db.backup import restore as make
    from db.migrate import current_revision

    make(file, database)
    revision = current_revision(database)
    if as_json:
        print_json({"revision": revision})
    else:
        typer.echo(f"restored at revision {revision}")


@db_app.command()
def sums(
    database: DatabaseOption,
    rebuild: Annotated[bool, typer.Option(help="Forget all sums first, and build them again.")] = False,
    as_json: JsonFlag = False,
) -> None:
    """Bring the sums that make reports fast up to date with the results; a station does so by itself."""
    from db.engine import describe, make_engine, parse_url
    from db.failures import store_errors
    from db.migrate import check_revision, require_file
    from db.sums import bring_up_to_date, forget_sums

    url = parse_url(database)
    require_file(url)
    engine = make_engine(url, timeout_s=3600.0)
    try:
        with store_errors(describe(url)):
            with engine.connect() as connection:
                check_revision(connection, describe(url))
            if rebuild:
                forget_sums(engine)
            added = bring_up_to_date(engine)
    finally:
        engine.dispose()
    if as_json:
        print_json({"figures": {"cycles_added": added}})
    else:
        typer.echo(f"added {added:,} cycles to the sums")
