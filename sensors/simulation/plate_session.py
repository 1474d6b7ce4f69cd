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
from sensors.formats.plate import PlateDescription, certified
from sensors.formats.plate_session import CERTIFICATE_FILE, PlateSession, SessionView
from sensors.formats.plate_truth import PlateTruth
from sensors.simulation.optics import Optics
from sensors.simulation.plate import PlateLight, PlateLook, plate_image
from sensors.simulation.render import SIMULATED_TIME

TILT = math.radians(10.0)
SHIFT_MM = 7.5
"""Half the pitch of our own plates."""


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
    """Return positions that make a strong calibration, the most important ones first; at most 9.

    Parameters
    ----------
    count
        How many.
    tilt
        Of the tilted ones, radians.
    shift_mm
        Along x and y, of the shifted ones. A plate that is smaller than a camera's field covers the field by
        larger ones.

    Notes
    -----
    Height on the stage separates focal length from distance; shifts by half a pitch put other marks at other
    places of the image, so that errors of marks do not pass for distortion; tilted views scale depth by the
    plate itself, which is better known over its width than the stage is over its travel. With all errors on,
    a wheel at 3° is then measured to 0.007′ RMS (10 rigs, joint adjustment), with seven heights alone to
    0.019′.

    Raises
    ------
    DegenerateInputError
        When `count` is not from 3 to 9.
    """
    s = shift_mm
    every = (
        PlatePosition("z0"),
        PlatePosition("z-30", (s, s, -30.0)),
        PlatePosition("z30", (0.0, 0.0, 30.0)),
        PlatePosition("tilted_1", tilt=(tilt, 0.0)),
        PlatePosition("tilted_2", tilt=(0.0, tilt)),
        PlatePosition("z-15", (-s, s, -15.0)),
        PlatePosition("z15", (s, -s, 15.0)),
        PlatePosition("tilted_3", tilt=(-tilt, 0.0)),
        PlatePosition("tilted_4", tilt=(0.0, -tilt)),
    )
    if not 3 <= count <= len(every):
        raise DegenerateInputError(field="views", expected=f"from 3 to {len(every)}", seen=str(count))
    return every[:count]


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
    true_plate = replace(plate.plate, points=true_points)
    cameras: dict[CameraKey, PosedCamera] = {}
    for head in calibration.heads:
        if head.name in heads:
            cameras[head.name, "left"], cameras[head.name, "right"] = head.cameras
    lights = {key: PlateLight(_top(of_light), spec.look.fall_off) for key in cameras}
    views, poses = [], {}
    for position in spec.positions:
        nominal = np.array(spec.centre_mm) + position.stage_mm
        off = spec.stage_errors * spec.stage_tolerance_mm * of_stage.uniform(-1.0, 1.0, 3)
        staged = RigidTransform.from_rotvec(np.array([*position.tilt, 0.0]), nominal + off)
        pose = position.rig_from_plate or staged
        noise = of_image.spawn(len(cameras))
        images: dict[CameraKey, Image] = {}
        for (key, camera), draw in zip(cameras.items(), noise, strict=True):
            images[key] = plate_image(
                true_plate, camera, pose, draw,
                look=spec.look, optics=spec.optics, light=lights[key], settings=spec.settings,
            )  # fmt: skip
        views.append(SessionView(position.name, nominal if position.on_stage else None, images))
        poses[position.name] = pose
    session = PlateSession(
        rig=calibration.rig,
        side=calibration.side,
        time_utc=time_utc,
        plate=plate,
        sizes={key: (camera.model.width, camera.model.height) for key, camera in cameras.items()},
        views=tuple(views),
        stage_tolerance_mm=spec.stage_tolerance_mm,
    )
    return session, PlateTruth(seed, plate.plate.indices, true_points, poses)


def _true_points(plate: Plate, spec: PlateSessionSpec, rng: np.random.Generator) -> Array:
    """Where the marks really are: evenly distributed, with the standard deviation that the plate states."""
    scale = math.sqrt(3.0) * np.array([spec.mark_errors, spec.mark_errors, spec.flatness_errors])
    return np.asarray(plate.points + scale * plate.sigma_mm * rng.uniform(-1.0, 1.0, plate.points.shape))


def _top(rng: np.random.Generator) -> tuple[float, float]:
    x, y = rng.uniform(-0.5, 0.5, 2)
    return float(x), float(y)
