"""How the steering of a vehicle type is swept: how far, in how many positions, and what ends it."""

from __future__ import annotations

from pydantic import Field, model_validator

from alignment.errors import DegenerateInputError
from sensors.formats import StrictModel

MOST_SWEEP_POSITIONS = 200
"""Of a sweep; the line counts them with straight ahead at the end."""


class SweepPlan(StrictModel):
    """The mode sweep of a vehicle type; angles are those of the steering wheel."""

    largest_deg: float = Field(
        ge=30, le=900, description="Farthest turn of the steering wheel to each side, degrees"
    )
    positions: int = Field(
        default=41,
        ge=5,
        le=MOST_SWEEP_POSITIONS,
        description="Positions from right to left at which images are taken, straight ahead follows",
    )
    tolerance_deg: float = Field(
        default=2.0,
        ge=0.1,
        le=45,
        description="How far the steering wheel may stand from the angle that is wanted, degrees",
    )
    held_deg: float = Field(
        default=0.5,
        ge=0.05,
        le=10,
        description="How far the steering wheel may move while images are taken, degrees",
    )
    fastest_deg_s: float = Field(
        default=720.0,
        ge=10,
        le=5000,
        description="Fastest turn of the steering wheel, degrees per second; what tells more has jumped",
    )
    oldest_s: float = Field(
        default=0.5, gt=0, le=10, description="Age beyond which a told angle counts for nothing, seconds"
    )
    step_timeout_s: float = Field(
        default=60.0, ge=1, le=3600, description="Longest wait for each step, seconds"
    )
    attempts: int = Field(
        default=3, ge=1, le=20, description="How often a position is wanted that a step did not reach"
    )
    brakes_held: bool = Field(
        default=False,
        description="Whether the brakes are held while the steering is turned, so that no wheel rolls; else "
        "the run-out that rolls needs road_z_mm of the stand and tyre_width_mm of the type",
    )
    require_angle: bool = Field(
        default=True,
        description="Whether there is no sweep without the steering wheel's angle from the line; else a "
        "step's own word for it counts where the line tells none",
    )

    @model_validator(mode="after")
    def _tells_positions_apart(self) -> SweepPlan:
        if 2.0 * self.tolerance_deg >= self.spacing_deg:
            raise DegenerateInputError(
                field="tolerance_deg",
                expected=f"less than half of the {self.spacing_deg:g}° between two positions, so that a "
                "sensor that stands still is found",
                seen=f"{self.tolerance_deg:g}",
            )
        return self

    @property
    def spacing_deg(self) -> float:
        """Between two positions, degrees."""
        return 2.0 * self.largest_deg / (self.positions - 1)

    def wanted_deg(self, straight_deg: float = 0.0) -> tuple[float, ...]:
        """Return the angles that are wanted, from right to left and then straight ahead, degrees.

        `straight_deg` is what the line tells of a steering wheel that stands straight.
        """
        turned = (k * self.spacing_deg - self.largest_deg for k in range(self.positions))
        return (*(straight_deg + angle for angle in turned), straight_deg)
