"""What a camera driver declares: the model of its settings, and how they become cameras.

An installed package adds a driver by an entry point of the group ``truewheel.cameras``, whose name is the
table of a rig in the station's configuration, and whose value is a `CameraDriver` or a `RigDriver`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Generic, Literal, TypeVar

from alignment.errors import ConfigurationError
from alignment.values import RigCalibration, Side
from sensors.camera import Camera, CameraSettings
from sensors.formats.validation import StrictModel
from sensors.frames import FrameTolerance
from sensors.rig import Rig

S = TypeVar("S", bound=StrictModel)


@dataclass(frozen=True)
class RigPlace:
    """The rig whose cameras are asked for.

    Attributes
    ----------
    rig
        Its name, such as ``front_left``.
    side
        Side of the vehicle.
    heads
        Names of its heads, in the order of the calibration; empty when there is no calibration.
    folder
        Folder of the configuration, where relative paths of the settings start.
    settings
        What every camera is told.
    tolerance
        What the frames of one shot may differ by.
    """

    rig: str
    side: Side
    heads: tuple[str, ...]
    folder: Path
    settings: CameraSettings
    tolerance: FrameTolerance

    def camera(self, head: str, side: Literal["left", "right"]) -> CameraPlace:
        """Return the place of one of its cameras."""
        return CameraPlace(f"{self.rig}/{head}/{side}", self, head, side)


@dataclass(frozen=True)
class CameraPlace:
    """The camera that is asked for.

    Attributes
    ----------
    name
        What `Camera.name` must be, such as ``front_left/head_1/left``.
    rig
        Of which it is a part.
    head
        Name of its stereo head.
    side
        ``left`` or ``right`` camera of that head.
    """

    name: str
    rig: RigPlace
    head: str
    side: Literal["left", "right"]


@dataclass(frozen=True)
class SeenCamera:
    """A camera as it names itself.

    Attributes
    ----------
    serial_number, model
        Of the camera.
    address
        Where it is: of its network, of its socket.
    user_name
        What somebody named it; empty where nobody did.
    """

    serial_number: str
    model: str
    address: str = ""
    user_name: str = ""


Discovery = Callable[[], Sequence[SeenCamera]]
"""Looks for cameras, in seconds; those in use are seen too."""


@dataclass(frozen=True)
class KnownCalibration:
    """The calibration of a rig that needs none to be measured, as it was built and not adjusted.

    Attributes
    ----------
    calibration
        Of the rig.
    method
        How it is known, for the record.
    created_utc
        Aware time, for the record; it does not age.
    """

    calibration: RigCalibration
    method: str
    created_utc: datetime


@dataclass(frozen=True, eq=False)
class CameraDriver(Generic[S]):
    """A driver of single cameras, of which the station builds heads and rigs by the calibration's names.

    Attributes
    ----------
    settings
        Model of the table that stands in a rig: a `StrictModel`, every number with its bounds.
    make
        Returns one camera of the rig, not connected; called once for each. It opens nothing yet.
    check
        Looks for mistakes that can be found without a camera, and raises `ConfigurationError`, whose `field`
        is a field of the settings; `truewheel config check` and every start call it.
    discover
        Looks for cameras that can be reached, which `truewheel camera list` shows.

    Raises
    ------
    ConfigurationError
        When the settings are no strict model, or what must be called cannot be.
    """

    settings: type[S]
    make: Callable[[S, CameraPlace], Camera]
    check: Callable[[S, RigPlace], object] | None = None
    discover: Discovery | None = None

    def __post_init__(self) -> None:
        _require_parts(self.settings, make=self.make, check=self.check, discover=self.discover)


@dataclass(frozen=True, eq=False)
class RigDriver(Generic[S]):
    """A driver of all cameras of a rig together: of a recording, of a simulator, of a common trigger.

    Attributes
    ----------
    settings, check, discover
        As for `CameraDriver`.
    make
        Returns the rig, not connected.
    calibration
        Of a rig that knows its own; the configuration may then leave it out.
    simulates
        Its images, 8 bit, are made by this program's compiled functions, which are loaded before the station
        is ready.
    plays
        Its images were taken before: what they say of their cameras is of then, and the next shot is one of
        another wheel, so that none is taken again.

    Raises
    ------
    ConfigurationError
        As for `CameraDriver`.
    """

    settings: type[S]
    make: Callable[[S, RigPlace], Rig]
    check: Callable[[S, RigPlace], object] | None = None
    calibration: Callable[[S, RigPlace], KnownCalibration] | None = None
    simulates: bool = False
    discover: Discovery | None = None
    plays: bool = False

    @property
    def in_process(self) -> bool:
        """Whether nothing but this program stands behind its cameras, which takes the time that it takes."""
        return self.simulates or self.plays

    def __post_init__(self) -> None:
        _require_parts(
            self.settings,
            make=self.make,
            check=self.check,
            calibration=self.calibration,
            discover=self.discover,
        )


Driver = CameraDriver[StrictModel] | RigDriver[StrictModel]


def _require_parts(settings: object, **called: object) -> None:
    if not (isinstance(settings, type) and issubclass(settings, StrictModel)):
        raise ConfigurationError(
            field="settings",
            expected="a model that descends from sensors.formats.validation.StrictModel",
            seen=getattr(settings, "__name__", repr(settings)),
        )
    loose = [
        f"{name}={settings.model_config.get(name)!r}"
        for name, strict in StrictModel.model_config.items()
        if settings.model_config.get(name) != strict
    ]
    if loose:
        raise ConfigurationError(
            field="settings",
            expected="a model as strict as StrictModel",
            seen=f"{settings.__name__} with {', '.join(loose)}",
        )
    for field, value in called.items():
        if not callable(value) and (value is not None or field == "make"):
            raise ConfigurationError(field=field, expected="a function", seen=repr(value))
