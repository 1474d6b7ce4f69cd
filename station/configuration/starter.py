"""The configuration that comes with the program, and a copy of it to start a station from."""

from __future__ import annotations

import re
import shutil
import sys
from pathlib import Path

from alignment.errors import ConfigurationError

SHIPPED = Path(__file__).resolve().parents[2] / "configs"
"""Where it lies, in a checkout as in an installation."""
SERVICE_FILE = "truewheel.service"
_IDENTITY = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")


def own_configuration(name: str = "station.toml") -> Path | None:
    """Return the configuration of the current folder, in ``configs/`` or beside it, if there is one."""
    return next((place for place in (Path("configs") / name, Path(name)) if place.is_file()), None)


def write_starter(folder: Path, station: str = "station_1") -> list[Path]:
    """Write a configuration that starts as it stands, with simulated rigs, to be edited.

    Parameters
    ----------
    folder
        Home of the station: files go to its ``configs/``, a systemd unit beside it; made when missing.
    station
        Identity of the station in every record.

    Returns
    -------
    list of Path
        What was written.

    Raises
    ------
    ConfigurationError
        When a file is there already, which then stays as it is, or the identity is none; nothing is written.
    """
    if not _IDENTITY.fullmatch(station):
        raise ConfigurationError(
            field="station.id",
            expected="1 to 64 letters, digits, dots, dashes and underscores",
            seen=f"'{station}'",
        )
    sources = sorted(
        path for path in SHIPPED.rglob("*") if path.suffix in (".toml", ".dbc") and path.is_file()
    )
    copies = {source: folder / "configs" / source.relative_to(SHIPPED) for source in sources}
    unit = folder / SERVICE_FILE
    present = [path for path in (*copies.values(), unit) if path.exists()]
    if present:
        raise ConfigurationError(
            file=present[0],
            expected="a folder without a configuration",
            seen="a file of this name",
            cure="Name another folder; nothing was changed",
        )
    for source, copy in copies.items():
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, copy)
    settings = folder / "configs" / "station.toml"
    text = settings.read_text(encoding="utf-8")
    settings.write_text(
        re.sub(r'^id = ".*"$', f'id = "{station}"', text, count=1, flags=re.M), encoding="utf-8"
    )
    service = (SHIPPED / SERVICE_FILE).read_text(encoding="utf-8")
    program = Path(sys.executable).with_name("truewheel")
    unit.write_text(
        service.replace("@HOME@", str(folder.resolve())).replace("@PROGRAM@", str(program)), encoding="utf-8"
    )
    return [*copies.values(), unit]


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
            cure="Name one with --config, or write one to start from: `truewheel init FOLDER`",
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
            file=place, expected="a configuration", seen="no such file", cure="Name one with --config"
        )
    return place


def reason_of_force(force: bool, reason: str, what: str, longest: int = 1000) -> str | None:
    """Return why something is forced; None when it is not.

    Raises
    ------
    ConfigurationError
        When only one of ``--force`` and ``--reason`` is given, or the reason has more than `longest`
        characters; `what` names what is forced.
    """
    if force != bool(reason.strip()):
        raise ConfigurationError(
            field="--force, --reason",
            expected=f"both or neither: a forced {what} says why",
            seen="--force alone" if force else "--reason alone",
            cure='Add --reason "…"' if force else "Add --force, or leave the reason out",
        )
    if len(reason.strip()) > longest:
        raise ConfigurationError(
            field="--reason", expected=f"at most {longest} characters", seen=str(len(reason.strip()))
        )
    return reason.strip() if force else None
