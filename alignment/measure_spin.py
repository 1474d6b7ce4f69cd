"""The spin axis of one wheel from images: the tyre plane of each shot, then the cone of their normals."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from hashlib import blake2b

import numpy as np

from alignment.arrays import Array, Singles
from alignment.calibration.judgement import Judgement
from alignment.measure import measure_wheel
from alignment.measure_heads import HeadSigns, judged_together
from alignment.prepared import PreparedRig
from alignment.refusals import warning
from alignment.values import (
    MeasureSettings,
    Refusal,
    RefusalCode,
    RigCalibration,
    StereoImages,
    WheelMeasurement,
)
from alignment.vehicle.angles import normal_from_angles
from alignment.wheel.reference import spin_reference
from alignment.wheel.series import SeriesRules, fit_series, fit_turning_axis, miscounted
from alignment.wheel.spin import SpinMeasurement, fit_spin_axis
from alignment.wheel.turned import has_turned, look_of

MeasureOne = Callable[[Sequence[StereoImages], PreparedRig, MeasureSettings], WheelMeasurement | Refusal]
_ROWS = 16  # of an image, of which one is compared
_TRUE_TO_NOISE = 1.5  # scatter about a standing axis, in the noise of one shot, that needs no wander


@dataclass(frozen=True, eq=False)
class SeriesMeasurement:
    """What came of a series of exposures.

    Attributes
    ----------
    spin
        The spin axis, run-out and what belongs to them.
    wheel
        The same wheel as a single exposure gives it, with the angles of the spin axis: for limits, zero
        measurements and records. Its method is ``spin_axis``; its quality is the worst of the exposures.
    """

    spin: SpinMeasurement
    wheel: WheelMeasurement


class SeriesUnderWay:
    """Measures exposures one by one while the next are taken, and the spin axis at their end.

    It keeps what is measured, never an image. One thread at a time.

    Parameters
    ----------
    rig
        Prepared.
    settings
        Of each measurement.
    rules
        What the series must be.
    measure
        `measure_wheel`, or one like it.
    """

    def __init__(
        self,
        rig: PreparedRig,
        settings: MeasureSettings,
        rules: SeriesRules,
        measure: MeasureOne = measure_wheel,
    ) -> None:
        self._rig, self._settings, self._rules, self._measure = rig, series_settings(settings), rules, measure
        self._seen: dict[bytes, int] = {}
        self._numbers: list[int] = []
        self._found: list[WheelMeasurement] = []
        self._looks: list[Singles] = []

    def take(self, number: int, images: Sequence[StereoImages]) -> Refusal | None:
        """Measure the next exposure; the refusal that ends the series, if it does."""
        if len(self._numbers) >= self._rules.exposures:
            return miscounted([*self._numbers, number], self._rules.exposures)
        first = self._seen.setdefault(_digest(images), number)
        if first != number:
            return Refusal(
                RefusalCode.EXPOSURE_DOUBLED,
                f"exposures {first} and {number} are the same images; check the trigger of the cameras, and "
                "measure again",
            )
        found = self._measure(images, self._rig, self._settings)
        if isinstance(found, Refusal):
            return replace(found, reason=f"exposure {number}: {found.reason}")
        self._numbers.append(number)
        self._found.append(found)
        self._looks.append(look_of(images))
        return None

    @property
    def last(self) -> WheelMeasurement:
        """The exposure measured last; IndexError before the first."""
        return self._found[-1]

    def result(self) -> SeriesMeasurement | Refusal:
        """Return the spin axis of what was taken; a refusal as `fit_series`, or of a head that moved."""
        judged = heads_judged(self._found, self._rig)
        if isinstance(judged, Refusal):
            return judged
        spin = fit_series(
            self._found,
            self._rig.calibration.side,
            self._rules,
            None if self._rig.calibration.covariance is None else self._rig.angle_covariance,
            self._numbers,
            lambda: has_turned(self._looks),
            _heads_at(self._rig),
        )
        if isinstance(spin, Refusal):
            return spin
        spin = _with_judgement(spin, judged)
        wheel = as_wheel(spin, self._found, self._rig)
        if judged is not None and judged.suspected:
            wheel = replace(wheel, warning=warning(judged, self._rig))
        return SeriesMeasurement(spin, wheel)


def series_settings(settings: MeasureSettings) -> MeasureSettings:
    """Settings of exposures whose heads are judged together; each alone where a head may be left out."""
    return replace(settings, judge_heads=settings.allow_lost_head)


def heads_judged(exposures: Sequence[WheelMeasurement], rig: PreparedRig) -> Judgement | Refusal | None:
    """Judge the heads by all exposures where one alone would be refused; None where none would."""
    signs = [m.signs for m in exposures if isinstance(m.signs, HeadSigns)]
    if all(one.refusal is None for one in signs):
        return None
    judged = judged_together(signs, rig)
    if isinstance(judged, Refusal):
        return replace(judged, reason=f"all exposures together: {judged.reason}")
    return judged


def _with_judgement(spin: SpinMeasurement, judged: Judgement | None) -> SpinMeasurement:
    if judged is None:
        return spin
    return replace(spin, angle_covariance=spin.angle_covariance + judged.covariance)


def _heads_at(rig: PreparedRig) -> Array:
    """(H,) polar angles of the heads, counted as phases: from the top, counter-clockwise from outboard."""
    places = [
        np.mean([camera.rig_from_camera.translation for camera in head.cameras], axis=0) for head in rig.heads
    ]
    out: Array = np.array([np.arctan2(-place[0], place[1]) for place in places])
    return out


def as_wheel(
    spin: SpinMeasurement, exposures: Sequence[WheelMeasurement], rig: PreparedRig
) -> WheelMeasurement:
    """Return a spin axis as the measurement of a wheel, with the worst quality of its exposures."""
    last, calibration = exposures[-1], rig.calibration
    vehicle = normal_from_angles(spin.camber, spin.toe, calibration.side)
    normal: Array = calibration.vehicle_from_rig.rotation.T @ vehicle
    centre = np.mean([m.centre for m in exposures], axis=0)
    evidence = [m.knock_evidence for m in exposures if m.knock_evidence is not None]
    unseen = [m.unseen for m in exposures if m.unseen is not None]
    lifts = [m.load_mm for m in exposures if m.load_mm is not None]
    return replace(
        last,
        camber=spin.camber,
        toe=spin.toe,
        angle_covariance=spin.angle_covariance,
        normal=normal,
        centre=centre,
        offset_mm=float(centre @ normal),
        points_used=sum(m.points_used for m in exposures),
        residual_rms_mm=max(m.residual_rms_mm for m in exposures),
        method=spin.method,
        degraded=spin.degraded,
        knock_evidence=max(evidence, default=None),
        warning=next((m.warning for m in exposures if m.warning is not None), None),
        unseen=None if not unseen else (max(u[0] for u in unseen), max(u[1] for u in unseen)),
        load_mm=max(lifts, default=None),
        signs=None,
        reference=spin_reference(exposures, spin, rig.axis_covariance),
    )


def measure_spin(
    shots: Iterable[Sequence[StereoImages]],
    calibration: RigCalibration | PreparedRig,
    settings: MeasureSettings,
    shot_done: Callable[[WheelMeasurement], None] = lambda _: None,
    numbers: Sequence[int] | None = None,
) -> SpinMeasurement | Refusal:
    """Measure the spin axis of a wheel that was turned between the shots, free of run-out.

    Parameters
    ----------
    shots
        At least eight, over a full turn if possible, at least over 120°; images as `measure_wheel` takes
        them. Each is let go once measured, so a generator keeps one in memory. Of twelve or more, in the
        order in which they were taken, a slow wander of the wheel is told from its run-out.
    calibration, settings
        As `measure_wheel` takes them; a plain calibration is prepared once for all shots.
    shot_done
        Given the tyre plane of each shot.
    numbers
        Of the shots, where they are the exposures of one series; one missing or doubled refuses it.

    Returns
    -------
    SpinMeasurement or Refusal
        The refusal of a single shot names it: a wheel that is seen only now and then is not guessed at.
        Otherwise as `fit_spin_axis`.
    """
    if numbers is not None and (wrong := miscounted(numbers, len(numbers))) is not None:
        return wrong
    rig = PreparedRig.of(calibration, settings)
    measurements = []
    settings = series_settings(settings)
    seen: dict[bytes, int] = {}
    for number, images in enumerate(shots, start=1):
        first = seen.setdefault(_digest(images), number)
        if first != number:
            return Refusal(
                RefusalCode.WRONG_IMAGES,
                f"shots {first} and {number} are the same images; give each shot of the turning wheel once",
            )
        found = measure_wheel(images, rig, settings)
        if isinstance(found, Refusal):
            return replace(found, reason=f"shot {number}: {found.reason}")
        measurements.append(found)
        shot_done(found)
    return spin_of_shots(measurements, rig)


def spin_of_shots(measurements: Sequence[WheelMeasurement], rig: PreparedRig) -> SpinMeasurement | Refusal:
    """Return the spin axis of tyre planes; a wandering one only where a standing one explains too little."""
    side, common = rig.calibration.side, rig.angle_covariance
    judged = heads_judged(measurements, rig)
    if isinstance(judged, Refusal):
        return judged
    found = fit_spin_axis(measurements, side, common)
    if isinstance(found, SpinMeasurement) and all(found.used) and found.scatter is not None:
        own = [m.angle_covariance - (0.0 if common is None else common) for m in measurements]
        noise = np.sqrt(np.median([np.trace(c) for c in own]) / 2.0)
        if found.scatter <= _TRUE_TO_NOISE * noise:
            return found
    turning = fit_turning_axis(measurements, side, common, _heads_at(rig)) or found
    return _with_judgement(turning, judged) if isinstance(turning, SpinMeasurement) else turning


def _digest(images: Sequence[StereoImages]) -> bytes:
    content = blake2b(digest_size=16)
    for pair in images:
        for image in (pair.left, pair.right):
            # Noise alone tells two exposures apart in any of their rows.
            content.update(np.ascontiguousarray(image[::_ROWS]).tobytes())
    return content.digest()
