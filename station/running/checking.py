"""Is a station's configuration sound? All that can be found without a camera, a bus or a database."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from urllib.parse import unquote

from alignment.errors import ConfigurationError, Deed, Remedy, TruewheelError
from db.connection import parse_url
from station.configuration import Configuration, read_configuration
from station.line.wire import load_line_database, require_interface
from station.running.cameras import check_rig
from station.running.frame import check_frame


def check_configuration(
    path: Path, *, uncalibrated: bool = False
) -> tuple[Configuration | None, list[TruewheelError]]:
    """Read a configuration with everything it names; return it with all that is wrong.

    Without the configuration itself there is one finding, the error of reading it. `uncalibrated` lets rigs
    be without a calibration.
    """
    try:
        configuration = read_configuration(path)
    except TruewheelError as error:
        return None, [error]
    found: list[TruewheelError] = []
    for check in _checks(configuration, uncalibrated):
        try:
            check()
        except TruewheelError as error:
            found.append(error)
    return configuration, found


def _checks(configuration: Configuration, uncalibrated: bool) -> Iterator[Callable[[], object]]:
    settings = configuration.settings
    yield lambda: configuration.hash
    yield lambda: load_line_database(configuration.path(settings.line.dbc))
    yield lambda: require_interface(settings.line.interface)
    yield lambda: _check_database(configuration)
    for field, name in (
        ("archive.folder", None if settings.archive is None else settings.archive.folder),
        ("cycle.image_folder", settings.cycle.image_folder),
        ("line.log", settings.line.log),
    ):
        if name is not None:
            yield lambda field=field, name=name: _check_writable(configuration, field, name)  # type: ignore[misc]
    for index in range(len(settings.rigs)):
        yield partial(check_rig, configuration, index, uncalibrated=uncalibrated)
    yield lambda: check_frame(configuration)


def _check_database(configuration: Configuration) -> None:
    settings = configuration.settings.database
    if settings.central_url is not None:
        parse_url(settings.central_url)
    url = parse_url(configuration.database_url)
    if url.get_backend_name() != "sqlite":
        return
    file = Path(unquote(url.database or ""))
    if not file.exists() and not settings.create:
        raise ConfigurationError(
            file=configuration.file,
            field="database.url",
            expected="a database that exists",
            seen=f"no file {file}",
            remedy=Remedy(Deed.MAKE_DATABASE, f"sqlite:///{file}"),
        )
    if not file.exists() and not _writable(file.parent):
        raise ConfigurationError(
            file=configuration.file,
            field="database.url",
            expected="a folder that can be written",
            seen=str(file.parent),
        )


def _check_writable(configuration: Configuration, field: str, name: str) -> None:
    path = configuration.path(name)
    if not _writable(path if path.is_dir() else path.parent):
        raise ConfigurationError(
            file=configuration.file, field=field, expected="a place that can be written", seen=f"'{name}'"
        )


def _writable(folder: Path) -> bool:
    """Whether files can be made there, or in the folder that it would be made in."""
    folder = folder.resolve()
    existing = next((place for place in (folder, *folder.parents) if place.exists()), folder)
    return existing.is_dir() and os.access(existing, os.W_OK)
