"""Figures of cameras over time: what a station remembers of how they were."""

from __future__ import annotations

import math
from dataclasses import dataclass

from db.records.plain import check_values

HOUR_S = 3600.0


@dataclass(frozen=True)
class CameraFigure:
    """One figure of one camera over a span of time.

    Attributes
    ----------
    camera
        Its name, ``front_left/head_2/right``.
    figure
        What it is, with its unit: ``temperature_c``, ``line_width_px``, …
    hours
        1 or 24; 0 for the first shots after a calibration.
    start
        Whole hours since 1970 (UTC): when the span began, or the calibration was made.
    n
        Shots.
    mean, minimum, maximum
        Of their values.
    """

    camera: str
    figure: str
    hours: int
    start: int
    n: int
    mean: float
    minimum: float
    maximum: float

    def __post_init__(self) -> None:
        check_values(self)

    @classmethod
    def of(cls, camera: str, figure: str, hours: int, start: int, value: float) -> CameraFigure:
        """The figure of one shot."""
        return cls(camera, figure, hours, start, 1, value, value, value)

    @property
    def which(self) -> tuple[str, str, int, int]:
        """What tells it from others of the station."""
        return self.camera, self.figure, self.hours, self.start

    def joined(self, other: CameraFigure) -> CameraFigure:
        """The figure over the shots of both, of the same span."""
        n = self.n + other.n
        low, high = min(self.minimum, other.minimum), max(self.maximum, other.maximum)
        mean = math.fsum((self.n * self.mean, other.n * other.mean)) / n
        # Rounding must not carry a mean of equal values past them.
        return CameraFigure(*self.which, n, min(max(mean, low), high), low, high)


@dataclass(frozen=True)
class CameraSerial:
    """Which camera stood at a place when a calibration was used first.

    Attributes
    ----------
    camera
        Name of the place, ``front_left/head_2/right``.
    calibration_id
        Of its rig.
    serial
        Serial number of the camera.
    """

    camera: str
    calibration_id: str
    serial: str

    def __post_init__(self) -> None:
        check_values(self)
