"""Is the environment of the program whole? One damaged package stops all that have plug-ins."""

from __future__ import annotations

from importlib.metadata import distributions

from alignment.errors import ConfigurationError, told


def damaged_package() -> ConfigurationError | None:
    """Return the error of the first installed package whose entry points cannot be read, if there is one.

    Libraries that look for their own plug-ins, such as pydantic, then fail as they are imported, with an
    error that names nothing. Loads none of them.
    """
    for distribution in distributions():
        try:
            list(distribution.entry_points)
        except Exception as error:  # noqa: BLE001  (whatever the file holds, it is what is looked for)
            place = getattr(distribution, "_path", None)
            return ConfigurationError(
                file=None if place is None else f"{place}/entry_points.txt",
                expected="entry points of an installed package",
                seen=told(error),
                cure="Install that package anew, or remove it",
            )
    return None
