"""`truewheel export`: results for other programs and for paper."""

from __future__ import annotations

import enum
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from station.commands.database import DatabaseOption
from station.commands.output import JsonFlag, print_json, read_uuid
from station.commands.outputs import ready_file
from station.commands.selection import (
    FromOption,
    PlantOption,
    ShiftOption,
    StationOption,
    TypeOption,
    UntilOption,
    VerdictOption,
    VinOption,
    WheelOption,
    ZoneOption,
)

if TYPE_CHECKING:
    from db.exports import AngleRow
    from db.queries import Filter, ResultReader


class ExportKind(enum.StrEnum):
    """What is written."""

    AQDEF = "aqdef"
    CSV = "csv"
    PARQUET = "parquet"
    CERTIFICATE = "certificate"


def export(
    kind: Annotated[
        ExportKind,
        typer.Argument(
            help="aqdef: Q-DAS, one file .dfq, or .dfd and .dfx. csv, parquet: one row for each angle with "
            "everything that explains it. certificate: PDF of one vehicle (the newest without --vin) or one "
            "gauge study.",
            show_default=False,
        ),
    ],
    database: DatabaseOption,
    out: Annotated[Path, typer.Option("--out", help="File to write.", show_default=False)],
    from_time: FromOption = None,
    until_time: UntilOption = None,
    shift: ShiftOption = None,
    timezone: ZoneOption = "UTC",
    station: StationOption = None,
    plant: PlantOption = None,
    vehicle_type: TypeOption = None,
    wheel: WheelOption = None,
    verdict: VerdictOption = None,
    vin: VinOption = None,
    encoding: Annotated[str, typer.Option(help="Of aqdef: utf-8, utf-16 or windows-1252.")] = "utf-8",
    cycle: Annotated[
        str | None,
        typer.Option(help="Of a certificate: UUID of the cycle.", show_default="the newest of --vin"),
    ] = None,
    study: Annotated[
        str | None,
        typer.Option(help="Of a certificate: UUID or name of a gauge study.", show_default=False),
    ] = None,
    as_json: JsonFlag = False,
) -> None:
    """Write results for other programs and for paper; angles in degrees."""
    ready_file(out)
    if kind is ExportKind.CERTIFICATE:
        answer = _certificate(database, out, vin, cycle, study)
    else:
        from db.queries import ResultReader, events, require_known
        from db.records import Severity
        from station.quality import read_filter, read_zone

        where = read_filter(
            from_time, until_time, shift, timezone, station, plant, vehicle_type, wheel, verdict, vin
        )
        with ResultReader(database) as reader:
            require_known(reader, where)
            rows = _rows(reader, where)
            if kind is ExportKind.AQDEF:
                from db.exports import write_aqdef

                # Two events of every cycle say that all went well: no file holds them.
                happened = events(reader, where, severities=(Severity.WARNING, Severity.ERROR))
                zone = read_zone(timezone)
                counts = write_aqdef(out, rows, happened, encoding=encoding, timezone=zone)
                answer = {
                    "files": [str(file) for file in counts.files],
                    "figures": {
                        "parts": counts.parts,
                        "characteristics": counts.characteristics,
                        "values": counts.values,
                    },
                }
            else:
                from db.exports import write_csv, write_parquet

                write = write_csv if kind is ExportKind.CSV else write_parquet
                answer = {"files": [str(out)], "figures": {"rows": write(out, rows)}}
    if as_json:
        print_json(answer)
    else:
        counted = ", ".join(f"{value} {name}" for name, value in answer["figures"].items())
        typer.echo(f"wrote {', '.join(answer['files'])}: {answer.get('assessment', counted)}")


def _rows(reader: ResultReader, where: Filter) -> Iterator[AngleRow]:
    from db.exports import angle_rows
    from db.queries import cycle_records

    for stored in cycle_records(reader, where):
        for row in angle_rows(stored):
            # The records are whole cycles; of their parts only the wheels that were asked for.
            if not where.wheels or row.part in where.wheels:
                yield row


def _certificate(
    database: str, out: Path, vin: str | None, cycle: str | None, study: str | None
) -> dict[str, Any]:
    from datetime import UTC, datetime

    from alignment.errors import ConfigurationError
    from db.exports import write_vehicle_certificate
    from db.queries import ResultReader, vin_history
    from station.quality import newest_vin
    from station.quality.gauge import load_gauge_study, write_study_certificate

    if vin is not None and study is not None:
        raise ConfigurationError(field="--vin, --study", expected="one of both", seen="both")
    now = datetime.now(UTC)
    if study is not None:
        stored = load_gauge_study(database, None, study)
        report = write_study_certificate(out, stored, created=now)
        return {"files": [str(out)], "assessment": report.assessment} | report.result.as_json()
    wanted = None if cycle is None else read_uuid("--cycle", cycle)
    with ResultReader(database) as reader:
        history = vin_history(reader, newest_vin(reader) if vin is None else vin)
        written = write_vehicle_certificate(out, history, created=now, cycle=wanted, source=reader.where)
    return {"files": [str(out)], "cycle": str(written), "figures": {"cycles": len(history.cycles)}}
