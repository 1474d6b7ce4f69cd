"""The projectors of a configuration: each rig that has one becomes a rig with its light."""

from __future__ import annotations

from typing import Any

from alignment.errors import ConfigurationError
from sensors.projectors import GuardedProjector, LitRig, ProjectorPlace
from sensors.rig import Rig
from station.configuration import Configuration
from station.running.cameras import call_bounds, in_driver

_VERBS = ("connect", "light", "dark", "state", "close")


def with_light(configuration: Configuration, index: int, rig: Rig) -> Rig | LitRig:
    """Return the rig with its projector where the configuration names one, not connected; else the rig.

    Raises
    ------
    InputError
        When the projector's driver finds a mistake, fails, or makes something else.
    """
    settings = configuration.settings.rigs[index]
    chosen = settings.projector
    if chosen is None:
        return rig
    place = ProjectorPlace(settings.name, settings.side, configuration.file.parent, rig)
    driver = chosen.projector.driver

    def made() -> Any:
        projector: Any = driver.make(chosen.options, place)
        whole = all(callable(getattr(projector, verb, None)) for verb in _VERBS)
        if not whole or not hasattr(projector, "can_be_dark"):
            raise ConfigurationError(
                expected="a projector from its driver, with the methods of "
                "sensors.projectors.ProjectorDevice",
                seen=f"an object of type '{type(projector).__name__}'",
                cure="Ask the makers of the driver for a version that fits truewheel",
            )
        return projector

    with in_driver(configuration, index, light=True):
        projector = made()
        if not driver.in_process:
            # One that hangs for good is made anew.
            projector = GuardedProjector(projector, settings.name, made, call_bounds(configuration))
        return LitRig(rig, projector, chosen.light())
