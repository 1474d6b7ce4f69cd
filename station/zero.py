"""Zero measurements: from shots of a master wheel to a record, and from the record to the correction."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from uuid import uuid4

import numpy as np
from numpy.typing import NDArray

from alignment.calibration.prediction import angle_covariance
from alignment.errors import DegenerateInputError
from alignment.measure import measure_wheel
from alignment.measure_spin import measure_spin
from alignment.values import MeasureSettings, Refusal, RigCalibration, Side
from alignment.wheel.zero import ZeroCorrection, zero_correction
from db.records import ZeroRecord
from sensors.formats import read_shot


@dataclass(frozen=True)
class MasterWheel:
    """A wheel whose angles are certified, in the vehicle frame as it stands at the rig, radians.

    `u` is the standard uncertainty of both angles.
    """

    name: str
    camber: float
    toe: float
    u: float = 0.0


def measure_zero(
    shots: Sequence[Path], calibration: RigCalibration, settings: MeasureSettings, master: MasterWheel
) -> ZeroRecord | Refusal:
    """Measure a master wheel: its tyre plane from one shot, or its spin axis from eight or more.

    The covariance leaves the calibration's share out: it is common to the master and to every wheel after it,
    whose own uncertainty counts it.

    Raises
    ------
    FormatError
        When a shot cannot be read.
    DegenerateInputError
        When the certified angles are far from what was measured.
    """
    recorded = [read_shot(shot, calibration) for shot in shots]
    images = [shot.images for shot in recorded]
    found = (
        measure_wheel(images[0], calibration, settings)
        if len(images) == 1
        else measure_spin(images, calibration, settings)
    )
    if isinstance(found, Refusal):
        return found
    off = max(abs(found.camber - master.camber), abs(found.toe - master.toe))
    if off > settings.maximum_angle:
        raise DegenerateInputError(
            field="certified angles",
            expected=f"within {math.degrees(settings.maximum_angle):g}° of the measured camber "
            f"{math.degrees(found.camber):.3f}° and toe {math.degrees(found.toe):.3f}°",
            seen=f"camber {math.degrees(master.camber):.3f}°, toe {math.degrees(master.toe):.3f}°",
        )
    covariance = found.angle_covariance + master.u**2 * np.eye(2)
    if calibration.covariance is not None:
        covariance = covariance - angle_covariance(calibration)
    camber_u, toe_u = (float(u) for u in np.sqrt(np.diag(covariance)))
    return ZeroRecord(
        id=f"zero-{calibration.rig}-{uuid4().hex[:12]}",
        rig=calibration.rig,
        calibration_id=calibration.id,
        measured_utc=max(shot.time_utc for shot in recorded),
        master=master.name,
        method=found.method,
        shots=len(images),
        camber=float(found.camber),
        toe=float(found.toe),
        certified_camber=master.camber,
        certified_toe=master.toe,
        camber_u=camber_u,
        toe_u=toe_u,
        correlation=float(np.clip(covariance[0, 1] / (camber_u * toe_u), -1.0, 1.0)),
        software_version=version("truewheel"),
    )


def correction_of(record: ZeroRecord, side: Side) -> ZeroCorrection:
    """Return the correction that a stored zero measurement stands for."""
    return zero_correction(
        (record.camber, record.toe),
        (record.certified_camber, record.certified_toe),
        _covariance(record),
        side,
    )


def _covariance(record: ZeroRecord) -> NDArray[np.float64]:
    mixed = record.correlation * record.camber_u * record.toe_u
    return np.array([[record.camber_u**2, mixed], [mixed, record.toe_u**2]])
