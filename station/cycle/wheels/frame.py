"""The common frame of a station's rigs, and the vehicle that stands in it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from alignment.errors import DegenerateInputError
from alignment.values import RigCalibration
from alignment.vehicle import (
    FOUR_WHEELS,
    Stand,
    VehicleGeometry,
    WheelAxis,
    placing_covariance,
    vehicle_geometry,
)
from db.records import Reference
from station.configuration import VehicleType
from station.cycle.wheels.positions import WheelResult
from station.cycle.words import Mode


@dataclass(frozen=True)
class CommonFrame:
    """What a station knows of its rigs when all of them stand in one frame.

    Attributes
    ----------
    stand
        Its road, and how well its temperature is known.
    reference
        What individual toe and thrust angle refer to.
    rigs
        Calibration of the rig of each wheel, whose placing says what the rigs share; without them nothing.
    """

    stand: Stand
    reference: Reference
    rigs: Mapping[str, RigCalibration] = field(default_factory=dict)


def frame_for(
    mode: Mode, frame: CommonFrame | None, kind: VehicleType, wheels: tuple[str, ...]
) -> CommonFrame | None:
    """Return the frame as it counts in a mode.

    Master wheels are certified against the stand, one by one. A type with limits of lengths, measured as a
    whole, is a master vehicle or frame, whose certificate is its own: it may stand askew as any vehicle.
    """
    if frame is None or mode is not Mode.MASTER_CHECK:
        return frame
    if kind.lengths.stated and whole_vehicle(wheels):
        return frame
    return replace(frame, reference="stand")


def tells_toe(frame: CommonFrame | None, wheels: tuple[str, ...]) -> bool:
    """Whether these wheels have toes of their own: part of a vehicle has no centreline."""
    return frame is None or frame.reference == "stand" or whole_vehicle(wheels)


def whole_vehicle(wheels: Mapping[str, WheelResult] | tuple[str, ...]) -> bool:
    """Whether these are the four wheels of a vehicle."""
    return set(FOUR_WHEELS) <= set(wheels)


def geometry_of(
    frame: CommonFrame | None, kind: VehicleType, results: Mapping[str, WheelResult], coverage_factor: float
) -> tuple[VehicleGeometry | None, str | None]:
    """Return the vehicle in its own frame, and why there is none where the wheels make no vehicle.

    Both are None where the rigs stand in no common frame, or a wheel was not asked for or not measured.
    """
    if frame is None or not whole_vehicle(results):
        return None, None
    axes: dict[str, WheelAxis] = {
        name: axis for name in FOUR_WHEELS if (axis := results[name].axis) is not None
    }
    placeless = [name for name in FOUR_WHEELS if results[name].measurement is not None and name not in axes]
    if placeless:
        return None, (
            f"expected the places of all four wheels, found none of {', '.join(placeless)}: the outermost "
            "ring of the sidewall was not seen; check that the heads see the widest part of the tyre"
        )
    if len(axes) < len(FOUR_WHEELS):
        return None, None
    try:
        geometry = vehicle_geometry(
            axes,
            frame.stand,
            kind.tyre_widths(),
            common=placing_covariance(axes, frame.rigs) if frame.rigs else None,
            thrust_sign=kind.thrust_sign,
            coverage_factor=coverage_factor,
        )
    except DegenerateInputError as error:
        return None, str(error)
    return geometry, None
