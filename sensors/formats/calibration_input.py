"""What a calibration was computed from, schema ``truewheel.calibration-input/1``: it can be judged again."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from alignment.calibration import CalibrationInput, PlateView
from alignment.imaging import RING_MARKED, MarkObservations, Pattern, PatternKind, Plate
from sensors.formats.calibration import Coordinate
from sensors.formats.files import write_bytes
from sensors.formats.validation import Name, StrictModel, dump_json, load_json, validate

_Point = tuple[Coordinate, Coordinate, Coordinate]
Pixel = tuple[Coordinate, Coordinate]
Sigma = Annotated[float, Field(ge=0, le=1e3)]
Text = Annotated[str, Field(min_length=1, max_length=200)]
_MOST_MARKS = 160_000


MarkIndex = Annotated[int, Field(ge=-10_000, le=10_000)]


class PlateMark(StrictModel):
    """One mark of the plate."""

    index: tuple[MarkIndex, MarkIndex] = Field(description="Column and row")
    point_mm: _Point = Field(description="Stated position, millimetres")
    sigma_mm: tuple[Sigma, Sigma, Sigma] = Field(description="Its standard uncertainties, millimetres")
    hollow: bool = Field(description="True for a ring mark")


class PlateEntry(StrictModel):
    """The plate."""

    mark_radius_mm: float = Field(
        ge=0, le=1000, description="Radius of every mark, millimetres; 0 for corners of squares"
    )
    hollow_radius_mm: float = Field(ge=0, le=1000, description="Radius of the ring marks' light centres")
    marks: tuple[PlateMark, ...] = Field(min_length=4, max_length=_MOST_MARKS, description="Every mark")


class Seen(StrictModel):
    """The marks that one camera saw in one view."""

    head: Name = Field(description="Name of the head")
    side: Literal["left", "right"] = Field(description="Which camera of it")
    corrected: bool = Field(
        description="True: projections of the marks' centres; false: centres of their imaged outlines"
    )
    marks: tuple[Annotated[int, Field(ge=0, lt=_MOST_MARKS)], ...] = Field(
        max_length=_MOST_MARKS, description="Numbers of the plate's marks, from 0"
    )
    pixels: tuple[Pixel, ...] = Field(max_length=_MOST_MARKS, description="Where they are, pixels")
    covariances: tuple[tuple[Coordinate, Coordinate, Coordinate], ...] = Field(
        max_length=_MOST_MARKS, description="Variance in x, covariance, variance in y of each, pixels²"
    )
    blur_px: float | None = Field(
        default=None, ge=0, le=1e3, description="Blur of the marks' edges, pixels; null where not known"
    )
    contrast: float | None = Field(
        default=None, ge=0, le=1e6, description="Contrast of the marks over the noise; null where not known"
    )

    @model_validator(mode="after")
    def _is_complete(self) -> Seen:
        self.observations()
        return self

    def observations(self) -> MarkObservations:
        """Return the value that the mathematics uses."""
        xx, xy, yy = np.array(self.covariances, dtype=np.float64).reshape(-1, 3).T
        covariance = np.stack([np.stack([xx, xy], axis=1), np.stack([xy, yy], axis=1)], axis=1)
        return MarkObservations(
            np.array(self.marks, dtype=np.int64),
            np.array(self.pixels, dtype=np.float64).reshape(-1, 2),
            covariance,
            self.corrected,
            self.blur_px,
            self.contrast,
        )


class InputView(StrictModel):
    """One position of the plate."""

    name: Text = Field(description="Name of the view")
    stage_mm: _Point | None = Field(description="Stage position, millimetres; null for an unknown pose")
    seen: tuple[Seen, ...] = Field(max_length=64, description="What each camera saw")


class CameraSize(StrictModel):
    """One camera and the size of its images."""

    head: Name = Field(description="Name of the head")
    side: Literal["left", "right"] = Field(description="Which camera of it")
    width: int = Field(ge=1, le=32_768, description="Width, pixels")
    height: int = Field(ge=1, le=32_768, description="Height, pixels")


class CalibrationInputFile(StrictModel):
    """What a calibration was computed from."""

    schema_: Literal["truewheel.calibration-input/1"] = Field(
        alias="schema", description="Kind and version of this file"
    )
    calibration_id: Text = Field(description="Identity of the calibration that was computed from it")
    plate: PlateEntry = Field(description="The plate")
    cameras: tuple[CameraSize, ...] = Field(
        min_length=1, max_length=32, description="Every camera, heads in order, left before right"
    )
    stage_sigma_mm: float = Field(ge=0, le=1e3, description="Standard uncertainty of each stage coordinate")
    views: tuple[InputView, ...] = Field(min_length=1, max_length=500, description="Positions of the plate")

    @model_validator(mode="after")
    def _is_input(self) -> CalibrationInputFile:
        self.value()
        return self

    def value(self) -> CalibrationInput:
        """Return the value that the mathematics uses."""
        marks = self.plate.marks
        # What the marks are no longer matters here, but whether they are circles.
        squares = self.plate.mark_radius_mm == 0.0
        plate = Plate(
            np.array([mark.index for mark in marks], dtype=np.int64),
            np.array([mark.point_mm for mark in marks]),
            np.array([mark.sigma_mm for mark in marks]),
            self.plate.mark_radius_mm,
            np.array([mark.hollow for mark in marks]),
            self.plate.hollow_radius_mm,
            Pattern(PatternKind.CHESSBOARD) if squares else RING_MARKED,
        )
        views = tuple(
            PlateView(
                view.name,
                None if view.stage_mm is None else np.array(view.stage_mm),
                {(seen.head, seen.side): seen.observations() for seen in view.seen},
            )
            for view in self.views
        )
        sizes = {(c.head, c.side): (c.width, c.height) for c in self.cameras}
        return CalibrationInput(plate, views, sizes, self.stage_sigma_mm)


def read_calibration_input(path: str | PathLike[str]) -> CalibrationInput:
    """Read what a calibration was computed from.

    Raises
    ------
    FormatError
        When the file is missing, is no JSON, or any field is missing, unknown or out of range.
    """
    path = Path(path)
    return validate(CalibrationInputFile, load_json(path, "the input of a calibration"), file=path).value()


def write_calibration_input(path: str | PathLike[str], data: CalibrationInput, calibration_id: str) -> None:
    """Write what a calibration was computed from, whole or not at all; it reads back exactly.

    Raises
    ------
    FormatError
        When a value is out of the format's range, or the file cannot be written.
    """
    path, plate = Path(path), data.plate
    marks = [
        {"index": index, "point_mm": point, "sigma_mm": sigma, "hollow": hollow}
        for index, point, sigma, hollow in zip(
            plate.indices.tolist(),
            plate.points.tolist(),
            plate.sigma_mm.tolist(),
            plate.hollow.tolist(),
            strict=True,
        )
    ]
    content = {
        "schema": "truewheel.calibration-input/1",
        "calibration_id": calibration_id,
        "plate": {
            "mark_radius_mm": plate.mark_radius_mm,
            "hollow_radius_mm": plate.hollow_radius_mm,
            "marks": marks,
        },
        "cameras": [
            {"head": head, "side": side, "width": width, "height": height}
            for (head, side), (width, height) in data.sizes.items()
        ],
        "stage_sigma_mm": data.stage_sigma_mm,
        "views": [_view_fields(view) for view in data.views],
    }
    write_bytes(path, dump_json(validate(CalibrationInputFile, content, file=path)))


def _view_fields(view: PlateView) -> dict[str, object]:
    seen = [
        {
            "head": head,
            "side": side,
            "corrected": of.corrected,
            "marks": of.marks.tolist(),
            "pixels": of.pixels.tolist(),
            "covariances": np.stack(
                [of.covariance[:, 0, 0], of.covariance[:, 0, 1], of.covariance[:, 1, 1]], axis=1
            ).tolist(),
            "blur_px": of.blur_px,
            "contrast": of.contrast,
        }
        for (head, side), of in view.observations.items()
    ]
    stage = None if view.stage_mm is None else view.stage_mm.tolist()
    return {"name": view.name, "stage_mm": stage, "seen": seen}
