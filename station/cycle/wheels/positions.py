"""One wheel position: its rig, its calibration, and what came of one shot."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from functools import cached_property
from typing import Any, Protocol

from alignment.errors import TruewheelError, together
from alignment.measure_spin import SeriesMeasurement, SeriesUnderWay
from alignment.measure_steering import steered_settings
from alignment.prepared import PreparedRig
from alignment.values import (
    MeasureSettings,
    Refusal,
    RefusalCode,
    RigCalibration,
    Side,
    StereoImages,
    WheelMeasurement,
)
from alignment.vehicle import WheelAxis
from alignment.wheel import LiveSpin, SeriesRules, SpinMeasurement
from db.records import CalibrationRecord, WheelOutcome, ZeroRecord
from sensors.formats import check_shot_matches
from sensors.shot import WheelShot
from station.cycle.wheels.acceptance import corrected_and_judged
from station.cycle.wheels.following import Follower, FollowFunction
from station.cycle.wheels.retaking import Retaking, of_devices
from station.cycle.wheels.series import SeriesError, SeriesPlan, take_series
from station.cycle.words import ErrorCode, Failure, fault
from station.threads import Worker

MeasureFunction = Callable[[Sequence[StereoImages], PreparedRig, MeasureSettings], WheelMeasurement | Refusal]


_LOG = logging.getLogger("truewheel.station")


def utc_now() -> datetime:
    """Return the aware UTC time, for records."""
    return datetime.now(UTC)


class ShootingRig(Protocol):
    """What the cycle needs of a rig; `sensors.rig.Rig` is one."""

    name: str

    def connect(self) -> None:
        """Reach all cameras."""
        ...

    def arm(self) -> None:
        """Prepare all cameras."""
        ...

    def shoot(self, timeout_s: float) -> WheelShot:
        """Take one image with each camera."""
        ...

    def close(self) -> None:
        """Let all cameras go."""
        ...


@dataclass(frozen=True, eq=False)
class CalibrationInForce:
    """The calibration of a rig, how long it may be used, and the document it was read from."""

    calibration: RigCalibration
    created_utc: datetime
    max_age_days: float
    document: Mapping[str, Any]

    @property
    def valid_until_utc(self) -> datetime:
        """End of its use."""
        return self.created_utc + timedelta(days=self.max_age_days)

    def valid_at(self, now: datetime) -> bool:
        """Whether it may be used at this time."""
        return self.created_utc <= now < self.valid_until_utc

    def record(self) -> CalibrationRecord:
        """Return the record of it; its end is left open, because the configuration may change that."""
        return CalibrationRecord(
            id=self.calibration.id,
            rig=self.calibration.rig,
            valid_from_utc=self.created_utc,
            document=self.document,
        )


ABORTED = Failure(
    WheelOutcome.FAULT, ErrorCode.NONE, "aborted", "the cycle was aborted before this wheel was measured"
)


@dataclass(frozen=True, eq=False)
class MeasuredWith:
    """What a wheel was measured with, beside its images: the same gives the same result.

    Attributes
    ----------
    in_force
        The calibration.
    settings
        Of the measurement.
    needs_place
        Whether a wheel without a place is refused.
    zero
        The zero measurement that corrects; None where there is none.
    rules
        Of the series; None of a single exposure.
    """

    in_force: CalibrationInForce
    settings: MeasureSettings
    needs_place: bool
    zero: ZeroRecord | None
    rules: SeriesRules | None


@dataclass(frozen=True, eq=False)
class WheelResult:
    """What came of one wheel in one cycle: a measurement, or why there is none.

    Attributes
    ----------
    calibration_id, calibration_valid
        The calibration it rests on, and whether that was in force.
    shot
        The images it was measured in, or refused for; None when there are none, or none of this calibration.
        Tens of megabytes: who keeps a result keeps it `without_images`.
    measured_utc, device_time_s
        Time of the images, and of the first camera's own clock; None when there are none.
    duration_s
        Of the measurement, without the images.
    zero_id
        The zero measurement that corrected the angles; None when there was none.
    axis
        The wheel in the frame of the stand; None where it was not measured, or its place is not known.
    spin
        Run-out and what else a series tells, its angles as measured, without that correction; None of a
        single exposure.
    live
        Follows the spin axis from single exposures after the series; None of a single exposure.
    retaken
        Why its cameras were armed, or its images taken, a second time; None where they were not.
    exposures
        All exposures of a series; None of a single one, and where they were not kept.
    measured_with
        Everything else that it was measured with; None where there are no images.
    """

    wheel: str
    calibration_id: str
    calibration_valid: bool
    measurement: WheelMeasurement | None
    failure: Failure | None
    measured_utc: datetime | None = None
    device_time_s: float | None = None
    duration_s: float | None = None
    zero_id: str | None = None
    shot: WheelShot | None = None
    axis: WheelAxis | None = None
    spin: SpinMeasurement | None = None
    live: LiveSpin | None = None
    retaken: str | None = None
    exposures: tuple[WheelShot, ...] | None = None
    measured_with: MeasuredWith | None = None

    def without_images(self) -> WheelResult:
        """Return the same, to be kept."""
        return replace(self, shot=None, live=None, exposures=None)


class PositionError(TruewheelError):
    """Why a position has nothing to measure."""

    def __init__(self, failure: Failure) -> None:
        super().__init__(failure.text)
        self.failure = failure


def _live(live: LiveSpin, found: WheelMeasurement, shot: WheelShot) -> WheelMeasurement | Refusal:
    axis = live.take(found, shot.frames[0].device_time_s)
    if axis is not None:
        return axis
    return Refusal(
        RefusalCode.INCONSISTENT_SHOTS,
        "where the run-out of the wheel leans to is not known any more; end the adjusting, and measure again",
    )


class WheelPosition:
    """Measures the wheel in front of one rig.

    Parameters
    ----------
    rig
        Its cameras.
    in_force
        Its calibration.
    measure
        `alignment.measure.measure_wheel`, or one like it.
    settings
        Choices of the measurement.
    shoot_timeout_s
        Bound of the waiting for images, seconds.
    clock, now
        Monotonic seconds, and aware UTC time.
    needs_place
        Whether a wheel without a place is refused: the vehicle's own frame cannot be had without it.
    stopped
        Why a measured shot is not to be believed, for what it says of its cameras; None where it is.
    retake_within_s
        Time in which images are taken again once after a camera failed, seconds; 0 takes none again.
    follow
        `alignment.follow.follow_wheel`; None where each shot is measured whole, also while the wheel is
        adjusted.
    """

    def __init__(
        self,
        rig: ShootingRig,
        in_force: CalibrationInForce,
        measure: MeasureFunction,
        settings: MeasureSettings,
        shoot_timeout_s: float,
        clock: Callable[[], float] = time.monotonic,
        now: Callable[[], datetime] = utc_now,
        *,
        needs_place: bool = False,
        retake_within_s: float = 0.0,
        stopped: Callable[[WheelShot, WheelMeasurement], str | None] = lambda shot, found: None,
        follow: FollowFunction | None = None,
    ) -> None:
        self.rig = rig
        self._needs_place = needs_place
        self._stopped = stopped
        self.in_force = in_force
        self._measure, self._follow = measure, follow
        self._settings = settings
        # What follows from the calibration alone is computed once, and goes when this position does.
        self._known_rig = PreparedRig.of(in_force.calibration, settings)
        self._shoot_timeout_s = shoot_timeout_s
        self.clock = clock
        self._now = now
        self._retaking = Retaking(retake_within_s, clock)
        self._arming = Retaking(retake_within_s, clock)

    @property
    def name(self) -> str:
        """Name of the wheel, which is its rig's."""
        return self.rig.name

    @property
    def side(self) -> Side:
        """Side of the vehicle."""
        return self.in_force.calibration.side

    @cached_property
    def steered_rig(self) -> PreparedRig:
        """The rig as prepared for wheels that are steered."""
        return PreparedRig.of(self.in_force.calibration, steered_settings(self._settings))

    def failed(self, failure: Failure) -> WheelResult:
        """Return the result of this wheel when it was not measured."""
        valid = self.in_force.valid_at(self._now())
        return WheelResult(
            self.name, self.in_force.calibration.id, valid, None, failure, retaken=self._retaken()
        )

    def late(self, bound_s: float) -> WheelResult:
        """Return the result of this wheel when its images and angles did not come within the bound."""
        text = f"{self.name}: expected images and angles within {bound_s:g} s"
        return self.failed(fault(ErrorCode.CYCLE_TIMEOUT, text))

    def follower(self) -> Follower | None:
        """What follows the wheel from shot to shot; None where each is measured whole."""
        return None if self._follow is None else Follower(self._follow, self.clock)

    def run(
        self,
        zeros: Sequence[ZeroRecord] = (),
        live: LiveSpin | None = None,
        follower: Follower | None = None,
        *,
        steered: bool = False,
    ) -> WheelResult:
        """Shoot and measure; every failure of a camera or of the measurement becomes part of the result.

        Parameters
        ----------
        zeros
            Zero measurements in force; the one of this rig and calibration corrects the angles.
        live
            Takes the run-out of a series off the tyre plane.
        follower
            Of this position, and of shots that follow each other.
        steered
            Whether the wheel may be steered far from straight ahead, as in a sweep.
        """
        self._retaking.begin()
        try:
            self._check_calibration()
            shot = self._retaking.done(self.rig, self.shoot)
        except PositionError as error:
            return self.failed(error.failure)
        except TruewheelError as error:
            # Its cameras could not be made ready for another attempt.
            return self.failed(fault(ErrorCode.CAMERA_FAULT, str(error)))
        started = self.clock()
        rig = self.steered_rig if steered else self._known_rig
        settings = steered_settings(self._settings) if steered else self._settings
        measure = self._measure if follower is None else follower.measure
        found = measure(shot.images, rig, settings)
        if live is not None and isinstance(found, WheelMeasurement):
            found = _live(live, found, shot)
        return self._result(found, shot, self.clock() - started, zeros, None)

    def run_series(
        self,
        plan: SeriesPlan,
        worker: Worker,
        ended: threading.Event,
        bound_s: float,
        zeros: Sequence[ZeroRecord] = (),
    ) -> WheelResult:
        """As `run`, of a series of exposures of a wheel that turns; see `take_series`."""
        self._retaking.begin()
        try:
            self._check_calibration()
            # One exposure alone cannot be taken again: the wheel turns on, and the count would begin anew.
            taken = self._retaking.done(self.rig, lambda: take_series(self, plan, worker, ended, bound_s))
        except PositionError as error:
            return self.failed(error.failure)
        except SeriesError as error:
            return self.failed(ABORTED if error.code is ErrorCode.NONE else fault(error.code, str(error)))
        except TruewheelError as error:
            if not of_devices(error):
                raise
            # They could not be made ready for another attempt.
            return self.failed(fault(ErrorCode.CAMERA_FAULT, str(error)))
        found = taken.found
        spin = found.spin if isinstance(found, SeriesMeasurement) else None
        wheel = found.wheel if isinstance(found, SeriesMeasurement) else found
        result = self._result(wheel, taken.shot, taken.duration_s, zeros, plan.rules)
        result = replace(result, exposures=taken.exposures)
        return result if result.measurement is None else replace(result, spin=spin, live=taken.live)

    def series(self, rules: SeriesRules) -> SeriesUnderWay:
        """Begin a series of exposures."""
        return SeriesUnderWay(self._known_rig, self._settings, rules, self._measure)

    def arm(self) -> None:
        """Prepare the cameras; those that fail are reached anew once. Raises `TruewheelError`."""
        self._arming.begin()
        self._arming.arm(self.rig)

    def expose(self, timeout_s: float, *, unlit: bool = False) -> WheelShot:
        """Take one exposure, without the projector where asked, again once when a camera failed.

        Raises `TruewheelError`.
        """
        shoot: Callable[[float], WheelShot] = self.rig.shoot
        if unlit:
            shoot = getattr(self.rig, "shoot_unlit", shoot)
        return self._retaking.done(self.rig, lambda: shoot(timeout_s))

    def shoot(self) -> WheelShot:
        """Take one exposure, of this calibration's cameras.

        Raises
        ------
        PositionError
            When a camera fails, or the cameras are others than those of the calibration.
        """
        try:
            shot = self.rig.shoot(self._shoot_timeout_s)
        except TruewheelError as error:
            raise PositionError(fault(ErrorCode.CAMERA_FAULT, str(error))) from error
        try:
            check_shot_matches(shot, self.in_force.calibration)
        except TruewheelError as error:
            raise PositionError(fault(ErrorCode.CALIBRATION_FAULT, f"{self.name}: {error}")) from error
        return shot

    def _retaken(self) -> str | None:
        return together(filter(None, (self._arming.told, self._retaking.told))) or None

    def _check_calibration(self) -> None:
        if self.in_force.valid_at(self._now()):
            return
        text = (
            f"{self.name}: calibration {self.in_force.calibration.id} is valid from "
            f"{self.in_force.created_utc:%Y-%m-%d} to {self.in_force.valid_until_utc:%Y-%m-%d}; calibrate "
            "the rig"
        )
        raise PositionError(fault(ErrorCode.CALIBRATION_FAULT, text))

    def _result(
        self,
        found: WheelMeasurement | Refusal,
        shot: WheelShot,
        duration_s: float,
        zeros: Sequence[ZeroRecord],
        rules: SeriesRules | None,
    ) -> WheelResult:
        zero = self._zero(zeros)
        basis = MeasuredWith(self.in_force, self._settings, self._needs_place, zero, rules)
        measurement, failure = corrected_and_judged(found, self.name, self.side, zero, self._needs_place)
        if measurement is not None and (why := self._stopped(shot, measurement)) is not None:
            measurement, failure = None, fault(ErrorCode.CAMERA_FAULT, f"{self.name}: {why}")
        return WheelResult(
            wheel=self.name,
            calibration_id=self.in_force.calibration.id,
            calibration_valid=True,
            measurement=measurement,
            failure=failure,
            measured_utc=shot.time_utc,
            device_time_s=shot.frames[0].device_time_s,
            duration_s=duration_s,
            zero_id=None if zero is None or measurement is None else zero.id,
            shot=shot,
            retaken=self._retaken(),
            axis=None
            if measurement is None or measurement.reference is None
            else WheelAxis.of(measurement, measurement.reference, self.in_force.calibration),
            measured_with=basis,
        )

    def _zero(self, zeros: Sequence[ZeroRecord]) -> ZeroRecord | None:
        own = self.name, self.in_force.calibration.id
        return next((zero for zero in zeros if (zero.rig, zero.calibration_id) == own), None)


def result_of(future: Future[WheelResult], position: WheelPosition) -> WheelResult:
    """Return the result of a position that ran in a thread; a defect of the program becomes a fault."""
    try:
        return future.result()
    except Exception as error:  # noqa: BLE001
        # A mistake in the program must become a fault that the line is told of, not a silent line.
        _LOG.exception("%s failed", position.name)
        return position.failed(
            fault(ErrorCode.INTERNAL_FAULT, f"{position.name}: {type(error).__name__}: {error}")
        )
