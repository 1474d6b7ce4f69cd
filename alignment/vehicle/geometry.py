"""A vehicle in a frame of its own: angles against its own centreline, its lengths, its place on the stand.

X of that frame is the geometric centreline, from the middle of the rear axle to that of the front one; Z is
the normal of the wheel supports, which the gauge frame gave to the stand. The four axes say nothing of Z:
they give yaw and place alone.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from alignment.arrays import Array
from alignment.errors import DegenerateInputError
from alignment.values import SIDES
from alignment.vehicle.axles import AxleAngles, EndPoints, ThrustSign, VehicleAngles
from alignment.vehicle.quantities import Scalar, VehicleState, of_axles, of_four_wheels
from alignment.vehicle.wheel_axes import AXIS_SIZE, FOUR_WHEELS, FRONT, REAR, Stand, TyreWidths, WheelAxis

MEASURED, TEMPERATURE, TYRE_WIDTH = "measured", "temperature", "tyre_width"
COMPONENTS = (MEASURED, TEMPERATURE, TYRE_WIDTH)
"""Parts of every covariance: wheels and rigs as measured; the stand's temperature; spread of tyre widths."""
LENGTHS = (
    "wheelbase_left",
    "wheelbase_right",
    "wheelbase_difference",
    "track_front",
    "track_rear",
    "sidewall_track_front",
    "sidewall_track_rear",
    "setback_front",
    "setback_rear",
    "axle_offset",
    "offset_front",
    "offset_rear",
    "place_x",
    "place_y",
)
"""Quantities in millimetres; all others are angles."""


@dataclass(frozen=True, eq=False)
class VehicleGeometry:
    """Everything that the axes of a vehicle's wheels say, with its joint covariance.

    Angles are in radians, lengths in millimetres. `names` of a vehicle with four wheels:

    - ``front_left.camber``, ``front_left.toe``, …: camber against the road plane, toe against the centreline;
    - ``front_left.toe_to_thrust``, ``front_right.toe_to_thrust``: toe against the thrust line;
    - ``front.total_toe``, ``front.camber_difference``, …; ``thrust_angle`` (against the centreline); ``yaw``;
    - the `LENGTHS`.

    Two wheels of one axle give their cambers, total toe and camber difference.

    Attributes
    ----------
    names
        Of the N quantities.
    values
        (N,) of them.
    parts
        (N, N) covariance by each of the `COMPONENTS`; they are independent of each other.
    between
        Between what wheelbase, track and setback are measured; None where there are none.
    thrust_sign
        Which side a positive thrust angle points to.
    coverage_factor
        k of the expanded uncertainties.
    missing
        Wheels without which the other quantities are not known; empty when all are.
    """

    names: tuple[str, ...]
    values: Array
    parts: Mapping[str, Array]
    between: EndPoints | None
    thrust_sign: ThrustSign = "left_positive"
    coverage_factor: float = 2.0
    missing: tuple[str, ...] = ()

    def __contains__(self, name: str) -> bool:
        return name in self.names

    @property
    def covariance(self) -> Array:
        """(N, N) joint covariance of all quantities."""
        out: Array = np.sum(list(self.parts.values()), axis=0)
        return out

    def value(self, name: str) -> float:
        """One quantity, radians or millimetres; KeyError for one that is not known."""
        return float(self.values[self._place(name)])

    def u(self, name: str) -> float:
        """Its standard uncertainty."""
        return math.sqrt(self._variance(name))

    def u_of(self, weights: Mapping[str, float]) -> float:
        """Standard uncertainty of a sum of quantities, each with a weight, in their unit."""
        by_quantity = np.zeros(len(self.names))
        for name, weight in weights.items():
            by_quantity[self._place(name)] = weight
        return math.sqrt(max(float(by_quantity @ self.covariance @ by_quantity), 0.0))

    def u95(self, name: str) -> float:
        """Its expanded uncertainty."""
        return self.coverage_factor * self.u(name)

    def share(self, name: str, component: str) -> float:
        """Part of its variance that comes from one of the `COMPONENTS`, 0 to 1."""
        k = self._place(name)
        whole = self._variance(name)
        return float(self.parts[component][k, k]) / whole if whole > 0.0 else 0.0

    @property
    def angles(self) -> VehicleAngles:
        """Angles of axles and vehicle, as the stand's own way gives them; of four wheels."""
        left, right = (f"{FRONT}_{side}.toe_to_thrust" for side in SIDES)
        return VehicleAngles(
            front=self.axle(FRONT),
            rear=self.axle(REAR),
            thrust_angle=self.value("thrust_angle"),
            thrust_angle_u=self.u("thrust_angle"),
            thrust_sign=self.thrust_sign,
            front_toe_left_to_thrust=self.value(left),
            front_toe_right_to_thrust=self.value(right),
        )

    def axle(self, axle: str) -> AxleAngles:
        """Angles of one axle of which both wheels are known."""
        total_toe, difference = f"{axle}.total_toe", f"{axle}.camber_difference"
        return AxleAngles(
            self.value(total_toe), self.value(difference), self.u(total_toe), self.u(difference)
        )

    def _place(self, name: str) -> int:
        if name not in self.names:
            raise KeyError(name)
        return self.names.index(name)

    def _variance(self, name: str) -> float:
        k = self._place(name)
        # Rounding may leave a variance of nothing below zero.
        return max(float(sum(part[k, k] for part in self.parts.values())), 0.0)


def vehicle_geometry(
    wheels: Mapping[str, WheelAxis],
    stand: Stand | None = None,
    tyres: TyreWidths | None = None,
    *,
    common: Array | None = None,
    thrust_sign: ThrustSign = "left_positive",
    coverage_factor: float = 2.0,
) -> VehicleGeometry:
    """Return what the axes of a vehicle's wheels say.

    Parameters
    ----------
    wheels
        By name, of `FOUR_WHEELS`: all four, or at least one whole axle.
    stand
        Height of the wheel supports, and how well its temperature is known.
    tyres
        Widths. Where those of both axles are stated, lengths are measured between wheel centres, and where
        the stand's road is known too between contact centres (ISO 8855: wheel plane, the vertical plane of
        the spin axis, and road). Otherwise between the outermost rings of the sidewalls. The spread counts
        in all cases: the centreline runs through the middles of wheels whose tyres are not all alike.
    common
        (5 N, 5 N) covariance that the rigs of the N wheels share, such as that of the gauge frame, in the
        order of `FOUR_WHEELS`; it is added to the wheels' own.
    thrust_sign
        Which side a positive thrust angle points to.
    coverage_factor
        k of the expanded uncertainties.

    Raises
    ------
    DegenerateInputError
        When no axle is whole, a name is unknown or on the other side, or the wheels do not stand as those of
        a vehicle: front before rear by half a metre, left to the left of right, yaw below 10°.
    """
    stand, tyres = stand or Stand(), tyres or TyreWidths()
    names = _known(wheels)
    state = VehicleState(names, [wheels[name] for name in names], tyres)
    between: EndPoints | None = None
    rows: dict[str, Scalar] = {}
    if names == FOUR_WHEELS:
        between, rows = of_four_wheels(state, stand, tyres, thrust_sign)
    else:
        rows = {f"{name}.camber": state.camber(name) for name in names} | of_axles(state)
    by_state = np.array([row.by_state for row in rows.values()])
    axes = AXIS_SIZE * len(names)
    measured = np.zeros((axes, axes)) if common is None else np.array(common, dtype=np.float64)
    if measured.shape != (axes, axes):
        raise DegenerateInputError(
            field="common", expected=f"a {axes} × {axes} matrix", seen=f"shape {measured.shape}"
        )
    for k, name in enumerate(names):
        own = slice(AXIS_SIZE * k, AXIS_SIZE * (k + 1))
        measured[own, own] += wheels[name].covariance
    points = np.array([wheels[name].point for name in names])
    heat = stand.covariance(points, tuple(wheels[name].side for name in names))
    of_axes, of_widths = by_state[:, :axes], by_state[:, axes:]
    parts = {
        MEASURED: of_axes @ measured @ of_axes.T,
        TEMPERATURE: of_axes @ heat @ of_axes.T,
        TYRE_WIDTH: tyres.sigma_mm**2 * of_widths @ of_widths.T,
    }
    return VehicleGeometry(
        names=tuple(rows),
        values=np.array([row.value for row in rows.values()]),
        parts=MappingProxyType(parts),
        between=between,
        thrust_sign=thrust_sign,
        coverage_factor=coverage_factor,
        missing=tuple(name for name in FOUR_WHEELS if name not in names),
    )


def _known(wheels: Mapping[str, WheelAxis]) -> tuple[str, ...]:
    for name, wheel in wheels.items():
        if name not in FOUR_WHEELS or not name.endswith(wheel.side):
            raise DegenerateInputError(
                field="wheels",
                expected=f"wheels of {', '.join(FOUR_WHEELS)}, on their sides",
                seen=f"'{name}' on the {wheel.side}",
            )
    names = tuple(name for name in FOUR_WHEELS if name in wheels)
    if not any(all(f"{axle}_{side}" in names for side in SIDES) for axle in (FRONT, REAR)):
        raise DegenerateInputError(
            field="wheels", expected="both wheels of an axle", seen=", ".join(names) or "none"
        )
    return names
