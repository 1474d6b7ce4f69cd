"""Front wheels that are steered before a rig: by numbers, and rendered; what the study `sweep` measures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from alignment.arrays import Array
from alignment.measure_steering import (
    errors_at_positions,
    measure_steered,
    rig_from_wheel,
    steered_settings,
)
from alignment.prepared import PreparedRig
from alignment.units import ARCMIN
from alignment.values import MeasureSettings, Refusal, RigCalibration
from alignment.vehicle import (
    RunOut,
    SteeredWheel,
    SteeringStand,
    VehicleWheel,
    WheelAxis,
    camber_toe,
)
from sensors.formats import SteeringTruth
from sensors.simulation import (
    RIG_SPECS,
    ROAD_Z_MM,
    SimulatedStand,
    SteeredVehicle,
    Vehicle,
    VehicleDraw,
    draw_steering,
    draw_vehicle,
    straight_vehicle,
)
from station.rehearsal import steering_truth
from station.studies.coverage import drawn
from station.studies.vehicle_stand import WIDTH_MM, placed_rig, side_of_wheel
from station.studies.wheels import exposed, lights

WHEEL: VehicleWheel = "front_left"
VEHICLES = 20
DEEP_STAGES: tuple[tuple[float, float, float], ...] = (
    (0.0, 0.0, 0.0),
    (0.0, 0.0, -60.0),
    (0.0, 0.0, -30.0),
    (0.0, 0.0, 30.0),
    (0.0, 0.0, 60.0),
    (7.5, 4.0, 15.0),
    (-5.0, -7.5, -40.0),
)
"""Seven positions of the plate, millimetres, over the depth that a steered wheel takes."""
LOAD_MM, RUN_OUT_MM = 5.0, 2.0
RUN_OUT_U, HEADING_U = 0.05 * ARCMIN, 0.045 * ARCMIN
"""Of the run-out by a series on rollers; of the thrust line of equal tyres (study `vehicle-budget`)."""
SETTINGS = steered_settings(MeasureSettings())


@dataclass(frozen=True, eq=False)
class ShotNoise:
    """What rendered exposures of one wheel at one angle of the steering gave.

    Attributes
    ----------
    angle
        Of the wheel, radians.
    stated
        (5, 5) own covariance as stated, mean.
    load
        (2, 2) what is stated not to be known of the load; None without.
    scatter
        Variance of camber and toe between exposures over the stated one, mean of both.
    off
        (2,) mean error of camber and toe, radians.
    """

    angle: float
    stated: Array
    load: Array | None
    scatter: float
    off: Array


@dataclass(frozen=True, eq=False)
class KnownSweep:
    """Positions of a wheel, what is known beside them, and the truth."""

    series: list[SteeredWheel]
    stand: SteeringStand
    run_out: RunOut
    truth: SteeringTruth


@lru_cache(VEHICLES)
def _drawn_vehicle(seed: int, number: int) -> Vehicle:
    """Tyres take their time."""
    draw = VehicleDraw(load_mm=LOAD_MM, runout_mm=RUN_OUT_MM)
    return straight_vehicle(
        draw_vehicle(int(np.random.default_rng([seed, 50, number]).integers(2**32)), None, draw)
    )


def steered_vehicle(seed: int, number: int) -> SteeredVehicle:
    """Draw a loaded vehicle with run-out, steering straight ahead; each number has another axis.

    Its tyres are even but for their run-out, and no side force is on them: what single exposures cannot tell
    from heads that moved is refused there, and no matter of the steering.
    """
    each = int(np.random.default_rng([seed, 51, number]).integers(2**32))
    vehicle = replace(_drawn_vehicle(seed, number % VEHICLES), seed=each)
    corners = {}
    for wheel, corner in vehicle.corners.items():
        assert corner.load is not None
        load = replace(corner.load, side_mm=0.0, longitudinal_mm=0.0)
        corners[wheel] = replace(corner, wobble=None, load=load)
    return draw_steering(replace(vehicle, corners=corners))


def even_steers(reach: float, positions: int) -> tuple[float, ...]:
    """Angles of the rack, radians."""
    return tuple(float(steer) for steer in np.linspace(-reach, reach, positions))


def states(vehicle: SteeredVehicle, steers: Sequence[float]) -> Array:
    """(N, 5) camber, toe and reference point of the tyre plane at angles of the rack, without any error."""
    out = []
    for steer in steers:
        corner = vehicle.corner_at(steer, WHEEL)
        camber, toe = corner.angles
        side = side_of_wheel(WHEEL)
        plane = replace(corner.pose, camber=camber, toe=toe).vehicle_from_tyre(side)[:, 2]
        point = np.array(corner.centre_mm) + 0.5 * corner.tyre_width_mm * plane
        out.append([*camber_toe(plane, side), *point])
    return np.array(out)


def known_beside(vehicle: SteeredVehicle, rng: np.random.Generator | None) -> tuple[SteeringStand, RunOut]:
    """Thrust line and run-out as other measurements would give them; exact where nothing draws errors."""
    straight = vehicle.at(0.0)
    toe = {wheel: corner.angles[1] for wheel, corner in straight.corners.items()}
    heading = 0.5 * (toe["rear_right"] - toe["rear_left"])
    plane, corner = states(vehicle, (0.0,))[0], straight.corners[WHEEL]
    lean = plane[:2] - corner.angles
    known = np.zeros((2, 2))
    heading_u = 0.0
    straight_toe = corner.angles[1] + heading
    if rng is not None:
        lean = lean + RUN_OUT_U * rng.standard_normal(2)
        known, heading_u = np.eye(2) * RUN_OUT_U**2, HEADING_U
        heading += HEADING_U * float(rng.standard_normal())
    stand = SteeringStand(heading, heading_u, ROAD_Z_MM, WIDTH_MM, 0.0, straight_toe)
    return stand, RunOut(float(lean[0]), float(lean[1]), known)


def sweep_by_numbers(
    vehicle: SteeredVehicle,
    steers: Sequence[float],
    noise: Sequence[ShotNoise],
    common: Array,
    drift: float,
    rng: np.random.Generator,
) -> KnownSweep:
    """Draw what a rig sees of a sweep: noise of each position, and what all have in common.

    Parameters
    ----------
    vehicle, steers
        What is steered, and to where.
    noise
        Of shots, by angle.
    common
        (N, 5, M) errors of the calibration.
    drift
        Share of what is not known of the load by which it changes over the sweep, one standard deviation.
    rng
        Draws all of it.
    """
    exact = states(vehicle, steers)
    shared = rng.standard_normal(common.shape[2])
    load = np.mean([one.load for one in noise if one.load is not None] or [np.zeros((2, 2))], axis=0)
    root = _root(load)
    drawn_load = root @ rng.standard_normal((2, 3))
    series = []
    for number, steer in enumerate(steers):
        stated, scatter = _between(noise, abs(steer))
        u = steer / max(map(abs, steers))
        error = _root(scatter * stated) @ rng.standard_normal(5) + common[number] @ shared
        error[:2] += drawn_load @ [1.0, drift * u, drift * u**2]
        state = exact[number] + error
        axis = WheelAxis(side_of_wheel(WHEEL), float(state[0]), float(state[1]), state[2:], stated)
        series.append(SteeredWheel(axis, common[number], load))
    return KnownSweep(
        series, *known_beside(vehicle, rng), steering_truth(vehicle, tuple(steers)).wheels[WHEEL]
    )


def exact_sweep(vehicle: SteeredVehicle, steers: Sequence[float]) -> KnownSweep:
    """Positions without any error."""
    side = side_of_wheel(WHEEL)
    series = [
        SteeredWheel(WheelAxis(side, float(state[0]), float(state[1]), state[2:], np.zeros((5, 5))))
        for state in states(vehicle, steers)
    ]
    return KnownSweep(
        series, *known_beside(vehicle, None), steering_truth(vehicle, tuple(steers)).wheels[WHEEL]
    )


def _known(
    series: list[SteeredWheel],
    vehicle: SteeredVehicle,
    steers: Sequence[float],
    rng: np.random.Generator | None,
) -> KnownSweep:
    truth = steering_truth(vehicle, tuple(steers)).wheels[WHEEL]
    return KnownSweep(series, *known_beside(vehicle, rng), truth)


def errors_of_calibration(rig: RigCalibration, vehicle: SteeredVehicle, steers: Sequence[float]) -> Array:
    """(N, 5, M) errors of the rig's calibration at the positions of a sweep."""
    found = states(vehicle, steers)
    back = rig.vehicle_from_rig.inverse()
    side = side_of_wheel(WHEEL)
    poses = []
    for state in found:
        axis = WheelAxis(side, float(state[0]), float(state[1]), state[2:], np.zeros((5, 5)))
        poses.append(rig_from_wheel(back.apply_vectors(axis.normal), back.apply(axis.point)))
    return errors_at_positions(rig, poses, found[:, 1])


def shot_noise(
    rig: RigCalibration,
    vehicle: SteeredVehicle,
    steers: Sequence[float],
    exposures: int,
    rng: np.random.Generator,
) -> list[ShotNoise] | Refusal:
    """Render a wheel at angles of the rack; exposures of each differ by their noise alone."""
    stand = _stand(rig)
    scenes = [vehicle.at(steer).scene(WHEEL, stand) for steer in steers]
    lit = [lights(scene, rig) for scene in scenes]
    shots = (
        exposed(light, scene, rng) for light, scene in zip(lit, scenes, strict=True) for _ in range(exposures)
    )
    series = measure_steered(shots, PreparedRig.of(rig, SETTINGS), SETTINGS)
    if isinstance(series, Refusal):
        return series
    exact = states(vehicle, steers)
    return [
        _noise_of(series[k * exposures : (k + 1) * exposures], exact[k], steer)
        for k, steer in enumerate(steers)
    ]


def _noise_of(series: Sequence[SteeredWheel], exact: Array, steer: float) -> ShotNoise:
    stated = np.mean([one.axis.covariance for one in series], axis=0)
    angles = np.array([[one.axis.camber, one.axis.toe] for one in series])
    loads = [one.load_covariance for one in series if one.load_covariance is not None]
    ratio = angles.var(axis=0, ddof=1) / np.diag(stated)[:2]
    load = np.mean(loads, axis=0) if loads else None
    return ShotNoise(steer, stated, load, float(ratio.mean()), angles.mean(axis=0) - exact[:2])


def rendered_sweep(
    rig: RigCalibration, vehicle: SteeredVehicle, steers: Sequence[float], rng: np.random.Generator
) -> KnownSweep | Refusal:
    """Render a sweep before the true cameras, and measure it with cameras drawn from their covariance."""
    assert rig.covariance is not None
    stand = _stand(rig)
    scenes = [vehicle.at(steer).scene(WHEEL, stand) for steer in steers]
    prepared = PreparedRig.of(drawn(rig, rig.covariance, rng), SETTINGS)
    series = measure_steered(
        (exposed(lights(scene, rig), scene, rng) for scene in scenes), prepared, SETTINGS
    )
    if isinstance(series, Refusal):
        return series
    return KnownSweep(
        series, *known_beside(vehicle, rng), steering_truth(vehicle, tuple(steers)).wheels[WHEEL]
    )


def sweep_rig(seed: int) -> RigCalibration:
    """The rig, calibrated with the plate over the depth of a steered wheel, and placed with a gauge frame."""
    return placed_rig(WHEEL, seed, DEEP_STAGES)


def _stand(rig: RigCalibration) -> SimulatedStand:
    return SimulatedStand(RIG_SPECS["standard"], {WHEEL: rig})


def _between(noise: Sequence[ShotNoise], angle: float) -> tuple[Array, float]:
    """Stated covariance (5, 5) and scatter over it at an angle between those that were rendered."""
    at = np.array([abs(one.angle) for one in noise])
    weight = np.maximum(1.0 - np.abs(at - angle) / _spacing(at), 0.0)
    weight /= weight.sum()
    stated = np.einsum("n,nab->ab", weight, np.array([one.stated for one in noise]))
    return stated, float(weight @ [one.scatter for one in noise])


def _spacing(at: Array) -> float:
    different = np.unique(np.round(at, 6))
    return float(np.diff(different).max()) if len(different) > 1 else np.inf


def _root(covariance: Array) -> Array:
    values, vectors = np.linalg.eigh(covariance)
    out: Array = vectors * np.sqrt(np.maximum(values, 0.0))
    return out
