"""What the formats of other programs have in common: named cameras, with or without poses."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np
from pydantic import BaseModel, ConfigDict

from alignment.arrays import Array
from alignment.errors import Deed, DegenerateInputError, FormatError, Remedy
from alignment.geometry import CameraModel, PosedCamera, RigidTransform
from alignment.values import HeadCalibration, RigCalibration, Side, nominal_vehicle_from_rig

_OF_HEAD = re.compile(r"^(?:(?P<head>.+)[._/-])?(?P<side>left|right)$", re.IGNORECASE)
_NOT_RIGID = 1e-3
BASELINE_MM = (5.0, 5000.0)
"""Distances of two cameras of a head that are believed; outside of them the unit of length is another one."""


class ForeignModel(BaseModel):
    """Base of what other programs write: keys that are not needed are passed over, numbers may be text."""

    model_config = ConfigDict(extra="ignore", frozen=True, allow_inf_nan=False)


@dataclass(frozen=True)
class NamedCamera:
    """One camera of another program's file.

    Attributes
    ----------
    name
        What the file calls it; ``<head>.left`` or ``<head>.right`` when Truewheel wrote it.
    model
        Its intrinsic parameters.
    reference_from_camera
        Its pose in the file's own frame of reference, millimetres; None when the file states none.
    """

    name: str
    model: CameraModel
    reference_from_camera: RigidTransform | None


def cameras_to_export(
    calibration: RigCalibration, path: Path, program: str, counts: Collection[int]
) -> list[tuple[str, str, CameraModel, RigidTransform]]:
    """Head, side, model, and the transform from rig to camera of each camera, left before right.

    Raises
    ------
    FormatError
        When the other program has no such model: not with so many (`counts`) Brown–Conrady coefficients, no
        division model, no skew.
    """
    cameras = []
    for head in calibration.heads:
        for side, camera in (("left", head.left), ("right", head.right)):
            model = camera.model
            seen = None
            if model.model != "brown":
                seen = f"model '{model.model}'"
            elif model.skew != 0:
                seen = f"a skew of {model.skew:g} pixels"
            elif len(model.coefficients) not in counts:
                seen = f"{len(model.coefficients)}: {', '.join(model.parameter_names[4:])}"
            if seen is not None:
                known = " or ".join(map(str, sorted(counts)))
                raise FormatError(
                    file=path,
                    field=f"{head.name}.{side}",
                    expected=f"a camera that {program} has: Brown–Conrady with {known} coefficients, no skew",
                    seen=seen,
                    cure="Calibrate with such a model, or use another format",
                )
            cameras.append((head.name, side, model, camera.rig_from_camera.inverse()))
    return cameras


def brown_camera(
    size: tuple[int, int],
    intrinsics: Sequence[float],
    coefficients: Sequence[float],
    file: str | PathLike[str],
    field: str,
) -> CameraModel:
    """Build a Brown–Conrady camera from fx, fy, cx, cy and OpenCV's coefficients; missing ones of 5 are 0.

    Raises
    ------
    FormatError
        When that is no camera.
    """
    filled = [*coefficients, *[0.0] * (5 - len(coefficients))]
    fx, fy, cx, cy = intrinsics
    try:
        return CameraModel(*size, fx, fy, cx, cy, "brown", tuple(filled))
    except DegenerateInputError as error:
        raise FormatError(
            file=file, field=f"{field}.{error.field}", expected=error.expected, seen=error.seen
        ) from error


def reference_from(
    rotation: Array, translation: Array, file: str | PathLike[str], field: str
) -> RigidTransform:
    """Turn a pose `camera from reference`, as all three programs state it, into `reference from camera`.

    Digits that were rounded away are no harm: the nearest rotation is taken.

    Raises
    ------
    FormatError
        When the rotation is none.
    """
    left, _, right = np.linalg.svd(rotation)
    nearest = left @ right
    off = float(np.abs(nearest - rotation).max())
    if not off < _NOT_RIGID or np.linalg.det(nearest) < 0:
        raise FormatError(
            file=file, field=field, expected="a rotation", seen=f"a matrix that is {off:.2g} from one"
        )
    return RigidTransform(nearest, translation).inverse()


def assemble(
    cameras: Sequence[NamedCamera], *, identity: str, rig: str, side: Side, file: str | PathLike[str]
) -> RigCalibration:
    """Make a rig of cameras; the file's frame of reference becomes the rig's.

    Cameras called ``<head>.left`` and ``<head>.right`` make heads of that name (``left`` and ``right`` alone
    are of ``head_1``); otherwise the first two are left and right of ``head_1``, the next two of ``head_2``,
    and so on. The pose of the rig in the vehicle is
    the nominal one.

    Raises
    ------
    FormatError
        When a camera has no pose or no partner.
    """
    for camera in cameras:
        if camera.reference_from_camera is None:
            raise FormatError(
                file=file,
                field=camera.name,
                expected="the pose of every camera in one frame",
                seen="none",
                cure="Export the cameras with their poses; lenses alone do not make a rig",
            )
    matches = [_OF_HEAD.match(camera.name) for camera in cameras]
    heads: dict[str, dict[str, NamedCamera]] = {}
    for n, (camera, match) in enumerate(zip(cameras, matches, strict=True)):
        name, which = f"head_{n // 2 + 1}", ("left", "right")[n % 2]
        if match is not None and all(matches):
            name, which = match["head"] or "head_1", match["side"].lower()
        heads.setdefault(name, {})[which] = camera
    for name, pair in heads.items():
        missing = {"left", "right"} - set(pair)
        if missing or sum(map(len, heads.values())) < len(cameras):
            raise FormatError(
                file=file,
                field=name,
                expected="one left and one right camera for each head",
                seen=", ".join(camera.name for camera in cameras),
                cure="Name them <head>.left and <head>.right, or give them in pairs, left before right",
            )
    try:
        return RigCalibration(
            identity,
            rig,
            side,
            tuple(
                HeadCalibration(name, _posed(pair["left"]), _posed(pair["right"]))
                for name, pair in heads.items()
            ),
            nominal_vehicle_from_rig(side),
        )
    except DegenerateInputError as error:
        raise FormatError(file=file, field=error.field, expected=error.expected, seen=error.seen) from error


def baselines_mm(calibration: RigCalibration) -> dict[str, float]:
    """Return the distance of the two cameras of each head, millimetres."""
    return {
        head.name: float(
            np.linalg.norm(head.right.rig_from_camera.translation - head.left.rig_from_camera.translation)
        )
        for head in calibration.heads
    }


def require_believable_baselines(calibration: RigCalibration, file: str | PathLike[str]) -> None:
    """Refuse baselines that no head has: the file's lengths are in another unit.

    Raises
    ------
    FormatError
        When one is outside of `BASELINE_MM`.
    """
    least, most = BASELINE_MM
    for head, length in baselines_mm(calibration).items():
        if least <= length <= most:
            continue
        likely, factor = ("m", 1e3) if length < least else ("mm", 1e-3)
        fits = least <= length * factor <= most
        raise FormatError(
            file=file,
            choice="unit",
            expected=f"a head whose cameras are {least:g} to {most:g} mm apart",
            seen=f"{length:.3g} mm for {head}",
            cure=f"The lengths of the file may be in {likely}" if fits else "Check the poses in the file",
            remedy=Remedy(Deed.SAY_UNIT, likely) if fits else None,
        )


def _posed(camera: NamedCamera) -> PosedCamera:
    pose = camera.reference_from_camera or RigidTransform.identity()
    return PosedCamera(camera.model, pose)
