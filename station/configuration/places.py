"""Where configurations lie: beside the program, and in the folder of a station."""

from __future__ import annotations

from pathlib import Path

from alignment.errors import ConfigurationError, Deed, Remedy

SHIPPED = Path(__file__).resolve().parents[2] / "configs"
"""Where it lies, in a checkout as in an installation."""


def own_configuration(name: str = "station.toml") -> Path | None:
    """Return the configuration of the current folder, in ``configs/`` or beside it, if there is one."""
    return next((place for place in (Path("configs") / name, Path(name)) if place.is_file()), None)


def own_config(given: Path | None) -> Path:
    """Return the configuration of the station that is to run: the given one, else that of this folder.

    Unlike `default_config` never the one beside the program, whose database would lie there too.

    Raises
    ------
    ConfigurationError
        When none is given and there is none here.
    """
    found = given or own_configuration()
    if found is None:
        raise ConfigurationError(
            file=Path("configs") / "station.toml",
            expected="a station's configuration",
            seen="no such file",
            remedy=Remedy(Deed.BEGIN_CONFIGURATION),
        )
    return found


def default_config(given: Path | None, name: str = "station.toml") -> Path:
    """Return the configuration to use: the given one, else ``configs/`` here or beside the program.

    Raises
    ------
    ConfigurationError
        When none is given and there is none in either place.
    """
    if given is not None:
        return given
    place = own_configuration(name) or SHIPPED / name
    if not place.is_file():
        raise ConfigurationError(
            file=place,
            expected="a configuration",
            seen="no such file",
            remedy=Remedy(Deed.NAME_CONFIGURATION),
        )
    return place
