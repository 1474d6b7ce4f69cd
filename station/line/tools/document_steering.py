"""The part of the line interface's description about steering: what is told, guidance, and the sweep."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from station.configuration import SweepPlan
from station.cycle import SWEEP_ENDS
from station.line.told import STEP_LIFETIME_S
from station.line.wire import LineDatabase

MakesTable = Callable[[Iterable[str], Iterable[Iterable[object]]], str]

_TOLD = """
## Steering wheel, ride heights, guidance, sweep

All of this came with interface 3.1. A controller of 3.0 sends none of its messages, asks for no sweep, may
leave the new ones of the station unread, and goes on unchanged.

**What the controller tells.** `SteeringWheel` and `RideHeight…` go out every 100 ms, from power-up on, also
between vehicles, where the controller knows them; a message that begins counts from its second frame.
`Sample` is one more with each measurement: a sensor that stands grows old however often it is sent. Without a
good frame for {silence_ms} ms nothing is known any more. An angle or a height that is not known is *invalid*,
never 0. When the vehicle leaves, both are told as invalid, once at least: what merely ceases stays known for
those {silence_ms} ms, and a start within them is measured with what the last vehicle told. The station looks
before the exposures and after them. What it made of them comes with the results:
`SteeringWheelResult`, `RideHeightUsed…`, and in `WheelRaw…` the angles as measured where `WheelResult…` holds
corrected ones. Where the vehicle type requires what was not known, or is absurd, wheels are not judged.

**Guidance** comes in the mode adjust, beside the live angles and with their `Shot`; the mode guidance stays
reserved. `GuidanceTarget…` goes before `Guidance…`; both count only when their `Shot` is the same. A
nutrunner turns only in the state turn, by `Turns` towards `Direction`. It stops at once in every other state,
without a good frame in time, and when `Age` is more than it may turn blindly. Guidance that grows too old is
lost; when adjusting is over, the state none comes once. Guidance is no verdict: that comes after stop.

**The sweep**, a start in the mode sweep:

1. The station shows the state turning, and in `SweepProgress` the position and the steering wheel's angle
   that it wants.
2. The controller (a robot, or the operator) turns the steering there and holds it. It sends `SweepStep` with
   the number of the start, the position and the angle that was reached, and then `Command` step with the same
   number; both stand, repeated every 100 ms, until the station shows sweeping or wants another position. All
   steps of a sweep have one number, so that an accepted answer may be that of the step before.
   A `SweepStep` older than {step_s:g} s does not count. Between steps it goes out every second with zeros.
3. The station shows sweeping and `SweepProgress` hold while it takes images: move nothing. A step that did
   not reach the angle is wanted again, up to `sweep.attempts` times.
4. The last position is straight ahead; its step ends the sweep. All wheels are measured there as in the mode
   automatic, and the results hold `Sweep…` beside the rest.

While a step stands, `step_incomplete` and `busy` pass; any other refusal is final.

```mermaid
sequenceDiagram
    participant P as PLC
    participant S as station
    Note over P,S: SteeringWheel every 100 ms, always; the start is one in the mode sweep
    P->>S: SteeringWheel
    P->>S: Vin1, Vin2, Vin3 (n), Command start (n)
    S->>P: CommandAnswer start (n) accepted, Status sweeping (n)
    loop each position
        S->>P: SweepProgress turn, Status turning (n)
        Note over P: the steering is turned and held
        P->>S: SweepStep (n), Command step (n)
        S->>P: Status sweeping (n), SweepProgress hold
        Note over S: images of the front wheels
    end
    S->>P: SweepProgress done, Status busy (n)
    Note over S: all wheels, straight ahead; verdict; record
    S->>P: results (n), Status ResultValid (n)
```

A vehicle is ok only when the sweep brought every steering axis, and all that has limits is within them.
`not_measured` in one of `Sweep…` is a fault of the vehicle, as an axis that no fixed one explains is. How a
sweep ends before that, always with the outcome fault of all wheels, and the station ready again:

"""
_MORE = """

An abort, a reset and a lost communication end a sweep as they end any cycle: with aborted, or without
results. The longest sweep is that of automatic, and for each of its positions `sweep.step_timeout_s` for
each attempt and `cycle.measure_timeout_s` for each of two exposures: the vehicle type says how many
({positions} where it does not, and straight ahead).
"""


def steering_text(database: LineDatabase, table: MakesTable) -> str:
    """The part, Markdown; `table` makes one of a head and rows."""
    silence_s = database.timeout_s("SteeringWheel") or 0.0
    rows = [[f"`{end}`", f"`{ending.code}`", ending.when] for end, ending in SWEEP_ENDS.items()]
    positions = SweepPlan.model_fields["positions"].default
    return (
        _TOLD.format(silence_ms=f"{1000 * silence_s:g}", step_s=STEP_LIFETIME_S)
        + table(("reason in the record", "error code", "when"), rows)
        + _MORE.format(positions=positions)
    )
