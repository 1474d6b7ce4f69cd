"""A station that adjusts: four wheels with prepared images of a turning tie rod, from exposure to the bus.

Every rig gives its images at the rate of its cameras; cycle, line, bus and controller are real.
"""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import can

from alignment.errors import LineTimeoutError
from alignment.follow import follow_wheel
from alignment.measure import measure_wheel
from alignment.values import MeasureSettings, RigCalibration, StereoImages
from sensors.camera import Frame
from sensors.shot import HeadFrames, WheelShot
from station.cycle import CalibrationInForce, Follower, LiveState, Mode, WheelPosition
from station.line.plc import PlcOrder, PlcSimulator, PlcTimeouts
from station.line.wire import BusSettings, LineDatabase, load_line_database, open_bus, read_live
from station.rehearsal.prepared import KIND, WHEELS, open_rehearsal

_IN_TURN = itertools.count()
_SETTLED, _LONGEST_S = 5, 60.0  # results of each wheel before any counts, and the longest wait for them
_TIMEOUTS = PlcTimeouts(busy_s=20.0, done_s=60.0, ready_s=60.0, acknowledged_s=20.0, silence_s=10.0)


@dataclass(frozen=True)
class LiveTimes:
    """What adjusting showed, after it had settled.

    Attributes
    ----------
    seconds
        How long it was looked at.
    delays_s
        From each exposure to the frame with its angles on the bus.
    results
        New angles of each wheel.
    without_angles
        Of them those without angles.
    cpu_s
        What the processor worked, controller and bus included.
    followed, whole
        Results of each wheel by following and by whole measurements, from the beginning.
    stop_s
        From the stop command to the results of the measurement that counts.
    """

    seconds: float
    delays_s: tuple[float, ...]
    results: tuple[int, ...]
    without_angles: int
    cpu_s: float
    followed: tuple[int, ...]
    whole: tuple[int, ...]
    stop_s: float


class PreparedTieRod:
    """Stands for the cameras of one wheel: a frame each `period_s`, forth and back through its views."""

    def __init__(
        self, name: str, views: Sequence[Sequence[StereoImages]], heads: Sequence[str], period_s: float
    ) -> None:
        self.name = name
        self._views, self._heads, self._period_s = views, heads, period_s
        self._taken = 0
        self._next_s = 0.0
        self.exposed_s: list[float] = []

    def connect(self) -> None:
        """Nothing to reach."""

    def arm(self) -> None:
        """Ready at once."""

    def shoot(self, timeout_s: float) -> WheelShot:
        """Wait for the next frame of the cameras, and give it."""
        wait_s = self._next_s - time.monotonic()
        if wait_s > 0.0:
            time.sleep(wait_s)
        now = time.monotonic()
        self._next_s = max(self._next_s + self._period_s, now)
        place = self._taken % max(2 * len(self._views) - 2, 1)
        images = self._views[min(place, max(2 * len(self._views) - 2, 1) - place)]
        self._taken += 1
        self.exposed_s.append(now)

        def frame(name: str, pair: StereoImages, side: str) -> Frame:
            return Frame(f"{self.name}/{name}/{side}", getattr(pair, side), self._taken, now, now, 5.0)

        heads = tuple(
            HeadFrames(name, frame(name, pair, "left"), frame(name, pair, "right"))
            for name, pair in zip(self._heads, images, strict=True)
        )
        return WheelShot(self.name, datetime.now(UTC), heads)

    def close(self) -> None:
        """Nothing to let go."""


class _LivePosition(WheelPosition):
    """Keeps what followed its wheel last."""

    last: Follower | None = None

    def follower(self) -> Follower | None:
        """As the position's."""
        self.last = super().follower()
        return self.last


def _position(rig: PreparedTieRod, calibration: RigCalibration, follow: bool) -> _LivePosition:
    mine = replace(calibration, rig=rig.name, id=f"{calibration.id}-{rig.name}")
    in_force = CalibrationInForce(mine, datetime(2026, 1, 1, tzinfo=UTC), 36_500.0, {"id": mine.id})
    function = follow_wheel if follow else None
    return _LivePosition(rig, in_force, measure_wheel, MeasureSettings(), 10.0, follow=function)


class _Watcher:
    """Notes when each new shot of each wheel is seen on the bus, and whether it has angles."""

    def __init__(self, database: LineDatabase) -> None:
        self._database = database
        self._wheel_of = {f"LiveAngles{ending}": wheel for wheel, ending in database.wheels.items()}
        self._shot: dict[str, int] = {}
        self._more = threading.Condition()
        self.seen: dict[str, list[tuple[float, bool]]] = {wheel: [] for wheel in WHEELS}

    def __call__(self, frame: can.Message) -> None:
        """Take a frame."""
        now = time.monotonic()
        name = self._database.name_of(frame)
        wheel = None if name is None else self._wheel_of.get(name)
        if wheel is None:
            return
        live = read_live(wheel, self._database.decode(frame))
        if live.shot != self._shot.get(wheel):
            with self._more:
                self._shot[wheel] = live.shot
                self.seen[wheel].append((now, live.state in (LiveState.INSIDE, LiveState.OUTSIDE)))
                self._more.notify_all()

    def wait(self, more: int) -> None:
        """Wait until each wheel has shown so many results more; raises LineTimeoutError."""
        with self._more:
            enough = {wheel: len(seen) + more for wheel, seen in self.seen.items()}
            if not self._more.wait_for(
                lambda: all(len(self.seen[wheel]) >= count for wheel, count in enough.items()), _LONGEST_S
            ):
                seen = min(len(seen) for seen in self.seen.values())
                raise LineTimeoutError(
                    f"expected live angles of all wheels within {_LONGEST_S:g} s, of one {seen} were seen"
                )


def run_live(
    folder: Path,
    dbc: Path,
    views: Sequence[Sequence[StereoImages]],
    calibration: RigCalibration,
    seconds: float,
    rate: float,
    *,
    follow: bool = True,
) -> LiveTimes:
    """Adjust four wheels for some seconds, over a bus in this process.

    Parameters
    ----------
    folder
        For the database.
    dbc
        Of the line.
    views
        Images of a wheel whose tie rod is turned; all four show them.
    calibration
        Of the rig.
    seconds
        From when each wheel has shown some results.
    rate
        Frames of each rig in a second, at most.
    follow
        Whether wheels are followed; else each frame is measured whole.

    Raises
    ------
    TruewheelError
        When the cycle fails.
    """
    names = [head.name for head in calibration.heads]
    rigs = [PreparedTieRod(name, views, names, 1.0 / rate) for name in WHEELS]
    positions = [_position(rig, calibration, follow) for rig in rigs]
    settings = BusSettings("virtual", f"live-{next(_IN_TURN)}", 500_000)
    database = load_line_database(dbc)
    watcher = _Watcher(database)
    stopping = threading.Event()
    with ExitStack() as stack:
        bus, plc_bus, third = (stack.enter_context(open_bus(settings)) for _ in range(3))
        third.listen(watcher)
        station = stack.enter_context(
            open_rehearsal(bus, database, f"sqlite:///{folder / 'live.db'}", positions=positions, kind=KIND)
        )
        serving = threading.Thread(target=station.cycle.serve, args=(stopping,), name="live station")
        serving.start()
        try:
            with PlcSimulator(plc_bus, database, timeouts=_TIMEOUTS) as plc:
                plc.start_up()
                order = PlcOrder("TWADJUST000000001", mode=Mode.ADJUST)
                sequence, started_s = plc.begin(order)
                watcher.wait(_SETTLED)
                first_s, cpu_s = time.monotonic(), time.process_time()
                time.sleep(seconds)
                watcher.wait(1)  # of a computer that does much else
                last_s, cpu_s = time.monotonic(), time.process_time() - cpu_s
                plc.stop(sequence)
                result = plc.finish(order, sequence, started_s)
                stop_s = result.done_s - last_s
        finally:
            stopping.set()
            serving.join(30.0)
    delays, results, without = [], [], 0
    for rig in rigs:
        seen = watcher.seen[rig.name]
        # The n-th result is of the n-th exposure.
        mine = [
            (at_s - exposed_s, good)
            for (at_s, good), exposed_s in zip(seen, rig.exposed_s, strict=False)
            if first_s <= at_s < last_s
        ]
        delays += [delay for delay, _ in mine]
        results.append(len(mine))
        without += sum(not good for _, good in mine)
    followers = [position.last for position in positions]
    return LiveTimes(
        last_s - first_s, tuple(delays), tuple(results), without, cpu_s,
        tuple(0 if one is None else one.followed for one in followers),
        tuple(0 if one is None else one.whole for one in followers),
        stop_s,
    )  # fmt: skip
