"""Brings the plate of the independent path tracer into a plate session."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from sensors.formats import PlateFile, PlateSession, SessionView, read_image
from sensors.formats.plate import describe_plate

HEADS = ("head_1", "head_2", "head_3")
SIDES = ("left", "right")


def plate_file(folder: Path) -> PlateFile:
    """The plate as its `plate.json` tells it: each head has the same arrangement of ring marks."""
    found = json.loads((folder / "plate" / "plate.json").read_text(encoding="utf-8"))
    first, last = found["index_range"]
    groups = [
        {"heads": (head,), "marks": ((i, j), (i + 2, j), (i, j + 1))}
        for head, (i, j) in found["corner_index"].items()
    ]
    return PlateFile.model_validate(
        {
            "schema": "truewheel.plate/1",
            "name": "path_traced",
            "columns": (first, last),
            "rows": (first, last),
            "pitch_mm": found["pitch_mm"],
            "mark_diameter_mm": found["mark_diameter_mm"],
            "hollow_diameter_mm": found["hollow_diameter_mm"],
            "hollow_marks": tuple(groups),
        }
    )


def session(folder: Path) -> PlateSession:
    """Three stage positions, 18 images."""
    described = json.loads((folder / "plate" / "plate.json").read_text(encoding="utf-8"))
    views = []
    for view in described["views"]:
        name = view["images"].split("_")[0]
        images = {
            (head, side): read_image(folder / "plate" / f"{name}_{head}_{side}.png")
            for head in HEADS
            for side in SIDES
        }
        views.append(SessionView(name, np.array(view["stage_mm"], float), images))
    return PlateSession(
        rig="path_traced",
        side="left",
        time_utc=datetime(2026, 1, 1, tzinfo=UTC),
        plate=describe_plate(plate_file(folder)),
        sizes={(head, side): (1280, 1024) for head in HEADS for side in SIDES},
        views=tuple(views),
    )
