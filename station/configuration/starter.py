"""A copy of the configuration that comes with the program, to start a station from."""

from __future__ import annotations

import re
import shutil
import sys
from pathlib import Path

from alignment.errors import ConfigurationError
from station.configuration.places import SHIPPED

SERVICE_FILE = "truewheel.service"
_IDENTITY = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")


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
