"""A camera that plays recorded shot folders, one for each trigger, in order."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
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
from sensors.formats.shot_file import FrameEntry
from sensors.formats.validation import FilePath, StrictModel
from sensors.frames import FrameTolerance
from sensors.rig import Rig, StereoHead


class RecordedOptions(StrictModel):
    """Cameras that play recorded shots."""

    shots: FilePath = Field(description="Folder of recorded shots, played in the order of their names")
    at_end: Literal["stop", "repeat"] = Field(
        default="stop", description="What follows the last shot: a camera fault, or the first shot again"
    )


class RecordedCamera(QueuedCamera):
    """Plays one camera of recorded shots. Settings are accepted; the images keep those they were taken with.

    Connecting begins with the first folder, arming goes on with the next. Frames count the triggers of this
    run; device time and exposure are the recorded ones, the host time is when the frame was fetched.

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
        self._entries: list[FrameEntry] = []
        self._played = 0

    def _open(self) -> None:
        """Read what all the shots say, so that a missing one shows now and not in the middle of a run.

        Raises
        ------
        FormatError
            When a shot cannot be read, lacks the head, or its image is missing.
        """
        self._entries = [self._entry(folder) for folder in self._folders]
        self._played = 0

    def _entry(self, folder: Path) -> FrameEntry:
        shot = read_shot_file(folder)
        heads = {head.name: head for head in shot.heads}
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
        return entry

    def _expose(self, counter: int, settings: CameraSettings) -> QueuedExposure:
        index = self._played
        if index >= len(self._entries):
            if self._at_end == "stop":
                raise CameraError(
                    self.name,
                    f"the recording ended after {count_of(len(self._entries), 'shot')}, "
                    f"trigger {counter} has none",
                    "Record more shots, or let the recording repeat",
                )
            index %= len(self._entries)
        self._played += 1
        frame = read_frame(self._folders[index], self._entries[index])
        return QueuedExposure(counter, frame.image, frame.device_time_s, frame.exposure_ms, self._clock())


def recorded_rig(
    folders: Sequence[str | PathLike[str]],
    at_end: Literal["stop", "repeat"] = "stop",
    name: str | None = None,
    tolerance: FrameTolerance | None = None,
) -> Rig:
    """Return a rig that plays recorded shots; each `Rig.shoot` gives the next folder's images.

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

    return Rig(
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
