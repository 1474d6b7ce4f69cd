"""`truewheel calibrate`: from images of the plate to a calibration file."""

from __future__ import annotations

import time
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from alignment.counting import count_of
from alignment.units import in_degrees
from station.commands.output import GOAL_MISSED, JsonFlag, print_json
from station.commands.outputs import ready_database, ready_file, ready_folder
from station.commands.warm_up import compiled_for

if TYPE_CHECKING:
    from datetime import datetime

    from sensors.formats import PlateSession
    from station.calibration import Calibrated


class MethodOption(StrEnum):
    """How a rig is calibrated."""

    JOINT = "joint"
    HEADS_THEN_POSES = "heads-then-poses"


class ModelOption(StrEnum):
    """Lens model."""

    AUTO = "auto"
    DIVISION = "division"
    RADIAL = "radial"
    BROWN5 = "brown5"
    BROWN8 = "brown8"
    THIN_PRISM = "thin_prism"
    TILTED = "tilted"


def calibrate(
    session: Annotated[Path, typer.Argument(help="Folder of a plate session.", show_default=False)],
    out: Annotated[
        Path,
        typer.Option(
            help="Calibration file. Written, an older one replaced, only when the calibration is accepted; "
            "what it was computed from goes beside it.",
            show_default=False,
        ),
    ],
    method: Annotated[
        MethodOption, typer.Option(help="All cameras jointly, or each head alone and then their poses.")
    ] = MethodOption.JOINT,
    model: Annotated[
        ModelOption, typer.Option(help="Lens model; auto chooses by cross-validation.")
    ] = ModelOption.AUTO,
    report: Annotated[
        Path | None, typer.Option(help="Folder for a report with pictures, HTML.", show_default=False)
    ] = None,
    database: Annotated[
        str | None,
        typer.Option(
            help="URL of the result database that keeps an accepted calibration, with figures as found and "
            "as left.",
            show_default=False,
        ),
    ] = None,
    as_json: JsonFlag = False,
) -> None:
    """Calibrate a rig from images of a plate; exit status 1 when the calibration is refused."""
    from datetime import UTC, datetime

    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    from sensors.formats import (
        describe_calibration,
        read_plate_session,
        write_calibration_file,
        write_calibration_input,
    )
    from station.calibration import CalibrateSettings, Method, accept_calibration, calibrate_session

    ready_file(out)
    ready_folder(report, "report")
    ready_database(database)
    compiled_for(("calibrate",), as_json)
    settings = CalibrateSettings(Method(method.value), None if model is ModelOption.AUTO else model.value)
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task("reading the images", total=1.0)
        images = read_plate_session(session)
        now = datetime.now(UTC)
        started = time.perf_counter()
        found = calibrate_session(
            images,
            settings,
            now,
            lambda done, doing: bar.update(task, completed=done, description=doing),
        )
        duration_s = time.perf_counter() - started
        bar.update(task, completed=1.0, description="done")
    beside = out.with_suffix(".input.json")
    if found.calibration is not None and found.data is not None and found.adjustment is not None:
        text = f"{method.value}, lens model {found.adjustment.model}, "
        text += f"{count_of(len(images.views), 'view')} of the plate"
        file = describe_calibration(found.calibration, method=text, created_utc=now, path=out)
        # The database first: where it fails, the file in force stays.
        if database is not None:
            document = file.model_dump(mode="json", by_alias=True)
            accept_calibration(database, file, document, found.data, images.time_utc)
        write_calibration_input(beside, found.data, found.calibration.id)
        write_calibration_file(out, file)
    page = None if report is None else _write_report(report, found, images, now)
    result = calibrated_as_json(found, out, beside, duration_s) | {
        "report": None if page is None else str(page)
    }
    if as_json:
        print_json(result)
    elif found.calibration is not None:
        typer.echo(f"accepted: {found.judgement.reason}")
        typer.echo(f"wrote {out}: calibration {found.calibration.id}, {duration_s:.1f} s")
    else:
        typer.echo(f"refused ({result['reason_code']}): {result['reason']}")
    if not as_json:
        for warning in found.judgement.warnings:
            typer.echo(f"warning: {warning}")
    if found.calibration is None:
        raise typer.Exit(GOAL_MISSED)


def _write_report(folder: Path, found: Calibrated, images: PlateSession, now: datetime) -> Path | None:
    """None when there was nothing to adjust, so nothing to draw."""
    from station.calibration import write_calibration_report

    if found.adjustment is None:
        return None
    return write_calibration_report(
        folder,
        found.adjustment,
        found.judgement,
        identity="(refused)" if found.calibration is None else found.calibration.id,
        rig=images.rig,
        side=images.side,
        method="joint adjustment",
        created_utc=now,
    )


def calibrated_as_json(found: Calibrated, out: Path, beside: Path, duration_s: float) -> dict[str, Any]:
    """Return what `truewheel calibrate --json` prints."""
    judgement, accepted = found.judgement, found.calibration is not None
    adjustment, choice = found.adjustment, found.choice
    return {
        "outcome": "accepted" if accepted else "refused",
        "reason": None if accepted else judgement.reason,
        "reason_code": None if judgement.problem is None else judgement.problem.value,
        "reprojection_rms_px": found.rms_px,
        "calibration_id": None if found.calibration is None else found.calibration.id,
        "predicted_camber_u95_deg": in_degrees(judgement.camber_u95),
        "predicted_toe_u95_deg": in_degrees(judgement.toe_u95),
        "model": None if adjustment is None else adjustment.model,
        "model_chosen_by": None if choice is None else f"left-out {choice.left_out}",
        "warnings": list(judgement.warnings),
        "views": None if found.data is None else len(found.data.views),
        "marks": None if adjustment is None else len(adjustment.mark),
        "calibration": str(out) if accepted else None,
        "input": str(beside) if accepted else None,
        "cameras": [
            {
                "camera": figures.name,
                "marks": figures.marks,
                "image_share": figures.image_share,
                "depth_share": figures.depth_share,
                "noise_scale": figures.noise_scale,
                "outliers": figures.outliers,
                "structure": figures.structure,
                "blur_px": figures.blur_px,
                "contrast": figures.contrast,
            }
            for figures in judgement.cameras
        ],
        "duration_s": duration_s,
    }
