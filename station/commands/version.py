"""`truewheel --version`: the versions of all parts, for people and as JSON."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import TYPE_CHECKING

import typer

from station.commands.output import print_json

if TYPE_CHECKING:
    from station.running import Parts


def print_version(*, as_json: bool) -> None:
    """Print what this program is made of."""
    from station.running import parts_of_program

    parts = parts_of_program()
    if as_json:
        print_json(asdict(parts))
        return
    lines = list(_lines(parts))
    width = max(len(name) for name, _ in lines)
    for name, text in lines:
        typer.echo(f"{name:<{width}}  {text}")
    for finding in parts.findings:
        typer.echo(f"truewheel: {finding}", err=True)


def _lines(parts: Parts) -> Iterator[tuple[str, str]]:
    """Names and versions; the program itself first, so that its version is found by any script."""
    yield "truewheel", parts.truewheel
    modified = " with changes" if parts.source.modified else ""
    yield "commit", f"{parts.source.commit}{modified}" if parts.source.commit else "unknown"
    yield "line interface", parts.interface or "unknown"
    yield "database revision", parts.database
    yield (
        "formats",
        ", ".join(text.removeprefix("truewheel.") for one in parts.formats.values() for text in one),
    )
    kernels = parts.kernels
    sizes = f"{kernels.functions} functions, {kernels.signatures} signatures"
    yield "compiled functions", f"{sizes}, sha256 {kernels.sha256[:12]}"
    yield "python", parts.python
    yield "platform", parts.platform
    for name, found in parts.libraries.items():
        yield name, found or "not installed"
    for name, found in parts.optional.items():
        yield f"{name} (optional)", found or "not installed"
    for driver in parts.drivers:
        yield f"{driver.drives}: {driver.name}", f"{driver.package} {driver.version}"
