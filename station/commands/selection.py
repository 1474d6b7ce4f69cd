"""Options by which results are chosen; the same for reports and exports."""

from __future__ import annotations

from typing import Annotated

import typer

FromOption = Annotated[
    str | None,
    typer.Option(
        "--from",
        help="Beginning: ISO 8601, UTC without a zone, or a span before now such as 8h, 7d, 4w.",
        show_default=False,
    ),
]
UntilOption = Annotated[str | None, typer.Option("--until", help="End, not included.", show_default=False)]
ShiftOption = Annotated[
    str | None,
    typer.Option("--shift", help="Only these hours of every day: 06:00-14:00.", show_default=False),
]
ZoneOption = Annotated[str, typer.Option("--timezone", help="Of the shift: Europe/Berlin.")]
StationOption = Annotated[
    list[str] | None, typer.Option("--station", help="Only this station. Several.", show_default=False)
]
PlantOption = Annotated[
    list[str] | None, typer.Option("--plant", help="Only this plant. Several.", show_default=False)
]
TypeOption = Annotated[
    list[str] | None, typer.Option("--type", help="Only this vehicle type. Several.", show_default=False)
]
WheelOption = Annotated[
    list[str] | None, typer.Option("--wheel", help="Only this wheel. Several.", show_default=False)
]
VerdictOption = Annotated[
    str | None, typer.Option("--verdict", help="Only ok, nok or none.", show_default=False)
]
VinOption = Annotated[
    str | None,
    typer.Option("--vin", help="Only this VIN; * stands for anything.", show_default=False),
]
