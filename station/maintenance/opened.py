"""A rig of the configuration, opened for a person to work with: calibrated or not."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from alignment.errors import ConfigurationError, FormatError
from sensors.camera import CameraSettings
from sensors.drivers.recorded import recorded_rig
from sensors.formats import SHOT_FILE
from sensors.projectors import LitRig, RigLight
from sensors.rig import Rig
from sensors.shot import WheelShot
from station.configuration import Configuration
from station.running import make_rig, read_rig_calibration, with_light

_MOST_SHOTS = 500  # as a plate session has views at most
_PLAYED_S = 60.0


class WorkRig:
    """The cameras and the light of one rig, connected.

    Parameters
    ----------
    rig
        Connected.
    timeout_s
        Bound of the waiting for the images of a shot.
    """

    def __init__(self, rig: Rig | LitRig, timeout_s: float) -> None:
        self._rig = rig
        self.cameras = rig.rig if isinstance(rig, LitRig) else rig
        self.timeout_s = timeout_s

    @property
    def name(self) -> str:
        """Of the rig."""
        return self._rig.name

    @property
    def settings(self) -> CameraSettings:
        """What its cameras are told."""
        return self.cameras.settings

    @property
    def light(self) -> RigLight | None:
        """How its projector is set; None where it has none."""
        return self._rig.light if isinstance(self._rig, LitRig) else None

    @property
    def can_be_dark(self) -> bool:
        """Whether there are exposures without the projector's light."""
        return isinstance(self._rig, LitRig) and self._rig.projector.can_be_dark

    def expose(self, exposure_ms: float | None) -> None:
        """Expose for another time from the next arming on; None changes nothing."""
        if exposure_ms is not None:
            self.cameras.settings = replace(self.settings, exposure_ms=exposure_ms)

    def arm(self, settings: CameraSettings | None = None, light: RigLight | None = None) -> None:
        """Arm the cameras, with other settings or light where these are given."""
        if settings is not None:
            self.cameras.settings = settings
        if light is not None and isinstance(self._rig, LitRig):
            self._rig.light = light
        self._rig.arm()

    def shoot(self) -> WheelShot:
        """Take a shot as a cycle does."""
        return self._rig.shoot(self.timeout_s)

    def shoot_unlit(self) -> WheelShot:
        """Take a shot without the projector's light, where that can be."""
        if isinstance(self._rig, LitRig):
            return self._rig.shoot_unlit(self.timeout_s)
        return self._rig.shoot(self.timeout_s)


def rig_index(configuration: Configuration, name: str) -> int:
    """Return the number of a rig in its configuration.

    Raises
    ------
    ConfigurationError
        When there is none of this name.
    """
    names = [rig.name for rig in configuration.settings.rigs]
    if name not in names:
        raise ConfigurationError(
            choice="rig", expected=f"a rig of {configuration.file}: {', '.join(names)}", seen=f"'{name}'"
        )
    return names.index(name)


@contextmanager
def opened_rig(configuration: Configuration, name: str) -> Iterator[WorkRig]:
    """Open the cameras and the projector of a rig; closed at the end.

    Raises
    ------
    ConfigurationError
        When there is no such rig, or its driver finds a mistake.
    SeveralErrors, CameraError, ProjectorError
        When they do not connect.
    """
    index = rig_index(configuration, name)
    settings = configuration.settings.rigs[index]
    known = None if settings.calibration is None else read_rig_calibration(configuration, index)
    rig = with_light(configuration, index, make_rig(configuration, index, known))
    rig.connect()
    try:
        yield WorkRig(rig, configuration.settings.cycle.shoot_timeout_s)
    finally:
        rig.close()


@contextmanager
def recorded_shots(folder: Path, rig: str) -> Iterator[WorkRig]:
    """Play what the station recorded of a rig, such as the images of the line's mode calibrate.

    Parameters
    ----------
    folder
        Holds the shots themselves, or a folder of each start with a shot named after the rig in it.
    rig
        Its name.

    Raises
    ------
    FormatError
        When there are none.
    """
    places = [*folder.glob(f"*/{SHOT_FILE}"), *folder.glob(f"*/{rig}/{SHOT_FILE}")]
    if not places or len(places) > _MOST_SHOTS:
        raise FormatError(
            file=folder,
            expected=f"1 to {_MOST_SHOTS} recorded shots of {rig}",
            seen=f"{len(places) or 'none'}",
        )
    played = recorded_rig([place.parent for place in sorted(places)], name=rig)
    played.connect()
    try:
        yield WorkRig(played, _PLAYED_S)
    finally:
        played.close()
