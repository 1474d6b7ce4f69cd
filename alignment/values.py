"""The values that enter and leave `measure_wheel`."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from alignment.arrays import Array
from alignment.errors import DegenerateInputError
from alignment.geometry.cameras import PosedCamera
from alignment.geometry.transforms import RigidTransform

Image = NDArray[np.uint8] | NDArray[np.uint16]
Side = Literal["left", "right"]
SIDES: tuple[Side, Side] = ("left", "right")
SHARED_SIZE = 7
"""Numbers of a gauge frame as a whole, as in `Placing.shared_covariance`."""
VEHICLE_POSE_NAMES = tuple(f"vehicle_from_rig.{name}" for name in ("rx", "ry", "rz", "x_mm", "y_mm", "z_mm"))


@dataclass(frozen=True)
class HeadCalibration:
    """One stereo head of a rig: its name and its two posed cameras."""

    name: str
    left: PosedCamera
    right: PosedCamera

    @property
    def cameras(self) -> tuple[PosedCamera, PosedCamera]:
        """Left, right."""
        return self.left, self.right


@dataclass(frozen=True, eq=False)
class Placing:
    """How well a view of a gauge frame put a rig into the vehicle frame, and what all rigs of it share.

    Attributes
    ----------
    view
        Names the frame and when it was seen. Rigs of one view share what is wrong with the frame as a whole.
    pose_covariance
        (6, 6) of `RigCalibration.vehicle_from_rig`, as at the end of its covariance: marks, the plate's
        certificate, cameras where theirs is known, and what the rigs share.
    shared_covariance
        (7, 7) of what the rigs share: turn of the whole frame about X, Y and Z of the vehicle frame
        (radians), its shift (millimetres), and its length over the stated one, less one.
    """

    view: str
    pose_covariance: Array
    shared_covariance: Array

    def __post_init__(self) -> None:
        for name, size in (("pose_covariance", 6), ("shared_covariance", SHARED_SIZE)):
            matrix = getattr(self, name)
            if matrix.shape != (size, size) or not np.isfinite(matrix).all():
                raise DegenerateInputError(
                    field=name, expected=f"{size} × {size} finite numbers", seen=f"shape {matrix.shape}"
                )


@dataclass(frozen=True, eq=False)
class RigCalibration:
    """Everything a rig's cameras are known to be, in the rig frame.

    Attributes
    ----------
    id
        Identity of this calibration; each record carries it.
    rig
        Name of the rig, such as ``front_left``; a shot names its rig.
    side
        Side of the vehicle, ``left`` or ``right``.
    heads
        The heads, in the order in which a shot gives their images.
    vehicle_from_rig
        Pose of the rig in the vehicle frame (ISO 8855).
    vehicle_from_rig_measured
        True when a gauge measured it, False when it is nominal.
    covariance
        (P, P) joint covariance of all parameters where known, ordered as `parameter_names`; per camera:
        rotation about its own axes (3, radians, see `RigidTransform.perturbed`), centre in the rig frame (3,
        millimetres), then `CameraModel.parameters`; at last, where it was measured, `vehicle_from_rig`:
        rotation about the rig's axes (3, radians), position in the vehicle frame (3, millimetres).
    placing
        Of the view that measured `vehicle_from_rig`; None where that is not known, as of older calibrations:
        the rig is then taken to share nothing with others.
    """

    id: str
    rig: str
    side: Side
    heads: tuple[HeadCalibration, ...]
    vehicle_from_rig: RigidTransform
    vehicle_from_rig_measured: bool = False
    covariance: Array | None = None
    placing: Placing | None = None

    def __post_init__(self) -> None:
        if self.side not in ("left", "right"):
            raise DegenerateInputError(field="side", expected="'left' or 'right'", seen=f"'{self.side}'")
        if not self.heads:
            raise DegenerateInputError(field="heads", expected="at least one head", seen="none")
        size = len(self.parameter_names)
        if self.covariance is not None and self.covariance.shape != (size, size):
            raise DegenerateInputError(
                field="covariance",
                expected=f"a {size} × {size} matrix, one row per parameter",
                seen=f"shape {self.covariance.shape}",
            )

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the rows of `covariance`, such as ``head_1.left.rx`` and ``vehicle_from_rig.rx``."""
        return self.camera_parameter_names + (VEHICLE_POSE_NAMES if self.vehicle_from_rig_measured else ())

    @property
    def camera_parameter_names(self) -> tuple[str, ...]:
        """Names of the first rows of `covariance`, those of the cameras."""
        pose = ("rx", "ry", "rz", "cx_mm", "cy_mm", "cz_mm")
        return tuple(
            f"{head.name}.{side}.{name}"
            for head in self.heads
            for side, camera in (("left", head.left), ("right", head.right))
            for name in (*pose, *camera.model.parameter_names)
        )

    def without_head(self, index: int) -> RigCalibration:
        """Return the calibration of the other heads; their covariance is that part of the whole."""
        lost = tuple(f"{self.heads[index].name}.{side}." for side in ("left", "right"))
        kept = [k for k, name in enumerate(self.parameter_names) if not name.startswith(lost)]
        return replace(
            self,
            heads=tuple(head for k, head in enumerate(self.heads) if k != index),
            covariance=None if self.covariance is None else self.covariance[np.ix_(kept, kept)],
        )


def nominal_vehicle_from_rig(side: Side) -> RigidTransform:
    """Rotation of a rig whose axes lie along the vehicle's: z outboard, y up, x = y × z; no translation.

    On the left x points backward, on the right forward.
    """
    if side == "left":
        return RigidTransform(np.array([[-1.0, 0, 0], [0, 0, 1.0], [0, 1.0, 0]]), np.zeros(3))
    return RigidTransform(np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]]), np.zeros(3))


@dataclass(frozen=True, eq=False)
class StereoImages:
    """The two images of one head: (height, width), one channel, 8 or 16 bit, of one exposure."""

    left: Image
    right: Image


PlaneMethod = Literal["revolution", "plane", "ridges"]
"""How the tyre plane is found from the points; see `MeasureSettings`."""


@dataclass(frozen=True)
class MeasureSettings:
    """What the station's configuration may choose of the measurement.

    Attributes
    ----------
    depth_range_mm
        Lowest and highest z, rig frame, in which the tyre's surface may lie. Must cover the wheel's travel;
        narrower than the depth that one line spacing stands for, left and right lines match uniquely.
    method
        ``revolution``: surface of revolution with a free profile; ``plane``: robust plane, the simple
        alternative, which follows the relief of the sidewall and states some arcminutes for it; ``ridges``:
        plane through nine bends of the light lines on one circle, for comparison only, good to some
        arcminutes too.
    minimum_points
        Fewer accepted points per head than this refuse the measurement.
    maximum_angle
        Largest believable camber or toe, radians; beyond it the measurement is refused.
    coverage_factor
        k of the expanded uncertainty; 2 for about 95 %.
    allow_lost_head
        True lets the other heads measure when one of at least three is lost; the result is marked degraded.
    judge_heads
        False leaves it to the caller whether heads moved: the result then carries their signs. For exposures
        of a wheel that turns, of which all together tell an uneven tyre from a head that moved.
    """

    depth_range_mm: tuple[float, float] = (-60.0, 60.0)
    method: PlaneMethod = "revolution"
    minimum_points: int = 300
    maximum_angle: float = math.radians(10.0)
    coverage_factor: float = 2.0
    allow_lost_head: bool = False
    judge_heads: bool = True


class RefusalCode(enum.StrEnum):
    """Why a wheel was not measured."""

    WRONG_IMAGES = "wrong_images"
    HEAD_DARK = "head_dark"
    HEAD_SATURATED = "head_saturated"
    TOO_MANY_LINES = "too_many_lines"
    TOO_FEW_POINTS = "too_few_points"
    NO_CORRESPONDENCE = "no_correspondence"
    NOT_A_WHEEL = "not_a_wheel"
    HEAD_MOVED = "head_moved"
    OUTSIDE_VOLUME = "outside_volume"
    TOO_FEW_SHOTS = "too_few_shots"
    TURN_TOO_SHORT = "turn_too_short"
    INCONSISTENT_SHOTS = "inconsistent_shots"
    EXPOSURE_MISSING = "exposure_missing"
    EXPOSURE_DOUBLED = "exposure_doubled"
    ANOTHER_WHEEL = "another_wheel"
    NOT_SLOW = "not_slow"
    RIDE_HEIGHT = "ride_height"
    TOO_FEW_POSITIONS = "too_few_positions"
    SWEEP_TOO_SMALL = "sweep_too_small"
    NO_STEERING_AXIS = "no_steering_axis"


@dataclass(frozen=True)
class Refusal:
    """A measurement that could not be made; never true, so `if measurement:` reads well.

    Attributes
    ----------
    code
        For programs.
    reason
        For people: what was seen, and what to do.
    head
        Name of the head that is to blame, where it is one.
    """

    code: RefusalCode
    reason: str
    head: str | None = None

    def __bool__(self) -> bool:
        return False


@dataclass(frozen=True)
class HeadQuality:
    """What one head contributed, and whether its cameras still see along the same rows.

    Attributes
    ----------
    name
        Of the head.
    points, points_offered
        Line points used, and those that cross the epipolar lines well enough.
    residual_rms_mm
        RMS of its residuals, millimetres.
    row_px
        Epipolar residual: RMS over the view of the smooth part of the row differences of crosses of light
        lines, pixels; None where too few crosses were seen.
    row_sigma_px
        What noise and calibration make of it, one standard deviation.
    share_looked_at
        Of the line points of its images; below 1 where there were more than the program takes. It thins them
        evenly along all lines.
    line_width_px
        Of the left and the right image: standard deviation of the profile across its light lines, pixels. It
        grows when a camera or the projector loses its focus.
    line_strength
        Of the left and the right image: median over its lines of the light above the background, in a unit of
        its own (see `alignment.imaging.lines.LightLines.strength`). It sinks with projector, exposure and
        dirt on a window.
    """

    name: str
    points: int
    points_offered: int
    residual_rms_mm: float
    row_px: float | None = None
    row_sigma_px: float | None = None
    share_looked_at: float = 1.0
    line_width_px: tuple[float, float] | None = None
    line_strength: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class WheelReference:
    """The place of a wheel: where its axis meets the plane of the outermost ring of the sidewall.

    Attributes
    ----------
    point
        (3,) rig frame, millimetres.
    covariance
        (5, 5) joint covariance of camber and toe (radians) and of the point along the axes of the vehicle
        frame (millimetres): images, cameras, and the pose of the rig where a gauge measured it.
    """

    point: Array
    covariance: Array


@dataclass(frozen=True, eq=False)
class WheelMeasurement:
    """The tyre plane of one exposure.

    Attributes
    ----------
    camber, toe
        Radians, signs as the conventions say.
    camber_u, toe_u
        Standard uncertainties, radians. They cover image noise and model misfit, and the calibration where
        its covariance is known, with it the pose of the rig in the vehicle where a gauge measured that; not
        the run-out of the wheel, nor a nominal pose of the rig.
    angle_covariance
        (2, 2) covariance of (camber, toe), radians².
    normal
        (3,) outboard unit normal of the tyre plane, rig frame.
    centre
        (3,) where the axis meets the mean height of the sidewall, rig frame, millimetres.
    offset_mm
        Signed distance of the plane from the rig's origin along `normal`.
    points_used
        Points that carried weight.
    residual_rms_mm
        RMS of their residuals along the normal.
    heads
        Quality per head.
    method
        The fit that was used, and that it is a tyre plane: ``tyre_plane/revolution``, ``tyre_plane/plane`` or
        ``tyre_plane/ridges``.
    coverage_factor
        k of `camber_u95` and `toe_u95`.
    degraded
        True when a head was lost and the others measured alone.
    knock_evidence
        2 ln of the evidence that a camera or head moved since its calibration, or that pictures are mixed,
        over that nothing did: about −5 on an intact rig, above 2.5 suspect, above 20 refused; None where it
        was not judged.
    warning
        What is suspect, in words, and what to do; None where nothing is. The uncertainty then covers it.
    unseen
        (camber, toe), radians: by how much a movement of one camera or head since the calibration may change
        them at most and yet show in none of this shot's images (found with 95 % probability beyond); None
        where it was not judged. Not part of the uncertainty, which holds for the rig as calibrated.
    load_mm
        Most by which the weight that the tyre carries lifts or lowers its sidewall where the heads see it,
        millimetres; it is taken off the plane, and what is not known of it is in the uncertainty. None where
        the wheel shows no load.
    reference
        The wheel's place; None where the outermost ring of its sidewall was not seen, or the method does not
        fit the profile of the sidewall.
    load_covariance
        (2, 2) what of `angle_covariance` is not known of the load, radians²: it is the same while the wheel
        turns. None where the wheel shows no load.
    signs
        Of the heads, a `measure_heads.HeadSigns`, where they are not judged yet; None elsewhere.
    """

    camber: float
    toe: float
    angle_covariance: Array
    normal: Array
    centre: Array
    offset_mm: float
    points_used: int
    residual_rms_mm: float
    heads: tuple[HeadQuality, ...]
    method: str
    coverage_factor: float = 2.0
    degraded: bool = False
    knock_evidence: float | None = None
    warning: str | None = None
    unseen: tuple[float, float] | None = None
    load_mm: float | None = None
    reference: WheelReference | None = None
    load_covariance: Array | None = None
    signs: object | None = None
    outcome: str = field(default="measured", init=False)

    @property
    def camber_u(self) -> float:
        """Standard uncertainty of camber, radians."""
        return float(math.sqrt(self.angle_covariance[0, 0]))

    @property
    def toe_u(self) -> float:
        """Standard uncertainty of toe, radians."""
        return float(math.sqrt(self.angle_covariance[1, 1]))

    @property
    def camber_u95(self) -> float:
        """Expanded uncertainty of camber, radians."""
        return self.coverage_factor * self.camber_u

    @property
    def toe_u95(self) -> float:
        """Expanded uncertainty of toe, radians."""
        return self.coverage_factor * self.toe_u
