"""`truewheel camera show | live | exposure`: for whoever mounts, focuses and lights the cameras of a rig."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from station.commands.output import GOAL_MISSED, JsonFlag, print_json
from station.commands.outputs import ready_new_folder
from station.commands.warm_up import compiled_for

if TYPE_CHECKING:
    from station.configuration import Configuration

RigArgument = Annotated[str, typer.Argument(help="Name of the rig, such as front_left.", show_default=False)]
ConfigOption = Annotated[
    Path | None, typer.Option(help="Station's configuration.", show_default="configs/station.toml")
]
ExposureOption = Annotated[
    float | None,
    typer.Option(help="Exposure, milliseconds, in place of the configured one.", min=0.001, max=1000),
]


def configuration_for_work(config: Path | None, as_json: bool) -> Configuration:
    """Return the station's configuration, with what looking at images needs compiled."""
    from sensors.drivers.driver import RigDriver
    from station.configuration import own_config, read_configuration

    configuration = read_configuration(own_config(config))
    works = ["measure_8", "calibrate"]
    drivers = [rig.cameras.driver for rig in configuration.settings.rigs]
    if any(isinstance(driver, RigDriver) and driver.simulates for driver in drivers):
        works += ["wheel_images", "plate_images"]
    compiled_for(works, as_json)
    return configuration


def show(
    rig: RigArgument,
    config: ConfigOption = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="New folder for the images as PNG, and a page that shows them.", show_default=False
        ),
    ] = None,
    dark: Annotated[
        bool, typer.Option("--dark", help="Without the projector's light, where it can be switched off.")
    ] = False,
    exposure_ms: ExposureOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Take one image with each camera: histogram, saturation, focus, light lines.

    Edges are the pixels over which the sharpest edges rise: turn the lens until they are fewest. Exit
    status 1 when an image is too dark, saturated or without contrast.
    """
    from station.maintenance import (
        advice,
        figures_as_json,
        figures_as_text,
        opened_rig,
        shot_figures,
        write_show,
    )

    if out is not None:
        ready_new_folder(out)
    configuration = configuration_for_work(config, as_json)
    with opened_rig(configuration, rig) as work:
        work.expose(exposure_ms)
        work.arm()
        shot = work.shoot_unlit() if dark else work.shoot()
    figures = shot_figures(shot)
    page = None if out is None else write_show(out, shot, figures)
    advised = [each.camera for each in figures if advice(each)]
    if as_json:
        cameras = [figures_as_json(each) | {"advice": advice(each)} for each in figures]
        print_json(
            {
                "rig": rig,
                "exposure_ms": shot.frames[0].exposure_ms,
                "cameras": cameras,
                "page": None if page is None else str(page),
                "figures": {"cameras": len(figures), "advised": len(advised)},
            }
        )
    else:
        for line in figures_as_text(figures):
            typer.echo(line)
        if page is not None:
            typer.echo(f"wrote {page}, and the images beside it")
    if advised:
        raise typer.Exit(GOAL_MISSED)


def live(
    rig: RigArgument,
    config: ConfigOption = None,
    port: Annotated[
        int, typer.Option(help="Of the page on this computer; 0 for any that is free.", min=0, max=65_535)
    ] = 0,
    seconds: Annotated[
        float, typer.Option(help="After so long it ends by itself.", min=0.1, max=86_400)
    ] = 3600.0,
    exposure_ms: ExposureOption = None,
) -> None:
    """Show a rig's cameras live in the browser of this computer, until Ctrl-C or its time is over.

    The page is served on the loopback address alone.
    """
    from station.maintenance import LiveView, opened_rig, served, watch_cameras

    configuration = configuration_for_work(config, as_json=False)
    with opened_rig(configuration, rig) as work:
        work.expose(exposure_ms)
        view = LiveView(rig, tuple(camera.name for camera in work.cameras.cameras))
        with served(view, port) as address:
            typer.echo(f"{address} shows {rig} for {seconds:g} s; Ctrl-C ends it")
            try:
                taken = watch_cameras(work, view, seconds)
            except KeyboardInterrupt:
                typer.echo("ended")
            else:
                typer.echo(f"ended after {taken} shots")


def exposure(
    rig: RigArgument,
    config: ConfigOption = None,
    plate: Annotated[
        bool, typer.Option("--plate", help="For the calibration plate in the light of the room.")
    ] = False,
    shortest_ms: Annotated[
        float, typer.Option(help="Shortest exposure, milliseconds.", min=0.001, max=1000)
    ] = 0.1,
    longest_ms: Annotated[
        float,
        typer.Option(
            help="Longest exposure, milliseconds; the shortest one for a brightness alone.",
            min=0.001,
            max=1000,
        ),
    ] = 20.0,
    as_json: JsonFlag = False,
) -> None:
    """Find exposure and projector brightness with a usual wheel before the rig, and print what to configure.

    Lines shall be bright and nothing saturated in the brightest camera; sun and lamps are warned of. Exit
    status 1 when no exposure does.
    """
    from alignment.errors import ConfigurationError
    from station.maintenance import ExposureLimits, exposure_in_toml, find_exposure, opened_rig

    configuration = configuration_for_work(config, as_json)
    if shortest_ms > longest_ms:
        raise ConfigurationError(
            choice="longest ms", expected=f"at least the shortest, {shortest_ms:g}", seen=f"{longest_ms:g}"
        )
    with opened_rig(configuration, rig) as work:
        found = find_exposure(
            work,
            "plate" if plate else "lines",
            ExposureLimits(shortest_ms, longest_ms),
            lambda text: typer.echo(text, err=True),
        )
    if as_json:
        print_json(
            {
                "rig": rig,
                "good": found.good,
                "exposure_ms": found.settings.exposure_ms,
                "gain_db": found.settings.gain_db,
                "brightness": None if found.light is None else found.light.brightness,
                "dark": None if found.light is None else found.light.dark,
                "ambient": found.ambient,
                "warnings": list(found.warnings),
                "cameras": [
                    {
                        "camera": each.camera,
                        "level": each.level,
                        "saturated": each.saturated,
                        "line_brightness": each.lines,
                    }
                    for each in found.cameras
                ],
                "figures": {"shots": found.shots, "warnings": len(found.warnings)},
            }
        )
    elif plate:
        typer.echo(f"for the plate: --exposure-ms {found.settings.exposure_ms:g}")
    else:
        typer.echo(exposure_in_toml(rig, found))
    for warning in found.warnings if not as_json else ():
        typer.echo(f"warning: {warning}")
    if not found.good:
        raise typer.Exit(GOAL_MISSED)
