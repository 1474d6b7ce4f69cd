"""A gauge session captured with the station's own cameras: one view of the frame by every rig."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from alignment.counting import listed
from alignment.errors import ConfigurationError
from sensors.formats import GaugeFrame, PlannedView, write_plate_session
from station.configuration import Configuration
from station.maintenance.capture import PlateCapture
from station.maintenance.opened import opened_rig

GAUGE_VIEW = PlannedView("gauge", staged=False)


def capture_gauge(
    configuration: Configuration,
    frame: GaugeFrame,
    exposure_ms: float | None = None,
    told: Callable[[str], None] = lambda text: None,
) -> tuple[dict[str, PlateCapture], dict[str, tuple[str, ...]]]:
    """Look at the gauge frame with every rig that it has a plate for.

    Parameters
    ----------
    configuration
        Of the station.
    frame
        That stands there, and stays until all rigs have seen it.
    exposure_ms
        In place of the configured one.
    told
        Hears of every rig.

    Returns
    -------
    dict, dict
        What was captured, and what is wrong with it, by rig; nothing is wrong where the latter is empty.

    Raises
    ------
    ConfigurationError
        When the station's rigs are not those of the frame.
    """
    names = [rig.name for rig in configuration.settings.rigs]
    if set(names) != set(frame.plates):
        raise ConfigurationError(
            file=configuration.file,
            field="rigs",
            expected=f"the rigs of the gauge frame '{frame.file.name}': {listed(list(frame.plates))}",
            seen=listed(names),
            cure="Name the frame of this station, or give each rig its plate in the frame's description",
        )
    captured: dict[str, PlateCapture] = {}
    problems: dict[str, tuple[str, ...]] = {}
    for rig in configuration.settings.rigs:
        with opened_rig(configuration, rig.name) as work:
            capture = PlateCapture(work, rig.side, frame.plates[rig.name].plate)
            work.expose(exposure_ms)
            work.arm()
            shot = capture.shoot(GAUGE_VIEW, by_all=True)
        if shot.problems:
            problems[rig.name] = shot.problems
        else:
            capture.keep(GAUGE_VIEW, shot)
            captured[rig.name] = capture
        told(rig.name)
    return captured, problems


def write_gauge(folder: Path, captured: Mapping[str, PlateCapture]) -> None:
    """Write a plate session of one view for each rig into a new folder, as `place_rigs` reads it.

    Raises
    ------
    FormatError
        When the folder of a rig holds something or cannot be written.
    """
    for name, capture in captured.items():
        write_plate_session(folder / name, capture.session())
