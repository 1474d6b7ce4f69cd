"""Nominal rigs, and rigs as built: heads around the wheel, cameras that look along the axis, projectors."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from alignment.errors import DegenerateInputError
from alignment.geometry import CameraModel, PosedCamera, RigidTransform
from alignment.values import HeadCalibration, RigCalibration, Side, nominal_vehicle_from_rig
from sensors.simulation.projector import LinePattern, Projector


@dataclass(frozen=True)
class Tolerances:
    """Standard deviations with which a rig is built.

    Attributes
    ----------
    direction, position_mm
        Of a camera's axes, radians each, and of its centre, each coordinate.
    focal, centre_px
        Relative, of the focal length; of the principal point, each coordinate.
    distortion
        Relative, of the first coefficient.
    """

    direction: float = math.radians(0.6)
    position_mm: float = 1.0
    focal: float = 0.006
    centre_px: float = 8.0
    distortion: float = 0.1


MEGAPIXEL_CAMERA = CameraModel(
    1280, 1024, 3000.0, 3000.0, 639.5, 511.5, "brown", (-0.08, 0.01, 0.0, 0.0, 0.0)
)
CCIR_CAMERA = CameraModel(752, 582, 15.2 * 116.589, 15.2 * 120.248, 375.5, 290.5, "division", (-0.08,))


@dataclass(frozen=True)
class RigSpec:
    """Nominal geometry of a rig: heads around the wheel.

    A head's cameras look straight at the wheel; seen from the wheel's centre their image's y axis points
    outward, and the left camera is where x is smaller.

    Attributes
    ----------
    camera
        Nominal intrinsic parameters of every camera.
    heads, head_radius_mm, distance_mm, baseline_mm
        How many heads; where their middles stand, radius and height z over the wheel; spacing of the cameras.
    projectors
        ``per_head``: one between each head's cameras, aligned with them; ``central``: one, on the rig's axis.
    pattern
        What a projector draws, sizes at `distance_mm` (``per_head``) or `central_distance_mm`.
    central_distance_mm
        Height of the central projector over the wheel.
    projector_level
        See `Projector.level`.
    tolerances
        How far rigs as built deviate.
    angles
        Polar angles of the heads about z of the rig, radians; the top is a quarter turn. Empty: they stand
        evenly, the first on top.
    """

    camera: CameraModel = MEGAPIXEL_CAMERA
    heads: int = 3
    head_radius_mm: float = 266.0
    distance_mm: float = 400.0
    baseline_mm: float = 80.0
    projectors: Literal["per_head", "central"] = "per_head"
    pattern: LinePattern = field(default_factory=LinePattern)
    central_distance_mm: float = 700.0
    projector_level: float = 8.0
    tolerances: Tolerances = field(default_factory=Tolerances)
    angles: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if self.angles and len(self.angles) != self.heads:
            raise DegenerateInputError(
                field="angles", expected=f"one for each of {self.heads} heads", seen=str(len(self.angles))
            )

    def rig_from_head(self, index: int) -> RigidTransform:
        """Nominal pose of a head, with the axes of its cameras; origin midway between them."""
        angle = self.angles[index] if self.angles else math.pi / 2 + index * 2 * math.pi / self.heads
        outward = np.array([math.cos(angle), math.sin(angle), 0.0])
        inboard = np.array([0.0, 0.0, -1.0])
        rotation = np.column_stack([np.cross(outward, inboard), outward, inboard])
        return RigidTransform(rotation, self.head_radius_mm * outward + [0.0, 0.0, self.distance_mm])


DENSE_PATTERN = LinePattern(
    columns=21, rows=15, column_pitch_mm=9.0, row_pitch_mm=10.0, width_mm=0.9, edge_mm=0.2
)
CENTRAL_PATTERN = LinePattern(columns=49, rows=49, column_pitch_mm=14.0, row_pitch_mm=14.0)

RIG_SPECS = {
    "standard": RigSpec(),
    "dense": RigSpec(pattern=DENSE_PATTERN),
    "central": RigSpec(projectors="central", pattern=CENTRAL_PATTERN),
    "upper": RigSpec(angles=(math.pi / 6, math.pi / 2, 5 * math.pi / 6)),
    "turned": RigSpec(angles=(math.pi / 3, math.pi, 5 * math.pi / 3)),
    "ccir": RigSpec(camera=CCIR_CAMERA, tolerances=replace(Tolerances(), centre_px=5.0)),
    "lifted": RigSpec(angles=(math.pi / 2, 13 * math.pi / 12, 23 * math.pi / 12)),
}
"""Rigs by name; ``ccir`` has the 752 × 582 cameras of the thesis with a 15.2 mm lens.

Heads stand at 90°, 210° and 330°; further from the road at 30°, 90° and 150° (``upper``), or at 60°, 180° and
300° (``turned``); with only the lower ones 15° higher, at 90°, 195° and 345° (``lifted``).
"""


def _build_camera(nominal: PosedCamera, tolerances: Tolerances, rng: np.random.Generator) -> PosedCamera:
    model = nominal.model
    focal = 1.0 + rng.normal(0.0, tolerances.focal)
    squeeze = 1.0 + rng.normal(0.0, tolerances.focal / 20.0)
    first = model.coefficients[0] * (1.0 + rng.normal(0.0, tolerances.distortion))
    coefficients = (first, *model.coefficients[1:])
    if model.model == "brown":
        decentering = tuple(rng.normal(0.0, 1e-4, 2))
        coefficients = (*coefficients[:2], *decentering, *coefficients[4:])
    built = replace(
        model,
        fx=model.fx * focal,
        fy=model.fy * focal * squeeze,
        cx=model.cx + rng.normal(0.0, tolerances.centre_px),
        cy=model.cy + rng.normal(0.0, tolerances.centre_px),
        coefficients=coefficients,
    )
    pose = nominal.rig_from_camera.perturbed(
        rng.normal(0.0, tolerances.direction, 3), rng.normal(0.0, tolerances.position_mm, 3)
    )
    return PosedCamera(built, pose)


def build_rig(spec: RigSpec, rig_name: str, side: Side, rng: np.random.Generator) -> RigCalibration:
    """Build a rig with true cameras that deviate from nominal as `spec.tolerances` says."""
    heads = []
    for index in range(spec.heads):
        rig_from_head = spec.rig_from_head(index)
        cameras = []
        for x in (-spec.baseline_mm / 2, spec.baseline_mm / 2):
            head_from_camera = RigidTransform(np.eye(3), np.array([x, 0.0, 0.0]))
            nominal = PosedCamera(spec.camera, rig_from_head @ head_from_camera)
            cameras.append(_build_camera(nominal, spec.tolerances, rng))
        heads.append(HeadCalibration(f"head_{index + 1}", *cameras))
    identity = f"simulated-{rig_name}-{int(rng.integers(2**32)):08x}"
    return RigCalibration(identity, rig_name, side, tuple(heads), nominal_vehicle_from_rig(side))


def build_projectors(spec: RigSpec, rng: np.random.Generator) -> tuple[Projector, ...]:
    """Build the rig's projectors, a degree and some millimetres out of place as real ones are."""
    if spec.projectors == "central":
        facing = RigidTransform(
            spec.rig_from_head(0).rotation, np.array([0.0, 0.0, spec.central_distance_mm])
        )
        poses, distance = [facing], spec.central_distance_mm
    else:
        poses, distance = [spec.rig_from_head(index) for index in range(spec.heads)], spec.distance_mm
    return tuple(
        Projector(
            rig_from_projector=pose.perturbed(rng.normal(0.0, math.radians(0.7), 3), rng.normal(0.0, 2.0, 3)),
            pattern=spec.pattern,
            distance_mm=distance,
            level=spec.projector_level,
            focus_mm=distance + 5.0,
        )
        for pose in poses
    )
