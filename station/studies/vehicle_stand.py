"""A stand of four calibrated rigs, and vehicles whose frame is known: what the study `vehicles` measures."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from alignment.arrays import Array
from alignment.calibration import CertifiedPlate, adjust, cameras_of_rig, place_rig
from alignment.geometry import RigidTransform
from alignment.units import ARCMIN
from alignment.values import RigCalibration, Side, nominal_vehicle_from_rig
from alignment.vehicle import FOUR_WHEELS, Stand, TyreWidths, WheelAxis, normal_from_angles
from sensors.simulation import RIG_SPECS, build_rig
from station.studies.simulated_views import STAGES, observe, square_plate

WHEELBASE_MM, TRACK_MM, WIDTH_MM, RADIUS_MM = 2700.0, 1512.0, 195.0, 310.0
CERTIFICATE_MM, CERTIFICATE_ANGLE = 0.01, 0.02 * ARCMIN
"""Standard uncertainties of the gauge frame's plates, as a measuring machine certifies them."""
STAND = Stand(road_z_mm=-RADIUS_MM, temperature_sigma_k=0.5, gradient_sigma_k_per_m=0.1)
"""Its temperature is known to ±1 K (95 %), and how unevenly warm it is to ±0.2 K/m."""
MOST_YAW, MOST_OFFSET_MM = math.radians(0.5), 20.0
_ASKEW, _OFF_MM = math.radians(0.3), 2.0  # of a rig as built, one standard deviation
_SCATTER_MM, _CAMBER, _TOE = 3.0, math.radians(0.5), math.radians(0.15)  # of vehicles


def side_of_wheel(name: str) -> Side:
    """Side of a wheel by its name."""
    return "left" if name.endswith("_left") else "right"


def place_of_rig(name: str) -> Array:
    """(3,) nominal place of a rig, millimetres: the outermost ring of a wheel that stands straight."""
    x = 0.5 * WHEELBASE_MM if name.startswith("front") else -0.5 * WHEELBASE_MM
    y = 0.5 * (TRACK_MM + WIDTH_MM)
    return np.array([x, y if side_of_wheel(name) == "left" else -y, 0.0])


def placed_rig(name: str, seed: int, stages: Sequence[tuple[float, float, float]] = STAGES) -> RigCalibration:
    """The true cameras and pose of a rig, with the covariance of its calibration and of its placing.

    It was calibrated with a plate on a stage (its positions, millimetres) and placed with one view of a gauge
    frame; both without images.
    """
    rng = np.random.default_rng([seed, 0, FOUR_WHEELS.index(name)])
    side = side_of_wheel(name)
    nominal = nominal_vehicle_from_rig(side)
    stands = nominal.perturbed(rng.normal(0.0, _ASKEW, 3), place_of_rig(name) + rng.normal(0.0, _OFF_MM, 3))
    true = replace(build_rig(RIG_SPECS["standard"], name, side, rng), vehicle_from_rig=stands)
    cameras, plate = cameras_of_rig(true), square_plate()
    found = adjust(observe(cameras, plate, stages, rng).data).rig_calibration(name, name, side, nominal)
    certified = CertifiedPlate(
        nominal.perturbed(np.zeros(3), place_of_rig(name)), CERTIFICATE_MM, CERTIFICATE_ANGLE
    )
    seen = observe(cameras, plate, [stands.inverse() @ certified.vehicle_from_plate], rng, corrected=False)
    placed = place_rig(seen.data, found, certified)
    return replace(true, vehicle_from_rig_measured=True, covariance=placed.calibration.covariance)


@dataclass(frozen=True, eq=False)
class DrawnVehicle:
    """A vehicle in its own frame, and how it stands.

    Attributes
    ----------
    angles
        (camber, toe) by wheel, radians, toe against the centreline.
    centres
        Wheel centres (3,) by wheel: axle middles on X, as far before the origin as behind.
    widths
        Of its tyres, millimetres.
    yaw, place
        Of the vehicle on the stand: radians, and (2,) millimetres.
    seed
        Of the skin and form of its tyres.
    """

    angles: Mapping[str, tuple[float, float]]
    centres: Mapping[str, Array]
    widths: Mapping[str, float]
    yaw: float
    place: Array
    seed: int = 0

    def on_stand(self, name: str) -> tuple[float, float, Array]:
        """Camber and toe of a wheel against the stand, and its reference point (3,) there."""
        camber, toe = self.angles[name]
        side = side_of_wheel(name)
        ring = self.centres[name] + 0.5 * self.widths[name] * normal_from_angles(camber, toe, side)
        turn = RigidTransform.from_rotvec(np.array([0.0, 0.0, self.yaw]), np.array([*self.place, 0.0]))
        shown = toe - self.yaw if side == "left" else toe + self.yaw
        return camber, shown, turn.apply(ring)

    def contact(self, name: str) -> Array:
        """(2,) contact centre of a wheel in the vehicle's own frame: below its middle, aside by its lean."""
        camber, toe = self.angles[name]
        n = normal_from_angles(camber, toe, side_of_wheel(name))
        height = self.centres[name][2] + RADIUS_MM
        out: Array = self.centres[name][:2] + height * n[2] / (1.0 - n[2] ** 2) * n[:2]
        return out

    @property
    def truth(self) -> dict[str, float]:
        """What a measurement should find, by the names of `VehicleGeometry`."""
        at: dict[str, Array] = {name: self.contact(name) for name in FOUR_WHEELS}
        out = {f"{name}.toe": toe for name, (_, toe) in self.angles.items()}
        out |= {f"{name}.camber": camber for name, (camber, _) in self.angles.items()}
        out["thrust_angle"] = 0.5 * (self.angles["rear_right"][1] - self.angles["rear_left"][1])
        for axle in ("front", "rear"):
            left, right = f"{axle}_left", f"{axle}_right"
            out[f"track_{axle}"] = float(at[left][1] - at[right][1])
            out[f"{axle}.total_toe"] = self.angles[left][1] + self.angles[right][1]
        for side in ("left", "right"):
            out[f"wheelbase_{side}"] = float(at[f"front_{side}"][0] - at[f"rear_{side}"][0])
        return out | {"yaw": self.yaw, "place_x": float(self.place[0]), "place_y": float(self.place[1])}


def draw_vehicle_on_stand(rng: np.random.Generator, width_spread_mm: float = 0.0) -> DrawnVehicle:
    """Draw a vehicle within ±0.5° and ±20 mm; widths within ±`width_spread_mm` of the nominal one."""
    angles, centres, widths = {}, {}, {}
    for axle, end in (("front", 1.0), ("rear", -1.0)):
        base, track = WHEELBASE_MM + rng.normal(0.0, _SCATTER_MM), TRACK_MM + rng.normal(0.0, _SCATTER_MM)
        setback = rng.normal(0.0, _SCATTER_MM)
        for sign in (1.0, -1.0):
            name = f"{axle}_{'left' if sign > 0 else 'right'}"
            x, z = end * 0.5 * base + sign * 0.5 * setback, rng.normal(0.0, _SCATTER_MM)
            centres[name] = np.array([x, sign * 0.5 * track, z])
            angles[name] = (float(rng.normal(0.0, _CAMBER)), float(rng.normal(0.0, _TOE)))
            widths[name] = WIDTH_MM + float(rng.uniform(-width_spread_mm, width_spread_mm))
    middle = 0.25 * sum(float(c[0]) for c in centres.values())
    centres = {name: c - np.array([middle, 0.0, 0.0]) for name, c in centres.items()}
    yaw, place = rng.uniform(-MOST_YAW, MOST_YAW), rng.uniform(-MOST_OFFSET_MM, MOST_OFFSET_MM, 2)
    return DrawnVehicle(angles, centres, widths, float(yaw), place, int(rng.integers(2**32)))


def tyres(width_spread_mm: float = 0.0) -> TyreWidths:
    """What is stated of widths that lie evenly within ±`width_spread_mm`."""
    return TyreWidths(WIDTH_MM, WIDTH_MM, width_spread_mm / math.sqrt(3.0))


def warmed(rng: np.random.Generator) -> dict[str, Array]:
    """By wheel what the stand's temperature does to camber, toe and place (5,), drawn once for all rigs."""
    points = np.array([place_of_rig(name) for name in FOUR_WHEELS])
    covariance = STAND.covariance(points, tuple(side_of_wheel(name) for name in FOUR_WHEELS))
    values, vectors = np.linalg.eigh(covariance)
    move = vectors @ (np.sqrt(np.maximum(values, 0.0)) * rng.standard_normal(len(values)))
    return dict(zip(FOUR_WHEELS, move.reshape(4, 5), strict=True))


def measured_axes(
    vehicle: DrawnVehicle,
    covariances: Mapping[str, Array],
    rng: np.random.Generator,
    *,
    warm: bool = True,
) -> dict[str, WheelAxis]:
    """What the rigs would see: each wheel off by a draw from its covariance (5, 5), and by the warm stand."""
    heat = warmed(rng) if warm else dict.fromkeys(map(str, FOUR_WHEELS), np.zeros(5))
    out: dict[str, WheelAxis] = {}
    for name in FOUR_WHEELS:
        values, vectors = np.linalg.eigh(covariances[name])
        off = vectors @ (np.sqrt(np.maximum(values, 0.0)) * rng.standard_normal(5)) + heat[name]
        camber, toe, point = vehicle.on_stand(name)
        out[name] = WheelAxis(
            side_of_wheel(name), camber + off[0], toe + off[1], point + off[2:], covariances[name]
        )
    return out
