"""What a simulated controller is asked to do, how long it waits, and what each vehicle brought."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from station.cycle import AxleAnswer, Mode, WheelAnswer
from station.line.wire import Value, VehicleReport


@dataclass(frozen=True)
class PlcOrder:
    """One vehicle to measure: its VIN, the number of its type, the wheels (None: all), and what to do."""

    vin: str
    vehicle_type: int = 1
    wheels: tuple[str, ...] | None = None
    mode: Mode = Mode.AUTOMATIC


@dataclass(frozen=True)
class PlcTimeouts:
    """How long the controller waits, seconds.

    Attributes
    ----------
    connect_s
        For a station that is not there yet.
    starting_s
        For a station that is heard and says that it is starting: it may be compiling.
    ready_s, busy_s, done_s, acknowledged_s
        For ready (also after a reset), for the answer to a command, for the results, for the end of
        ResultValid after the acknowledgement.
    silence_s
        Without a good Status for so long, a station once heard counts as lost.
    """

    connect_s: float = 10.0
    starting_s: float = 600.0
    ready_s: float = 5.0
    busy_s: float = 1.0
    done_s: float = 60.0
    acknowledged_s: float = 2.0
    silence_s: float = 0.5


DEFAULT_TIMEOUTS = PlcTimeouts()


@dataclass(frozen=True)
class ReceivedMessage:
    """One message from the station: when (seconds of the controller's clock), its name, its signals."""

    time_s: float
    name: str
    values: dict[str, Value]


@dataclass(frozen=True)
class PlcResult:
    """Everything one vehicle brought.

    Attributes
    ----------
    order, sequence
        What was asked; the order is None for results that the station held from before.
    vehicle
        Verdict of the vehicle and thrust angle.
    wheels, axles
        Of all wheels and axles of the line, also those not requested.
    started_s, busy_s, done_s, acknowledged_s
        When start was sent, busy and ResultValid were seen, and the end of ResultValid was seen.
    received
        All messages of the station from start to the end of ResultValid, in order.
    """

    order: PlcOrder | None
    sequence: int
    vehicle: VehicleReport
    wheels: tuple[WheelAnswer, ...]
    axles: tuple[AxleAnswer, ...]
    started_s: float
    busy_s: float
    done_s: float
    acknowledged_s: float
    received: tuple[ReceivedMessage, ...]


def first_shown(
    received: Iterable[ReceivedMessage], sequence: int, flags: tuple[str, ...], otherwise: float
) -> float:
    """When a Status of this sequence first showed one of the flags."""
    shown = (
        message.time_s
        for message in received
        if message.name == "Status"
        and message.values["Sequence"] == sequence
        and any(message.values[flag] for flag in flags)
    )
    return next(shown, otherwise)
