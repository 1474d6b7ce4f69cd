"""`truewheel run`: the station, from its configuration until it is told to stop."""

from __future__ import annotations

import logging
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import FrameType

from alignment.counting import count_of
from alignment.errors import together
from station.configuration import Configuration, read_configuration
from station.cycle import CycleReport, Observer, StationState, missed_limits
from station.line.tools import named_cable
from station.line.wire import ONE_PROCESS, BusSettings
from station.running.composition import OpenStation, bus_settings, open_station
from station.warm_up import StoppedError

_ENDING = ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT")
_LOG = logging.getLogger("truewheel.station")


class _Log(Observer):
    def __init__(self) -> None:
        self._state: StationState | None = None

    def entered(self, state: StationState) -> None:
        # A reset that changes nothing enters the state anew, as often as the controller sends one.
        if state is not self._state:
            _LOG.info("state %s", state)
        self._state = state

    def cycle_done(self, report: CycleReport) -> None:
        trigger, record = report.trigger, report.record
        why = together([*filter(None, [record.reason_text]), *missed_limits(report.evaluation)])
        _LOG.info(
            "start %d, VIN %s: %s%s, line was told %s",
            trigger.sequence,
            trigger.vin,
            record.outcome,
            f" ({why})" if why else "",
            report.told or "nothing",
        )


def run_station(config: Path, stopping: threading.Event | None = None, plug: Path | None = None) -> None:
    """Run the station until a signal ends it in order, or until `stopping` is set; see `stop_on_signals`.

    A cycle under way is finished, and results that nobody acknowledged are held for the next start.

    Parameters
    ----------
    config
        The station's file.
    stopping
        Ends it.
    plug
        Instead of the configured bus the station is on one end of a cable, and another program of this
        computer finds the other end, for the interface ``slcan``, under this name.

    Raises
    ------
    TruewheelError
        When it cannot start; all failures together. Told to end while it starts is none.
    """
    stopping = stopping or threading.Event()
    try:
        with stop_on_signals(stopping):
            configuration = read_configuration(config)
            with (
                _end_of_the_bus(configuration, plug) as bus,
                open_station(configuration, _Log(), stopping, bus) as station,
            ):
                _serve(configuration, station, bus, plug, stopping)
    except StoppedError:
        _LOG.info("told to end before it was ready")
    _LOG.info("stopped")


@contextmanager
def _end_of_the_bus(configuration: Configuration, plug: Path | None) -> Iterator[BusSettings]:
    settings = bus_settings(configuration)
    if plug is None:
        yield settings
        return
    with named_cable(plug) as end:
        yield replace(settings, interface=end.interface, channel=end.channel, options=end.options)


def _serve(
    configuration: Configuration,
    station: OpenStation,
    bus: BusSettings,
    plug: Path | None,
    stopping: threading.Event,
) -> None:
    if bus.interface == ONE_PROCESS:
        _LOG.warning(
            "line %s %s is in this process only, no PLC can reach it: configure the interface of a bus, or "
            "start the station with a cable",
            bus.interface,
            bus.channel,
        )
    _LOG.info(
        "%s is ready: %s, line %s",
        configuration.settings.station.name,
        count_of(len(station.positions), "rig"),
        f"{bus.interface} {bus.channel}" if plug is None else f"at the other end of the cable {plug}",
    )
    station.cycle.serve(stopping)
    _LOG.info("line at the end: %s", station.line.health)
    for thread in station.cycle.threads:
        if not thread.good:
            _LOG.warning("at the end: %s", thread)


@contextmanager
def stop_on_signals(stopping: threading.Event) -> Iterator[None]:
    """Let SIGINT, SIGTERM, SIGHUP and SIGQUIT set `stopping`; only in the main thread, where signals arrive.

    A second signal adds nothing: every wait at the end is bounded. What was told to be ignored stays ignored,
    so that `nohup` keeps a station running when its terminal goes.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(number: int, frame: FrameType | None) -> None:
        stopping.set()

    # Some systems have fewer.
    numbers = [number for name in _ENDING if (number := getattr(signal, name, None)) is not None]
    heeded = [number for number in numbers if signal.getsignal(number) is not signal.SIG_IGN]
    before = {number: signal.signal(number, stop) for number in heeded}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
