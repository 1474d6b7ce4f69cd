"""Who answers for something: a person by name, the same wherever one is asked for."""

from __future__ import annotations

from typing import Annotated

import typer

PersonOption = Annotated[
    str, typer.Option("--person", help="Who answers for it, by name.", show_default=False)
]
