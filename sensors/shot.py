"""The images of one wheel, taken at one moment, with what the cameras said about them."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

from alignment.counting import listed
from alignment.errors import DegenerateInputError
from alignment.imaging import without_ambient
from alignment.values import Image, StereoImages
from sensors.camera import Frame


@dataclass(frozen=True, eq=False)
class HeadFrames:
    """The two frames of one stereo head, of the same trigger."""

    name: str
    left: Frame
    right: Frame

    def __post_init__(self) -> None:
        if self.left.trigger_counter != self.right.trigger_counter:
            raise DegenerateInputError(
                field=f"{self.name}.trigger_counter",
                expected="left and right frame of the same trigger",
                seen=f"{self.left.trigger_counter} and {self.right.trigger_counter}",
            )


@dataclass(frozen=True)
class SeriesPlace:
    """Which exposure of a turning wheel a shot is.

    Attributes
    ----------
    number
        In its series, from 1.
    exposures
        That the series was to have.
    turn
        How far the wheel had turned since the first exposure, radians, counter-clockwise seen from outboard;
        None where nothing told it.
    """

    number: int
    exposures: int
    turn: float | None = None


@dataclass(frozen=True, eq=False)
class WheelShot:
    """One exposure of all heads of a rig.

    Attributes
    ----------
    rig
        Name of the rig that took it; its calibration carries the same name.
    time_utc
        When the cameras were triggered; aware, UTC.
    heads
        In the order of the calibration.
    dark
        The same heads without the projector's light, by the next trigger, with the same exposure time; empty
        where none were taken.
    series
        Its place among the exposures of a turning wheel; None for a single one.
    """

    rig: str
    time_utc: datetime
    heads: tuple[HeadFrames, ...]
    dark: tuple[HeadFrames, ...] = ()
    series: SeriesPlace | None = None

    def __post_init__(self) -> None:
        if self.time_utc.tzinfo is None:
            raise DegenerateInputError(
                field="time_utc", expected="a time with its zone", seen=self.time_utc.isoformat()
            )
        names = [head.name for head in self.heads]
        if not names or len(set(names)) < len(names):
            raise DegenerateInputError(
                field="heads", expected="one or more heads with different names", seen=listed(names)
            )
        if self.dark and [head.name for head in self.dark] != names:
            raise DegenerateInputError(
                field="dark",
                expected=f"the heads {listed(names)}",
                seen=listed([head.name for head in self.dark]),
            )
        for mine, without in zip(self.frames, self.dark_frames, strict=False):
            if mine.exposure_ms != without.exposure_ms or mine.image.shape != without.image.shape:
                raise DegenerateInputError(
                    field=f"dark.{without.camera}",
                    expected=f"an image of {mine.image.shape}, {mine.exposure_ms:g} ms, as the lit one",
                    seen=f"{without.image.shape}, {without.exposure_ms:g} ms",
                )
        counters = [head.left.trigger_counter for head in self.heads]
        if len(set(counters)) > 1:
            raise DegenerateInputError(
                field="trigger_counter",
                expected="heads of the same trigger",
                seen=", ".join(f"{n} of {head.name}" for n, head in zip(counters, self.heads, strict=True)),
            )

    @property
    def images(self) -> tuple[StereoImages, ...]:
        """What `measure_wheel` takes: the pairs of images, in the order of `heads`.

        Where there is a dark exposure its light is subtracted (`alignment.imaging.without_ambient`).
        """
        if not self.dark:
            return tuple(StereoImages(head.left.image, head.right.image) for head in self.heads)
        return tuple(
            StereoImages(_subtracted(head.left, dark.left), _subtracted(head.right, dark.right))
            for head, dark in zip(self.heads, self.dark, strict=True)
        )

    @property
    def number(self) -> int:
        """Which exposure since the rig was armed, from 1; with a dark one it takes two triggers."""
        counter = self.heads[0].left.trigger_counter
        return (counter + 1) // 2 if self.dark else counter

    @property
    def frames(self) -> tuple[Frame, ...]:
        """All frames with the projector's light: left and right of the first head, then of the next."""
        return _frames(self.heads)

    @property
    def dark_frames(self) -> tuple[Frame, ...]:
        """All frames without it, in the same order; none where none were taken."""
        return _frames(self.dark)


def _frames(heads: tuple[HeadFrames, ...]) -> tuple[Frame, ...]:
    return tuple(frame for head in heads for frame in (head.left, head.right))


def _subtracted(lit: Frame, dark: Frame) -> Image:
    return without_ambient(lit.image, dark.image)
