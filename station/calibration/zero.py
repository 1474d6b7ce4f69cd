"""Zero measurements: from shots of a master wheel to a record, and from the record to the correction."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from importlib.metadata import version
from pathlib import Path
from uuid import uuid4

import numpy as np

from alignment.arrays import Array
from alignment.believable import LARGEST_SHIFT, certificate_slip
from alignment.errors import ConfigurationError, Deed, DegenerateInputError, Remedy
from alignment.measure import measure_wheel
from alignment.measure_spin import measure_spin
from alignment.prepared import PreparedRig
from alignment.units import in_arcminutes
from alignment.values import MeasureSettings, Refusal, RigCalibration, WheelMeasurement
from alignment.wheel import SpinMeasurement
from db.records import ZeroRecord
from sensors.formats import read_shot
from station.calibration.master import MasterWheel

LARGEST_ZERO = LARGEST_SHIFT
"""Largest zero value that is believed unless the station says otherwise, radians."""


def measure_zero(
    shots: Sequence[Path],
    calibration: RigCalibration,
    settings: MeasureSettings,
    master: MasterWheel,
    largest: float = LARGEST_ZERO,
    forced_reason: str | None = None,
) -> ZeroRecord | Refusal:
    """Measure a master wheel: its tyre plane from one shot, or its spin axis from eight or more.

    The covariance leaves the calibration's share out: it is common to the master and to every wheel after it,
    whose own uncertainty counts it.

    Parameters
    ----------
    shots
        Folders.
    calibration, settings
        Of the rig, and of the measurement.
    master
        What is certified.
    largest
        Largest believable zero value, measured less certified, of each angle, radians.
    forced_reason
        Why a larger one shall count all the same; recorded where it is larger. None to refuse it.

    Raises
    ------
    FormatError
        When a shot cannot be read.
    ConfigurationError
        When a zero value, or the certificate's uncertainty, is larger than what is believed.
    DegenerateInputError
        When the certified angles are farther from what was measured than any wheel can be, forced or not.
    """
    if 2.0 * master.u > largest and forced_reason is None:
        raise ConfigurationError(
            choice="certified u95",
            expected="an expanded uncertainty below the largest believable zero value, "
            f"{in_arcminutes(largest)}",
            seen=in_arcminutes(2.0 * master.u),
            cure="Check the unit in the certificate: degrees are asked for",
        )
    recorded = [read_shot(shot, calibration) for shot in shots]
    images = [shot.images for shot in recorded]
    rig = PreparedRig.of(calibration, settings)
    found = (
        measure_wheel(images[0], rig, settings) if len(images) == 1 else measure_spin(images, rig, settings)
    )
    if isinstance(found, Refusal):
        return found
    seen = SeenMaster(found, len(images), max(shot.time_utc for shot in recorded), rig.angle_covariance)
    return zero_of(seen, calibration, settings.maximum_angle, master, largest, forced_reason)


@dataclass(frozen=True, eq=False)
class SeenMaster:
    """A master wheel as it was measured.

    Attributes
    ----------
    found
        Its tyre plane, or its spin axis.
    shots, measured_utc
        Of how many shots, and when the last was taken.
    common
        (2, 2) covariance of camber and toe that the calibration makes, radians²; None where it is not known.
    """

    found: WheelMeasurement | SpinMeasurement
    shots: int
    measured_utc: datetime
    common: Array | None


def zero_of(
    seen: SeenMaster,
    calibration: RigCalibration,
    maximum_angle: float,
    master: MasterWheel,
    largest: float = LARGEST_ZERO,
    forced_reason: str | None = None,
) -> ZeroRecord:
    """Return the zero measurement that a measured master wheel makes; errors as `measure_zero`."""
    found = seen.found
    off = max(abs(found.camber - master.camber), abs(found.toe - master.toe))
    if off > maximum_angle:
        raise DegenerateInputError(
            field="certified angles",
            expected=f"within {math.degrees(maximum_angle):g}° of the measured camber "
            f"{math.degrees(found.camber):.3f}° and toe {math.degrees(found.toe):.3f}°",
            seen=f"camber {math.degrees(master.camber):.3f}°, toe {math.degrees(master.toe):.3f}°",
        )
    believed = off <= largest and 2.0 * master.u <= largest
    if off > largest and forced_reason is None:
        raise _unbelievable((found.camber, found.toe), master, largest)
    covariance = found.angle_covariance + master.u**2 * np.eye(2)
    if seen.common is not None:
        covariance = covariance - seen.common
    camber_u, toe_u = (float(u) for u in np.sqrt(np.diag(covariance)))
    return ZeroRecord(
        id=f"zero-{calibration.rig}-{uuid4().hex[:12]}",
        rig=calibration.rig,
        calibration_id=calibration.id,
        measured_utc=seen.measured_utc,
        master=master.name,
        method=found.method,
        shots=seen.shots,
        camber=float(found.camber),
        toe=float(found.toe),
        certified_camber=master.camber,
        certified_toe=master.toe,
        camber_u=camber_u,
        toe_u=toe_u,
        correlation=float(np.clip(covariance[0, 1] / (camber_u * toe_u), -1.0, 1.0)),
        software_version=version("truewheel"),
        forced_reason=None if believed else forced_reason,
    )


def _unbelievable(measured: tuple[float, float], master: MasterWheel, largest: float) -> ConfigurationError:
    """Say by how much the master is off its certificate, and which slip of the pen would explain it."""
    slip = certificate_slip(measured, (master.camber, master.toe), (largest, largest))
    cure = (
        "Check master wheel, certificate and calibration"
        if slip is None
        else f"It would fit with {slip}: check the certificate"
    )
    seen = [
        f"{name} {math.degrees(certified):.3f}°, {in_arcminutes(found - certified, '+')} off"
        for name, found, certified in zip(
            ("camber", "toe"), measured, (master.camber, master.toe), strict=True
        )
    ]
    return ConfigurationError(
        choice="camber, toe",
        expected=f"certified angles within {in_arcminutes(largest)} of the measured camber "
        f"{math.degrees(measured[0]):.3f}° and toe {math.degrees(measured[1]):.3f}°",
        seen=f"{', '.join(seen)}, of '{master.name}'",
        cure=cure,
        remedy=Remedy(Deed.FORCE),
    )
