"""Templates of the rooms, filled: each room keeps its own in ``templates``, all extend ``page.html``."""

from __future__ import annotations

from functools import cache
from typing import Any

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup


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
    environment.filters["css_text"] = _css_text
    return environment


def _css_text(text: str) -> Markup:
    """Text between the quotes of a style sheet: whatever is not a letter or a digit is told by its number."""
    kept = (c if c.isalnum() and c.isascii() else f"\\{ord(c):x} " for c in text)
    return Markup("".join(kept))
