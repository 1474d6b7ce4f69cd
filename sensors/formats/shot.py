"""A recorded shot: a folder of images and ``shot.json``, see `shot_file`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from datetime import UTC
from os import PathLike
from pathlib import Path

from alignment.errors import FormatError
from alignment.values import RigCalibration
from sensors.camera import Frame
from sensors.formats.files import write_folder
from sensors.formats.images import encode_image, read_image
from sensors.formats.shot_file import FRAME_NUMBERS, SHOT_1, SHOT_2, FrameEntry, HeadShot, ShotFile
from sensors.formats.validation import dump_json, load_json, validate
from sensors.shot import HeadFrames, SeriesPlace, WheelShot

SHOT_FILE = "shot.json"


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
    return WheelShot(
        described.rig,
        described.time_utc.astimezone(UTC),
        _read_heads(folder, described.heads, calibration),
        _read_heads(folder, described.dark or (), calibration),
        _place(described),
    )


def _read_heads(
    folder: Path, heads: Sequence[HeadShot], calibration: RigCalibration | None
) -> tuple[HeadFrames, ...]:
    found = []
    for index, entry in enumerate(heads):
        left, right = None, None
        if calibration is not None:
            left, right = ((c.model.width, c.model.height) for c in calibration.heads[index].cameras)
        frames = read_frame(folder, entry.left, left), read_frame(folder, entry.right, right)
        found.append(HeadFrames(entry.name, *frames))
    return tuple(found)


def _place(described: ShotFile) -> SeriesPlace | None:
    found = described.series
    return None if found is None else SeriesPlace(found.number, found.exposures, found.turn)


def read_frame(folder: Path, entry: FrameEntry, expected_size: tuple[int, int] | None = None) -> Frame:
    """Read one image of a shot as the frame it was; `expected_size` is (width, height), pixels."""
    numbers = entry.model_dump(include=set(FRAME_NUMBERS))
    return Frame(
        camera=entry.camera,
        image=read_image(folder / entry.image, expected_size),
        **numbers,
        in_force=None if entry.in_force is None else entry.in_force.value(),
        temperature_c=entry.temperature_c,
    )


def write_shot(folder: str | PathLike[str], shot: WheelShot) -> None:
    """Write a shot into a new folder, whole or not at all; it reads back to exactly the same values.

    What the first version of the format can say is written in it, so that every older program reads it.

    Parameters
    ----------
    folder
        Must not exist, or be empty: a recorded shot is never replaced.
    shot
        Images become 8- or 16-bit PNG named ``<head>_<side>.png``, dark ones ``<head>_<side>_dark.png``.

    Raises
    ------
    FormatError
        When a value is out of the format's range, or the folder holds something or cannot be written.
    """
    folder = Path(folder)
    write_folder(folder, shot_files(shot, folder))


def shot_files(shot: WheelShot, folder: Path) -> dict[str, bytes]:
    """Return the files of a shot, by name; `folder` is named in what `write_shot` raises of its values."""
    files: dict[str, bytes] = {}
    data: dict[str, object] = {
        "schema": SHOT_2 if _says_more(shot) else SHOT_1,
        "rig": shot.rig,
        "time_utc": shot.time_utc.astimezone(UTC),
        "heads": _head_entries(shot.heads, "", files),
    }
    if shot.series is not None:
        data["series"] = asdict(shot.series)
    if shot.dark:
        data["dark"] = _head_entries(shot.dark, "_dark", files)
    described = validate(ShotFile, data, file=folder / SHOT_FILE)
    return files | {SHOT_FILE: dump_json(described, without_none=True)}


def _says_more(shot: WheelShot) -> bool:
    """Whether it says what only the second version of the format holds."""
    told = (f.in_force is not None or f.temperature_c is not None for f in shot.frames)
    return shot.series is not None or bool(shot.dark) or any(told)


def _head_entries(
    heads: Sequence[HeadFrames], ending: str, files: dict[str, bytes]
) -> list[dict[str, object]]:
    """Describe heads, and add their images to the files."""
    found = []
    for head in heads:
        entries: dict[str, object] = {"name": head.name}
        for side, frame in (("left", head.left), ("right", head.right)):
            image = f"{head.name}_{side}{ending}.png"
            files[image] = encode_image(frame.image)
            entries[side] = FrameEntry.of(frame, image)
        found.append(entries)
    return found


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
