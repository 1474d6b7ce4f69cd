"""One trigger on its way to the answer: made when it comes, handed through the steps, dropped at the end."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from uuid import UUID, uuid4

from db.records import AdjustingRecord, ZeroRecord
from station.configuration import VehicleType
from station.cycle.judging import SweepFound, Swept
from station.cycle.wheels import ABORTED, SeriesPlan, WheelPosition, WheelResult
from station.cycle.words import Abort, Command, ErrorCode, Outcome, Reset, ToldOfVehicle, Trigger


@dataclass(frozen=True)
class Trouble:
    """Why the station stands, as the line is told it; `wheel` is the first that it is about, if any."""

    code: ErrorCode = ErrorCode.NONE
    wheel: str | None = None


NO_TROUBLE = Trouble()


@dataclass(eq=False)
class CycleUnderWay:
    """Everything that is known of one cycle so far. Nobody keeps it: its results hold all of the images.

    Attributes
    ----------
    trigger
        What was asked: sequence, wheels, VIN, mode.
    received_utc
        When it came.
    positions
        Of the wheels that were asked for, in the trigger's order.
    kind
        The vehicle type; None where images are recorded and nothing is judged.
    uuid
        The cycle's, in every record of it.
    zeros
        Zero measurements in force at its start.
    results
        What came of the wheels that are done, by name.
    said
        What the line told of steering wheel and ride heights, before the exposures and after them.
    plan
        The series that is taken of each wheel; None where single exposures are measured.
    swept
        What came of each steered wheel at the positions of a sweep; empty where there was none.
    axes
        The steering axes that this makes; None where no sweep was asked for.
    adjusted
        What was turned before the wheels were measured, as found.
    interruption
        The abort or reset that ends it.
    trouble
        What the line is told of it beside its state.
    measured_s, committed_s
        When the last wheel was done and when the commit returned, monotonic seconds; None before, and where
        it is not certain that there was a commit.
    told
        What the line was told of the vehicle; None while it was told nothing.
    last_word
        UUID of the cycle that says what the line was told: its own, unless that says otherwise.
    """

    trigger: Trigger
    received_utc: datetime
    positions: Sequence[WheelPosition]
    kind: VehicleType | None
    uuid: UUID = field(default_factory=uuid4)
    zeros: tuple[ZeroRecord, ...] = ()
    results: dict[str, WheelResult] = field(default_factory=dict)
    said: list[ToldOfVehicle] = field(default_factory=list)
    plan: SeriesPlan | None = None
    swept: Swept = field(default_factory=dict)
    axes: SweepFound | None = None
    adjusted: tuple[AdjustingRecord, ...] = ()
    interruption: Command | None = None
    trouble: Trouble = NO_TROUBLE
    measured_s: float | None = None
    committed_s: float | None = None
    told: Outcome | None = None
    last_word: UUID = field(init=False)

    def __post_init__(self) -> None:
        self.last_word = self.uuid

    @property
    def sequence(self) -> int:
        """The controller's number of its start."""
        return self.trigger.sequence

    @property
    def interrupted(self) -> bool:
        """Whether an abort or a reset ends it."""
        return self.interruption is not None

    @property
    def forgotten(self) -> bool:
        """Whether the line reset the station amid it: nobody is told of this vehicle any more."""
        return isinstance(self.interruption, Reset)

    def heed(self, command: Command | None) -> bool:
        """Take note of an abort of this start or a reset; true when the cycle is to end."""
        of_this = isinstance(command, Abort) and command.sequence == self.sequence
        if not self.interrupted and (of_this or isinstance(command, Reset)):
            self.interruption = command
        return self.interrupted

    def take(self, results: Mapping[str, WheelResult]) -> None:
        """Add results of wheels that are done."""
        self.results |= results

    @property
    def wheels(self) -> tuple[WheelResult, ...]:
        """One result for each wheel that was asked for; those that nothing came of were aborted."""
        return tuple(self.results.get(p.name) or p.failed(ABORTED) for p in self.positions)
