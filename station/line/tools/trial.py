"""What a requirement on a station at the line is tried out with: a controller, vehicles, expectations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from alignment.errors import LineError
from station.cycle import ErrorCode, Mode
from station.line.plc import PlcOrder, PlcResult, PlcSimulator
from station.line.wire import Answer, CommandAnswer, CommandCode, LineDatabase, LineStatus


@dataclass(frozen=True)
class Vehicles:
    """Vehicles that points may start: a known type, one that the station does not know; patience, seconds."""

    vin: str = "TWCHKX00000000001"
    vehicle_type: int = 1
    unknown_type: int = 65_535
    patience_s: float = 60.0
    wheels: tuple[str, ...] | None = None


@dataclass(frozen=True)
class PointVerdict:
    """How a point went: passed, or failed with what was expected and seen."""

    point: str
    requirement: str
    failure: str | None = None

    @property
    def passed(self) -> bool:
        """Whether it passed."""
        return self.failure is None


class NotFulfilledError(LineError):
    """A point is not fulfilled."""


@dataclass
class Trial:
    """What a point works with."""

    plc: PlcSimulator
    database: LineDatabase
    vehicles: Vehicles
    wrongs: list[str] = field(default_factory=list)

    def order(self, mode: Mode = Mode.AUTOMATIC, **changes: object) -> PlcOrder:
        """An order of the known vehicle."""
        values: dict[str, object] = {
            "vin": self.vehicles.vin,
            "vehicle_type": self.vehicles.vehicle_type,
            "wheels": self.vehicles.wheels,
            "mode": mode,
        }
        return PlcOrder(**(values | changes))  # type: ignore[arg-type]

    def expect(self, what: str, true: bool) -> None:
        """Fail unless something is so."""
        if not true:
            raise NotFulfilledError(f"expected {what}; last status: {self.plc.status or 'none'}")

    def status(self, what: str, reached: Callable[[LineStatus], bool]) -> LineStatus:
        """Wait for a Status."""
        return self.plc.view.wait(what, self.vehicles.patience_s, reached)

    def refused(self, code: CommandCode, sequence: int, why: ErrorCode) -> None:
        """Expect that the command that stands is refused for this reason."""
        found = self.plc.answer_to(code, sequence)
        self.plc.withdraw()
        self.expect(
            f"{code} {sequence} to be refused with {why}, found {found.answer} {found.error_code}",
            found.answer is Answer.REFUSED and found.error_code is why,
        )

    def accepted(self, code: CommandCode, sequence: int) -> CommandAnswer:
        """Expect that the command that stands is accepted."""
        found = self.plc.answer_to(code, sequence)
        self.plc.withdraw()
        self.expect(f"{code} {sequence} to be accepted, found {found}", found.answer is Answer.ACCEPTED)
        return found

    def held(self) -> int:
        """Bring a vehicle to the moment when its results are held; its number."""
        sequence, _ = self.plc.begin(self.order())
        self.status("ResultValid", lambda s: s.done and s.sequence == sequence)
        return sequence

    def end(self, sequence: int) -> PlcResult:
        """Take the results of a start over."""
        return self.plc.finish(None, sequence, 0.0)


@dataclass(frozen=True)
class Point:
    """One requirement and how it is tried out; `mode` is what the station must offer for it."""

    name: str
    requirement: str
    run: Callable[[Trial], None]
    mode: Mode = Mode.AUTOMATIC
