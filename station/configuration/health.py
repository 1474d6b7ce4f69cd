"""From what on a camera is warned of, and from what on it stops the wheel that it looks at."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from alignment.errors import DegenerateInputError
from sensors.formats import StrictModel

_Celsius = Annotated[float, Field(ge=-40, le=150)]
_Growth = Annotated[float, Field(gt=1, le=100)]
_Pixels = Annotated[float, Field(gt=0, le=100)]


class HealthOptions(StrictModel):
    """When cameras are warned of. A warning is an event and a line of the log; it stops nothing.

    "First shots" are the first fifty after the calibration; what is compared with them, with their mean.
    Each `…_stop…` that is given makes the shot that is beyond it a camera fault.
    """

    temperature_warn_c: _Celsius = Field(default=65.0, description="Warn above, °C, of the camera itself")
    temperature_stop_c: _Celsius | None = Field(
        default=None, description="A hotter camera stops its wheel, °C; none without"
    )
    failures_warn: int = Field(
        default=2, ge=1, le=100, description="Warn of so many failed shots of a camera among its last hundred"
    )
    link_warn_share: float = Field(
        default=0.9, gt=0, le=1, description="Warn of a link slower than this share of its fastest"
    )
    width_warn_ratio: _Growth = Field(
        default=1.25,
        description="Warn when the light lines are so many times as wide as in the first shots: out of focus",
    )
    width_stop_ratio: _Growth | None = Field(
        default=None, description="Lines so many times as wide stop the wheel; none without"
    )
    light_warn_ratio: _Growth = Field(
        default=1.5,
        description="Warn when the lines are so many times darker or brighter than in the first shots",
    )
    light_stop_ratio: _Growth | None = Field(
        default=None, description="Lines so many times darker or brighter stop the wheel; none without"
    )
    row_warn_px: _Pixels = Field(
        default=0.1,
        description="Warn when the epipolar residual of a head has grown by so much over its first shots:"
        " a camera moved, pixels",
    )
    row_stop_px: _Pixels | None = Field(
        default=None, description="A residual grown by so much stops the wheel, pixels; none without"
    )

    @model_validator(mode="after")
    def _warns_before_it_stops(self) -> HealthOptions:
        for name, unit in (("temperature", "c"), ("width", "ratio"), ("light", "ratio"), ("row", "px")):
            warn, stop = (getattr(self, f"{name}_{what}_{unit}") for what in ("warn", "stop"))
            if stop is not None and stop <= warn:
                raise DegenerateInputError(
                    field=f"{name}_stop_{unit}",
                    expected=f"more than {name}_warn_{unit}, {warn:g}, so that it warns before it stops",
                    seen=f"{stop:g}",
                )
        return self
