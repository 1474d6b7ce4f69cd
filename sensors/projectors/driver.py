"""What a projector driver declares: the model of its settings, and how they become a projector.

An installed package adds a driver by an entry point of the group ``truewheel.projectors``, whose name is the
table in ``[rigs.projector]`` of the station's configuration, and whose value is a `ProjectorDriver`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

from alignment.errors import ConfigurationError
from alignment.values import Side
from sensors.drivers.installed import DriverKind, InstalledDriver, load_entry
from sensors.formats.validation import StrictModel
from sensors.projectors.projector import ProjectorDevice

Options = TypeVar("Options", bound=StrictModel)


@dataclass(frozen=True)
class ProjectorPlace:
    """The rig whose projector is asked for.

    Attributes
    ----------
    rig, side
        Its name, and the side of the vehicle.
    folder
        Folder of the configuration, where relative paths of the settings start.
    cameras
        The rig itself, not connected, as its driver made it: a simulated projector lights simulated cameras.
    """

    rig: str
    side: Side
    folder: Path
    cameras: object


@dataclass(frozen=True, eq=False)
class ProjectorDriver(Generic[Options]):
    """A driver of projectors.

    Attributes
    ----------
    settings
        Model of its table: a `StrictModel`, every number with its bounds.
    make
        Returns the projector of a rig, not connected; it opens nothing yet.
    can_be_dark
        Whether its projectors can leave exposures without light.
    adjustable
        Whether their brightness can be set.
    in_process
        Whether nothing but this program stands behind them, so that no call needs a bound.

    Raises
    ------
    ConfigurationError
        When the settings are no strict model, or what must be called cannot be.
    """

    settings: type[Options]
    make: Callable[[Options, ProjectorPlace], ProjectorDevice]
    can_be_dark: bool = True
    adjustable: bool = True
    in_process: bool = False

    def __post_init__(self) -> None:
        settings: object = self.settings
        if not (isinstance(settings, type) and issubclass(settings, StrictModel)):
            raise ConfigurationError(
                field="settings",
                expected="a model that descends from sensors.formats.validation.StrictModel",
                seen=getattr(settings, "__name__", repr(settings)),
            )
        if not callable(self.make):
            raise ConfigurationError(field="make", expected="a function", seen=repr(self.make))


PROJECTORS = DriverKind(
    "truewheel.projectors", "projector driver", (ProjectorDriver,), frozenset({"brightness", "dark"})
)
"""Drivers of projectors; their tables stand in ``[rigs.projector]``."""


@dataclass(frozen=True)
class LoadedProjector:
    """A driver of projectors, and where it came from."""

    installed: InstalledDriver
    driver: ProjectorDriver[StrictModel]


def load_projector(name: str) -> LoadedProjector:
    """Import an installed driver of projectors; errors as `load_entry`."""
    described, found = load_entry(name, PROJECTORS)
    assert isinstance(found, ProjectorDriver)
    return LoadedProjector(described, found)
