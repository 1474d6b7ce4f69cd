"""Templates of the rooms, filled: each room keeps its own in ``templates``, all extend ``page.html``."""

from __future__ import annotations

from functools import cache
from typing import Any

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined


def page(room: str, template: str, **values: Any) -> str:
    """Return a page.

    Parameters
    ----------
    room
        The package whose template it is: ``station.quality.reports``.
    template
        Name of a file in its ``templates``.
    values
        What the template names. All is escaped but for `markupsafe.Markup`.

    Raises
    ------
    jinja2.UndefinedError
        When the template names a value that is not given.
    """
    return _templates(room).get_template(template).render(**values)


@cache
def _templates(room: str) -> Environment:
    environment = Environment(
        loader=ChoiceLoader([PackageLoader(room), PackageLoader("station.pages")]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["words"] = lambda name: str(name).replace("_", " ")
    return environment
