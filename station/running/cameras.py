"""The rigs of a configuration: their calibration, and the driver that makes their cameras."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from alignment.errors import ConfigurationError, InputError, TruewheelError, told
from alignment.values import SIDES
from sensors.bounded import CallBounds
from sensors.camera import Camera
from sensors.drivers.driver import CameraDriver, CameraPlace, KnownCalibration, RigDriver, RigPlace
from sensors.formats import StrictModel, read_calibration_file, write_calibration
from sensors.guarded import GuardedCamera
from sensors.rig import Rig, StereoHead
from station.configuration import Configuration
from station.cycle import CalibrationInForce

_UNLIMITED_DAYS = 36_500.0  # a simulated rig does not age


def open_rig(configuration: Configuration, index: int) -> tuple[Rig, CalibrationInForce]:
    """Return a rig of the configuration, not connected, and its calibration; its cameras are guarded.

    Raises
    ------
    InputError
        When its calibration cannot be read or is of another rig, or its driver finds a mistake, fails, or
        makes something else than cameras.
    """
    rig = configuration.settings.rigs[index]
    driver = rig.cameras.driver
    calibration = None if rig.calibration is None else read_rig_calibration(configuration, index)
    require_calibration(configuration, index)
    made = make_rig(configuration, index, calibration)
    if calibration is None:
        assert isinstance(driver, RigDriver)
        assert driver.calibration is not None
        with in_driver(configuration, index):
            place = rig_place(configuration, index, None)
            calibration = _known(driver.calibration(rig.options, place))
    return made, calibration


def require_calibration(configuration: Configuration, index: int) -> None:
    """Refuse a rig that has nothing but the names of its heads: it can be looked at, and measures nothing."""
    rig = configuration.settings.rigs[index]
    if rig.calibration is None and not rig.knows_calibration:
        raise ConfigurationError(
            file=configuration.file,
            field=f"rigs[{index}].calibration",
            expected=f"the calibration file of {rig.name}",
            seen="none, only the names of its heads",
            cure="Capture a plate session with its cameras, calibrate it, and name the file here",
        )


def make_rig(configuration: Configuration, index: int, calibration: CalibrationInForce | None) -> Rig:
    """Return the cameras of a rig, not connected; its heads are those of the calibration where there is one.

    Raises
    ------
    InputError
        When its driver finds a mistake, fails, or makes something else than cameras.
    """
    rig = configuration.settings.rigs[index]
    driver = rig.cameras.driver
    place = rig_place(configuration, index, calibration)
    with in_driver(configuration, index):
        if driver.check is not None:
            driver.check(rig.options, place)
        if not isinstance(driver, RigDriver):
            return _rig_of_cameras(configuration, index, driver, place, calibration)
        made: object = driver.make(rig.options, place)
        if not isinstance(made, Rig):
            raise _no(f"a Rig for {place.rig}", made)
        if not driver.in_process:
            bounds, sizes = call_bounds(configuration), _sizes(calibration, rig.name)
            made.guard(lambda camera: GuardedCamera(camera, None, bounds, size=sizes.get(camera.name)))
        return made


def call_bounds(configuration: Configuration) -> CallBounds:
    """Return how long a call of a camera driver may take."""
    settings = configuration.settings
    call_s = settings.cameras.call_timeout_s
    late_s = min(2.0, call_s)
    return CallBounds(call_s, settings.cycle.shoot_timeout_s + late_s, late_s)


def takes_again_within_s(configuration: Configuration, index: int) -> float:
    """Return in which time images of a rig are taken again once after a camera failed; 0: never."""
    driver = configuration.settings.rigs[index].cameras.driver
    plays = isinstance(driver, RigDriver) and driver.plays
    # The next recorded shot is one of another wheel.
    return 0.0 if plays else configuration.settings.cycle.measure_timeout_s


def check_rig(configuration: Configuration, index: int, *, uncalibrated: bool = False) -> None:
    """Look for all mistakes of a rig that can be found without its cameras; errors as `open_rig`.

    `uncalibrated` lets it be without a calibration, as while its cameras are commissioned.
    """
    rig = configuration.settings.rigs[index]
    calibration = None if rig.calibration is None else read_rig_calibration(configuration, index)
    if not uncalibrated:
        require_calibration(configuration, index)
    check = rig.cameras.driver.check
    if check is not None:
        with in_driver(configuration, index):
            check(rig.options, rig_place(configuration, index, calibration))


def rig_place(configuration: Configuration, index: int, calibration: CalibrationInForce | None) -> RigPlace:
    """Return what a driver is told of a rig."""
    rig, cameras = configuration.settings.rigs[index], configuration.settings.cameras
    known = None if calibration is None else tuple(head.name for head in calibration.calibration.heads)
    heads = known or rig.heads or ()
    return RigPlace(
        rig.name, rig.side, heads, configuration.file.parent, cameras.settings(), cameras.tolerance()
    )


def read_rig_calibration(configuration: Configuration, index: int) -> CalibrationInForce:
    """Read the calibration file that a rig of the configuration names.

    Raises
    ------
    ConfigurationError
        When it is of another rig or side.
    FormatError
        When it cannot be read.
    """
    rig = configuration.settings.rigs[index]
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


def _known(known: KnownCalibration) -> CalibrationInForce:
    with tempfile.TemporaryDirectory() as folder:
        # Through the file format, so that the record holds what a calibration file would.
        path = Path(folder) / "calibration.json"
        write_calibration(path, known.calibration, method=known.method, created_utc=known.created_utc)
        document = read_calibration_file(path).model_dump(mode="json", by_alias=True)
    return CalibrationInForce(known.calibration, known.created_utc, _UNLIMITED_DAYS, document)


def _rig_of_cameras(
    configuration: Configuration,
    index: int,
    driver: CameraDriver[StrictModel],
    place: RigPlace,
    calibration: CalibrationInForce | None,
) -> Rig:
    rig, bounds = configuration.settings.rigs[index], call_bounds(configuration)
    sizes = _sizes(calibration, rig.name)

    def made(one: CameraPlace) -> Camera:
        camera = driver.make(rig.options, one)
        methods = [getattr(camera, name, None) for name in ("connect", "arm", "trigger", "fetch", "close")]
        if not all(map(callable, methods)):
            raise _no(f"a camera for {one.name}, with the methods of sensors.camera.Camera", camera)
        if getattr(camera, "name", None) != one.name:
            raise _no(f"a camera of the name {one.name}", camera)
        return camera

    def guarded(one: CameraPlace) -> Camera:
        # One that hangs for good is made anew.
        return GuardedCamera(made(one), partial(made, one), bounds, size=sizes.get(one.name))

    heads = [
        StereoHead(name, guarded(place.camera(name, "left")), guarded(place.camera(name, "right")))
        for name in place.heads
    ]
    return Rig(place.rig, heads, place.settings, tolerance=place.tolerance)


def _sizes(calibration: CalibrationInForce | None, rig: str) -> dict[str, tuple[int, int]]:
    """(height, width) of the images of each camera, by its name; nothing where no calibration says it."""
    if calibration is None:
        return {}
    return {
        f"{rig}/{head.name}/{side}": (camera.model.height, camera.model.width)
        for head in calibration.calibration.heads
        for side, camera in zip(SIDES, head.cameras, strict=True)
    }


@contextlib.contextmanager
def in_driver(configuration: Configuration, index: int, light: bool = False) -> Iterator[None]:
    """Let mistakes name their field of the file, and whatever else a driver raises be one clear error.

    `light` says that it is the driver of the rig's projector and not of its cameras.
    """
    rig = configuration.settings.rigs[index]
    name, made, installed = rig.driver, "cameras", rig.cameras.installed
    field = f"rigs[{index}].{name}"
    if light:
        assert rig.projector is not None
        name, made, installed = rig.projector.driver, "a projector", rig.projector.projector.installed
        field = f"rigs[{index}].projector.{name}"
    try:
        yield
    except InputError as error:
        if error.file is not None:
            raise
        raise ConfigurationError(
            file=configuration.file,
            field=f"{field}.{error.field}" if error.field else field,
            expected=error.expected,
            seen=error.seen,
            cure=error.cure,
            remedy=error.remedy,
        ) from error
    except TruewheelError:
        raise
    except Exception as error:
        raise ConfigurationError(
            file=configuration.file,
            field=field,
            expected=f"{made} from the driver '{name}' ({installed})",
            seen=told(error),
            cure=f"Check its settings; if they are right, tell the makers of {installed.package}",
        ) from error


def _no(expected: str, made: object) -> ConfigurationError:
    name = getattr(made, "name", None)
    named = f" of the name {name!r}" if isinstance(name, str) else ""
    return ConfigurationError(
        expected=f"{expected} from its driver",
        seen=f"an object of type '{type(made).__name__}'" + named,
        cure="Ask the makers of the driver for a version that fits truewheel",
    )
