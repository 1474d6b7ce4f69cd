"""Which starts a station serves, and why it declines the others."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from station.configuration import VehicleType
from station.cycle.judging import STEERED, axle_of
from station.cycle.wheels import CommonFrame, frame_for, tells_toe
from station.cycle.words import ErrorCode, Mode, Prepare, StationState, Trigger


def why_declined(
    asked: Trigger | Prepare,
    state: StationState,
    wheels: Collection[str],
    vehicle_types: Mapping[int, VehicleType],
    frame: CommonFrame | None,
    *,
    images: bool,
) -> ErrorCode | None:
    """Why a start or a preparation cannot be served, if it cannot.

    Parameters
    ----------
    asked
        With its wheels, vehicle type and mode.
    state
        Of the cycle.
    wheels
        That have a rig.
    vehicle_types
        By number.
    frame
        Common frame of the rigs.
    images
        Whether there is a folder for images of the mode calibrate.
    """
    if state is not StationState.IDLE:
        return ErrorCode.RESET_REQUIRED
    if asked.mode is Mode.CALIBRATE:
        known = images and set(asked.wheels) <= set(wheels)
        return None if known else ErrorCode.MODE_NOT_AVAILABLE
    kind = vehicle_types.get(asked.vehicle_type)
    if kind is None:
        return ErrorCode.UNKNOWN_VEHICLE_TYPE
    if asked.mode is Mode.SWEEP and kind.sweep is None:
        return ErrorCode.MODE_NOT_AVAILABLE
    known = all(wheel in wheels and axle_of(wheel) in kind.axles for wheel in asked.wheels)
    if asked.mode is Mode.SWEEP and not STEERED.keys() & set(asked.wheels):
        return ErrorCode.WHEEL_NOT_AVAILABLE
    if known and tells_toe(frame_for(asked.mode, frame, kind, asked.wheels), asked.wheels):
        return None
    return ErrorCode.WHEEL_NOT_AVAILABLE
