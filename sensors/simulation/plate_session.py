"""A rendered plate session: a plate with its errors, on a stage with its errors, seen by all cameras."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from datetime import datetime

import numpy as np

from alignment.arrays import Array
from alignment.calibration import CameraKey
from alignment.errors import DegenerateInputError
from alignment.geometry import PosedCamera, RigidTransform
from alignment.imaging import Plate
from alignment.values import Image, RigCalibration
from sensors.camera import CameraSettings
from sensors.formats.planned_views import SHIFT_MM, TILT, plate_plan
from sensors.formats.plate import PlateDescription, certified
from sensors.formats.plate_session import CERTIFICATE_FILE, PlateSession, SessionView
from sensors.formats.plate_truth import PlateTruth
from sensors.simulation.optics import Optics
from sensors.simulation.plate import PlateLight, PlateLook, plate_image
from sensors.simulation.render import SIMULATED_TIME


@dataclass(frozen=True)
class PlatePosition:
    """Where a plate is put.

    Attributes
    ----------
    name
        Name of the view.
    stage_mm
        Nominal position of the plate's origin, counted from where the session is centred.
    tilt
        Rotation vector of the plate about its x and y axes, radians. A tilted plate is not on the stage: the
        session does not tell its pose.
    rig_from_plate
        True pose of a plate that is on no stage, such as one of a gauge frame; the others do not count then.
    """

    name: str
    stage_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tilt: tuple[float, float] = (0.0, 0.0)
    rig_from_plate: RigidTransform | None = None

    @property
    def on_stage(self) -> bool:
        """Whether the session tells its position."""
        return self.rig_from_plate is None and not any(self.tilt)


def plate_positions(
    count: int = 7, tilt: float = TILT, shift_mm: float = SHIFT_MM
) -> tuple[PlatePosition, ...]:
    """Return the positions of `plate_plan`."""
    return tuple(
        PlatePosition(view.name, view.stage_mm, view.tilt) for view in plate_plan(count, tilt, shift_mm)
    )


@dataclass(frozen=True)
class PlateSessionSpec:
    """How a session is made.

    Attributes
    ----------
    positions
        Of the plate, one view each.
    centre_mm
        Where the plate is when the positions are at zero, rig frame; the session's stage counts from the
        rig's origin.
    heads
        Names of the heads that look; all when None.
    mark_errors, flatness_errors, stage_errors
        Errors are evenly distributed over so many times what the plate's description and the stage's
        tolerance allow; 0 for none.
    stage_tolerance_mm
        What the session says of its stage.
    certificate_sigma_mm
        When given, the plate comes with a certificate that states the marks with this (normal) error.
    look, optics, settings
        Of plate and cameras.
    """

    positions: tuple[PlatePosition, ...] = field(default_factory=plate_positions)
    centre_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    heads: tuple[str, ...] | None = None
    mark_errors: float = 1.0
    flatness_errors: float = 0.0
    stage_errors: float = 1.0
    stage_tolerance_mm: float = 0.01
    certificate_sigma_mm: float | None = None
    look: PlateLook = field(default_factory=PlateLook)
    optics: Optics = field(default_factory=Optics)
    settings: CameraSettings = field(default_factory=CameraSettings)


def simulate_plate_session(
    spec: PlateSessionSpec,
    plate: PlateDescription,
    calibration: RigCalibration,
    rng: np.random.Generator,
    *,
    seed: int = 0,
    time_utc: datetime = SIMULATED_TIME,
) -> tuple[PlateSession, PlateTruth]:
    """Take images of a plate with all cameras of a rig.

    Parameters
    ----------
    spec
        How the session is made.
    plate
        As its maker describes it; the simulated one deviates within what that allows.
    calibration
        The true cameras.
    rng
        Draws errors, light and noise; a session with more views begins with the same ones.
    seed
        What `rng` was made from, for the record.
    time_utc
        When it was; aware.

    Returns
    -------
    PlateSession, PlateTruth
        What a calibration is made from, and what it must not know.

    Raises
    ------
    DegenerateInputError
        When `spec` names heads that the rig does not have.
    """
    before = PlateBeforeRig.of(spec, plate, calibration, rng)
    views, poses = [], {}
    for position in spec.positions:
        nominal, pose = before.put(position)
        noise = before.of_image.spawn(len(before.cameras))
        images: dict[CameraKey, Image] = {}
        for key, draw in zip(before.cameras, noise, strict=True):
            images[key] = before.image(key, pose, draw, spec.settings)
        views.append(SessionView(position.name, nominal if position.on_stage else None, images))
        poses[position.name] = pose
    cameras = before.cameras
    session = PlateSession(
        rig=calibration.rig,
        side=calibration.side,
        time_utc=time_utc,
        plate=before.plate,
        sizes={key: (camera.model.width, camera.model.height) for key, camera in cameras.items()},
        views=tuple(views),
        stage_tolerance_mm=spec.stage_tolerance_mm,
    )
    return session, PlateTruth(seed, plate.plate.indices, before.true_plate.points, poses)


@dataclass(frozen=True, eq=False)
class PlateBeforeRig:
    """A plate with its errors before the cameras of a rig, in the light that falls on it.

    Attributes
    ----------
    spec
        How it is made.
    plate
        As it is described, with its certificate where it has one.
    true_plate
        As it is.
    cameras, lights
        Of the heads that look.
    of_stage, of_image
        Draw the errors of its positions, and the noise of images.
    """

    spec: PlateSessionSpec
    plate: PlateDescription
    true_plate: Plate
    cameras: dict[CameraKey, PosedCamera]
    lights: dict[CameraKey, PlateLight]
    of_stage: np.random.Generator
    of_image: np.random.Generator

    @classmethod
    def of(
        cls,
        spec: PlateSessionSpec,
        plate: PlateDescription,
        calibration: RigCalibration,
        rng: np.random.Generator,
    ) -> PlateBeforeRig:
        """Draw plate and light; errors as `simulate_plate_session`."""
        known = [head.name for head in calibration.heads]
        heads = known if spec.heads is None else list(spec.heads)
        if not heads or not set(heads) <= set(known):
            raise DegenerateInputError(
                field="heads", expected=f"heads among {', '.join(known)}", seen=", ".join(heads) or "none"
            )
        of_plate, of_stage, of_light, of_image = rng.spawn(4)
        true_points = _true_points(plate.plate, spec, of_plate)
        if spec.certificate_sigma_mm is not None:
            stated = true_points + of_plate.normal(0.0, spec.certificate_sigma_mm, true_points.shape)
            sigma = np.full(len(stated), spec.certificate_sigma_mm)
            plate = certified(plate.file, stated, sigma, CERTIFICATE_FILE)
        cameras: dict[CameraKey, PosedCamera] = {}
        for head in calibration.heads:
            if head.name in heads:
                cameras[head.name, "left"], cameras[head.name, "right"] = head.cameras
        lights = {key: PlateLight(_top(of_light), spec.look.fall_off) for key in cameras}
        true_plate = replace(plate.plate, points=true_points)
        return cls(spec, plate, true_plate, cameras, lights, of_stage, of_image)

    def put(self, position: PlatePosition) -> tuple[Array, RigidTransform]:
        """Put the plate there: where the stage says it is (3,), and its true pose in the rig frame."""
        spec = self.spec
        nominal = np.array(spec.centre_mm) + position.stage_mm
        off = spec.stage_errors * spec.stage_tolerance_mm * self.of_stage.uniform(-1.0, 1.0, 3)
        staged = RigidTransform.from_rotvec(np.array([*position.tilt, 0.0]), nominal + off)
        return nominal, position.rig_from_plate or staged

    def image(
        self, key: CameraKey, pose: RigidTransform, rng: np.random.Generator, settings: CameraSettings
    ) -> Image:
        """What a camera sees of the plate in this pose."""
        return plate_image(
            self.true_plate, self.cameras[key], pose, rng,
            look=self.spec.look, optics=self.spec.optics, light=self.lights[key], settings=settings,
        )  # fmt: skip


def _true_points(plate: Plate, spec: PlateSessionSpec, rng: np.random.Generator) -> Array:
    """Where the marks really are: evenly distributed, with the standard deviation that the plate states."""
    scale = math.sqrt(3.0) * np.array([spec.mark_errors, spec.mark_errors, spec.flatness_errors])
    return np.asarray(plate.points + scale * plate.sigma_mm * rng.uniform(-1.0, 1.0, plate.points.shape))


def _top(rng: np.random.Generator) -> tuple[float, float]:
    x, y = rng.uniform(-0.5, 0.5, 2)
    return float(x), float(y)
