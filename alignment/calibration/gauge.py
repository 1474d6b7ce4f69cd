"""Where a rig stands in the vehicle: the pose of a gauge plate in the rig, and of that plate in the vehicle.

The cameras are held as calibrated; the plate's pose and the deviations of its marks are adjusted to what all
cameras see of it. The errors of the cameras are carried along (the consider estimate of Schmidt 1966), with
their correlation to the pose: what a calibration gets wrong for the plate it gets wrong for the wheel too,
and much of that cancels.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from alignment.arrays import Array
from alignment.believable import LARGEST_MOUNTING, LARGEST_SHIFT, LARGEST_TURN, pose_slip, turn_from_nominal
from alignment.calibration.adjustment import AdjustmentSettings, Solution, solve
from alignment.calibration.check import check_with_plate
from alignment.calibration.equations import normal_equations
from alignment.calibration.observations import CalibrationInput, CameraKey, PlateView, cameras_of_rig
from alignment.calibration.prediction import predict_angle_uncertainty
from alignment.calibration.problem import LOCAL, POSE, Priors, Problem, build_problem, initial_state
from alignment.calibration.projection import INTRINSICS
from alignment.calibration.start import camera_from_plate
from alignment.errors import DegenerateInputError
from alignment.geometry.cameras import PosedCamera
from alignment.geometry.transforms import RigidTransform, cross_matrices
from alignment.units import ARCMIN
from alignment.values import SHARED_SIZE, Placing, RigCalibration
from alignment.vehicle.angles import camber_toe
from alignment.vehicle.placed import pose_by_frame

_COVERAGE_FACTOR = 2.0
_OUTBOARD = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class CertifiedPlate:
    """What a gauge frame's certificate says of one of its plates.

    Attributes
    ----------
    vehicle_from_plate
        Its pose in the vehicle frame.
    position_sigma_mm
        Standard uncertainty of each coordinate of its origin.
    angle_sigma
        Standard uncertainty of its rotation about each of its axes, radians.
    view
        Names the frame and when it was seen; the same for all rigs that saw it then.
    shared_covariance
        (7, 7) of the frame as a whole, as in `Placing`.
    """

    vehicle_from_plate: RigidTransform
    position_sigma_mm: float
    angle_sigma: float
    view: str = "gauge frame"
    shared_covariance: Array = field(default_factory=lambda: np.zeros((SHARED_SIZE, SHARED_SIZE)))


@dataclass(frozen=True, eq=False)
class PlacedRig:
    """A rig whose pose in the vehicle was measured.

    Attributes
    ----------
    calibration
        The given one with that pose, and with its covariance where that of the cameras is known.
    rig_from_plate
        Pose of the plate in the rig frame.
    pose_covariance
        (6, 6) of `vehicle_from_rig` (rotation about the rig's axes, position in the vehicle frame): marks,
        certificate, the frame as a whole and, where known, cameras.
    transfer_covariance
        (6, 6) the same without the certificate.
    marks
        Marks that each camera saw.
    rms_px
        RMS length of the residuals that carry weight, pixels.
    noise_scale
        Residuals of each camera over what mark finding states.
    outliers
        Share of observations without weight.
    camber_change, toe_change
        What the new pose changes of the angles of a wheel, radians.
    was_measured
        Whether the pose it replaces was measured too.
    turn_from_nominal
        Angle between the measured and the nominal pose, radians.
    scale_reason
        The sentence that names the plate's pitch where all cameras see its marks too far apart, or too near,
        by one factor; None otherwise.
    """

    calibration: RigCalibration
    rig_from_plate: RigidTransform
    pose_covariance: Array
    transfer_covariance: Array
    marks: dict[CameraKey, int]
    rms_px: float
    noise_scale: dict[CameraKey, float]
    outliers: float
    camber_change: float
    toe_change: float
    turn_from_nominal: float
    was_measured: bool = False
    scale_reason: str | None = None


@dataclass(frozen=True)
class PlacingLimits:
    """What the placing of a rig must reach.

    Attributes
    ----------
    marks
        Fewest marks of each camera.
    noise_scale
        Largest residuals of a camera over what mark finding states; the calibration's errors count.
    outliers
        Largest share of observations without weight.
    transfer_u95
        Largest expanded uncertainty of camber and toe that comes from seeing the plate, radians.
    turn_from_nominal
        Largest believable angle between the rig's axes and the vehicle's, radians.
    usual_turn
        Above it that angle needs a reason.
    change
        Above it a change of camber or toe from an earlier measured pose needs a reason, radians.
    """

    marks: int = 20
    noise_scale: float = 6.0
    outliers: float = 0.05
    transfer_u95: float = 0.1 * ARCMIN
    turn_from_nominal: float = LARGEST_TURN
    usual_turn: float = LARGEST_MOUNTING
    change: float = LARGEST_SHIFT


def place_rig(data: CalibrationInput, calibration: RigCalibration, certified: CertifiedPlate) -> PlacedRig:
    """Measure the pose of a rig in the vehicle frame from one view of a gauge plate.

    Parameters
    ----------
    data
        The plate and what each camera saw of it: one view, in an unknown pose.
    calibration
        The cameras of the rig.
    certified
        The plate in the vehicle.

    Raises
    ------
    DegenerateInputError
        When there is not exactly one view, its stage position is given, its cameras are not those of the
        calibration, or the marks do not determine the plate's pose.
    """
    cameras = _cameras(data, calibration)
    view = _only_view(data)
    marks = {key: len(view.observations[key].marks) if key in view.observations else 0 for key in cameras}
    best = max(marks, key=lambda key: marks[key])
    if not marks[best]:
        raise DegenerateInputError(field=view.name, expected="marks of the gauge plate", seen="none")
    start = cameras[best].rig_from_camera @ camera_from_plate(
        data.plate, cameras[best].model, view.observations[best]
    )
    # All cameras are held, so the lens model that is named is that of none.
    problem = build_problem(
        data, cameras, "brown5", Priors(), fixed_cameras=frozenset(cameras), frame_is_known=True
    )
    settings = AdjustmentSettings(least_noise_scale=1.0)
    solution = solve(problem, initial_state(problem, cameras, [start]), settings)
    found = RigidTransform(solution.state.view_rotations[0], solution.state.view_shifts[0])
    by_cameras = _pull_of_cameras(problem, solution, list(cameras.values()))

    vehicle_from_rig = certified.vehicle_from_plate @ found.inverse()
    turn = _by_plate_in_rig(found, vehicle_from_rig)
    stated = _by_plate_in_vehicle(found, certified.vehicle_from_plate)
    known = calibration.covariance
    own = turn @ solution.covariance @ turn.T
    sigmas = np.array([certified.angle_sigma] * 3 + [certified.position_sigma_mm] * 3)
    of_frame = pose_by_frame(vehicle_from_rig)
    of_certificate = (stated * sigmas**2) @ stated.T + of_frame @ certified.shared_covariance @ of_frame.T
    covariance = None
    if known is not None:
        size = len(calibration.camera_parameter_names)
        cross = turn @ by_cameras @ known[:size, :size]
        own = own + cross @ (turn @ by_cameras).T
        covariance = np.block([[known[:size, :size], cross.T], [cross, own + of_certificate]])
        covariance = 0.5 * (covariance + covariance.T)
    placed = replace(
        calibration,
        vehicle_from_rig=vehicle_from_rig,
        vehicle_from_rig_measured=True,
        covariance=covariance,
        placing=Placing(certified.view, own + of_certificate, certified.shared_covariance),
    )
    before, after = (
        camber_toe(pose.apply_vectors(_OUTBOARD), calibration.side)
        for pose in (calibration.vehicle_from_rig, vehicle_from_rig)
    )
    pixels = np.linalg.solve(problem.whitening, solution.at.residuals[..., None])[..., 0]
    squares = np.square(pixels).sum(axis=1)
    return PlacedRig(
        calibration=placed,
        rig_from_plate=found,
        pose_covariance=own + of_certificate,
        transfer_covariance=own,
        marks=marks,
        rms_px=math.sqrt(float(solution.weights @ squares / solution.weights.sum())),
        noise_scale={key: float(scale) for key, scale in zip(data.cameras, solution.scales, strict=True)},
        outliers=float((solution.weights < 0.5).mean()),
        camber_change=after[0] - before[0],
        toe_change=after[1] - before[1],
        turn_from_nominal=turn_from_nominal(vehicle_from_rig, calibration.side),
        was_measured=calibration.vehicle_from_rig_measured,
        scale_reason=None
        if min(marks.values()) < PlacingLimits().marks
        else check_with_plate(data, calibration).scale_reason,
    )


def _only_view(data: CalibrationInput) -> PlateView:
    """Return the one view of the gauge plate."""
    if len(data.views) != 1 or data.views[0].stage_mm is not None:
        raise DegenerateInputError(
            field="views",
            expected="one view of the gauge plate, its stage position null",
            seen=", ".join(
                f"{v.name} at {'an unknown pose' if v.stage_mm is None else v.stage_mm.tolist()}"
                for v in data.views
            ),
        )
    return data.views[0]


def transfer_u95(placed: PlacedRig) -> float:
    """Expanded uncertainty, radians, of the larger of camber and toe that comes from seeing the plate."""
    # A wheel's outboard normal is near z: turns about x and y move it.
    return _COVERAGE_FACTOR * math.sqrt(float(np.diag(placed.transfer_covariance)[:2].max()))


def judge_placing(placed: PlacedRig, limits: PlacingLimits | None = None) -> str | None:
    """None when a placing is good, else the sentence that says what is wrong and what to do."""
    limits = limits or PlacingLimits()
    for key, count in placed.marks.items():
        if count < limits.marks:
            return (
                f"{' '.join(key)} saw {count} marks of the gauge plate, at least {limits.marks} are needed; "
                "check that the plate fills its field"
            )
    if placed.turn_from_nominal > limits.turn_from_nominal:
        slip = pose_slip(placed.calibration.vehicle_from_rig, placed.calibration.side)
        return (
            f"the rig would be turned by {math.degrees(placed.turn_from_nominal):.1f}° against the vehicle, "
            f"at most {math.degrees(limits.turn_from_nominal):g}° are believable; "
            + ("" if slip is None else f"it would fit with {slip}: ")
            + "check that the plate is the one the frame's description gives to this rig, and its rotation "
            "there"
        )
    if placed.scale_reason is not None:
        return placed.scale_reason
    if placed.outliers > limits.outliers:
        return (
            f"{100 * placed.outliers:.0f} % of the marks do not fit, allowed are "
            f"{100 * limits.outliers:.0f} %; check that the plate is the described one, and clean"
        )
    worst = max(placed.noise_scale, key=lambda key: placed.noise_scale[key])
    if placed.noise_scale[worst] > limits.noise_scale:
        return (
            f"{' '.join(worst)} does not fit the others: its residuals are "
            f"{placed.noise_scale[worst]:.1f} times the noise of its marks, allowed is "
            f"{limits.noise_scale:g} times; calibrate the rig, then see the gauge frame again"
        )
    u95 = transfer_u95(placed)
    if u95 > limits.transfer_u95:
        return (
            f"seeing the plate alone makes the angles uncertain by ±{u95 / ARCMIN:.3f}′ (95 %), allowed is "
            f"±{limits.transfer_u95 / ARCMIN:.3f}′; check light and focus, and calibrate the rig"
        )
    return None


def placing_in_doubt(placed: PlacedRig, limits: PlacingLimits | None = None) -> str | None:
    """The sentence that says why a good placing needs a reason before it turns every later wheel; None when
    it is believed without."""
    limits = limits or PlacingLimits()
    if placed.turn_from_nominal > limits.usual_turn:
        return (
            f"the rig would be turned by {math.degrees(placed.turn_from_nominal):.2f}° against the vehicle, "
            f"usual are at most {math.degrees(limits.usual_turn):g}°; check the plate's rotation in the "
            "frame's description, its signs first"
        )
    change = max(abs(placed.camber_change), abs(placed.toe_change))
    if placed.was_measured and change > limits.change:
        return (
            f"camber would change by {placed.camber_change / ARCMIN:+.4g}′ and toe by "
            f"{placed.toe_change / ARCMIN:+.4g}′ against the pose that a gauge frame gave before, at most "
            f"{limits.change / ARCMIN:.4g}′ are believable; check the rig's seat and the frame's description"
        )
    return None


def predicted_u95(placed: PlacedRig) -> tuple[float, float] | None:
    """Expanded uncertainties of camber and toe, radians, from cameras and pose together; None where the
    cameras' covariance is not known."""
    if placed.calibration.covariance is None:
        return None
    camber, toe = predict_angle_uncertainty(placed.calibration)
    return _COVERAGE_FACTOR * camber, _COVERAGE_FACTOR * toe


def _cameras(data: CalibrationInput, calibration: RigCalibration) -> dict[CameraKey, PosedCamera]:
    cameras = cameras_of_rig(calibration)
    sizes = {key: (camera.model.width, camera.model.height) for key, camera in cameras.items()}
    if sizes != data.sizes or tuple(sizes) != data.cameras:
        raise DegenerateInputError(
            field="heads",
            expected=f"the cameras of calibration {calibration.id} with their image sizes, in order: "
            + ", ".join(map(" ".join, sizes)),
            seen=", ".join(map(" ".join, data.cameras)),
            cure="Name the calibration of the rig that took the session.",
        )
    return cameras


def _pull_of_cameras(problem: Problem, solution: Solution, cameras: list[PosedCamera]) -> Array:
    """(6, P) change of the plate's found pose per change of each camera parameter."""
    sizes = [POSE + len(camera.model.parameters) for camera in cameras]
    first = np.cumsum([0, *sizes])
    camera_columns = np.full((len(cameras), POSE + INTRINSICS), -1, np.int64)
    for k, size in enumerate(sizes):
        camera_columns[k, :size] = first[k] + np.arange(size)
    columns = np.full((len(problem.camera), LOCAL), -1, np.int64)
    columns[:, : POSE + INTRINSICS] = camera_columns[problem.camera]
    columns[:, POSE + INTRINSICS :] = first[-1] + np.arange(POSE)
    wide = replace(problem, columns=columns, camera_columns=camera_columns, size=int(first[-1]) + POSE)
    weight = solution.weights / solution.scales[problem.camera] ** 2
    matrix, _ = normal_equations(wide, solution.state, solution.at, weight).schur()
    return np.asarray(-np.linalg.solve(matrix[-POSE:, -POSE:], matrix[-POSE:, :-POSE]), dtype=np.float64)


def _by_plate_in_rig(rig_from_plate: RigidTransform, vehicle_from_rig: RigidTransform) -> Array:
    """(6, 6) change of `vehicle_from_rig` per change of `rig_from_plate`, both as `perturbed` takes them."""
    out = np.zeros((6, 6))
    out[:3, :3] = -rig_from_plate.rotation
    # The plate stays in the vehicle: what it moves in the rig, the rig moves the other way about it.
    moved = cross_matrices(rig_from_plate.translation) @ rig_from_plate.rotation
    out[3:, :3] = -vehicle_from_rig.rotation @ moved
    out[3:, 3:] = -vehicle_from_rig.rotation
    return out


def _by_plate_in_vehicle(rig_from_plate: RigidTransform, vehicle_from_plate: RigidTransform) -> Array:
    """(6, 6) change of `vehicle_from_rig` per change of `vehicle_from_plate`."""
    out = np.zeros((6, 6))
    out[:3, :3] = rig_from_plate.rotation
    out[3:, :3] = -vehicle_from_plate.rotation @ cross_matrices(rig_from_plate.inverse().translation)
    out[3:, 3:] = np.eye(3)
    return out
