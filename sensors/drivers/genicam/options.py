"""What may stand in a rig's table of GenICam cameras, whoever made them."""

from __future__ import annotations

from collections import Counter
from typing import Annotated, Literal

from pydantic import Field

from alignment.counting import listed
from alignment.errors import ConfigurationError
from sensors.drivers.driver import RigPlace
from sensors.drivers.genicam.device import Action
from sensors.drivers.genicam.pixels import PixelFormat
from sensors.formats.validation import Name, StrictModel

CameraId = Annotated[str, Field(min_length=1, max_length=64)]
OutputLine = Annotated[str, Field(pattern=r"^Line[0-9]{1,2}$")]
_Feature = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]{0,63}$")]
_Text = Annotated[str, Field(max_length=200)]
_Key = Annotated[int, Field(ge=0, le=0xFFFFFFFF)]


class ActionOptions(StrictModel):
    """An action command of GigE Vision, by which all cameras of the rig expose at once."""

    device_key: _Key = Field(default=1, description="Key of the cameras")
    group_key: _Key = Field(default=1, description="Group of the cameras; each rig has its own")
    group_mask: Annotated[int, Field(ge=1, le=0xFFFFFFFF)] = Field(
        default=1, description="Bits of the groups that are meant"
    )
    address: str = Field(
        default="255.255.255.255",
        pattern=r"^([0-9]{1,3}\.){3}[0-9]{1,3}$",
        description="Broadcast address of the cameras' network",
    )
    ahead_ms: float = Field(
        default=0.0,
        ge=0,
        le=1000,
        description="Cameras expose so long after the command, at one time of their synchronised clocks, "
        "milliseconds; 0 when it reaches them",
    )

    def action(self) -> Action:
        """Return the value that a device takes."""
        return Action(self.device_key, self.group_key, self.group_mask, self.address, self.ahead_ms / 1e3)


class Region(StrictModel):
    """A part of the sensor."""

    x: int = Field(ge=0, le=65_535, description="First column")
    y: int = Field(ge=0, le=65_535, description="First row")
    width: int = Field(ge=1, le=65_535, description="Pixels")
    height: int = Field(ge=1, le=65_535, description="Pixels")


class GenICamOptions(StrictModel):
    """GenICam cameras of a rig."""

    cameras: dict[Name, tuple[CameraId, CameraId]] = Field(
        min_length=1, max_length=8, description="Serial number or own name of left and right camera, by head"
    )
    pixel_format: PixelFormat = Field(default="Mono8", description="Of GenICam's naming convention")
    trigger_source: str = Field(
        default="Software",
        pattern=r"^(Software|Line[0-9]{1,2}|Action[1-9]|Off)$",
        description="What exposes: a command to each camera, a line, an action command to all; Off takes the "
        "next image of cameras that run freely, for what stands still",
    )
    trigger_activation: Literal["RisingEdge", "FallingEdge"] = Field(
        default="RisingEdge", description="Edge of the line that exposes"
    )
    leader: tuple[Name, Literal["left", "right"]] | None = Field(
        default=None,
        description="Camera that is triggered by command, whose output is the line of the others; without "
        "one something else drives the line",
    )
    exposure_output: OutputLine | None = Field(
        default=None, description="Output that is high while a camera exposes, for the others and the light"
    )
    action: ActionOptions | None = Field(default=None, description="The action command of this rig")
    ptp: bool = Field(default=False, description="The cameras synchronise their clocks (IEEE 1588)")
    packet_size: int | None = Field(
        default=None, ge=220, le=16_384, description="Bytes of a network packet; left as it is without"
    )
    region: Region | None = Field(default=None, description="Part of the sensor; the whole without")
    buffers: int = Field(default=8, ge=2, le=64, description="Images that a camera's ring holds")
    exposure_tolerance: float = Field(
        default=0.01, ge=0, le=0.5, description="Share by which a camera may round the exposure time"
    )
    features: tuple[tuple[_Feature, bool | int | float | _Text], ...] = Field(
        default=(), max_length=64, description="Further features, set in this order: name and value"
    )

    @property
    def waits(self) -> bool:
        """Whether a signal exposes that all cameras wait for."""
        return self.trigger_source.startswith(("Line", "Action"))

    def leads(self, head: str, side: str) -> bool:
        """Whether this camera, once it is triggered, makes the others expose.

        Of an action command it is the first camera through which it is sent.
        """
        if self.trigger_source.startswith("Action"):
            return (head, side) == (next(iter(self.cameras)), "left")
        return self.leader == (head, side)


def check_options(options: GenICamOptions, rig: RigPlace) -> None:
    """Find what is wrong without a camera.

    Raises
    ------
    ConfigurationError
        Its field is one of the options.
    """
    missing = [head for head in rig.heads if head not in options.cameras]
    if missing:
        raise ConfigurationError(
            field="cameras",
            expected=f"two cameras for each head of the calibration ({listed(list(rig.heads))})",
            seen=f"none for {listed(missing)}",
        )
    counted = Counter(camera for pair in options.cameras.values() for camera in pair)
    twice = [camera for camera, count in counted.items() if count > 1]
    if twice:
        raise ConfigurationError(
            field="cameras", expected="each camera once", seen=f"{listed(twice)} more than once"
        )
    _check_trigger(options)


def _check_trigger(options: GenICamOptions) -> None:
    source, leader = options.trigger_source, options.leader
    if leader is not None:
        if not source.startswith("Line"):
            raise ConfigurationError(
                field="leader", expected="none, unless trigger_source is a line", seen=f"'{source}'"
            )
        if leader[0] not in options.cameras:
            raise ConfigurationError(
                field="leader", expected=f"a head of {listed(list(options.cameras))}", seen=f"'{leader[0]}'"
            )
        if options.exposure_output is None:
            raise ConfigurationError(
                field="exposure_output",
                expected="the line by which the leader triggers the others",
                seen="none",
                cure="Name the output to which the others' trigger line is wired",
            )
    if source == options.exposure_output:
        raise ConfigurationError(
            field="exposure_output", expected="another line than trigger_source", seen=f"'{source}' for both"
        )
    if source.startswith("Action") != (options.action is not None):
        raise ConfigurationError(
            field="action",
            expected="a table where trigger_source is an action, and none otherwise",
            seen=f"trigger_source '{source}' {'without' if options.action is None else 'with'} one",
        )
    if options.action is not None and options.action.ahead_ms > 0 and not options.ptp:
        raise ConfigurationError(
            field="action.ahead_ms",
            expected="0, unless ptp is true: a time means the same to all cameras only then",
            seen=f"{options.action.ahead_ms:g}",
        )
