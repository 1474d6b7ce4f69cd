"""The spin axis of one wheel from images: the tyre plane of each shot, then the cone of their normals."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from hashlib import blake2b

import numpy as np

from alignment.measure import measure_wheel
from alignment.prepared import PreparedRig
from alignment.values import (
    MeasureSettings,
    Refusal,
    RefusalCode,
    RigCalibration,
    StereoImages,
    WheelMeasurement,
)
from alignment.wheel.spin import SpinMeasurement, fit_spin_axis


def measure_spin(
    shots: Iterable[Sequence[StereoImages]],
    calibration: RigCalibration | PreparedRig,
    settings: MeasureSettings,
    shot_done: Callable[[WheelMeasurement], None] = lambda _: None,
) -> SpinMeasurement | Refusal:
    """Measure the spin axis of a wheel that was turned between the shots, free of run-out.

    Parameters
    ----------
    shots
        At least eight, over a full turn if possible, at least over 120°; images as `measure_wheel` takes
        them. Each is let go once measured, so a generator keeps one in memory.
    calibration, settings
        As `measure_wheel` takes them; a plain calibration is prepared once for all shots.
    shot_done
        Given the tyre plane of each shot.

    Returns
    -------
    SpinMeasurement or Refusal
        The refusal of a single shot names it: a wheel that is seen only now and then is not guessed at.
        Otherwise as `fit_spin_axis`.
    """
    rig = PreparedRig.of(calibration, settings)
    measurements = []
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
    return fit_spin_axis(measurements, rig.calibration.side, rig.angle_covariance)


def _digest(images: Sequence[StereoImages]) -> bytes:
    content = blake2b(digest_size=16)
    for pair in images:
        for image in (pair.left, pair.right):
            content.update(np.ascontiguousarray(image).tobytes())
    return content.digest()
