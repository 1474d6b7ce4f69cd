"""Puts a station together from its configuration: the one place that decides which parts stand behind it."""

from __future__ import annotations

import math
import re
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from typing import TypeVar

from alignment.errors import SeveralErrors, TruewheelError, WarmUpError
from alignment.follow import follow_wheel
from alignment.measure import measure_wheel
from db.records import HOUR_S
from db.store import ResultStore
from db.upkeep import BackgroundWork
from sensors.drivers.driver import RigDriver
from sensors.guarded import GuardedCamera
from sensors.projectors import LitRig
from sensors.rig import Rig
from station.configuration import Configuration, StationConfig
from station.cycle import (
    SERVED_MODES,
    Bounds,
    CalibrationInForce,
    CommonFrame,
    ErrorCode,
    Identity,
    ImageMemory,
    MeasuringCycle,
    Mode,
    Observer,
    SeriesChoice,
    StationState,
    StationStatus,
    WheelPosition,
    utc_now,
)
from station.health import CalibrationUsed, CameraWatch, WatchingObserver
from station.line import StationLine
from station.line.wire import BusSettings, LineBus, LineDatabase, LineOptions, load_line_database, open_bus
from station.running.cameras import open_rig, takes_again_within_s
from station.running.frame import common_frame
from station.running.light import with_light
from station.running.masters import masters_of
from station.store import (
    ArchivingObserver,
    ImageArchive,
    StationStore,
    describe_station,
    open_archive,
    open_store,
)
from station.warm_up import Work, warm_up

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class OpenStation:
    """A station with everything connected, ready to serve."""

    cycle: MeasuringCycle
    positions: tuple[WheelPosition, ...]
    store: ResultStore
    background: BackgroundWork
    line: StationLine
    line_database: LineDatabase
    bus: LineBus


def works_of(configuration: Configuration) -> tuple[Work, ...]:
    """Return what a station does that needs compiled functions.

    Cameras other than simulated ones may deliver 8 or 16 bit.
    """
    drivers = [rig.cameras.driver for rig in configuration.settings.rigs]
    simulated = [isinstance(driver, RigDriver) and driver.simulates for driver in drivers]
    works = [Work.MEASURE_8]
    if not all(simulated):
        works.append(Work.MEASURE_16)
    if any(simulated):
        works += [Work.WHEEL_IMAGES, Work.DEFORMED_WHEEL_IMAGES]
    return tuple(works)


@contextmanager
def open_station(
    configuration: Configuration,
    observer: Observer | None = None,
    stopping: threading.Event | None = None,
    bus_end: BusSettings | None = None,
) -> Iterator[OpenStation]:
    """Open cameras, database and line, and load what a measurement needs; closed again at the end.

    The line says *starting* from the moment it is open until all of it is compiled and loaded.

    Parameters
    ----------
    configuration
        Of the station.
    observer
        Watches the cycle.
    stopping
        Ends the compiling early.
    bus_end
        The station's end of the bus instead of the configured one.

    Raises
    ------
    SeveralErrors
        Everything that failed, together: one look at the message tells all there is to repair.
    TruewheelError
        The failure, when there is only one; WarmUpError when something does not compile, StoppedError when
        `stopping` was set meanwhile.
    """
    settings = configuration.settings
    failures: list[TruewheelError] = []

    def attempt(action: Callable[[], T]) -> T | None:
        try:
            return action()
        except TruewheelError as error:
            failures.append(error)
            return None

    with ExitStack() as stack:
        database = attempt(lambda: load_line_database(configuration.path(settings.line.dbc)))
        opened = [attempt(partial(_open_lit, configuration, k)) for k in range(len(settings.rigs))]
        rigs = [each for each in opened if each is not None]
        frame = None
        if len(rigs) == len(opened):
            frame = attempt(lambda: common_frame(configuration, [known.calibration for _, known in rigs]))
        for rig, _ in rigs:
            stack.callback(rig.close)
            attempt(rig.connect)
        store = attempt(lambda: stack.enter_context(open_store(configuration)))
        bus = attempt(lambda: stack.enter_context(open_bus(bus_end or bus_settings(configuration))))
        if failures:
            raise _together(failures)
        assert database is not None
        assert store is not None
        assert bus is not None
        watch = _watch(configuration, store, rigs)
        again_s = [takes_again_within_s(configuration, k) for k in range(len(rigs))]
        whole = tuple(
            _position(settings, rig, known, frame, within_s, watch)
            for (rig, known), within_s in zip(rigs, again_s, strict=True)
        )
        archive = open_archive(configuration, store)
        if archive is not None:
            # Before the line, which at the end must not seem alive while images are written.
            stack.enter_context(archive)
        line = stack.enter_context(StationLine(bus, database, options=line_options(configuration)))
        try:
            warm_up(works_of(configuration), stopping=stopping)
        except WarmUpError:
            line.publish(StationStatus(StationState.FAULT, ErrorCode.INTERNAL_FAULT))
            raise
        images = settings.cycle.image_folder
        stack.enter_context(watch)
        cycle = MeasuringCycle(
            Identity(settings.station.id, version("truewheel"), configuration.hash),
            whole,
            configuration.vehicle_types,
            line,
            store.results,
            cycle_bounds(settings),
            settings.measure.coverage_factor,
            WatchingObserver(_archiving(archive, observer or Observer()), watch),
            image_folder=None if images is None else configuration.path(images),
            threads=[*line.threads, watch.thread, *([] if archive is None else [archive.thread])],
            frame=frame,
            series=series_choice(settings),
            masters=masters_of(settings, store.results, whole),
        )
        stack.callback(cycle.close)
        cycle.start()
        describe_station(store.results, configuration, whole, utc_now())
        yield OpenStation(cycle, whole, store.results, store.background, line, database, bus)


def _open_lit(configuration: Configuration, index: int) -> tuple[Rig | LitRig, CalibrationInForce]:
    rig, known = open_rig(configuration, index)
    return with_light(configuration, index, rig), known


def cycle_bounds(settings: StationConfig) -> Bounds:
    """Return the longest waits of a cycle; the line's description says what they come to."""
    return Bounds(
        measure_s=settings.cycle.measure_timeout_s,
        # The store bounds each statement; a commit is a few of them.
        store_s=2.0 * settings.database.timeout_s,
        acknowledge_s=settings.line.acknowledge_timeout_s,
        adjust_s=settings.cycle.adjust_timeout_s,
    )


def series_choice(settings: StationConfig) -> SeriesChoice:
    """Return what a station says of series of exposures."""
    cycle = settings.cycle
    turn = math.radians(cycle.least_turn_deg)
    kept = settings.archive
    memory = None if kept is None else ImageMemory(round(1e6 * kept.series_mb))
    return SeriesChoice(cycle.measure, cycle.exposures, turn, cycle.exposure_interval_s, memory)


def _archiving(archive: ImageArchive | None, observer: Observer) -> Observer:
    """The observer, with the archive of images before it when there is one."""
    return observer if archive is None else ArchivingObserver(observer, archive)


def bus_settings(configuration: Configuration) -> BusSettings:
    """Return the station's end of the bus."""
    line = configuration.settings.line
    log = None if line.log is None else configuration.path(line.log)
    most_bytes = round(1e6 * line.log_mb)
    return BusSettings(
        line.interface, line.channel, line.bitrate, log, line.options, most_bytes, line.log_files
    )


def line_options(configuration: Configuration) -> LineOptions:
    """Return what the configuration sets of the line."""
    settings = configuration.settings
    numbers = [int(number) for number in re.findall(r"\d+", version("truewheel"))[:3]]
    major, minor, patch = [*numbers, 0, 0, 0][:3]
    return LineOptions(
        communication_timeout_s=settings.line.communication_timeout_s,
        live_age_s=settings.cycle.live_max_age_s,
        modes=SERVED_MODES - ({Mode.CALIBRATE} if settings.cycle.image_folder is None else set()),
        software=(major, minor, patch),
    )


def _together(failures: list[TruewheelError]) -> TruewheelError:
    if len(failures) == 1:
        return failures[0]
    return SeveralErrors(f"the station cannot start, {len(failures)} parts failed", failures)


def _position(
    settings: StationConfig,
    rig: Rig | LitRig,
    known: CalibrationInForce,
    frame: CommonFrame | None,
    retake_within_s: float,
    watch: CameraWatch,
) -> WheelPosition:
    return WheelPosition(
        rig,
        known,
        measure_wheel,
        settings.measure.settings(),
        settings.cycle.shoot_timeout_s,
        needs_place=frame is not None and frame.reference == "vehicle",
        retake_within_s=retake_within_s,
        stopped=watch.stopped,
        follow=follow_wheel,
    )


def _watch(
    configuration: Configuration,
    store: StationStore,
    rigs: Sequence[tuple[Rig | LitRig, CalibrationInForce]],
) -> CameraWatch:
    station = configuration.settings.station.id
    calibrated = {
        rig.name: CalibrationUsed(known.calibration.id, int(known.created_utc.timestamp() // HOUR_S))
        for rig, known in rigs
    }
    cameras = [camera for rig, _ in rigs for camera in rig.cameras if isinstance(camera, GuardedCamera)]
    first, serials = store.results.first_camera_figures(station), store.results.camera_serials(station)
    note, health = store.background.note, configuration.settings.health
    return CameraWatch(health, station, store.results, note, cameras, calibrated, first, serials)
