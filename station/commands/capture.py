"""`truewheel capture`: plates, gauge frames and wheels, recorded with the station's own cameras."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from alignment.counting import count_of
from station.commands.camera_work import ConfigOption, ExposureOption, RigArgument, configuration_for_work
from station.commands.output import GOAL_MISSED, JsonFlag, print_json
from station.commands.outputs import ready_new_folder
from station.configuration import default_config

if TYPE_CHECKING:
    from sensors.formats import PlannedView
    from station.maintenance import PlateCapture, PlateShot, WorkRig

_MOST_TRIES = 50
capture_app = typer.Typer(
    no_args_is_help=True, help="Record plates, gauge frames and wheels with the station's cameras."
)
OutOption = Annotated[Path, typer.Option(help="New folder for what is captured.", show_default=False)]


@capture_app.command("plate-session")
def plate_session(
    rig: RigArgument,
    out: OutOption,
    plate: Annotated[
        Path | None,
        typer.Option(help="Description of the plate.", show_default="configs/plates/rig.toml"),
    ] = None,
    config: ConfigOption = None,
    views: Annotated[
        int, typer.Option(help="Positions of the plate, the most important ones first.", min=3, max=9)
    ] = 7,
    auto: Annotated[
        bool,
        typer.Option(
            "--auto", help="Take each view when the plate was moved and stands still, without Enter."
        ),
    ] = False,
    wait: Annotated[float, typer.Option(help="Longest wait for that, seconds.", min=0, max=3600)] = 300.0,
    shots: Annotated[
        Path | None,
        typer.Option(
            help="Take what the station recorded, such as the images of the line's mode calibrate, in the "
            "order of the names, in place of its cameras.",
            show_default=False,
        ),
    ] = None,
    exposure_ms: ExposureOption = None,
    stage_tolerance_mm: Annotated[
        float, typer.Option(help="Each stage coordinate is right within ± this.", min=1e-4, max=1)
    ] = 0.01,
    as_json: JsonFlag = False,
) -> None:
    """Capture a plate session: says where the plate goes next, refuses bad views, tells what is missing.

    Exit status 1 when the session is written and lacks something that the calibration will ask for.
    """
    from alignment.errors import TruewheelError
    from sensors.formats import plate_plan, read_plate, write_plate_session
    from station.maintenance import PlateCapture, opened_rig, recorded_shots
    from station.maintenance import rig_index as index_of

    ready_new_folder(out)
    configuration = configuration_for_work(config, as_json)
    described = read_plate(default_config(plate, "plates/rig.toml"))
    side = configuration.settings.rigs[index_of(configuration, rig)].side
    opened = opened_rig(configuration, rig) if shots is None else recorded_shots(shots, rig)
    with opened as work:
        work.expose(exposure_ms)
        capture = PlateCapture(work, side, described, stage_tolerance_mm)
        plan = plate_plan(views)
        try:
            for number, planned in enumerate(plan, 1):
                _say(as_json, f"view {number} of {len(plan)}, {planned.name}: {_instruction(planned)}")
                if shots is not None:
                    going_on = _one(work, capture, planned, as_json)
                elif auto:
                    going_on = _when_still(work, capture, planned, wait, as_json)
                else:
                    going_on = _by_hand(work, capture, planned, as_json)
                if not going_on:
                    break
        except TruewheelError:
            # A camera that is lost amid the session must not cost the views before.
            if capture.views:
                write_plate_session(out, capture.session())
                typer.echo(f"kept {count_of(len(capture.views), 'view')} in {out}", err=True)
            raise
    if not capture.views:
        typer.echo("nothing written: no view of the plate was taken", err=True)
        raise typer.Exit(GOAL_MISSED)
    write_plate_session(out, capture.session())
    _report(out, capture, len(plan), as_json)


def _instruction(planned: PlannedView) -> str:
    from station.maintenance import instruction

    return instruction(planned)


def _say(as_json: bool, text: str) -> None:
    typer.echo(text, err=as_json)


def _one(work: WorkRig, capture: PlateCapture, planned: PlannedView, as_json: bool) -> bool:
    """Take the next recorded shot; False at the end of the recording."""
    from alignment.errors import SeveralErrors

    work.arm()
    try:
        shot = capture.shoot(planned)
    except SeveralErrors as error:
        _say(as_json, f"  the recording ends here: {error.exceptions[0]}")
        return False
    _kept(capture, planned, shot, as_json)
    return True


def _when_still(
    work: WorkRig, capture: PlateCapture, planned: PlannedView, wait_s: float, as_json: bool
) -> bool:
    work.arm()
    return _kept(capture, planned, capture.wait_still(planned, wait_s), as_json)


def _by_hand(work: WorkRig, capture: PlateCapture, planned: PlannedView, as_json: bool) -> bool:
    """Ask until a view is good, skipped, or the session is ended; False when it is ended."""
    armed = False
    for _ in range(_MOST_TRIES):
        typer.echo(
            "  Enter takes it; X Y Z where the stage says otherwise; s skips it; q ends > ",
            nl=False,
            err=True,
        )
        line = sys.stdin.readline()
        answer = line.strip().lower()
        if not line or answer == "q":
            return False
        if answer == "s":
            return True
        stage = _stage(answer, planned)
        if answer and stage is None:
            typer.echo(f"  three numbers, s, q or nothing, not '{answer}'", err=True)
            continue
        if not armed:
            work.arm()
            armed = True
        if _kept(capture, planned, capture.shoot(planned), as_json, stage):
            return True
    return False


def _stage(answer: str, planned: PlannedView) -> tuple[float, ...] | None:
    try:
        stage = tuple(float(part) for part in answer.replace(",", " ").split())
    except ValueError:
        return None
    good = planned.on_stage and len(stage) == 3 and all(math.isfinite(x) and abs(x) <= 1000 for x in stage)
    return stage if good else None


def _kept(
    capture: PlateCapture,
    planned: PlannedView,
    shot: PlateShot,
    as_json: bool,
    stage: tuple[float, ...] | None = None,
) -> bool:
    """Keep a good view and say how the cameras are covered; say what is wrong with a bad one."""
    from station.maintenance import coverage_of, what_is_missing

    for problem in shot.problems:
        _say(as_json, f"  not taken: {problem}")
    if shot.problems:
        return False
    capture.keep(planned, shot, stage)
    covered = coverage_of(capture.seen, capture.sizes())
    _say(as_json, "  taken; covered: " + ", ".join(f"{each.name} {each.image_share:.0%}" for each in covered))
    for missing in what_is_missing(capture.seen, capture.sizes(), capture.plate.plate):
        _say(as_json, f"  still missing: {missing}")
    return True


def _report(out: Path, capture: PlateCapture, planned: int, as_json: bool) -> None:
    from station.maintenance import coverage_of, what_is_missing, what_would_help

    sizes = capture.sizes()
    missing = what_is_missing(capture.seen, sizes, capture.plate.plate)
    if as_json:
        print_json(
            {
                "session": str(out),
                "rig": capture.rig.name,
                "views": [view.name for view in capture.views],
                "cameras": [
                    {
                        "camera": each.name,
                        "views": each.views,
                        "marks": each.marks,
                        "image_share": each.image_share,
                        "missing": list(each.missing),
                    }
                    for each in coverage_of(capture.seen, sizes)
                ],
                "missing": list(missing),
                "advice": list(what_would_help(capture.seen)),
                "figures": {"views": len(capture.views), "planned": planned, "missing": len(missing)},
            }
        )
    else:
        typer.echo(
            f"wrote {out}: {count_of(len(capture.views), 'view')} of the plate by {len(sizes)} cameras"
        )
        for text in what_would_help(capture.seen):
            typer.echo(f"better still: {text}")
        for text in missing:
            typer.echo(f"missing: {text}")
    if missing:
        raise typer.Exit(GOAL_MISSED)


@capture_app.command("gauge-session")
def gauge_session(
    out: OutOption,
    frame: Annotated[
        Path | None,
        typer.Option(help="Description of the gauge frame.", show_default="configs/plates/gauge.toml"),
    ] = None,
    config: ConfigOption = None,
    exposure_ms: ExposureOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Capture one view of the gauge frame with every rig of the station.

    Exit status 1 when a rig does not see its plate well; nothing is written then.
    """
    from sensors.formats import read_gauge_frame
    from station.maintenance import capture_gauge, write_gauge

    ready_new_folder(out)
    configuration = configuration_for_work(config, as_json)
    gauge = read_gauge_frame(default_config(frame, "plates/gauge.toml"))
    captured, problems = capture_gauge(
        configuration, gauge, exposure_ms, lambda name: _say(as_json, f"{name}: looked at")
    )
    if not problems:
        write_gauge(out, captured)
    if as_json:
        print_json(
            {
                "session": None if problems else str(out),
                "frame": gauge.file.name,
                "rigs": list(captured),
                "problems": {name: list(found) for name, found in problems.items()},
                "figures": {"rigs": len(captured), "problems": len(problems)},
            }
        )
    else:
        for name, found in problems.items():
            for problem in found:
                typer.echo(f"{name}: {problem}")
        typer.echo("nothing written" if problems else f"wrote {out}: one view of {', '.join(captured)}")
    if problems:
        raise typer.Exit(GOAL_MISSED)


@capture_app.command("shot")
def shot(
    rig: RigArgument,
    out: OutOption,
    config: ConfigOption = None,
    exposure_ms: ExposureOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Capture one shot of the wheel before a rig, as `truewheel measure` reads it.

    Exit status 1 when an image is too dark or saturated; nothing is written then.
    """
    from sensors.formats import write_shot
    from station.maintenance import advice, figures_as_json, opened_rig, shot_figures

    ready_new_folder(out)
    configuration = configuration_for_work(config, as_json)
    with opened_rig(configuration, rig) as work:
        work.expose(exposure_ms)
        work.arm()
        taken = work.shoot()
    figures = shot_figures(taken)
    problems = [f"{each.camera}: {advice(each)}" for each in figures if advice(each)]
    if not problems:
        write_shot(out, taken)
    if as_json:
        print_json(
            {
                "shot": None if problems else str(out),
                "rig": rig,
                "problems": problems,
                "cameras": [figures_as_json(each) for each in figures],
                "figures": {"images": len(figures), "problems": len(problems)},
            }
        )
    else:
        for problem in problems:
            typer.echo(problem)
        typer.echo("nothing written" if problems else f"wrote {out}: {len(figures)} images")
    if problems:
        raise typer.Exit(GOAL_MISSED)
