"""The zero measurement in force, as the correction of a wheel's angles."""

from __future__ import annotations

import numpy as np

from alignment.arrays import Array
from alignment.values import Side
from alignment.wheel import ZeroCorrection, zero_correction
from db.records import ZeroRecord


def correction_of(record: ZeroRecord, side: Side) -> ZeroCorrection:
    """Return the correction that a stored zero measurement stands for."""
    return zero_correction(
        (record.camber, record.toe),
        (record.certified_camber, record.certified_toe),
        _covariance(record),
        side,
    )


def _covariance(record: ZeroRecord) -> Array:
    mixed = record.correlation * record.camber_u * record.toe_u
    return np.array([[record.camber_u**2, mixed], [mixed, record.toe_u**2]])
