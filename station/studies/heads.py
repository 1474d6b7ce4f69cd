"""One simulated stereo head before a plate on a stage: what the studies of whole heads have in common."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from alignment.arrays import Array, Index
from alignment.calibration import (
    AdjustmentSettings,
    CalibrationInput,
    CameraKey,
    Known,
    OneCameraMethod,
    PlateView,
    adjust,
)
from alignment.errors import DegenerateInputError
from alignment.geometry import CameraModel, PosedCamera, RigidTransform
from alignment.imaging import MarkObservations, PlateRefusal, find_marks, identify_marks, locate_marks
from alignment.stereo import triangulate
from alignment.values import HeadCalibration, RigCalibration, nominal_vehicle_from_rig
from sensors.formats import PlateDescription, PlateFile, PlateSession, PlateTruth, describe_plate
from sensors.simulation import PlatePosition, PlateSessionSpec, simulate_plate_session

_HEAD = "head"
LEFT: CameraKey = (_HEAD, "left")
RIGHT: CameraKey = (_HEAD, "right")
_SIZE = (752, 582)
SCALE_X, SCALE_Y = 116.589, 120.248
"""Pixels per millimetre of the CV-M50, CCIR."""
NOMINAL = Known(aspect=SCALE_X / SCALE_Y)
"""What a data sheet says of it; the principal point is taken to be in the middle."""


@dataclass(frozen=True)
class HeadSpec:
    """Nominal geometry of a head before a plate, and how far a built one deviates.

    Attributes
    ----------
    focal_mm, coefficients
        Of both lenses; `coefficients` of Brown's model.
    baseline_mm, distance_mm
        Between the cameras; from the plate to the middle between them.
    convergence
        Angle between the optical axes, radians.
    direction, position_mm, centre_px, focal
        Standard deviations of a camera's axes (radians each), its centre, its principal point, its focal
        lengths (relative).
    lens
        Standard deviations of the coefficients.
    """

    focal_mm: float
    baseline_mm: float
    distance_mm: float
    coefficients: tuple[float, ...]
    lens: tuple[float, ...]
    convergence: float = 0.0
    direction: float = math.radians(0.6)
    position_mm: float = 1.0
    centre_px: float = 5.0
    focal: float = 0.006


def build_head(spec: HeadSpec, rng: np.random.Generator) -> RigCalibration:
    """True cameras of a head that deviates from nominal; its frame is the plate's at the stage's zero."""
    cameras = []
    for side in (-1.0, 1.0):
        # The cameras look along −z, y of the image down; a converging one turns towards the middle.
        turned = Rotation.from_euler("xy", [math.pi, side * spec.convergence / 2])
        model = CameraModel(
            *_SIZE,
            SCALE_X * spec.focal_mm * (1.0 + rng.normal(0.0, spec.focal)),
            SCALE_Y * spec.focal_mm * (1.0 + rng.normal(0.0, spec.focal)),
            (_SIZE[0] - 1) / 2 + rng.normal(0.0, spec.centre_px),
            (_SIZE[1] - 1) / 2 + rng.normal(0.0, spec.centre_px),
            "brown",
            tuple(c + s * rng.normal() for c, s in zip(spec.coefficients, spec.lens, strict=True)),
        )
        centre = np.array([side * spec.baseline_mm / 2, 0.0, spec.distance_mm])
        pose = RigidTransform(turned.as_matrix(), centre).perturbed(
            rng.normal(0.0, spec.direction, 3), rng.normal(0.0, spec.position_mm, 3)
        )
        cameras.append(PosedCamera(model, pose))
    return RigCalibration(
        "true", "study", "left", (HeadCalibration(_HEAD, *cameras),), nominal_vehicle_from_rig("left")
    )


def ringed_plate(marks: int, pitch_mm: float, diameter_mm: float) -> PlateDescription:
    """Plate of marks × marks (odd) about its middle, three of them rings there; errors ±0.01 mm."""
    half = marks // 2
    return describe_plate(
        PlateFile.model_validate(
            {
                "schema": "truewheel.plate/1",
                "name": "study",
                "columns": (-half, half),
                "rows": (-half, half),
                "pitch_mm": pitch_mm,
                "mark_diameter_mm": diameter_mm,
                "hollow_diameter_mm": 0.4 * diameter_mm,
                "hollow_marks": ({"marks": ((-1, 0), (1, 0), (-1, 1))},),
            }
        )
    )


def take_images(
    true: RigCalibration,
    plate: PlateDescription,
    stages_mm: Sequence[tuple[float, float, float]],
    rng: np.random.Generator,
) -> tuple[PlateSession, PlateTruth]:
    """Images of the plate at stage positions; marks, flatness and stage off by up to ±0.01 mm."""
    positions = tuple(PlatePosition(f"view {k}", stage) for k, stage in enumerate(stages_mm))
    spec = PlateSessionSpec(positions=positions, flatness_errors=1.0)
    return simulate_plate_session(spec, plate, true, rng)


def observe_images(session: PlateSession, methods: Sequence[str]) -> dict[str, CalibrationInput]:
    """Marks of every image, by each method.

    Parameters
    ----------
    session
        Images of one head.
    methods
        Of `alignment.imaging.mark_location`; ``centroid/entropy`` is ``centroid`` with that threshold.

    Raises
    ------
    DegenerateInputError
        When the plate is not recognised in an image.
    """
    plate = session.plate.seen_by(_HEAD)
    views: dict[str, list[PlateView]] = {method: [] for method in methods}
    for view in session.views:
        seen: dict[str, dict[CameraKey, MarkObservations]] = {method: {} for method in methods}
        for key, image in view.images.items():
            rough = find_marks(image)
            for method in methods:
                way, _, threshold = method.partition("/")
                marks = locate_marks(image, rough, way, threshold=threshold or "otsu")
                found = identify_marks(marks, plate)
                if isinstance(found, PlateRefusal):
                    raise DegenerateInputError(
                        field=f"{view.name}, {' '.join(key)}", expected="the plate", seen=found.reason
                    )
                seen[method][key] = found
        for method in methods:
            views[method].append(PlateView(view.name, view.stage_mm, seen[method]))
    return {
        method: CalibrationInput(plate, tuple(views[method]), dict(session.sizes), session.stage_sigma_mm)
        for method in methods
    }


def split(data: CalibrationInput, count: int) -> tuple[CalibrationInput, tuple[PlateView, ...]]:
    """Return the input with its first `count` views, and the other views."""
    return replace(data, views=data.views[:count]), data.views[count:]


def places(data: CalibrationInput, view: PlateView) -> Array:
    """Where plate and stage say the plate's marks are, (M, 3) mm, head frame.

    Raises
    ------
    DegenerateInputError
        For a view without stage.
    """
    if view.stage_mm is None:
        raise DegenerateInputError(field=view.name, expected="a plate on the stage", seen="one held by hand")
    return data.plate.points + view.stage_mm


def calibrate_each(data: CalibrationInput, method: OneCameraMethod) -> dict[CameraKey, PosedCamera]:
    """Each camera by itself, from all views, stage and plate taken for exact.

    Raises
    ------
    DegenerateInputError
        As the method.
    """
    cameras = {}
    for key, size in data.sizes.items():
        points = np.concatenate([places(data, view)[view.observations[key].marks] for view in data.views])
        pixels = np.concatenate([view.observations[key].pixels for view in data.views])
        cameras[key] = method(points, pixels, size, NOMINAL).camera
    return cameras


def calibrate_jointly(data: CalibrationInput, model: str = "brown5") -> dict[CameraKey, PosedCamera]:
    """Both cameras together, with plate and stage as unknowns under their uncertainty."""
    return adjust(data, AdjustmentSettings(model=model)).cameras


def measured_points(cameras: Mapping[CameraKey, PosedCamera], view: PlateView) -> tuple[Index, Array]:
    """Rows (K,) of the marks that both cameras see in a view, and where they measure them, (K, 3) mm."""
    left, right = view.observations[LEFT], view.observations[RIGHT]
    marks, in_left, in_right = np.intersect1d(left.marks, right.marks, return_indices=True)
    points, _ = triangulate(cameras[LEFT], cameras[RIGHT], left.pixels[in_left], right.pixels[in_right])
    return marks, points
