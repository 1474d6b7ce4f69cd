"""What can be turned on a type of vehicle, what a turn does, and what locking its nut usually adds."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from alignment.errors import DegenerateInputError
from sensors.formats import StrictModel

LARGEST_PER_TURN_DEG = 5.0
_PerTurn = Annotated[float, Field(ge=-LARGEST_PER_TURN_DEG, le=LARGEST_PER_TURN_DEG)]
LEAST_MAIN_DEG = 0.05
"""Less than this per turn is no adjuster of an angle."""


class AdjusterOptions(StrictModel):
    """One adjuster of each wheel of an axle. Positive turns lengthen a tie rod, or lean the top outboard.

    What the maker states of a turn is where guidance begins; it learns within each adjusting.
    """

    toe_deg_per_turn: _PerTurn = Field(
        default=0.0, description="Change of toe by one positive turn, degrees, positive for toe-in"
    )
    camber_deg_per_turn: _PerTurn = Field(
        default=0.0, description="Change of camber by one positive turn, degrees, positive outboard"
    )
    deg_per_turn_error: float = Field(
        default=0.3,
        ge=0.01,
        le=0.6,
        description="How wrong these may be on a sound vehicle, as a share; more is no misadjusted vehicle",
    )
    coupling_error: float = Field(
        default=0.3,
        ge=0.05,
        le=1.0,
        description="How far the change of the other angle, as a share of that of its own, may be from what"
        " these two say on a sound vehicle",
    )
    range_turns: float = Field(
        gt=0, le=100, description="Most turns to either side from where the adjuster was found"
    )
    backlash_turns: float = Field(
        default=0.1, ge=0, le=1, description="Turns that move nothing when the direction changes"
    )
    drift_deg: float = Field(
        default=0.0,
        ge=-0.5,
        le=0.5,
        description="What locking the nut usually adds to its angle, before any was seen, degrees",
    )
    drift_bound_deg: float = Field(
        default=0.15, ge=0, le=0.5, description="Most that the target leaves room for it, degrees"
    )
    aim_before_drift: bool = Field(
        default=True, description="Whether the target leaves room for what locking usually adds"
    )

    @model_validator(mode="after")
    def _drift_is_within_its_bound(self) -> AdjusterOptions:
        if abs(self.drift_deg) > self.drift_bound_deg:
            raise DegenerateInputError(
                field="drift_deg",
                expected=f"at most drift_bound_deg, {self.drift_bound_deg:g}, to either side",
                seen=f"{self.drift_deg:g}",
            )
        return self


class TieRodOptions(AdjusterOptions):
    """A tie rod, which sets toe."""

    @model_validator(mode="after")
    def _sets_toe(self) -> TieRodOptions:
        _check_main("toe_deg_per_turn", self.toe_deg_per_turn, self.camber_deg_per_turn)
        return self


class CamberBoltOptions(AdjusterOptions):
    """A camber bolt or eccentric, which sets camber."""

    @model_validator(mode="after")
    def _sets_camber(self) -> CamberBoltOptions:
        _check_main("camber_deg_per_turn", self.camber_deg_per_turn, self.toe_deg_per_turn)
        if self.camber_deg_per_turn < 0.0:
            raise DegenerateInputError(
                field="camber_deg_per_turn",
                expected="above 0: positive turns lean the top of the wheel outboard",
                seen=f"{self.camber_deg_per_turn:g}",
            )
        return self


class AxleAdjusters(StrictModel):
    """What can be turned at each wheel of one axle; nothing where nothing is named."""

    tie_rod: TieRodOptions | None = Field(default=None, description="Sets toe")
    camber_bolt: CamberBoltOptions | None = Field(default=None, description="Sets camber")

    @model_validator(mode="after")
    def _tells_camber_from_toe(self) -> AxleAdjusters:
        rod, bolt = self.tie_rod, self.camber_bolt
        if rod is None or bolt is None:
            return self
        own = rod.toe_deg_per_turn * bolt.camber_deg_per_turn
        across = rod.camber_deg_per_turn * bolt.toe_deg_per_turn
        if abs(own) < 2.0 * abs(across):
            raise DegenerateInputError(
                field="camber_bolt",
                expected="two adjusters of which one sets toe and the other camber",
                seen="two that change both angles nearly alike",
            )
        return self


def _check_main(name: str, main: float, other: float) -> None:
    if abs(main) < LEAST_MAIN_DEG or abs(main) < abs(other):
        raise DegenerateInputError(
            field=name,
            expected=f"at least {LEAST_MAIN_DEG:g} to either side, and no less than the other angle's",
            seen=f"{main:g}",
        )
