"""Where a plate is put for a calibration, view by view: for the simulator and for who moves the stage."""

from __future__ import annotations

import math
from dataclasses import dataclass

from alignment.errors import DegenerateInputError

TILT = math.radians(10.0)
SHIFT_MM = 7.5
"""Half the pitch of our own plates."""
FEWEST_PLANNED, MOST_PLANNED = 3, 9


@dataclass(frozen=True)
class PlannedView:
    """One position of the plate.

    Attributes
    ----------
    name
        Name of the view.
    stage_mm
        Nominal position of the plate's origin, counted from where the session is centred.
    tilt
        Rotation vector of the plate about its x and y axes, radians. A tilted plate is not on the stage: the
        session does not tell its pose.
    staged
        Whether there is a stage; none moves the plate of a gauge frame.
    """

    name: str
    stage_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tilt: tuple[float, float] = (0.0, 0.0)
    staged: bool = True

    @property
    def on_stage(self) -> bool:
        """Whether the session tells its position."""
        return self.staged and not any(self.tilt)


def plate_plan(count: int = 7, tilt: float = TILT, shift_mm: float = SHIFT_MM) -> tuple[PlannedView, ...]:
    """Return positions that make a strong calibration, the most important ones first; at most 9.

    Parameters
    ----------
    count
        How many.
    tilt
        Of the tilted ones, radians.
    shift_mm
        Along x and y, of the shifted ones. A plate that is smaller than a camera's field covers the field by
        larger ones.

    Notes
    -----
    Height on the stage separates focal length from distance; shifts by half a pitch put other marks at other
    places of the image, so that errors of marks do not pass for distortion; tilted views scale depth by the
    plate itself, which is better known over its width than the stage is over its travel. With all errors on,
    a wheel at 3° is then measured to 0.007′ RMS (10 rigs, joint adjustment), with seven heights alone to
    0.019′.

    Raises
    ------
    DegenerateInputError
        When `count` is not from 3 to 9.
    """
    s = shift_mm
    every = (
        PlannedView("z0"),
        PlannedView("z-30", (s, s, -30.0)),
        PlannedView("z30", (0.0, 0.0, 30.0)),
        PlannedView("tilted_1", tilt=(tilt, 0.0)),
        PlannedView("tilted_2", tilt=(0.0, tilt)),
        PlannedView("z-15", (-s, s, -15.0)),
        PlannedView("z15", (s, -s, 15.0)),
        PlannedView("tilted_3", tilt=(-tilt, 0.0)),
        PlannedView("tilted_4", tilt=(0.0, -tilt)),
    )
    if not FEWEST_PLANNED <= count <= MOST_PLANNED:
        raise DegenerateInputError(
            field="views", expected=f"from {FEWEST_PLANNED} to {MOST_PLANNED}", seen=str(count)
        )
    return every[:count]
