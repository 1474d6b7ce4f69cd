"""A recorded shot: a folder of images and ``shot.json``, schema ``truewheel.shot/1``."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC
from os import PathLike
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AwareDatetime, Field, model_validator

from alignment.errors import DegenerateInputError, FormatError
from alignment.values import RigCalibration
from sensors.camera import Frame
from sensors.formats.files import write_folder
from sensors.formats.images import encode_image, read_image
from sensors.formats.validation import Name, StrictModel, dump_json, load_json, validate
from sensors.frames import HOST_SPREAD_S
from sensors.shot import HeadFrames, WheelShot

SHOT_FILE = "shot.json"
_FRAME_NUMBERS = ("trigger_counter", "device_time_s", "host_time_s", "exposure_ms")

ImageName = Annotated[
    str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9 _.-]{0,200}\.([Pp][Nn][Gg]|[Tt][Ii][Ff][Ff]?)$")
]


class FrameEntry(StrictModel):
    """One image and what its camera said about it."""

    image: ImageName = Field(description="File in this folder, PNG or TIFF")
    camera: str = Field(min_length=1, max_length=200, description="Name of the camera")
    trigger_counter: int = Field(
        ge=1, lt=2**63, description="Count of the trigger; left and right of a head have the same"
    )
    device_time_s: float = Field(
        ge=-1e12, le=1e12, description="The camera's own clock at the exposure, seconds; its origin is free"
    )
    host_time_s: float = Field(
        ge=-1e12,
        le=1e12,
        description="The computer's monotonic clock when the image arrived, seconds; its origin is free",
    )
    exposure_ms: float = Field(gt=0, le=60_000, description="Exposure time, milliseconds")


class HeadShot(StrictModel):
    """The two images of one head."""

    name: Name = Field(description="Name of the head, as in the calibration")
    left: FrameEntry = Field(description="Image of the camera that the calibration calls left")
    right: FrameEntry = Field(description="Image of the camera that the calibration calls right")

    @model_validator(mode="after")
    def _is_of_one_trigger(self) -> HeadShot:
        if self.left.trigger_counter != self.right.trigger_counter:
            raise DegenerateInputError(
                field="right.trigger_counter",
                expected=f"{self.left.trigger_counter}, the trigger of the left image",
                seen=str(self.right.trigger_counter),
                cure="Pair images of the same trigger; images of two moments do not triangulate",
            )
        return self


class ShotFile(StrictModel):
    """What ``shot.json`` holds."""

    schema_: Literal["truewheel.shot/1"] = Field(alias="schema", description="Kind and version of this file")
    rig: Name = Field(description="Name of the rig, as in its calibration")
    time_utc: AwareDatetime = Field(description="When the cameras were triggered, ISO 8601 with the zone")
    heads: tuple[HeadShot, ...] = Field(
        min_length=1, max_length=16, description="The heads, in the order of the calibration"
    )

    @model_validator(mode="after")
    def _names_differ(self) -> ShotFile:
        entries = [entry for head in self.heads for entry in (head.left, head.right)]
        for field, what, names in (
            ("heads", "heads with different names", [head.name for head in self.heads]),
            ("heads", "a different image for each camera", [entry.image for entry in entries]),
        ):
            if len(set(names)) < len(names):
                twice = next(name for name in names if names.count(name) > 1)
                raise DegenerateInputError(field=field, expected=what, seen=f"'{twice}' twice")
        self._is_of_one_moment()
        return self

    def _is_of_one_moment(self) -> None:
        first = self.heads[0].left
        # A program that does not know the time writes 0.
        known = [e.host_time_s for h in self.heads for e in (h.left, h.right) if e.host_time_s != 0.0]
        for number, head in enumerate(self.heads):
            for side, entry in (("left", head.left), ("right", head.right)):
                if entry.trigger_counter != first.trigger_counter:
                    raise DegenerateInputError(
                        field=f"heads[{number}].{side}.trigger_counter",
                        expected=f"{first.trigger_counter}, the trigger of the first image",
                        seen=f"{entry.trigger_counter} of camera {entry.camera}",
                        cure="Put images of one trigger into a shot; where triggers are not counted, write 1",
                    )
                if entry.host_time_s != 0.0 and abs(entry.host_time_s - known[0]) > HOST_SPREAD_S:
                    raise DegenerateInputError(
                        field=f"heads[{number}].{side}.host_time_s",
                        expected=f"within {HOST_SPREAD_S:g} s of the first image, {known[0]:g}",
                        seen=f"{entry.host_time_s:g} of camera {entry.camera}",
                        cure="Put images of one trigger into a shot; where times are not known, write 0",
                    )


def read_shot_file(folder: str | PathLike[str]) -> ShotFile:
    """Read and check ``shot.json`` without the images; errors as `read_shot`."""
    folder = Path(folder)
    if not folder.is_dir():
        seen = "a file" if folder.is_file() else "no such folder"
        raise FormatError(file=folder, expected=f"a folder with {SHOT_FILE} and its images", seen=seen)
    path = folder / SHOT_FILE
    return validate(ShotFile, load_json(path, "the description of a shot"), file=path)


def read_shot(folder: str | PathLike[str], calibration: RigCalibration | None = None) -> WheelShot:
    """Read a recorded shot.

    Parameters
    ----------
    folder
        Holds ``shot.json`` and the images it names.
    calibration
        When given, the shot must be of its rig, with its heads and its image sizes.

    Raises
    ------
    FormatError
        When anything is missing, damaged, unknown or out of range, or does not match the calibration.
    """
    folder = Path(folder)
    described = read_shot_file(folder)
    if calibration is not None:
        names = [head.name for head in described.heads]
        _check_names(described.rig, names, calibration, folder / SHOT_FILE)
    heads = []
    for index, entry in enumerate(described.heads):
        left, right = None, None
        if calibration is not None:
            left, right = ((c.model.width, c.model.height) for c in calibration.heads[index].cameras)
        heads.append(
            HeadFrames(
                entry.name, read_frame(folder, entry.left, left), read_frame(folder, entry.right, right)
            )
        )
    return WheelShot(described.rig, described.time_utc.astimezone(UTC), tuple(heads))


def read_frame(folder: Path, entry: FrameEntry, expected_size: tuple[int, int] | None = None) -> Frame:
    """Read one image of a shot as the frame it was; `expected_size` is (width, height), pixels."""
    numbers = entry.model_dump(include=set(_FRAME_NUMBERS))
    return Frame(camera=entry.camera, image=read_image(folder / entry.image, expected_size), **numbers)


def write_shot(folder: str | PathLike[str], shot: WheelShot) -> None:
    """Write a shot into a new folder, whole or not at all; it reads back to exactly the same values.

    Parameters
    ----------
    folder
        Must not exist, or be empty: a recorded shot is never replaced.
    shot
        Images become 8- or 16-bit PNG named ``<head>_<side>.png``.

    Raises
    ------
    FormatError
        When a value is out of the format's range, or the folder holds something or cannot be written.
    """
    folder = Path(folder)
    files: dict[str, bytes] = {}
    heads = []
    for head in shot.heads:
        entries: dict[str, object] = {"name": head.name}
        for side, frame in (("left", head.left), ("right", head.right)):
            image = f"{head.name}_{side}.png"
            files[image] = encode_image(frame.image)
            numbers = {name: getattr(frame, name) for name in _FRAME_NUMBERS}
            entries[side] = {"image": image, "camera": frame.camera, **numbers}
        heads.append(entries)
    data = {
        "schema": "truewheel.shot/1",
        "rig": shot.rig,
        "time_utc": shot.time_utc.astimezone(UTC),
        "heads": heads,
    }
    described = validate(ShotFile, data, file=folder / SHOT_FILE)
    write_folder(folder, {**files, SHOT_FILE: dump_json(described)})


def check_shot_matches(
    shot: WheelShot, calibration: RigCalibration, file: str | PathLike[str] | None = None
) -> None:
    """Check that a shot was taken by the rig of a calibration: its name, its heads in order, image sizes.

    Parameters
    ----------
    shot
        Live or recorded.
    calibration
        Of the rig.
    file
        Where the shot was read, for the message.

    Raises
    ------
    FormatError
        When it was not.
    """
    _check_names(shot.rig, [head.name for head in shot.heads], calibration, file)
    for head, known in zip(shot.heads, calibration.heads, strict=True):
        for side, frame, camera in (("left", head.left, known.left), ("right", head.right, known.right)):
            height, width = frame.image.shape
            if (width, height) != (camera.model.width, camera.model.height):
                raise FormatError(
                    file=file,
                    field=f"{head.name}.{side}",
                    expected=f"an image of {camera.model.width} × {camera.model.height} pixels, "
                    f"as calibration {calibration.id} says",
                    seen=f"{width} × {height}",
                    cure="Use the calibration of these cameras, or images as the cameras deliver them",
                )


def _check_names(
    rig: str, heads: Sequence[str], calibration: RigCalibration, file: str | PathLike[str] | None
) -> None:
    known = [head.name for head in calibration.heads]
    of_calibration = f"calibration {calibration.id} is of"
    if rig != calibration.rig:
        raise FormatError(
            file=file,
            field="rig",
            expected=f"'{calibration.rig}', which {of_calibration}",
            seen=f"'{rig}'",
            cure=f"Use the calibration of rig '{rig}'",
        )
    if list(heads) != known:
        raise FormatError(
            file=file,
            field="heads",
            expected=f"the heads {', '.join(known)} in this order, which {of_calibration}",
            seen=", ".join(heads),
            cure="Use the calibration of these heads, or write them in its order",
        )
