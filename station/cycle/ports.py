"""What surrounds the measuring cycle: line, store and observer as it sees them, and its plain values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol
from uuid import UUID

from db.records import (
    AdjustingRecord,
    CalibrationCheckRecord,
    CalibrationRecord,
    CycleRecord,
    EventRecord,
    StoredCycle,
    ZeroRecord,
)
from station.cycle.judging import Evaluation
from station.cycle.wheels import WheelResult
from station.cycle.words import (
    AxleAnswer,
    Command,
    ErrorCode,
    Guidance,
    LiveAngles,
    MasterShown,
    Outcome,
    StationState,
    StationStatus,
    SweepProgress,
    ToldOfVehicle,
    Trigger,
    VehicleAnswer,
    WheelAnswer,
)


class Line(Protocol):
    """What the cycle needs of the line; `station.line.interface.StationLine` is one."""

    def next_command(self, timeout_s: float) -> Command | None:
        """Take the next command."""
        ...

    def publish(self, status: StationStatus) -> None:
        """Say what the cycle does."""
        ...

    def send_results(
        self,
        sequence: int,
        wheel_answers: Sequence[WheelAnswer],
        axle_answers: Sequence[AxleAnswer] = (),
        vehicle_answer: VehicleAnswer | None = None,
    ) -> Outcome:
        """Send all results of a start."""
        ...

    def restore_results(
        self,
        sequence: int,
        wheel_answers: Sequence[WheelAnswer],
        axle_answers: Sequence[AxleAnswer] = (),
        vehicle_answer: VehicleAnswer | None = None,
    ) -> Outcome:
        """Offer results of an earlier run that nobody acknowledged."""
        ...

    def publish_live(self, angles: LiveAngles, measured_s: float) -> None:
        """Show angles of a wheel that is adjusted."""
        ...

    def publish_guidance(self, guidance: Guidance, measured_s: float) -> None:
        """Show what to do at a wheel that is adjusted."""
        ...

    def publish_sweep(self, progress: SweepProgress) -> None:
        """Show how a sweep goes."""
        ...

    def publish_master(self, master: MasterShown) -> None:
        """Show where the station stands with its master checks."""
        ...

    def told(self) -> ToldOfVehicle:
        """What was told last of the vehicle's steering wheel and ride heights."""
        ...

    def refuse(self, sequence: int, code: ErrorCode) -> None:
        """Decline a start or a preparation."""
        ...


class Store(Protocol):
    """What the cycle needs of the database; `db.store.ResultStore` is one."""

    def write_cycle(self, record: CycleRecord) -> None:
        """Store a cycle, durable on return."""
        ...

    def record_calibration(self, record: CalibrationRecord) -> None:
        """Store a calibration."""
        ...

    def record_event(self, record: EventRecord) -> None:
        """Store an event."""
        ...

    def record_check(self, record: CalibrationCheckRecord) -> None:
        """Store a check of a calibration."""
        ...

    def write_master_check(
        self,
        record: CycleRecord,
        checks: Sequence[CalibrationCheckRecord],
        outcomes: Sequence[EventRecord],
    ) -> None:
        """Store a cycle of a master with what it says of the calibrations, durable on return."""
        ...

    def cycle(self, uuid: UUID) -> StoredCycle | None:
        """Return the cycle of this UUID."""
        ...

    def recent_cycles(self, n: int, station: str | None = None) -> tuple[StoredCycle, ...]:
        """Return the last cycles, newest first; of one station when it is named."""
        ...

    def cycle_events(self, cycle: UUID, codes: Sequence[str]) -> tuple[EventRecord, ...]:
        """Return the newest event of each of these codes that is of this cycle."""
        ...

    def zeros_in_force(self, installed: Sequence[tuple[str, str]] | None = None) -> tuple[ZeroRecord, ...]:
        """Return the zero measurement in force of each rig and calibration; of these when given."""
        ...

    def recent_adjustings(self, station: str, vehicle_type: str, n: int) -> tuple[AdjustingRecord, ...]:
        """Return the last adjusters whose nuts were locked on vehicles of a type, newest first."""
        ...


@dataclass(frozen=True)
class Identity:
    """What every record says of the program that made it."""

    station: str
    software_version: str
    config_hash: str


@dataclass(frozen=True)
class Bounds:
    """Longest waits of a cycle, seconds: for all wheels, one commit, the acknowledgement, adjusting.

    Results that were not acknowledged in time are still held; the station says so and takes no other start.
    """

    measure_s: float
    store_s: float
    acknowledge_s: float
    adjust_s: float = 600.0


@dataclass(frozen=True, eq=False)
class CycleReport:
    """One cycle as it ended. Its results hold the images: who keeps it keeps it `without_images`.

    Attributes
    ----------
    committed_s
        When the commit returned, monotonic seconds; None when nothing was stored.
    told
        What the line was told of the vehicle; None when it was told nothing.
    """

    trigger: Trigger
    record: CycleRecord
    evaluation: Evaluation
    committed_s: float | None
    told: Outcome | None

    def without_images(self) -> CycleReport:
        """Return the same, to be kept."""
        return replace(self, evaluation=self.evaluation.without_images())


class Observer:
    """Watches the cycle; does nothing unless overridden.

    Called in the cycle's thread, so be quick; what is shown holds images, so keep nothing of it with them.
    """

    def entered(self, state: StationState) -> None:
        """Look at a new state."""

    def wheel_done(self, result: WheelResult) -> None:
        """Look at the result of a wheel."""

    def cycle_done(self, report: CycleReport) -> None:
        """Look at a finished cycle."""
