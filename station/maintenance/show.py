"""One image of each camera of a rig, as text for a terminal, as files and as a page."""

from __future__ import annotations

from pathlib import Path

from sensors.formats import write_image
from sensors.shot import WheelShot
from station.maintenance.figures import ImageFigures, bars, inline_picture, sparkline
from station.maintenance.remarks import advice
from station.pages import page

PAGE = "cameras.html"


def figures_as_text(figures: tuple[ImageFigures, ...]) -> list[str]:
    """Return a table of the cameras' figures, and what is to be done, line by line."""
    rows = [("camera", "saturated", "bright", "middle", "edges", "lines", "histogram (black … white)")]
    rows += [
        (
            each.camera,
            f"{each.saturated:.2%}",
            f"{each.bright:.0%}",
            f"{each.middle:.0%}",
            "–" if each.edge_px is None else f"{each.edge_px:.1f} px",
            "–" if each.brightness is None else f"{each.lines}, {each.brightness:.0%}",
            f"|{sparkline(each)}|",
        )
        for each in figures
    ]
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    lines = [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows
    ]
    return lines + [f"{each.camera}: {advice(each)}" for each in figures if advice(each)]


def write_show(folder: Path, shot: WheelShot, figures: tuple[ImageFigures, ...]) -> Path:
    """Write every image as its camera delivered it, and a page that shows them; return the page.

    Parameters
    ----------
    folder
        New.
    shot
        One of the rig.
    figures
        Of its images.
    """
    folder.mkdir(parents=True, exist_ok=True)
    cameras = []
    for frame, each in zip(shot.frames, figures, strict=True):
        name = "_".join(frame.camera.split("/")[1:]) or frame.camera
        write_image(folder / f"{name}.png", frame.image)
        cameras.append(
            {
                "name": frame.camera,
                "file": f"{name}.png",
                "picture": inline_picture(frame.image),
                "bars": bars(each),
                "figures": each,
                "advice": advice(each),
            }
        )
    path = folder / PAGE
    path.write_text(
        page(
            "station.maintenance",
            "show.html",
            title=f"Cameras of {shot.rig}",
            time=f"{shot.time_utc:%Y-%m-%d %H:%M:%S} UTC",
            exposure_ms=shot.frames[0].exposure_ms,
            cameras=cameras,
        ),
        encoding="utf-8",
    )
    return path
