"""One wheel in front of a rig: pose, tyre, light, things in the way; and the truth about its angles."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.arrays import Array, Index
from alignment.geometry import RigidTransform
from alignment.values import RigCalibration, Side, nominal_vehicle_from_rig
from alignment.vehicle import camber_toe, normal_from_angles
from sensors.formats.truth import TyreLoad, WheelTruth
from sensors.simulation.deformation import Contact, Wobble
from sensors.simulation.optics import Optics
from sensors.simulation.projector import Projector
from sensors.simulation.rigs import RigSpec, build_projectors
from sensors.simulation.tyre import GREY, Material, Tyre, TyreShape, draw_tyre, lathe

RUN_OUT_RADIUS_MM = 300.0
MOMENTS = 3


@dataclass(frozen=True)
class WheelPose:
    """How a wheel stands and has turned.

    Attributes
    ----------
    camber, toe
        Of the spin axis in the vehicle frame, radians, signs as the conventions say.
    spin
        Turn about the spin axis, radians, counter-clockwise seen from outboard.
    run_out, run_out_phase
        Angle between tyre plane and spin axis, radians, and the direction in the wheel to which the tyre's
        normal leans; it turns with the spin.
    offset_mm
        Wheel centre in the rig frame.
    """

    camber: float = 0.0
    toe: float = 0.0
    spin: float = 0.0
    run_out: float = 0.0
    run_out_phase: float = 0.0
    offset_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def vehicle_from_tyre(self, side: Side) -> Array:
        """Rotation (3, 3) of the tyre in the vehicle frame."""
        nominal = nominal_vehicle_from_rig(side).rotation
        outboard, normal = nominal[:, 2], normal_from_angles(self.camber, self.toe, side)
        across = np.cross(outboard, normal)
        sine = float(np.linalg.norm(across))
        turn = math.atan2(sine, float(outboard @ normal)) / sine if sine > 0 else 0.0
        lean = self.run_out * np.array([-math.sin(self.run_out_phase), math.cos(self.run_out_phase), 0.0])
        return np.asarray(
            Rotation.from_rotvec(across * turn).as_matrix()
            @ nominal
            @ Rotation.from_rotvec([0.0, 0.0, self.spin]).as_matrix()
            @ Rotation.from_rotvec(lean).as_matrix()
        )

    def rig_from_tyre(self, side: Side, vehicle_from_rig: RigidTransform) -> RigidTransform:
        """Pose of the tyre in the rig frame."""
        rotation = vehicle_from_rig.rotation.T @ self.vehicle_from_tyre(side)
        return RigidTransform(rotation, np.array(self.offset_mm))


@dataclass(frozen=True, eq=False)
class Obstacle:
    """Something between cameras and wheel: a triangle mesh in the rig frame, millimetres; casts shadows.

    It should be wider than four pixels: thinner parts may be missed.
    """

    vertices: Array
    triangles: Index
    material: Material = GREY


def cable(start: Array, end: Array, diameter_mm: float, material: Material = GREY) -> Obstacle:
    """Build a straight cable between two points (3,) of the rig frame."""
    axis = np.asarray(end, dtype=float) - start
    length = float(np.linalg.norm(axis))
    half = diameter_mm / 2
    vertices, triangles = lathe(np.array([[0, 0], [half, 0], [half, length], [0, length]]), 32)
    rotation = Rotation.align_vectors(axis[None] / length, [[0.0, 0.0, 1.0]])[0].as_matrix()
    return Obstacle(vertices @ rotation.T + start, triangles, material)


def lump(centre: Array, radii_mm: tuple[float, float, float], material: Material = GREY) -> Obstacle:
    """Build an ellipsoid, about the size of a hand or a box, in the rig frame."""
    polar = np.linspace(0.0, math.pi, 25)
    vertices, triangles = lathe(np.column_stack([np.sin(polar), np.cos(polar)]), 48)
    return Obstacle(vertices * radii_mm + np.asarray(centre, dtype=float), triangles, material)


@dataclass(frozen=True)
class Sun:
    """A beam of parallel light with a soft edge; it casts no shadows.

    Attributes
    ----------
    towards
        Direction from the wheel to the light, rig frame.
    through_mm
        A point on the axis of the beam, rig frame.
    radius_mm
        Of the beam.
    level
        Irradiance, in the unit of `Projector.level`.
    """

    towards: tuple[float, float, float] = (0.4, 0.6, 1.0)
    through_mm: tuple[float, float, float] = (0.0, 260.0, 0.0)
    radius_mm: float = 40.0
    level: float = 5.0


@dataclass(frozen=True, eq=False)
class WheelScene:
    """Everything that describes one wheel in front of a rig, except the cameras.

    Attributes
    ----------
    side
        Side of the vehicle.
    pose, tyre, projectors
        The wheel, and what lights it.
    optics
        Of all cameras.
    ambient
        Irradiance from all around, in the unit of `Projector.level`.
    sun, obstacles
        Disturbances.
    transmission
        Share of the light that a camera passes, by name such as ``head_2.left``; 1 for those not named.
    seed
        What the scene was drawn from, for the record.
    load
        What the road does to the tyre; None for a wheel in the air.
    wobble
        What turns with the wheel beside the run-out of its pose.
    turning
        How far the wheel turns during one exposure, radians; the pose is the middle of it.
    """

    side: Side
    pose: WheelPose
    tyre: Tyre
    projectors: tuple[Projector, ...]
    optics: Optics = field(default_factory=Optics)
    ambient: float = 0.15
    sun: Sun | None = None
    obstacles: tuple[Obstacle, ...] = ()
    transmission: Mapping[str, float] = field(default_factory=dict)
    seed: int = 0
    load: TyreLoad | None = None
    wobble: Wobble | None = None
    turning: float = 0.0

    @property
    def contact(self) -> Contact:
        """Where the road is: straight down in the vehicle frame, whatever camber and turn the wheel has."""
        tyre_from_vehicle = self.pose.vehicle_from_tyre(self.side).T
        down, ahead = -tyre_from_vehicle[:, 2], tyre_from_vehicle[:, 0]
        turning = down[0] * ahead[1] - down[1] * ahead[0]
        return Contact(math.atan2(down[1], down[0]), 1 if turning > 0 else -1)

    @cached_property
    def deformed_tyre(self) -> Tyre:
        """The tyre as it stands there: under its load, with its wobble."""
        if self.load is None and self.wobble is None:
            return self.tyre
        load = None if self.load is None else (self.load, self.contact)
        return self.tyre.deformed(load, self.wobble, (self.pose.run_out, self.pose.run_out_phase))

    @cached_property
    def moments(self) -> tuple[WheelScene, ...]:
        """The instants whose mean an exposure sees: one of a wheel that stands, else `MOMENTS`."""
        if not self.turning:
            return (self,)
        steps = (np.arange(MOMENTS) + 0.5) / MOMENTS - 0.5
        return tuple(
            replace(
                self, pose=replace(self.pose, spin=self.pose.spin + float(step) * self.turning), turning=0.0
            )
            for step in steps
        )

    def rig_from_tyre(self, calibration: RigCalibration) -> RigidTransform:
        """Pose of the tyre in the frame of a rig that stands as its calibration says."""
        return self.pose.rig_from_tyre(self.side, calibration.vehicle_from_rig)


def draw_pose(
    rng: np.random.Generator, camber: float, toe: float, reach_mm: float = 8.0, run_out: float = 0.0
) -> WheelPose:
    """Draw a pose: any spin, any phase of the run-out, each coordinate of the centre within ±`reach_mm`."""
    x, y, z = (float(value) for value in rng.uniform(-reach_mm, reach_mm, 3))
    spin, phase = (float(value) for value in rng.uniform(0.0, 2.0 * math.pi, 2))
    return WheelPose(camber, toe, spin, run_out, phase, (x, y, z))


def draw_scene(
    spec: RigSpec,
    side: Side,
    pose: WheelPose,
    rng: np.random.Generator,
    shape: str | TyreShape = "touring",
    *,
    seed: int = 0,
) -> WheelScene:
    """Draw tyre and projectors for a pose in front of a rig; `seed` is kept for the record.

    Change the scene with `dataclasses.replace`: other light, obstacles, a dirty tyre.
    """
    return WheelScene(side, pose, draw_tyre(rng, shape), build_projectors(spec, rng), seed=seed)


def truth_of(scene: WheelScene) -> WheelTruth:
    """Return what a measurement of the scene should find."""
    pose = scene.pose
    camber, toe = camber_toe(pose.vehicle_from_tyre(scene.side)[:, 2], scene.side)
    return WheelTruth(
        side=scene.side,
        seed=scene.seed,
        camber_deg=math.degrees(camber),
        toe_deg=math.degrees(toe),
        spin_camber_deg=math.degrees(pose.camber),
        spin_toe_deg=math.degrees(pose.toe),
        spin_angle_deg=math.degrees(pose.spin),
        runout_mm=2.0 * RUN_OUT_RADIUS_MM * math.sin(pose.run_out),
        runout_radius_mm=RUN_OUT_RADIUS_MM,
        centre_mm=pose.offset_mm,
        load=scene.load,
        rim_runout_mm=0.0 if scene.wobble is None else scene.wobble.rim_mm,
        second_harmonic_mm=0.0 if scene.wobble is None else scene.wobble.second_mm,
    )
