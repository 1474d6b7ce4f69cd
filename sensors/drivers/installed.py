"""Which drivers of cameras or projectors are installed, and loading one: none is imported before that."""

from __future__ import annotations

import contextlib
import difflib
import re
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points

from alignment.errors import ConfigurationError, Deed, Remedy, told
from sensors.drivers.driver import CameraDriver, Driver, RigDriver, SeenCamera

OWN_PACKAGE = "truewheel"
_NAME = re.compile(r"[a-z][a-z0-9_]{0,40}")


@dataclass(frozen=True)
class DriverKind:
    """What is driven.

    Attributes
    ----------
    group
        Of the entry points.
    called
        What a driver of this kind is called in messages.
    types
        Of which one is.
    reserved
        What the table holds besides in which a driver's stands; none can have such a name.
    """

    group: str
    called: str
    types: tuple[type, ...]
    reserved: frozenset[str]


CAMERAS = DriverKind(
    "truewheel.cameras",
    "camera driver",
    (CameraDriver, RigDriver),
    frozenset({"name", "calibration", "heads", "projector"}),
)
"""Drivers of cameras; their tables stand in a rig."""


@dataclass(frozen=True)
class InstalledDriver:
    """A driver as its package declares it.

    Attributes
    ----------
    name
        Of the entry point: the table in a rig.
    package, version
        What was installed.
    target
        Where the driver stands, ``module:ATTRIBUTE``.
    """

    name: str
    package: str
    version: str
    target: str

    @property
    def foreign(self) -> bool:
        """Whether another package than this program brought it."""
        return self.package != OWN_PACKAGE

    def __str__(self) -> str:
        return f"{self.target} of {self.package} {self.version}"


@dataclass(frozen=True)
class LoadedDriver:
    """A driver, and where it came from."""

    installed: InstalledDriver
    driver: Driver


def installed_drivers(kind: DriverKind = CAMERAS) -> tuple[InstalledDriver, ...]:
    """Return the drivers of all installed packages, by name; nothing of them is imported."""
    found = [_described(point) for point in _points(kind)]
    return tuple(sorted(found, key=lambda one: (one.name, one.package, one.target)))


def conflicts(installed: Sequence[InstalledDriver], kind: DriverKind = CAMERAS) -> list[ConfigurationError]:
    """Return what keeps declared drivers from ever being used: a name twice, or one that no rig can hold."""
    counted = Counter(one.name for one in installed)
    found = [_twice(name, installed, kind) for name, count in counted.items() if count > 1]
    return found + [_misnamed(one, kind) for one in installed if _is_misnamed(one.name, kind)]


def load_driver(name: str) -> LoadedDriver:
    """Import an installed driver of cameras; errors as `load_entry`."""
    described, found = load_entry(name, CAMERAS)
    assert isinstance(found, CameraDriver | RigDriver)
    return LoadedDriver(described, found)


def load_entry(name: str, kind: DriverKind) -> tuple[InstalledDriver, object]:
    """Import an installed driver of a kind; what was declared, and one of `kind.types`.

    Raises
    ------
    ConfigurationError
        When no package declares it, two do, it cannot be imported, or is no driver. Whatever a package raises
        when it is imported ends in this error.
    """
    candidates = [point for point in _points(kind) if point.name == name]
    if not candidates:
        raise _unknown(name, kind)
    if len(candidates) > 1:
        raise _twice(name, [_described(point) for point in candidates], kind)
    described = _described(candidates[0])
    if _is_misnamed(name, kind):
        raise _misnamed(described, kind)
    wanted = f"a {kind.called} '{name}' that can be loaded ({described})"
    try:
        # What a package prints would spoil the one object that a command prints on standard output.
        with contextlib.redirect_stdout(sys.stderr):
            found = candidates[0].load()
    except (Exception, SystemExit) as error:  # (whatever a foreign package does, the user must learn of it)
        raise ConfigurationError(
            expected=wanted,
            seen=told(error),
            cure=f"Install {described.package} anew, or ask its makers for a version that fits truewheel",
        ) from error
    if not isinstance(found, kind.types):
        raise ConfigurationError(
            expected=wanted,
            seen=f"an object of type '{type(found).__name__}' instead of a "
            + " or ".join(one.__name__ for one in kind.types),
            cure=f"Ask the makers of {described.package} for a version that fits truewheel",
        )
    return described, found


def seen_cameras(name: str) -> tuple[SeenCamera, ...]:
    """Return the cameras that an installed driver sees; none where it cannot look.

    It may take seconds, and whatever the makers' libraries take.

    Raises
    ------
    ConfigurationError
        When the driver does not load, or fails to look, as without its maker's library.
    """
    loaded = load_driver(name)
    discover = loaded.driver.discover
    if discover is None:
        return ()
    try:
        with contextlib.redirect_stdout(sys.stderr):
            found = tuple(discover())
        if not all(isinstance(one, SeenCamera) for one in found):
            raise TypeError("not all that it found are a SeenCamera")  # (told like whatever else goes wrong)
    except ConfigurationError:
        raise
    except (Exception, SystemExit) as error:
        raise ConfigurationError(
            expected=f"the cameras that the driver '{name}' sees ({loaded.installed})",
            seen=told(error),
            cure=f"If it stays, tell the makers of {loaded.installed.package}",
        ) from error
    return found


def _points(kind: DriverKind) -> list[EntryPoint]:
    return list(entry_points(group=kind.group))


def _described(point: EntryPoint) -> InstalledDriver:
    distribution = point.dist
    try:
        package = (distribution.name if distribution else None) or "a package without a name"
        version = (distribution.version if distribution else None) or "without a version"
    except Exception:  # noqa: BLE001  (its metadata are damaged, the driver may be sound)
        package, version = "a package with damaged metadata", "of unknown version"
    return InstalledDriver(point.name, package, version, point.value)


def _unknown(name: str, kind: DriverKind) -> ConfigurationError:
    names = sorted({point.name for point in _points(kind)})
    close = difflib.get_close_matches(name, names, 1)
    meant = f"Did you mean '{close[0]}'? " if close else ""
    expected, seen = f"an installed {kind.called} ({', '.join(names) or 'there is none'})", f"'{name}'"
    if not names:
        # Not even those of this program: its metadata are from before it had any.
        cure = "Install truewheel anew, its metadata are older than the program (`make setup` in a checkout)"
        return ConfigurationError(expected=expected, seen=seen, cure=cure)
    remedy = Remedy(Deed.LIST_DRIVERS, then=f"{meant}Install the package that brings another")
    return ConfigurationError(expected=expected, seen=seen, remedy=remedy)


def _twice(name: str, installed: Sequence[InstalledDriver], kind: DriverKind) -> ConfigurationError:
    return ConfigurationError(
        expected=f"one package that brings the {kind.called} '{name}'",
        seen=" and ".join(str(one) for one in installed if one.name == name),
        cure="Uninstall all of them but one",
    )


def _is_misnamed(name: str, kind: DriverKind) -> bool:
    return not _NAME.fullmatch(name) or name in kind.reserved


def _misnamed(one: InstalledDriver, kind: DriverKind) -> ConfigurationError:
    return ConfigurationError(
        expected=f"a {kind.called} named by small letters, digits and underscores, other than "
        + ", ".join(sorted(kind.reserved)),
        seen=f"'{one.name}' ({one})",
        cure="Have its makers name it otherwise",
    )
