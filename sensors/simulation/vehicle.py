"""A vehicle on a stand: four wheels on a chassis whose rods and bolts can be turned, and rigs before them.

Camber and toe of every wheel are kept against the vehicle's own frame (X along the centreline, from the
middle of the rear axle to that of the front one; Z the normal of the wheel supports). Left out: springs, a
steering wheel (front rods turn one wheel each), and the small way that a wheel's centre takes when its rod is
turned.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from alignment.arrays import Array
from alignment.geometry import RigidTransform
from alignment.values import RigCalibration, Side, nominal_vehicle_from_rig
from alignment.vehicle import FOUR_WHEELS, normal_from_angles
from sensors.formats.truth import TyreLoad
from sensors.simulation.deformation import Wobble
from sensors.simulation.rigs import RIG_SPECS, RigSpec, build_projectors
from sensors.simulation.scene import RUN_OUT_RADIUS_MM, WheelPose, WheelScene
from sensors.simulation.simulated_rig import standing, true_calibration
from sensors.simulation.tyre import Tyre, draw_tyre

ROAD_Z_MM = -310.0
"""Height of the wheel supports; the origin of the stand's frame lies at the height of the wheels' centres."""


@dataclass(frozen=True)
class Adjuster:
    """What one turn of a rod or bolt does to its wheel, radians per turn."""

    toe: float
    camber: float


TIE_ROD = Adjuster(toe=math.radians(0.7), camber=math.radians(0.02))
CAMBER_BOLT = Adjuster(toe=math.radians(0.05), camber=math.radians(0.5))


@dataclass(frozen=True)
class VehicleSpec:
    """What a maker states of a vehicle type, millimetres and radians.

    Attributes
    ----------
    wheelbase_mm, track_front_mm, track_rear_mm
        Nominal, between contact centres.
    tyre_width_mm
        From outermost ring to outermost ring.
    camber, toe
        Nominal, front and rear.
    shape
        Of its tyres, one of `MADE_SHAPES`.
    """

    name: str = "Compact"
    wheelbase_mm: float = 2700.0
    track_front_mm: float = 1512.0
    track_rear_mm: float = 1508.0
    tyre_width_mm: float = 195.0
    camber: tuple[float, float] = (math.radians(-0.5), math.radians(-1.3))
    toe: tuple[float, float] = (math.radians(0.1), math.radians(0.15))
    shape: str = "touring"


@dataclass(frozen=True)
class Corner:
    """One wheel of a vehicle, in the vehicle's own frame.

    Attributes
    ----------
    camber, toe
        Of the spin axis, radians, before rod and bolt were turned.
    centre_mm
        Middle of the wheel: on the axis, half a tyre's width inboard of the outermost ring; Z from the origin
        of the stand's frame.
    tyre_width_mm
        Of this tyre.
    pose
        Spin and run-out; its angles and place are not used.
    load, wobble
        What the road does to the tyre, and what turns with the wheel.
    rod_turns, bolt_turns
        By which tie rod and camber bolt have been turned.
    """

    camber: float
    toe: float
    centre_mm: tuple[float, float, float]
    tyre_width_mm: float
    pose: WheelPose = field(default_factory=WheelPose)
    load: TyreLoad | None = None
    wobble: Wobble | None = None
    rod_turns: float = 0.0
    bolt_turns: float = 0.0

    @property
    def angles(self) -> tuple[float, float]:
        """Camber and toe of the spin axis as it is now, radians."""
        return (
            self.camber + self.rod_turns * TIE_ROD.camber + self.bolt_turns * CAMBER_BOLT.camber,
            self.toe + self.rod_turns * TIE_ROD.toe + self.bolt_turns * CAMBER_BOLT.toe,
        )


@dataclass(frozen=True, eq=False)
class Vehicle:
    """A vehicle and how it stands.

    Attributes
    ----------
    spec
        Its type.
    corners
        By position.
    tyre
        Skin and form of all its tyres, in the air.
    yaw
        Direction of its centreline, radians, counter-clockwise from the stand's X seen from above.
    place_mm
        X and Y of the middle between its axles' midpoints in the stand's frame.
    seed
        What it was drawn from.
    """

    spec: VehicleSpec
    corners: Mapping[str, Corner]
    tyre: Tyre
    yaw: float = 0.0
    place_mm: tuple[float, float] = (0.0, 0.0)
    seed: int = 0

    def with_rod_turned(self, wheel: str, turns: float) -> Vehicle:
        """Return the vehicle after one tie rod was turned; positive turns are toe-in."""
        corner = self.corners[wheel]
        return self._with(wheel, replace(corner, rod_turns=corner.rod_turns + turns))

    def with_bolt_turned(self, wheel: str, turns: float) -> Vehicle:
        """Return the vehicle after one camber bolt was turned; positive turns lean the top outboard."""
        corner = self.corners[wheel]
        return self._with(wheel, replace(corner, bolt_turns=corner.bolt_turns + turns))

    def _with(self, wheel: str, corner: Corner) -> Vehicle:
        return replace(self, corners={**self.corners, wheel: corner})

    def on_stand(self, wheel: str) -> tuple[float, float, Array]:
        """Camber and toe of a spin axis against the stand's axes; the wheel's middle (3,) in its frame."""
        corner = self.corners[wheel]
        camber, toe = corner.angles
        turn = RigidTransform.from_rotvec(np.array([0.0, 0.0, self.yaw]), np.array([*self.place_mm, 0.0]))
        # A vehicle that has turned to the left shows the stand less toe on the left.
        toe += -self.yaw if side_of(wheel) == "left" else self.yaw
        return camber, toe, np.asarray(turn.apply(np.array(corner.centre_mm)))

    def scene(self, wheel: str, stand: SimulatedStand) -> WheelScene:
        """Return the wheel as it stands before its rig."""
        corner, side = self.corners[wheel], side_of(wheel)
        camber, toe, middle = self.on_stand(wheel)
        # The tyre frame's origin lies off the middle of the wheel along its axis.
        inboard = 0.5 * corner.tyre_width_mm - self.tyre.outermost_mm
        origin = middle + inboard * normal_from_angles(camber, toe, side)
        x, y, z = (float(c) for c in stand.rigs[wheel].vehicle_from_rig.inverse().apply(origin))
        pose = replace(corner.pose, camber=camber, toe=toe, offset_mm=(x, y, z))
        projectors = build_projectors(
            stand.spec, np.random.default_rng([self.seed, 4, FOUR_WHEELS.index(wheel)])
        )
        return WheelScene(
            side, pose, self.tyre, projectors, seed=self.seed, load=corner.load, wobble=corner.wobble
        )


@dataclass(frozen=True, eq=False)
class SimulatedStand:
    """The rigs of a stand, each with its true cameras and its true pose in the stand's frame.

    Attributes
    ----------
    spec
        The rigs' nominal geometry and light.
    rigs
        True calibrations by position of the wheel.
    """

    spec: RigSpec
    rigs: Mapping[str, RigCalibration]


def side_of(wheel: str) -> Side:
    """Side of a wheel by its position."""
    return "left" if wheel.endswith("left") else "right"


def build_stand(
    spec: VehicleSpec,
    seed: int,
    preset: str = "standard",
    light: RigSpec | None = None,
    askew: float = math.radians(0.3),
) -> SimulatedStand:
    """Build four rigs before the nominal places of a vehicle's wheels.

    Each is turned by about `askew` (one standard deviation about each axis, radians) and stands some
    millimetres off; its calibration says how. `light` exchanges the preset's own pattern.
    """
    rigs: dict[str, RigCalibration] = {}
    for number, wheel in enumerate(FOUR_WHEELS):
        side = side_of(wheel)
        rng = np.random.default_rng([seed, 5, number])
        built = true_calibration(wheel, side, preset, int(rng.integers(2**32)))
        stands = nominal_vehicle_from_rig(side).perturbed(
            rng.normal(0.0, askew, 3), _nominal_place(spec, wheel) + rng.normal(0.0, 2.0, 3)
        )
        rigs[wheel] = standing(built, stands)
    return SimulatedStand(light or RIG_SPECS[preset], rigs)


def _nominal_place(spec: VehicleSpec, wheel: str) -> Array:
    """Outermost ring of a nominal wheel in the stand's frame (3,)."""
    front = wheel.startswith("front")
    track, camber = (spec.track_front_mm, spec.camber[0]) if front else (spec.track_rear_mm, spec.camber[1])
    across = 0.5 * (track + spec.tyre_width_mm) - ROAD_Z_MM * math.tan(camber)
    along = 0.5 * spec.wheelbase_mm
    return np.array([along if front else -along, across if side_of(wheel) == "left" else -across, 0.0])


@dataclass(frozen=True)
class VehicleDraw:
    """How much a drawn vehicle varies; angles radians.

    Attributes
    ----------
    angles
        Standard deviation of camber and toe of each wheel about its type's.
    place_mm
        The same of each coordinate of a wheel's middle: wheelbase, track, setback and loaded radius follow.
    tyre_width_sigma_mm
        Spread of the widths of its tyres.
    load_mm
        Bulge of a tyre at the front, about; tyres at the rear bulge less. 0: wheels in the air.
    load_width_deg
        Bounds of the bulges' half width.
    runout_mm
        Largest run-out of a tyre, peak to peak at a radius of 300 mm; that of the rim and a second harmonic
        follow.
    """

    angles: float = math.radians(0.08)
    place_mm: float = 1.0
    tyre_width_sigma_mm: float = 0.0
    load_mm: float = 0.0
    load_width_deg: tuple[float, float] = (18.0, 32.0)
    runout_mm: float = 0.0


def draw_vehicle(
    seed: int,
    spec: VehicleSpec | None = None,
    draw: VehicleDraw | None = None,
    yaw: float = 0.0,
    place_mm: tuple[float, float] = (0.0, 0.0),
) -> Vehicle:
    """Draw a vehicle; the same seed gives the same, wherever it stands and whatever it weighs."""
    spec, draw = spec or VehicleSpec(), draw or VehicleDraw()
    middles = _middles(spec, draw, np.random.default_rng([seed, 6]))
    corners: dict[str, Corner] = {}
    for number, wheel in enumerate(FOUR_WHEELS):
        rng = np.random.default_rng([seed, 7, number])
        front = wheel.startswith("front")
        camber, toe = (values[0 if front else 1] for values in (spec.camber, spec.toe))
        camber, toe = rng.normal((camber, toe), (2.0 * draw.angles, draw.angles))
        x, y, z = (float(c) for c in middles[number])
        width = spec.tyre_width_mm + draw.tyre_width_sigma_mm * rng.standard_normal()
        tilt = math.asin(0.5 * draw.runout_mm * rng.uniform(0.3, 1.0) / RUN_OUT_RADIUS_MM)
        spin, phase, second, rim = rng.uniform(0.0, 2.0 * math.pi, 4)
        wobble = None
        if draw.runout_mm:
            sizes = draw.runout_mm * rng.uniform(0.1, 0.3, 2)
            wobble = Wobble(float(sizes[0]), second, float(sizes[1]), rim)
        load = _load(draw, front, rng) if draw.load_mm else None
        pose = WheelPose(spin=spin, run_out=tilt, run_out_phase=phase)
        corners[wheel] = Corner(float(camber), float(toe), (x, y, z), float(width), pose, load, wobble)
    tyre = draw_tyre(np.random.default_rng([seed, 8]), spec.shape)
    return Vehicle(spec, corners, tyre, yaw, place_mm, seed)


def passing_vehicle(
    seed: int, number: int, draw: VehicleDraw, most_yaw: float = 0.0, most_offset_mm: float = 0.0
) -> Vehicle:
    """Return one of the vehicles that come one after the other, from 1, each standing askew as it happens to.

    Yaw, and both coordinates of its place, are even within ± their most (radians, millimetres).
    """
    rng = np.random.default_rng([seed, 10, number])
    yaw = float(rng.uniform(-most_yaw, most_yaw))
    x, y = (float(c) for c in rng.uniform(-most_offset_mm, most_offset_mm, 2))
    return draw_vehicle(int(rng.integers(2**32)), None, draw, yaw, (x, y))


def _middles(spec: VehicleSpec, draw: VehicleDraw, rng: np.random.Generator) -> Array:
    """Middles of four wheels (4, 3) whose axles' midpoints lie on X, as far before the origin as behind."""
    half = np.array([0.0, 0.5 * spec.tyre_width_mm, 0.0])
    nominal = [
        _nominal_place(spec, wheel) - (half if side_of(wheel) == "left" else -half) for wheel in FOUR_WHEELS
    ]
    drawn = np.array(nominal) + rng.normal(0.0, draw.place_mm, (4, 3))
    front, rear = drawn[:2].mean(axis=0), drawn[2:].mean(axis=0)
    along = front - rear
    back = -math.atan2(along[1], along[0])
    turn = RigidTransform.from_rotvec(np.array([0.0, 0.0, back]), np.zeros(3))
    middle = 0.5 * (front + rear) * [1.0, 1.0, 0.0]
    return np.asarray(turn.apply(drawn - middle))


def _load(draw: VehicleDraw, front: bool, rng: np.random.Generator) -> TyreLoad:
    bulge = draw.load_mm * (1.0 if front else 0.8) * rng.uniform(0.9, 1.1)
    width = float(rng.uniform(*draw.load_width_deg))
    return TyreLoad(
        bulge_mm=float(bulge),
        width_deg=width,
        shape="gaussian" if rng.uniform() < 0.5 else "wave",
        side_mm=float(bulge * rng.uniform(-0.2, 0.2)),
        side_width_deg=2.0 * width,
        longitudinal_mm=float(bulge * rng.uniform(-0.05, 0.05)),
        crest=float(rng.uniform(0.45, 0.65)),
    )
