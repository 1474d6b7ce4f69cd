"""What ``shot.json`` holds: ``truewheel.shot/1``, and ``truewheel.shot/2`` for what the first cannot say."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import AwareDatetime, Field, model_validator

from alignment.errors import DegenerateInputError
from alignment.wheel import FEWEST_EXPOSURES, MOST_EXPOSURES
from sensors.camera import Frame, SettingsInForce
from sensors.formats.validation import Name, StrictModel
from sensors.frames import HOST_SPREAD_S

SHOT_1, SHOT_2 = "truewheel.shot/1", "truewheel.shot/2"

ImageName = Annotated[
    str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9 _.-]{0,200}\.([Pp][Nn][Gg]|[Tt][Ii][Ff][Ff]?)$")
]
FRAME_NUMBERS = ("trigger_counter", "device_time_s", "host_time_s", "exposure_ms")
_Text = Annotated[str, Field(max_length=200)]
_SettingName = Annotated[str, Field(min_length=1, max_length=200)]
_SettingValue = Annotated[str, Field(max_length=1000)]


class InForceEntry(StrictModel):
    """What a camera was set to, as it said itself."""

    model: _Text = Field(description="Model, as the camera names itself")
    serial_number: _Text = Field(description="Serial number, as the camera names itself")
    exposure_ms: float = Field(gt=0, le=60_000, description="Exposure time, milliseconds")
    gain_db: float = Field(ge=-60, le=120, description="Analogue gain, decibels")
    pixel_format: _Text = Field(description="Name of GenICam's Pixel Format Naming Convention, such as Mono8")
    bits: int = Field(ge=1, le=16, description="Significant bits of a pixel")
    trigger_source: _Text = Field(description="Such as Software or Line1")
    packet_size: int | None = Field(
        default=None, ge=1, le=1_000_000, description="Bytes; absent where the link has no such setting"
    )
    others: dict[_SettingName, _SettingValue] = Field(
        default={}, max_length=200, description="What else the driver sets, as the camera gives it, by name"
    )

    @classmethod
    def of(cls, found: SettingsInForce) -> dict[str, Any]:
        """Return the fields of what a camera said."""
        values = {name: getattr(found, name) for name in cls.model_fields if name != "others"}
        return {name: value for name, value in values.items() if value is not None} | (
            {"others": dict(found.others)} if found.others else {}
        )

    def value(self) -> SettingsInForce:
        """Return it as a frame carries it."""
        return SettingsInForce(**self.model_dump(exclude={"others"}), others=tuple(self.others.items()))


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
    temperature_c: float | None = Field(
        default=None, ge=-100, le=200, description="Of the camera, °C; absent where it has no sensor (shot/2)"
    )
    in_force: InForceEntry | None = Field(
        default=None, description="What the camera was set to; absent where it cannot be read (shot/2)"
    )

    @classmethod
    def of(cls, frame: Frame, image: str) -> dict[str, Any]:
        """Return the fields of a frame whose image is in this file."""
        fields: dict[str, Any] = {"image": image}
        fields |= {name: getattr(frame, name) for name in ("camera", *FRAME_NUMBERS)}
        if frame.temperature_c is not None:
            fields["temperature_c"] = frame.temperature_c
        if frame.in_force is not None:
            fields["in_force"] = InForceEntry.of(frame.in_force)
        return fields


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

    @property
    def entries(self) -> tuple[FrameEntry, FrameEntry]:
        """Left, right."""
        return self.left, self.right


class SeriesEntry(StrictModel):
    """Which exposure of a turning wheel a shot is."""

    number: int = Field(ge=1, le=MOST_EXPOSURES, description="Of this exposure in its series, from 1")
    exposures: int = Field(
        ge=FEWEST_EXPOSURES, le=MOST_EXPOSURES, description="How many the series was to have"
    )
    turn: float | None = Field(
        default=None,
        ge=-1000,
        le=1000,
        description="How far the wheel had turned since the first exposure, radians, counter-clockwise seen "
        "from outboard; absent where nothing told it",
    )

    @model_validator(mode="after")
    def _is_one_of_them(self) -> SeriesEntry:
        if self.number > self.exposures:
            raise DegenerateInputError(
                field="number", expected=f"at most {self.exposures}, the exposures of the series",
                seen=str(self.number),
            )  # fmt: skip
        return self


class ShotFile(StrictModel):
    """What ``shot.json`` holds."""

    schema_: Literal["truewheel.shot/1", "truewheel.shot/2"] = Field(
        alias="schema", description="Kind and version of this file"
    )
    rig: Name = Field(description="Name of the rig, as in its calibration")
    time_utc: AwareDatetime = Field(description="When the cameras were triggered, ISO 8601 with the zone")
    heads: tuple[HeadShot, ...] = Field(
        min_length=1, max_length=16, description="The heads, in the order of the calibration"
    )
    series: SeriesEntry | None = Field(
        default=None, description="Which exposure of a turning wheel it is; absent for a single one (shot/2)"
    )
    dark: tuple[HeadShot, ...] | None = Field(
        default=None,
        min_length=1,
        max_length=16,
        description="The same heads without the projector's light, taken next to this exposure (shot/2)",
    )

    @model_validator(mode="after")
    def _is_whole(self) -> ShotFile:
        self._names_differ()
        _is_of_one_moment(self.heads, "heads")
        if self.dark is not None:
            self._dark_matches(self.dark)
        if self.schema_ == SHOT_1 and (newer := self._newer_field()) is not None:
            raise DegenerateInputError(
                field=newer,
                expected=f"no such field in {SHOT_1}",
                seen="one",
                cure=f"Write {SHOT_2} as its schema",
            )
        return self

    def _names_differ(self) -> None:
        entries = [entry for head in (*self.heads, *(self.dark or ())) for entry in head.entries]
        for field, what, names in (
            ("heads", "heads with different names", [head.name for head in self.heads]),
            ("heads", "a different image for each camera", [entry.image for entry in entries]),
        ):
            if len(set(names)) < len(names):
                twice = next(name for name in names if names.count(name) > 1)
                raise DegenerateInputError(field=field, expected=what, seen=f"'{twice}' twice")

    def _dark_matches(self, dark: tuple[HeadShot, ...]) -> None:
        names, lit = ([head.name for head in heads] for heads in (dark, self.heads))
        if names != lit:
            raise DegenerateInputError(
                field="dark", expected=f"the heads {', '.join(lit)} in this order", seen=", ".join(names)
            )
        _is_of_one_moment(dark, "dark")

    def _newer_field(self) -> str | None:
        """The first field that the first version of the format does not have."""
        if self.series is not None:
            return "series"
        if self.dark is not None:
            return "dark"
        for number, head in enumerate(self.heads):
            for side, entry in zip(("left", "right"), head.entries, strict=True):
                for name in ("in_force", "temperature_c"):
                    if getattr(entry, name) is not None:
                        return f"heads[{number}].{side}.{name}"
        return None


def _numbered(heads: tuple[HeadShot, ...]) -> Iterator[tuple[int, str, FrameEntry]]:
    for number, head in enumerate(heads):
        for side, entry in zip(("left", "right"), head.entries, strict=True):
            yield number, side, entry


def _is_of_one_moment(heads: tuple[HeadShot, ...], field: str) -> None:
    first = heads[0].left
    # A program that does not know the time writes 0.
    known = [entry.host_time_s for _, _, entry in _numbered(heads) if entry.host_time_s != 0.0]
    for number, side, entry in _numbered(heads):
        if entry.trigger_counter != first.trigger_counter:
            raise DegenerateInputError(
                field=f"{field}[{number}].{side}.trigger_counter",
                expected=f"{first.trigger_counter}, the trigger of the first image",
                seen=f"{entry.trigger_counter} of camera {entry.camera}",
                cure="Put images of one trigger into a shot; where triggers are not counted, write 1",
            )
        if entry.host_time_s != 0.0 and abs(entry.host_time_s - known[0]) > HOST_SPREAD_S:
            raise DegenerateInputError(
                field=f"{field}[{number}].{side}.host_time_s",
                expected=f"within {HOST_SPREAD_S:g} s of the first image, {known[0]:g}",
                seen=f"{entry.host_time_s:g} of camera {entry.camera}",
                cure="Put images of one trigger into a shot; where times are not known, write 0",
            )
