"""`truewheel zero`: zero measurements against a master wheel."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from station.commands.database import DatabaseOption
from station.commands.output import GOAL_MISSED, JsonFlag, print_json, reason_of_force
from station.commands.outputs import ready_database
from station.commands.warm_up import compiled_for_images

if TYPE_CHECKING:
    from db.records import StoredZero, ZeroRecord

zero_app = typer.Typer(
    no_args_is_help=True,
    help="Zero measurements: angles relative to a master wheel. The newest one of a rig and its calibration "
    "that was not revoked corrects every wheel.",
)


@zero_app.command("measure")
def measure_command(
    shots: Annotated[
        list[Path],
        typer.Argument(
            help="Folder of one shot of the master wheel, or of eight or more while it turned.",
            show_default=False,
        ),
    ],
    calibration: Annotated[Path, typer.Option(help="Calibration file of the rig.", show_default=False)],
    camber: Annotated[
        float, typer.Option(help="Certified camber as it stands there, degrees.", min=-10, max=10)
    ],
    toe: Annotated[float, typer.Option(help="Certified toe, degrees.", min=-10, max=10)],
    database: DatabaseOption,
    certified_u95: Annotated[
        float, typer.Option(help="Expanded uncertainty (k = 2) of both, degrees.", min=0, max=1)
    ] = 0.0,
    master: Annotated[str, typer.Option(help="Name of the master wheel.")] = "master wheel",
    config: Annotated[
        Path | None,
        typer.Option(help="Station's configuration whose [measure] and [zero] count.", show_default=False),
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Store it though it is larger than what is believed.")
    ] = False,
    reason: Annotated[str, typer.Option(help="Why it is forced, for the record.", show_default=False)] = "",
    as_json: JsonFlag = False,
) -> None:
    """Measure a master wheel and store the zero measurement; exit status 1 when the images are refused.

    A zero value larger than what [zero] believes, 10′ by default, is not stored unless it is forced.
    """
    from alignment.values import MeasureSettings, Refusal
    from db.records import CalibrationRecord
    from db.store import ResultStore
    from sensors.formats import read_calibration_file, read_shot
    from station.calibration import LARGEST_ZERO, MasterWheel, measure_zero
    from station.configuration import read_configuration

    ready_database(database)
    forced_reason = reason_of_force(force, reason, "zero measurement")
    settings, largest = MeasureSettings(), LARGEST_ZERO
    if config is not None:
        station = read_configuration(config).settings
        settings = station.measure.settings()
        largest = math.radians(station.zero.largest_arcmin / 60.0)
    file = read_calibration_file(calibration)
    images = read_shot(shots[0], file.calibration()).images
    compiled_for_images(images, as_json, *(["spin"] if len(shots) > 1 else []))
    wheel = MasterWheel(math.radians(camber), math.radians(toe), math.radians(certified_u95) / 2.0, master)
    with ResultStore(database) as store:
        found = measure_zero(shots, file.calibration(), settings, wheel, largest, forced_reason)
        if isinstance(found, Refusal):
            if as_json:
                print_json({"outcome": "refused", "reason": found.reason, "reason_code": str(found.code)})
            else:
                typer.echo(f"refused ({found.code}): {found.reason}")
            raise typer.Exit(GOAL_MISSED)
        document = file.model_dump(mode="json", by_alias=True)
        store.record_calibration(CalibrationRecord(file.id, file.rig, file.created_utc, document))
        store.record_zero(found)
    if as_json:
        print_json({"outcome": "measured", "reason": None, "reason_code": None, **zero_as_json(found)})
    else:
        typer.echo(f"stored {found.id}: {zero_line(found)}")


@zero_app.command("list")
def list_command(database: DatabaseOption, as_json: JsonFlag = False) -> None:
    """Show all zero measurements, oldest first, and which are in force."""
    from db.store import ResultStore

    with ResultStore(database) as store:
        stored, in_force = store.zeros(), {record.id for record in store.zeros_in_force()}
    if as_json:
        print_json({"zero_measurements": [_stored_as_json(zero, in_force) for zero in stored]})
        return
    for zero in stored:
        typer.echo(f"{zero.record.id}  {_state(zero, in_force):10}  {zero_line(zero.record)}")
    if not stored:
        typer.echo("no zero measurements")


@zero_app.command("revoke")
def revoke_command(
    zero_id: Annotated[
        str, typer.Argument(metavar="ID", help="Of the zero measurement.", show_default=False)
    ],
    database: DatabaseOption,
    reason: Annotated[str, typer.Option(help="Why, for the record.")] = "no reason given",
    as_json: JsonFlag = False,
) -> None:
    """End a zero measurement: the one before it counts again; what was stored stays."""
    from datetime import UTC, datetime

    from alignment.errors import ConfigurationError
    from db.records import ZeroRevocation
    from db.store import ResultStore

    with ResultStore(database) as store:
        if store.zero(zero_id) is None:
            raise ConfigurationError(
                field="ID",
                expected="the id of a zero measurement",
                seen=f"'{zero_id}'",
                cure="`truewheel zero list` shows them",
            )
        store.revoke_zero(ZeroRevocation(zero_id, datetime.now(UTC), reason))
        revoked = store.zero(zero_id)
    if as_json and revoked is not None:
        print_json(_stored_as_json(revoked, in_force=set()))
    else:
        typer.echo(f"revoked {zero_id}")


def zero_as_json(record: ZeroRecord) -> dict[str, Any]:
    """Return a zero measurement as ``--json`` prints it, degrees."""
    return {
        "id": record.id,
        "rig": record.rig,
        "calibration_id": record.calibration_id,
        "measured_utc": record.measured_utc.isoformat(),
        "master": record.master,
        "method": record.method,
        "shots": record.shots,
        "camber_deg": math.degrees(record.camber),
        "toe_deg": math.degrees(record.toe),
        "certified_camber_deg": math.degrees(record.certified_camber),
        "certified_toe_deg": math.degrees(record.certified_toe),
        "camber_u95_deg": 2.0 * math.degrees(record.camber_u),
        "toe_u95_deg": 2.0 * math.degrees(record.toe_u),
        "forced_reason": record.forced_reason,
    }


def _stored_as_json(zero: StoredZero, in_force: set[str]) -> dict[str, Any]:
    revocation = zero.revocation
    return zero_as_json(zero.record) | {
        "stored_utc": zero.stored_utc.isoformat(),
        "in_force": zero.record.id in in_force,
        "revoked_utc": None if revocation is None else revocation.utc.isoformat(),
        "revoked_reason": None if revocation is None else revocation.reason,
    }


def _state(zero: StoredZero, in_force: set[str]) -> str:
    if zero.revocation is not None:
        return "revoked"
    return "in force" if zero.record.id in in_force else "superseded"


def zero_line(record: ZeroRecord) -> str:
    """Return a zero measurement on one line, for people."""
    off = [
        60.0 * math.degrees(measured - certified)
        for measured, certified in (
            (record.camber, record.certified_camber),
            (record.toe, record.certified_toe),
        )
    ]
    return (
        f"{record.measured_utc:%Y-%m-%d %H:%M} {record.rig}, {record.master}, measured less certified camber "
        f"{off[0]:+.3f}′, toe {off[1]:+.3f}′, calibration {record.calibration_id}"
        + ("" if record.forced_reason is None else f", FORCED: {record.forced_reason}")
    )
