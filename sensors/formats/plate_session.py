"""Images of a plate in several positions: a folder, schema ``truewheel.plate-session/1``."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from os import PathLike
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import AwareDatetime, Field, model_validator

from alignment.arrays import Array
from alignment.calibration import CameraKey
from alignment.errors import DegenerateInputError, FormatError
from alignment.values import SIDES, Image, Side
from sensors.formats.calibration import check_side
from sensors.formats.files import write_folder
from sensors.formats.images import encode_image, read_image
from sensors.formats.plate import AnyPlateFile, PlateDescription, describe_plate, read_plate
from sensors.formats.shot_file import ImageName
from sensors.formats.validation import FilePath, Name, StrictModel, dump_json, load_json, validate

SESSION_FILE = "session.json"
CERTIFICATE_FILE = "plate_certificate.csv"
StageCoordinate = Annotated[float, Field(ge=-10_000, le=10_000)]


class ImageSize(StrictModel):
    """Size of all images of one camera."""

    width: int = Field(ge=1, le=32_768, description="Width of the images, pixels")
    height: int = Field(ge=1, le=32_768, description="Height of the images, pixels")


class HeadCameras(StrictModel):
    """The cameras of one head."""

    name: Name = Field(description="Name of the head; the calibration will name it the same")
    left: ImageSize | None = Field(
        default=None, description="The camera that the calibration will call left, null when there is none"
    )
    right: ImageSize | None = Field(
        default=None, description="The camera that the calibration will call right, null when there is none"
    )

    @model_validator(mode="after")
    def _has_camera(self) -> HeadCameras:
        if self.left is None and self.right is None:
            raise DegenerateInputError(field="left", expected="at least one camera", seen="none")
        return self


class HeadImages(StrictModel):
    """What one head saw in one view."""

    head: Name = Field(description="Name of the head")
    left: ImageName | None = Field(
        default=None, description="Image of its left camera, a file in this folder; null when none was taken"
    )
    right: ImageName | None = Field(
        default=None, description="Image of its right camera, a file in this folder; null when none was taken"
    )


class ViewEntry(StrictModel):
    """One position of the plate."""

    name: Name = Field(description="Name of the view")
    stage_mm: tuple[StageCoordinate, StageCoordinate, StageCoordinate] | None = Field(
        description="Where the stage says the plate's origin is in the rig frame, millimetres, the plate's "
        "axes along the rig's; null for a plate in an unknown pose, such as held by hand or tilted"
    )
    images: tuple[HeadImages, ...] = Field(
        min_length=1, max_length=16, description="What was seen, head by head"
    )


class PlateSessionFile(StrictModel):
    """What ``session.json`` holds."""

    schema_: Literal["truewheel.plate-session/1"] = Field(
        alias="schema", description="Kind and version of this file"
    )
    rig: Name = Field(description="Name of the rig; its calibration and its shots name the same")
    side: Literal["left", "right"] = Field(description="Side of the vehicle")
    time_utc: AwareDatetime = Field(description="When the session began, ISO 8601 with the zone")
    plate: AnyPlateFile | None = Field(
        default=None, description="Description of the plate; null when plate_file names one"
    )
    plate_file: FilePath | None = Field(
        default=None, description="TOML file that describes the plate, relative to this folder"
    )
    stage_tolerance_mm: float = Field(
        default=0.01, ge=1e-4, le=1, description="Each stage coordinate is right within ± this, millimetres"
    )
    heads: tuple[HeadCameras, ...] = Field(
        min_length=1, max_length=16, description="Heads and cameras, in the order of the shots"
    )
    views: tuple[ViewEntry, ...] = Field(min_length=1, max_length=500, description="Positions of the plate")

    @model_validator(mode="after")
    def _is_session(self) -> PlateSessionFile:
        if (self.plate is None) == (self.plate_file is None):
            raise DegenerateInputError(
                field="plate",
                expected="either a plate here or the name of its file under 'plate_file'",
                seen="neither" if self.plate is None else "both",
            )
        check_side(self.rig, self.side)
        _check_different("heads", "heads", [head.name for head in self.heads])
        _check_different("views", "views", [view.name for view in self.views])
        self._check_images()
        return self

    def _check_images(self) -> None:
        without_image = set(self.sizes())
        every: list[str] = []
        for v, view in enumerate(self.views):
            place = f"views[{v}].images"
            _check_different(place, "heads", [entry.head for entry in view.images])
            for n, entry in enumerate(view.images):
                for side, image in ((side, getattr(entry, side)) for side in SIDES):
                    if image is None:
                        continue
                    if (entry.head, side) not in self.sizes():
                        raise DegenerateInputError(
                            field=f"{place}[{n}].{side}",
                            expected="an image of a camera that 'heads' lists",
                            seen=f"one of {entry.head} {side}",
                        )
                    without_image.discard((entry.head, side))
                    every.append(image)
        _check_different("views", "images", every)
        if without_image:
            listed = ", ".join(f"{head} {side}" for head, side in sorted(without_image))
            raise DegenerateInputError(
                field="views", expected="at least one image of each camera", seen=f"none of {listed}"
            )

    def sizes(self) -> dict[CameraKey, tuple[int, int]]:
        """(width, height) of each camera's images, heads in order, left before right."""
        cameras = ((head, side) for head in self.heads for side in SIDES)
        sizes = {(head.name, side): getattr(head, side) for head, side in cameras}
        return {key: (size.width, size.height) for key, size in sizes.items() if size is not None}


def _check_different(place: str, what: str, names: list[str]) -> None:
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise DegenerateInputError(
            field=place, expected=f"{what} with different names", seen=f"'{twice[0]}' twice"
        )


@dataclass(frozen=True, eq=False)
class SessionView:
    """The images of one position of the plate.

    Attributes
    ----------
    name
        Name of the view.
    stage_mm
        (3,) where the stage says the plate's origin is, rig frame; None for an unknown pose.
    images
        By head and camera; a camera that is missing took none.
    """

    name: str
    stage_mm: Array | None
    images: Mapping[CameraKey, Image]


@dataclass(frozen=True, eq=False)
class PlateSession:
    """All images of a plate from which one rig is calibrated.

    Attributes
    ----------
    rig, side
        Name of the rig, side of the vehicle.
    time_utc
        When the session began; aware.
    plate
        The plate of all views.
    sizes
        (width, height) of each camera's images; names every camera, heads in the order in which a shot gives
        their images, left before right.
    views
        Positions of the plate.
    stage_tolerance_mm
        Each stage coordinate is right within ± this.
    """

    rig: str
    side: Side
    time_utc: datetime
    plate: PlateDescription
    sizes: Mapping[CameraKey, tuple[int, int]]
    views: tuple[SessionView, ...]
    stage_tolerance_mm: float = field(default=0.01)

    @property
    def heads(self) -> tuple[str, ...]:
        """Names of the heads, in order."""
        return tuple(dict.fromkeys(head for head, _ in self.sizes))

    @property
    def stage_sigma_mm(self) -> float:
        """Standard uncertainty of each stage coordinate, for an even distribution within the tolerance."""
        return self.stage_tolerance_mm / math.sqrt(3.0)


def read_plate_session(folder: str | PathLike[str]) -> PlateSession:
    """Read a plate session with all its images.

    Raises
    ------
    FormatError
        When anything of the session, its images or the plate's certificate is missing, damaged, unknown or
        out of range, or an image has another size than its camera.
    ConfigurationError
        When the file that describes the plate is missing or wrong.
    """
    folder = Path(folder)
    if not folder.is_dir():
        seen = "a file" if folder.is_file() else "no such folder"
        raise FormatError(file=folder, expected=f"a folder with {SESSION_FILE} and its images", seen=seen)
    path = folder / SESSION_FILE
    found = validate(PlateSessionFile, load_json(path, "the description of a plate session"), file=path)
    if found.plate is not None:
        plate = describe_plate(found.plate, folder)
    else:
        plate = read_plate(folder / str(found.plate_file))
    sizes = found.sizes()
    return PlateSession(
        rig=found.rig,
        side=found.side,
        time_utc=found.time_utc.astimezone(UTC),
        plate=plate,
        sizes=sizes,
        views=tuple(_read_view(folder, entry, sizes) for entry in found.views),
        stage_tolerance_mm=found.stage_tolerance_mm,
    )


def _read_view(folder: Path, entry: ViewEntry, sizes: Mapping[CameraKey, tuple[int, int]]) -> SessionView:
    images: dict[CameraKey, Image] = {}
    for head in entry.images:
        for side in SIDES:
            name = getattr(head, side)
            if name is not None:
                images[head.head, side] = _read_view_image(folder / name, entry.name, sizes[head.head, side])
    return SessionView(entry.name, None if entry.stage_mm is None else np.array(entry.stage_mm), images)


def _read_view_image(path: Path, view: str, size: tuple[int, int]) -> Image:
    if not path.exists():
        raise FormatError(
            file=path,
            expected=f"an image of view '{view}'",
            seen="no such file",
            cure=f"Copy it, or record the view again, or write null for it in {SESSION_FILE}",
        )
    image = read_image(path)
    width, height = size
    if image.shape != (height, width):
        raise FormatError(
            file=path,
            expected=f"an image of {width} × {height} pixels, as {SESSION_FILE} says of its camera",
            seen=f"{image.shape[1]} × {image.shape[0]}",
            cure="Use the images as the camera delivers them",
        )
    return image


def write_plate_session(folder: str | PathLike[str], session: PlateSession) -> None:
    """Write a plate session into a new folder, whole or not at all; it reads back to exactly the same values.

    Parameters
    ----------
    folder
        Must not exist, or be empty: what is recorded is never replaced.
    session
        Images become 8- or 16-bit PNG named ``<view>_<head>_<side>.png``; the plate's description goes into
        ``session.json``, its certificate beside it.

    Raises
    ------
    FormatError
        When a value is out of the format's range, or the folder holds something or cannot be written.
    """
    folder = Path(folder)
    files: dict[str, bytes] = {}
    views: list[dict[str, object]] = []
    for view in session.views:
        entries: dict[str, dict[str, str]] = {}
        for (head, side), image in view.images.items():
            name = f"{view.name}_{head}_{side}.png"
            files[name] = encode_image(image)
            entries.setdefault(head, {"head": head})[side] = name
        stage = None if view.stage_mm is None else np.asarray(view.stage_mm, dtype=float).tolist()
        views.append({"name": view.name, "stage_mm": stage, "images": list(entries.values())})
    heads: dict[str, dict[str, object]] = {head: {"name": head} for head in session.heads}
    for (head, side), (width, height) in session.sizes.items():
        heads[head][side] = {"width": width, "height": height}
    plate = session.plate.file.model_dump(mode="json", by_alias=True)
    if session.plate.certificate is not None:
        plate["certificate"] = CERTIFICATE_FILE
        files[CERTIFICATE_FILE] = session.plate.certificate
    data = {
        "schema": "truewheel.plate-session/1",
        "rig": session.rig,
        "side": session.side,
        "time_utc": session.time_utc.astimezone(UTC),
        "plate": plate,
        "stage_tolerance_mm": session.stage_tolerance_mm,
        "heads": list(heads.values()),
        "views": views,
    }
    described = validate(PlateSessionFile, data, file=folder / SESSION_FILE)
    write_folder(folder, {**files, SESSION_FILE: dump_json(described)})
