"""Kalibr's camchain YAML: ``cam0``, ``cam1``, … in one file, lengths in metres.

``T_cam_imu`` takes points of the inertial unit's frame to the camera; here the rig's frame is in its place.
``T_cn_cnm1`` takes points of the camera before this one to this one. Both are written. Read is, besides,
``T_imu_cam``, the inverse of ``T_cam_imu``, as OpenVINS writes it. All poses are put into one frame: the
inertial unit's when the first camera has its pose in it, else the first camera's, along the chain. Poses that
contradict each other, and a pose by another name alone, are refused.
``rostopic`` carries the names: ``/<rig>/<head>/<side>/image_raw``.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from pydantic import Field

from alignment.counting import count_of
from alignment.errors import FormatError
from alignment.geometry import RigidTransform
from alignment.values import RigCalibration
from sensors.formats.exchange.cameras import (
    ForeignModel,
    NamedCamera,
    brown_camera,
    cameras_to_export,
    reference_from,
)
from sensors.formats.exchange.trees import yaml_values
from sensors.formats.files import write_bytes
from sensors.formats.validation import validate

_Row = tuple[float, float, float, float]
_TOPIC = re.compile(r"(?:^|/)(?P<head>[^/]+)/(?P<side>left|right)(?:/|$)")
_KIND = "a camera chain of Kalibr"
_POSES = ("T_cam_imu", "T_imu_cam", "T_cn_cnm1")
_APART_MM, _APART_RAD = 1.0, 1e-3


class _ChainCamera(ForeignModel):
    camera_model: str
    intrinsics: tuple[float, ...] = Field(min_length=1, max_length=16)
    distortion_model: str
    distortion_coeffs: tuple[float, ...] = Field(max_length=16)
    resolution: tuple[int, int]
    rostopic: str = ""
    T_cam_imu: tuple[_Row, _Row, _Row, _Row] | None = None
    T_imu_cam: tuple[_Row, _Row, _Row, _Row] | None = None
    T_cn_cnm1: tuple[_Row, _Row, _Row, _Row] | None = None


def write_kalibr(path: Path, calibration: RigCalibration) -> None:
    """Write a camera chain; metres, the rig's frame in the place of the inertial unit's.

    Raises
    ------
    FormatError
        When Kalibr has no model for a camera: only ``radtan``, that is k1, k2, p1, p2; or the file cannot be
        written.
    """
    chain: dict[str, dict[str, Any]] = {}
    before: RigidTransform | None = None
    cameras = cameras_to_export(calibration, path, "Kalibr", (5,))
    for n, (head, side, model, camera_from_rig) in enumerate(cameras):
        k1, k2, p1, p2, k3 = model.coefficients
        if k3 != 0:
            raise FormatError(
                file=path,
                field=f"{head}.{side}",
                expected="k3 = 0: Kalibr's radtan has k1, k2, p1, p2",
                seen=f"{k3:g}",
                cure="Calibrate without k3, or use another format",
            )
        entry: dict[str, Any] = {"T_cam_imu": _matrix(camera_from_rig)}
        if before is not None:
            entry["T_cn_cnm1"] = _matrix(camera_from_rig @ before.inverse())
        before = camera_from_rig
        chain[f"cam{n}"] = {
            **entry,
            "camera_model": "pinhole",
            "intrinsics": [model.fx, model.fy, model.cx, model.cy],
            "distortion_model": "radtan",
            "distortion_coeffs": [k1, k2, p1, p2],
            "resolution": [model.width, model.height],
            "rostopic": f"/{calibration.rig}/{head}/{side}/image_raw",
        }
    text = yaml.safe_dump(chain, sort_keys=False, default_flow_style=None, width=1000)
    write_bytes(path, f"# Truewheel calibration {calibration.id}\n{text}".encode())


def _matrix(transform: RigidTransform) -> list[list[float]]:
    matrix = np.eye(4)
    matrix[:3, :3] = transform.rotation
    matrix[:3, 3] = transform.translation / 1000.0
    rows: list[list[float]] = matrix.tolist()
    return rows


def read_kalibr(paths: Sequence[Path], *, unit_mm: float = 1000.0) -> tuple[NamedCamera, ...]:
    """Read the cameras of one camera chain.

    Raises
    ------
    FormatError
        When the file is missing, is no camera chain, or has another model than ``pinhole`` with ``radtan`` or
        ``none``.
    """
    if len(paths) != 1:
        raise FormatError(
            file=paths[0], expected="one file, with all cameras", seen=count_of(len(paths), "file")
        )
    path = paths[0]
    data = yaml_values(path, _KIND)
    count = sum(str(key).startswith("cam") for key in data) if isinstance(data, dict) else 0
    if count == 0 or any(f"cam{n}" not in data for n in range(count)):
        raise FormatError(file=path, expected=f"{_KIND}: cam0, cam1, …", seen="other keys")
    keys = [f"cam{n}" for n in range(count)]
    chain = [_entry(data, key, path) for key in keys]
    poses = _poses(chain, [data[key] for key in keys], path, unit_mm)
    return tuple(
        NamedCamera(_name(entry, key), _model(entry, path, key), pose)
        for entry, key, pose in zip(chain, keys, poses, strict=True)
    )


def _entry(data: dict[str, Any], key: str, path: Path) -> _ChainCamera:
    try:
        return validate(_ChainCamera, data[key], file=path)
    except FormatError as error:
        field = ".".join(part for part in (key, error.field) if part)
        raise FormatError(
            file=path,
            field=field,
            expected=error.expected,
            seen=error.seen,
            cure=error.cure,
            remedy=error.remedy,
        ) from error


def _name(entry: _ChainCamera, key: str) -> str:
    found = _TOPIC.search(entry.rostopic)
    return key if found is None else f"{found['head']}.{found['side']}"


def _model(entry: _ChainCamera, path: Path, key: str) -> Any:
    for field, seen, known in (
        ("camera_model", entry.camera_model, ("pinhole",)),
        ("distortion_model", entry.distortion_model, ("radtan", "none")),
    ):
        if seen not in known:
            raise FormatError(
                file=path, field=f"{key}.{field}", expected=" or ".join(known), seen=f"'{seen}'"
            )
    wanted = 4 if entry.distortion_model == "radtan" else 0
    if len(entry.intrinsics) != 4 or len(entry.distortion_coeffs) != wanted:
        raise FormatError(
            file=path,
            field=f"{key}.intrinsics, {key}.distortion_coeffs",
            expected=f"fu, fv, pu, pv, and {wanted} coefficients",
            seen=f"{len(entry.intrinsics)} and {len(entry.distortion_coeffs)} numbers",
        )
    return brown_camera(entry.resolution, entry.intrinsics, entry.distortion_coeffs, path, key)


def _poses(
    chain: Sequence[_ChainCamera], raw: Sequence[dict[str, Any]], path: Path, unit_mm: float
) -> list[RigidTransform]:
    """Return reference from camera of each, all in one frame."""
    in_unit = [_in_unit(entry, path, f"cam{n}", unit_mm) for n, entry in enumerate(chain)]
    steps = [
        None if entry.T_cn_cnm1 is None else _transform(entry.T_cn_cnm1, path, f"cam{n}.T_cn_cnm1", unit_mm)
        for n, entry in enumerate(chain)
    ]
    for n in range(1, len(chain)):
        before, step, own = in_unit[n - 1], steps[n], in_unit[n]
        if before is not None and step is not None and own is not None:
            _require_same(
                before @ step, own, path, f"cam{n}.T_cn_cnm1", "the poses of both in the unit's frame"
            )
    poses: list[RigidTransform] = []
    for n, entry in enumerate(raw):
        own = in_unit[n] if in_unit[0] is not None else None
        step = steps[n]
        if own is not None:
            poses.append(own)
        elif n > 0 and step is not None:
            poses.append(poses[-1] @ step)
        else:
            strange = [name for name in entry if str(name).startswith("T_") and name not in _POSES]
            if n == 0 and not strange:
                poses.append(RigidTransform.identity())
                continue
            seen = f"{', '.join(map(str, strange))}, which is not known" if strange else "none"
            if n > 0 and in_unit[n] is not None:
                seen = f"its pose in the inertial unit's frame, and none of {_first_without(in_unit)}"
            raise FormatError(
                file=path,
                field=f"cam{n}.T_cn_cnm1",
                expected="the pose of the camera in one frame with the others: T_cn_cnm1, or T_cam_imu "
                "(or its inverse T_imu_cam) for every camera",
                seen=seen,
            )
    return poses


def _first_without(in_unit: Sequence[RigidTransform | None]) -> str:
    return f"cam{in_unit.index(None)}"


def _in_unit(entry: _ChainCamera, path: Path, key: str, unit_mm: float) -> RigidTransform | None:
    """Return the camera's pose in the inertial unit's frame where it is stated, one way or the other."""
    poses = []
    if entry.T_cam_imu is not None:
        poses.append(_transform(entry.T_cam_imu, path, f"{key}.T_cam_imu", unit_mm))
    if entry.T_imu_cam is not None:
        poses.append(_transform(entry.T_imu_cam, path, f"{key}.T_imu_cam", unit_mm).inverse())
    if len(poses) == 2:
        _require_same(poses[0], poses[1], path, f"{key}.T_imu_cam", "the inverse of T_cam_imu")
    return poses[0] if poses else None


def _require_same(one: RigidTransform, other: RigidTransform, path: Path, field: str, what: str) -> None:
    """Refuse two statements of one pose that differ by more than what rounding and estimating twice leave."""
    apart = one.inverse() @ other
    turn, shift = float(np.linalg.norm(apart.rotvec())), float(np.linalg.norm(apart.translation))
    if turn > _APART_RAD or shift > _APART_MM:
        raise FormatError(
            file=path,
            field=field,
            expected=f"a pose that agrees with {what}",
            seen=f"one that is {shift:.3g} mm and {np.degrees(turn):.3g}° from it",
            cure="Take the poses of one calibration, or remove those that are of another",
        )


def _transform(rows: Sequence[_Row], path: Path, field: str, unit_mm: float) -> RigidTransform:
    matrix = np.array(rows)
    if not np.allclose(matrix[3], [0.0, 0.0, 0.0, 1.0]):
        raise FormatError(file=path, field=field, expected="a last row 0 0 0 1", seen=str(rows[3]))
    return reference_from(matrix[:3, :3], unit_mm * matrix[:3, 3], path, field)
