"""The studies by name; a study's module is loaded when it is asked for."""

from __future__ import annotations

from importlib import import_module
from typing import cast

from alignment.errors import ConfigurationError
from station.studies.study import Study

STUDIES = {
    "correction": "station.studies.correction",
    "lenz-tsai": "station.studies.lenz_tsai",
    "nonparallel-head": "station.studies.nonparallel_head",
}
"""Name and module; the module has the study under the name `STUDY`."""


def load_study(name: str) -> Study:
    """Return the study of that name.

    Raises
    ------
    ConfigurationError
        When there is none.
    """
    if name not in STUDIES:
        raise ConfigurationError(
            field="NAME", expected=f"one of {', '.join(sorted(STUDIES))}, or 'all'", seen=f"'{name}'"
        )
    return cast("Study", import_module(STUDIES[name]).STUDY)
