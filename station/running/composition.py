"""Puts a station together from its configuration: the one place that decides which parts stand behind it."""

from __future__ import annotations

import re
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import TypeVar

from alignment.errors import ConfigurationError, SeveralErrors, TruewheelError, WarmUpError
from alignment.measure import measure_wheel
from db.store import ResultStore
from db.upkeep.background import BackgroundWork
from sensors.drivers.recorded import recorded_rig
from sensors.formats import read_calibration_file, write_calibration
from sensors.formats.files import entries
from sensors.formats.shot import SHOT_FILE
from sensors.rig import Rig
from station.configuration.settings import (
    Configuration,
    RecordedOptions,
    RigSettings,
    SimulatedOptions,
    StationConfig,
)
from station.cycle.measuring import MeasuringCycle
from station.cycle.ports import Bounds, Identity, Observer
from station.cycle.positions import CalibrationInForce, WheelPosition, utc_now
from station.cycle.words import ErrorCode, Mode, StationState, StationStatus
from station.line.interface import StationLine
from station.line.wire.bus import LineBus, open_bus
from station.line.wire.channel import BusSettings
from station.line.wire.dbc import LineDatabase, load_line_database
from station.line.wire.options import LineOptions
from station.store.archive import ArchivingObserver, ImageArchive
from station.store.opening import describe_station, open_archive, open_store
from station.warm_up.needs import Work
from station.warm_up.prepare import warm_up

T = TypeVar("T")
_UNLIMITED_DAYS = 36_500.0  # a simulated rig does not age


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
    simulated = [rig.simulated is not None for rig in configuration.settings.rigs]
    works = [Work.MEASURE_8]
    if not all(simulated):
        works.append(Work.MEASURE_16)
    if any(simulated):
        works.append(Work.WHEEL_IMAGES)
    return tuple(works)


@contextmanager
def open_station(
    configuration: Configuration,
    observer: Observer | None = None,
    stopping: threading.Event | None = None,
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
        positions = [attempt(partial(_position, configuration, k)) for k in range(len(settings.rigs))]
        for position in positions:
            if position is not None:
                stack.callback(position.rig.close)
                attempt(position.rig.connect)
        store = attempt(lambda: stack.enter_context(open_store(configuration)))
        bus = attempt(lambda: stack.enter_context(open_bus(bus_settings(configuration))))
        if failures:
            raise _together(failures)
        assert database is not None
        assert store is not None
        assert bus is not None
        whole = tuple(position for position in positions if position is not None)
        line = stack.enter_context(StationLine(bus, database, options=line_options(configuration)))
        try:
            warm_up(works_of(configuration), stopping=stopping)
        except WarmUpError:
            line.publish(StationStatus(StationState.FAULT, ErrorCode.INTERNAL_FAULT))
            raise
        images = settings.cycle.image_folder
        archive = open_archive(configuration, store)
        if archive is not None:
            stack.enter_context(archive)
        cycle = MeasuringCycle(
            Identity(settings.station.id, version("truewheel"), configuration.hash),
            whole,
            configuration.vehicle_types,
            line,
            store.results,
            cycle_bounds(settings),
            settings.measure.coverage_factor,
            _archiving(archive, whole, observer or Observer()),
            image_folder=None if images is None else configuration.path(images),
            threads=[*line.threads, *([] if archive is None else [archive.thread])],
        )
        stack.callback(cycle.close)
        cycle.start()
        describe_station(store.results, configuration, whole, utc_now())
        yield OpenStation(cycle, whole, store.results, store.background, line, database, bus)


def cycle_bounds(settings: StationConfig) -> Bounds:
    """Return the longest waits of a cycle; the line's description says what they come to."""
    return Bounds(
        measure_s=settings.cycle.measure_timeout_s,
        # The store bounds each statement; a commit is a few of them.
        store_s=2.0 * settings.database.timeout_s,
        acknowledge_s=settings.line.acknowledge_timeout_s,
        adjust_s=settings.cycle.adjust_timeout_s,
    )


def _archiving(
    archive: ImageArchive | None, positions: Sequence[WheelPosition], observer: Observer
) -> Observer:
    """The observer, with the archive of images before it when there is one."""
    return observer if archive is None else ArchivingObserver(observer, positions, archive)


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
        modes=frozenset(Mode) - ({Mode.CALIBRATE} if settings.cycle.image_folder is None else set()),
        software=(major, minor, patch),
    )


def _together(failures: list[TruewheelError]) -> TruewheelError:
    if len(failures) == 1:
        return failures[0]
    return SeveralErrors(f"the station cannot start, {len(failures)} parts failed", failures)


def _position(configuration: Configuration, index: int) -> WheelPosition:
    settings, rig = configuration.settings, configuration.settings.rigs[index]
    calibration: CalibrationInForce | None = None
    if rig.calibration is not None:
        calibration = read_rig_calibration(configuration, rig, index)
    if rig.simulated is not None:
        cameras, true = _simulated(configuration, rig, rig.simulated)
        calibration = calibration or true
    elif rig.recorded is not None:
        cameras = _recorded(configuration, rig, rig.recorded, index)
    assert calibration is not None
    return WheelPosition(
        cameras, calibration, measure_wheel, settings.measure.settings(), settings.cycle.shoot_timeout_s
    )


def read_rig_calibration(configuration: Configuration, rig: RigSettings, index: int) -> CalibrationInForce:
    """Read the calibration file that a rig of the configuration names.

    Raises
    ------
    ConfigurationError
        When it is of another rig or side.
    FormatError
        When it cannot be read.
    """
    assert rig.calibration is not None
    file = read_calibration_file(configuration.path(rig.calibration))
    for field, expected, seen in (("rig", rig.name, file.rig), ("side", rig.side, file.side)):
        if expected != seen:
            raise ConfigurationError(
                file=configuration.file,
                field=f"rigs[{index}].calibration",
                expected=f"a calibration of {field} '{expected}'",
                seen=f"'{rig.calibration}', which is of {field} '{seen}'",
                cure="Name the calibration of this rig",
            )
    return CalibrationInForce(
        file.calibration(),
        file.created_utc,
        configuration.settings.cycle.calibration_max_age_days,
        file.model_dump(mode="json", by_alias=True),
    )


def _simulated(
    configuration: Configuration, rig: RigSettings, options: SimulatedOptions
) -> tuple[Rig, CalibrationInForce]:
    # Only a configuration that names the simulator loads it.
    from sensors.simulation.simulated_rig import (
        TRUE_CALIBRATION_METHOD,
        TRUE_CALIBRATION_UTC,
        SimulatedRig,
        angles_about,
        true_calibration,
    )

    true = true_calibration(rig.name, rig.side, options.rig, options.seed)
    with tempfile.TemporaryDirectory() as folder:
        # Through the file format, so that the record holds what a calibration file would.
        path = Path(folder) / "calibration.json"
        write_calibration(path, true, method=TRUE_CALIBRATION_METHOD, created_utc=TRUE_CALIBRATION_UTC)
        document = read_calibration_file(path).model_dump(mode="json", by_alias=True)
    cameras = SimulatedRig(
        true,
        options.rig,
        options.seed,
        angles_about(options.camber_deg, options.toe_deg, options.spread_deg),
        configuration.settings.cameras.settings(),
        configuration.settings.cameras.tolerance(),
    )
    return cameras, CalibrationInForce(true, TRUE_CALIBRATION_UTC, _UNLIMITED_DAYS, document)


def _recorded(configuration: Configuration, rig: RigSettings, options: RecordedOptions, index: int) -> Rig:
    folders = recorded_folders(configuration, options, index)
    return recorded_rig(folders, options.at_end, rig.name, configuration.settings.cameras.tolerance())


def recorded_folders(configuration: Configuration, options: RecordedOptions, index: int) -> list[Path]:
    """Return the shots that a rig of the configuration plays, in the order of their names.

    Raises
    ------
    ConfigurationError
        When there are none.
    """
    folder = configuration.path(options.shots)
    folders = [path.parent for path in entries(folder, SHOT_FILE, "shots")]
    if not folders:
        raise ConfigurationError(
            file=configuration.file,
            field=f"rigs[{index}].recorded.shots",
            expected=f"a folder of recorded shots, each a folder with {SHOT_FILE}",
            seen=f"none in '{options.shots}'",
        )
    return folders
