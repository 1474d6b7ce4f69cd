"""Cameras that play recorded shot folders in order, and the rig of them, which gives each shot whole."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Literal

from pydantic import Field

from alignment.counting import count_of
from alignment.errors import CameraError, ConfigurationError, FormatError
from alignment.values import Side
from sensors.camera import CameraSettings
from sensors.drivers.driver import RigDriver, RigPlace
from sensors.drivers.queued import QueuedCamera, QueuedExposure
from sensors.formats.files import entries
from sensors.formats.shot import SHOT_FILE, read_frame, read_shot_file
from sensors.formats.shot_file import FrameEntry, HeadShot
from sensors.formats.validation import FilePath, StrictModel
from sensors.frames import FrameTolerance
from sensors.rig import Rig, StereoHead
from sensors.shot import WheelShot


class RecordedOptions(StrictModel):
    """Cameras that play recorded shots."""

    shots: FilePath = Field(description="Folder of recorded shots, played in the order of their names")
    at_end: Literal["stop", "repeat"] = Field(
        default="stop", description="What follows the last shot: a camera fault, or the first shot again"
    )


@dataclass(frozen=True)
class _Played:
    """An image of a recording, and whether it is a dark one, which belongs to the one before."""

    folder: Path
    entry: FrameEntry
    dark: bool = False


class RecordedCamera(QueuedCamera):
    """Plays one camera of recorded shots. Settings are accepted; the images keep those they were taken with.

    Connecting begins with the first folder, arming goes on with the next. A shot that has a dark image takes
    two triggers, as it did when it was recorded: the second one plays that. Frames count the triggers of this
    run; the host time is when the frame was fetched, everything else is as recorded.

    Parameters
    ----------
    name
        Name of the camera.
    folders
        Shot folders, in the order in which they are played.
    head
        Name of the head in the shots.
    side
        ``left`` or ``right`` camera of that head.
    at_end
        After the last folder: ``stop`` makes the next trigger fail, ``repeat`` begins again with the first.
    clock, sleep
        As for `QueuedCamera`.

    Raises
    ------
    ConfigurationError
        When there is no folder.
    """

    def __init__(
        self,
        name: str,
        folders: Sequence[str | PathLike[str]],
        head: str,
        side: Side,
        at_end: Literal["stop", "repeat"] = "stop",
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        super().__init__(name, clock, sleep)
        if not folders:
            raise ConfigurationError(
                field=f"{name}.folders", expected="at least one shot folder", seen="none"
            )
        self._folders = tuple(Path(folder) for folder in folders)
        self._head = head
        self._side = side
        self._at_end = at_end
        self._entries: list[_Played] = []
        self._played = 0

    def _open(self) -> None:
        """Read what all the shots say, so that a missing one shows now and not in the middle of a run.

        Raises
        ------
        FormatError
            When a shot cannot be read, lacks the head, or its image is missing.
        """
        self._entries = [entry for folder in self._folders for entry in self._entries_of(folder)]
        self._played = 0

    def arm(self, settings: CameraSettings) -> None:
        """Take over settings, and go on with the next shot; see `Camera.arm`."""
        super().arm(settings)
        if self.dark_next:
            self._played += 1

    @property
    def dark_next(self) -> bool:
        """Whether the next trigger plays the dark image of the shot that was just played."""
        return bool(self._entries) and self._entries[self._played % len(self._entries)].dark

    def _entries_of(self, folder: Path) -> list[_Played]:
        shot = read_shot_file(folder)
        lit = self._entry(folder, shot.heads)
        if shot.dark is None:
            return [lit]
        return [lit, replace(self._entry(folder, shot.dark), dark=True)]

    def _entry(self, folder: Path, described: Sequence[HeadShot]) -> _Played:
        heads = {head.name: head for head in described}
        if self._head not in heads:
            raise FormatError(
                file=folder / SHOT_FILE,
                field="heads",
                expected=f"head '{self._head}', which camera {self.name} plays",
                seen=", ".join(heads),
            )
        head = heads[self._head]
        entry = head.left if self._side == "left" else head.right
        if not (folder / entry.image).is_file():
            raise FormatError(
                file=folder / entry.image,
                expected=f"the image that {SHOT_FILE} names",
                seen="no such file",
                cure="Copy the whole folder",
            )
        return _Played(folder, entry)

    def _expose(self, counter: int, settings: CameraSettings) -> QueuedExposure:
        index = self._played
        if index >= len(self._entries):
            if self._at_end == "stop":
                raise CameraError(
                    self.name,
                    f"the recording ended after {count_of(len(self._folders), 'shot')}, "
                    f"trigger {counter} has none",
                    "Record more shots, or let the recording repeat",
                )
            index %= len(self._entries)
        self._played += 1
        frame = read_frame(self._entries[index].folder, self._entries[index].entry)
        return QueuedExposure(
            counter,
            frame.image,
            frame.device_time_s,
            frame.exposure_ms,
            self._clock(),
            frame.in_force,
            frame.temperature_c,
        )


class RecordedRig(Rig):
    """A rig of recorded cameras: a shot that has dark images is given with them, as it was recorded.

    Its light is that of the recording, which no projector changes.
    """

    plays = True

    def shoot(self, timeout_s: float) -> WheelShot:
        """Play the next shot; see `Rig.shoot`."""
        lit = super().shoot(timeout_s)
        if not any(isinstance(camera, RecordedCamera) and camera.dark_next for camera in self.cameras):
            return lit
        return replace(lit, dark=super().shoot(timeout_s).heads)


def recorded_rig(
    folders: Sequence[str | PathLike[str]],
    at_end: Literal["stop", "repeat"] = "stop",
    name: str | None = None,
    tolerance: FrameTolerance | None = None,
) -> Rig:
    """Return a rig that plays recorded shots; each `Rig.shoot` gives the next folder's, with its dark images.

    Parameters
    ----------
    folders
        Shot folders of one rig; the first says which heads there are.
    at_end
        As for `RecordedCamera`.
    name
        Name of the rig; by default what the first shot says.
    tolerance
        What the frames of one shot may differ by. The same folder twice running repeats its
        images on purpose.

    Raises
    ------
    FormatError
        When the first folder is no shot.
    ConfigurationError
        When there is no folder.
    """
    if not folders:
        raise ConfigurationError(field="folders", expected="at least one shot folder", seen="none")
    shot = read_shot_file(folders[0])
    rig = name or shot.rig

    def camera(head: str, side: Side) -> RecordedCamera:
        return RecordedCamera(f"{rig}/{head}/{side}", folders, head, side, at_end)

    return RecordedRig(
        rig,
        [StereoHead(h.name, camera(h.name, "left"), camera(h.name, "right")) for h in shot.heads],
        tolerance=replace(tolerance or FrameTolerance(), repeats=_twice_running(folders, at_end)),
    )


def _twice_running(folders: Sequence[str | PathLike[str]], at_end: Literal["stop", "repeat"]) -> bool:
    """Whether a shot follows itself."""
    played = [Path(folder).resolve() for folder in folders]
    followers = played[1:] + (played[:1] if at_end == "repeat" else [])
    return any(one == other for one, other in zip(played, followers, strict=False))


def shot_folders(options: RecordedOptions, place: RigPlace) -> list[Path]:
    """Return the shots that a rig of a configuration plays, in the order of their names.

    Raises
    ------
    ConfigurationError
        When there are none.
    """
    folders = [path.parent for path in entries(place.folder / options.shots, SHOT_FILE, "shots")]
    if not folders:
        raise ConfigurationError(
            field="shots",
            expected=f"a folder of recorded shots, each a folder with {SHOT_FILE}",
            seen=f"none in '{options.shots}'",
        )
    return folders


def _make(options: RecordedOptions, place: RigPlace) -> Rig:
    return recorded_rig(shot_folders(options, place), options.at_end, place.rig, place.tolerance)


DRIVER = RigDriver(RecordedOptions, _make, check=shot_folders, plays=True)
"""The driver ``recorded``."""
