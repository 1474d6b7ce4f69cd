"""`truewheel db`: the result database."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from alignment.counting import count_of
from alignment.errors import ConfigurationError, TruewheelError
from station.commands.output import GOAL_MISSED, JsonFlag, print_json
from station.commands.outputs import ready_file
from station.commands.words import remedy_in_commands
from station.configuration import default_config

db_app = typer.Typer(no_args_is_help=True, help="The result database.")

DATABASE_VARIABLE = "TRUEWHEEL_DATABASE"


def own_database() -> str:
    """Return the URL of the database of this folder's station, for who names none.

    Raises
    ------
    ConfigurationError
        When there is no configuration here, or it is not sound.
    """
    from station.configuration import own_configuration, read_configuration

    found = own_configuration()
    if found is None:
        raise ConfigurationError(
            choice="database",
            expected="the URL of a result database",
            seen="none, and no station's configuration in this folder",
            cure=f"Name it, or set the environment variable {DATABASE_VARIABLE}",
        )
    return read_configuration(found).database_url


DatabaseOption = Annotated[
    str,
    typer.Option(
        "--database",
        help="sqlite:///FILE or postgresql://USER@HOST/DATABASE; without it, that of this folder's station.",
        envvar=DATABASE_VARIABLE,
        default_factory=own_database,
        show_default=False,
    ),
]


@db_app.command()
def migrate(database: DatabaseOption, as_json: JsonFlag = False) -> None:
    """Create the database, or bring it to this program's schema; nothing stored is lost."""
    from db.connection import migrate as migrate_database

    revision = migrate_database(database)
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
    everything: Annotated[
        bool, typer.Option("--all", help="Compare the sums of all days, and every row with its hash.")
    ] = False,
    as_json: JsonFlag = False,
) -> None:
    """Look for damage, gaps, missing records and sums that disagree; changes nothing."""
    from db.upkeep import check_database

    report = check_database(database, None if everything else days)
    waiting = report.pending if report.ships or _has_central(database) else None
    if as_json:
        print_json(
            {
                "revision": report.revision,
                "findings": list(report.findings),
                "remedies": [remedy_in_commands(remedy) for remedy in report.remedies],
                "chains": {
                    name: {"number": end.number, "hash": end.hash} for name, end in report.heads.items()
                },
                "figures": {
                    "cycles": report.cycles,
                    "wheels": report.wheels,
                    "cycles_not_in_sums": report.behind,
                    "records_to_ship": waiting,
                    "findings": len(report.findings),
                },
            }
        )
    else:
        typer.echo(f"revision {report.revision}: {report.cycles:,} cycles, {report.wheels:,} wheels")
        if waiting:
            typer.echo(f"{count_of(waiting, 'record')} {'waits' if waiting == 1 else 'wait'} to be shipped")
        if report.behind:
            typer.echo(f"{report.behind:,} cycles are not in the sums yet: run `truewheel db sums`")
        for name, end in report.heads.items():
            typer.echo(
                f"chain of {f'station {name}' if name else 'no station'}: link {end.number}, {end.hash}"
            )
        for finding in report.findings:
            typer.echo(finding)
        for remedy in report.remedies:
            typer.echo(remedy_in_commands(remedy))
        typer.echo("nothing is wrong" if not report.findings else count_of(len(report.findings), "finding"))
    if report.findings:
        raise typer.Exit(GOAL_MISSED)


def _has_central(database: str) -> bool:
    """Whether it is the database of this folder's station, and that ships to a central one."""
    from db.connection import parse_url
    from station.configuration import own_configuration, read_configuration

    found = own_configuration()
    if found is None:
        return False
    with suppress(TruewheelError):  # The check is of the database, not of the configuration.
        configuration = read_configuration(found)
        if configuration.settings.database.central_url is None:
            return False
        own, asked = (parse_url(url) for url in (configuration.database_url, database))
        files = {str(Path(url.database or "").resolve()) for url in (own, asked)}
        return own.drivername == asked.drivername and len(files) == 1
    return False


@db_app.command()
def backup(
    database: DatabaseOption,
    out: Annotated[Path, typer.Option(help="New file for the copy.", show_default=False)],
    as_json: JsonFlag = False,
) -> None:
    """Copy the database as it is now, while stations go on writing."""
    from db.upkeep import backup as make

    ready_file(out, new=True)
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
    from db.connection import current_revision
    from db.upkeep import restore as make

    make(file, database)
    revision = current_revision(database)
    if as_json:
        print_json({"revision": revision})
    else:
        typer.echo(f"restored at revision {revision}")


@db_app.command()
def show(
    database: DatabaseOption,
    newest: Annotated[int, typer.Option(help="How many VINs, the newest.", min=1, max=10_000)] = 20,
    as_json: JsonFlag = False,
) -> None:
    """Show the names that reports and exports can be asked for: stations, types, VINs, characteristics, …"""
    from db.queries import ResultReader, known_names
    from station.quality import print_names, terminal

    with ResultReader(database) as reader:
        known = known_names(reader, newest)
    names = {
        "stations": known.stations,
        "plants": known.plants,
        "vehicle_types": known.vehicle_types,
        "wheels": known.wheels,
        "characteristics": tuple(map(str, known.characteristics)),
        "vins": known.vins,
    }
    if as_json:
        print_json({kind: list(those) for kind, those in names.items()})
        return
    console = terminal()
    for kind, those in names.items():
        title = f"newest {len(those)} VINs" if kind == "vins" else kind.replace("_", " ")
        print_names(console, title, those)


@db_app.command()
def sums(
    database: DatabaseOption,
    rebuild: Annotated[bool, typer.Option(help="Forget all sums first, and build them again.")] = False,
    as_json: JsonFlag = False,
) -> None:
    """Bring the sums that make reports fast up to date with the results; a station does so by itself."""
    from db.connection import check_revision, describe, make_engine, parse_url, require_file, store_errors
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


@db_app.command()
def retention(
    config: Annotated[
        Path | None,
        typer.Option(
            "--config",
            help="Station's configuration whose [archive] counts.",
            show_default="configs/station.toml",
        ),
    ] = None,
    apply: Annotated[
        bool, typer.Option("--apply", help="Remove it now; a station that runs does so by itself.")
    ] = False,
    as_json: JsonFlag = False,
) -> None:
    """Say which archived images the configuration keeps no longer, and why; results stay in any case."""
    from datetime import UTC, datetime

    from alignment.errors import InputError
    from db.connection import station_lock
    from db.store import ResultStore
    from db.upkeep import enforce, kept, leaving
    from station.configuration import read_configuration
    from station.store import archive_policy

    configuration = read_configuration(default_config(config))
    archive = configuration.settings.archive
    if archive is None:
        raise InputError(
            file=config, field="archive", expected="[archive] with folder and policy", seen="none",
            cure="No images are kept without",
        )  # fmt: skip
    policy, now = archive_policy(archive), datetime.now(UTC)
    removed = 0
    with ResultStore(configuration.database_url) as store:
        before, going = kept(store), leaving(store, policy, now, most=2**31)
        if apply:
            with station_lock(configuration.database_url, configuration.settings.station.id):
                while gone := enforce(store, configuration.path(archive.folder), policy, now):
                    removed += len(gone)
        after = kept(store)
    reasons: dict[str, int] = {}
    for one in going:
        name = f"{one.record.retention}: {one.reason}"
        reasons[name] = reasons.get(name, 0) + 1
    size = sum(one.record.bytes for one in going)
    if as_json:
        figures = {
            "shots": before.shots, "bytes": before.bytes, "leaving_shots": len(going),
            "leaving_bytes": size, "removed_shots": removed, "kept_shots": after.shots,
        }  # fmt: skip
        print_json({"reasons": reasons, "figures": figures})
        return
    typer.echo(f"{before.shots:,} archived shots, {before.bytes / 1e9:.2f} GB")
    for name, number in reasons.items():
        typer.echo(f"{number:,} go, {name}")
    if apply:
        typer.echo(f"removed {removed:,}; {after.shots:,} shots, {after.bytes / 1e9:.2f} GB are left")
    else:
        typer.echo(f"{len(going):,} would go, {size / 1e9:.2f} GB; --apply removes them")


@db_app.command()
def event(
    database: DatabaseOption,
    station: Annotated[str, typer.Option(help="Where it happened.", show_default=False)],
    text: Annotated[
        str | None, typer.Argument(help="What happened: 'lamp 2 changed'.", show_default=False)
    ] = None,
    temperature: Annotated[
        float | None,
        typer.Option(
            help="Degrees Celsius; reports of drift use it.", min=-60.0, max=200.0, show_default=False
        ),
    ] = None,
    code: Annotated[str, typer.Option(help="Short name to find it by.", metavar="CODE")] = "maintenance",
    time: Annotated[
        str | None,
        typer.Option(help="When: ISO 8601, UTC without a zone; or a span before now.", show_default="now"),
    ] = None,
    as_json: JsonFlag = False,
) -> None:
    """Record what only people or other systems know: maintenance, the temperature of the hall."""
    from datetime import UTC, datetime

    from alignment.errors import InputError
    from db.queries import Filter, ResultReader, require_known
    from db.records import EventRecord, Severity
    from db.store import ResultStore
    from station.quality import read_time
    from station.quality.reports import TEMPERATURE

    if (text is None) == (temperature is None):
        raise InputError(
            field="TEXT", expected="either a text or --temperature", seen="both" if text else "none"
        )
    if code == TEMPERATURE and temperature is None:
        raise InputError(
            field="--code",
            expected="another code for a text, which no report reads a number from",
            seen=f"'{code}'",
            cure="Record degrees Celsius with --temperature 31.5",
        )
    utc = read_time("--time", time) or datetime.now(UTC)
    with ResultReader(database) as reader:
        require_known(reader, Filter(stations=(station,)))
    if temperature is not None:
        code, text = TEMPERATURE, f"{temperature:g} °C"
    record = EventRecord(utc, station, Severity.INFO, "command line", code, text or "", value=temperature)
    with ResultStore(database) as store:
        store.record_event(record)
    if as_json:
        print_json({"event": str(record.uuid), "utc": utc.isoformat(), "code": code, "text": text})
    else:
        typer.echo(f"{utc:%Y-%m-%d %H:%M} UTC, {station}: {code}: {text}")
