"""Zero measurements of all rigs at once, against a master vehicle: certified angles and lengths of its own.

Its toes are certified against its own centreline, and it may stand askew: where its wheels are, which no
angle of a rig changes much, tells its yaw, and with it what each rig should have seen.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

from pydantic import Field, model_validator

from alignment.believable import LARGEST_LENGTH_SHIFT_MM
from alignment.errors import ConfigurationError, Deed, DegenerateInputError, Remedy
from alignment.values import RigCalibration
from alignment.vehicle import FOUR_WHEELS, VehicleGeometry
from db.records import ZeroRecord
from sensors.formats import StrictModel
from station.calibration.master import MasterWheel
from station.calibration.zero import LARGEST_ZERO, SeenMaster, zero_of
from station.configuration import read_toml

_Degrees = Annotated[float, Field(ge=-10, le=10)]
_Length = Annotated[float, Field(ge=500, le=10_000)]


class CertifiedWheel(StrictModel):
    """Certified angles of one wheel."""

    camber_deg: _Degrees = Field(description="Against the road, degrees")
    toe_deg: _Degrees = Field(description="Against the vehicle's centreline, degrees")


class CertifiedLengths(StrictModel):
    """Certified lengths; what is left out is not compared."""

    wheelbase_left: _Length | None = Field(default=None, description="Millimetres")
    wheelbase_right: _Length | None = Field(default=None, description="Millimetres")
    track_front: _Length | None = Field(default=None, description="Millimetres")
    track_rear: _Length | None = Field(default=None, description="Millimetres")
    sidewall_track_front: _Length | None = Field(default=None, description="Between sidewalls, millimetres")
    sidewall_track_rear: _Length | None = Field(default=None, description="Between sidewalls, millimetres")


class MasterVehicle(StrictModel):
    """The certificate of a master vehicle, or of a frame that stands for one."""

    name: str = Field(min_length=1, max_length=80, description="Name of the master vehicle")
    u95_deg: float = Field(default=0.0, ge=0, le=1, description="Expanded uncertainty (k = 2) of all angles")
    u95_mm: float = Field(default=0.0, ge=0, le=10, description="Expanded uncertainty (k = 2) of all lengths")
    wheels: dict[str, CertifiedWheel] = Field(description="By the name of the wheel, all four")
    lengths_mm: CertifiedLengths = Field(default=CertifiedLengths(), description="Certified lengths")

    @model_validator(mode="after")
    def _has_four_wheels(self) -> MasterVehicle:
        if set(self.wheels) != set(FOUR_WHEELS):
            raise DegenerateInputError(
                field="wheels", expected=", ".join(FOUR_WHEELS), seen=", ".join(self.wheels) or "none"
            )
        return self


@dataclass(frozen=True)
class LengthFound:
    """A certified length as it was measured, millimetres; `u95` is of their difference."""

    name: str
    value: float
    certified: float
    u95: float


def read_master_vehicle(path: Path) -> MasterVehicle:
    """Read a certificate; errors as `station.configuration.read_toml`."""
    return read_toml(MasterVehicle, path, "the certificate of a master vehicle")


def lengths_found(master: MasterVehicle, geometry: VehicleGeometry) -> tuple[LengthFound, ...]:
    """Compare what is certified of lengths with what was measured."""
    certified = {name: getattr(master.lengths_mm, name) for name in type(master.lengths_mm).model_fields}
    return tuple(
        LengthFound(name, geometry.value(name), value, math.hypot(geometry.u95(name), master.u95_mm))
        for name, value in certified.items()
        if value is not None
    )


def vehicle_zeros(
    seen: Mapping[str, tuple[SeenMaster, RigCalibration]],
    geometry: VehicleGeometry,
    master: MasterVehicle,
    maximum_angle: float,
    largest: float = LARGEST_ZERO,
    forced_reason: str | None = None,
) -> tuple[ZeroRecord, ...]:
    """Return the zero measurements of all four rigs.

    Parameters
    ----------
    seen
        By wheel: the master's wheel as its rig measured it, and the calibration of the rig.
    geometry
        What the places of its wheels say: its yaw and lengths.
    master
        Its certificate.
    maximum_angle
        Largest believable angle of a wheel, radians.
    largest, forced_reason
        As `station.calibration.zero.measure_zero` takes them; a length that is off by more than what is
        believed needs a reason too.

    Raises
    ------
    ConfigurationError
        When an angle or a length is farther from its certificate than what is believed, and is not forced.
    DegenerateInputError
        When an angle is farther off than any wheel can be.
    """
    far = [
        found
        for found in lengths_found(master, geometry)
        if abs(found.value - found.certified) > LARGEST_LENGTH_SHIFT_MM
    ]
    if far and forced_reason is None:
        raise ConfigurationError(
            field="lengths_mm",
            expected=f"certified lengths within {LARGEST_LENGTH_SHIFT_MM:g} mm of the measured ones",
            seen=", ".join(
                f"{each.name} {each.certified:g}, measured {each.value:.3f} ± {each.u95:.3f}" for each in far
            ),
            cure="Check certificate and tyre widths, or place the rigs anew with the gauge frame",
            remedy=Remedy(Deed.FORCE),
        )
    yaw, yaw_u = geometry.value("yaw"), geometry.u("yaw")
    records = []
    for name in FOUR_WHEELS:
        one, calibration = seen[name]
        certified = master.wheels[name]
        # A vehicle that has turned to the left shows the stand less toe on the left.
        turned = -yaw if name.endswith("left") else yaw
        wheel = MasterWheel(
            math.radians(certified.camber_deg),
            math.radians(certified.toe_deg) + turned,
            math.hypot(math.radians(master.u95_deg) / 2.0, yaw_u),
            f"{master.name}, {name.replace('_', ' ')}",
        )
        record = zero_of(one, calibration, maximum_angle, wheel, largest, forced_reason)
        records.append(replace(record, forced_reason=forced_reason) if far else record)
    return tuple(records)
