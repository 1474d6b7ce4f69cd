"""Kalibr's camchain YAML: ``cam0``, ``cam1``, … in one file, lengths in metres.

``T_cam_imu`` takes points of the inertial unit's frame to the camera; here the rig's frame is in its place.
``T_cn_cnm1`` takes points of the camera before this one to this one. Both are written. Read is ``T_cam_imu``
where it stands, else the chain; without any ``T_cam_imu`` the first camera's frame is the reference.
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

from alignment.errors import FormatError
from alignment.geometry.transforms import RigidTransform
from alignment.values import RigCalibration
from sensors.formats.exchange.cameras import (
    ForeignModel,
    NamedCamera,
    brown_camera,
    cameras_to_export,
    reference_from,
)
from sensors.formats.files import read_bytes, write_bytes
from sensors.formats.validation import validate

_Row = tuple[float, float, float, float]
_TOPIC = re.compile(r"(?:^|/)(?P<head>[^/]+)/(?P<side>left|right)(?:/|$)")
_KIND = "a camera chain of Kalibr"


class _ChainCamera(ForeignModel):
    camera_model: str
    intrinsics: tuple[float, ...] = Field(min_length=1, max_length=16)
    distortion_model: str
    distortion_coeffs: tuple[float, ...] = Field(max_length=16)
    resolution: tuple[int, int]
    rostopic: str = ""
    T_cam_imu: tuple[_Row, _Row, _Row, _Row] | None = None
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
        raise FormatError(file=paths[0], expected="one file, with all cameras", seen=f"{len(paths)} files")
    path = paths[0]
    try:
        data = yaml.safe_load(read_bytes(path, _KIND).decode("utf-8-sig"))
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        seen = " ".join(str(error).split())
        raise FormatError(file=path, expected=f"{_KIND} in YAML", seen=f"an error: {seen}") from error
    count = sum(str(key).startswith("cam") for key in data) if isinstance(data, dict) else 0
    if count == 0 or any(f"cam{n}" not in data for n in range(count)):
        raise FormatError(file=path, expected=f"{_KIND}: cam0, cam1, …", seen="other keys")
    cameras: list[NamedCamera] = []
    before: RigidTransform | None = None
    for n in range(count):
        key = f"cam{n}"
        try:
            entry = validate(_ChainCamera, data[key], file=path)
        except FormatError as error:
            field = ".".join(part for part in (key, error.field) if part)
            raise FormatError(
                file=path, field=field, expected=error.expected, seen=error.seen, cure=error.cure
            ) from error
        pose = _pose(entry, before, path, key, unit_mm)
        cameras.append(NamedCamera(_name(entry, key), _model(entry, path, key), pose))
        before = pose
    return tuple(cameras)


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


def _pose(
    entry: _ChainCamera, before: RigidTransform | None, path: Path, key: str, unit_mm: float
) -> RigidTransform:
    """Return reference from camera; `before` is that of the camera before, None for the first."""
    if entry.T_cam_imu is not None:
        return _transform(entry.T_cam_imu, path, f"{key}.T_cam_imu", unit_mm)
    if entry.T_cn_cnm1 is not None:
        step = _transform(entry.T_cn_cnm1, path, f"{key}.T_cn_cnm1", unit_mm)
        return step if before is None else before @ step
    if before is None:
        return RigidTransform.identity()
    raise FormatError(file=path, field=f"{key}.T_cn_cnm1", expected="the pose of the camera", seen="none")


def _transform(rows: Sequence[_Row], path: Path, field: str, unit_mm: float) -> RigidTransform:
    matrix = np.array(rows)
    if not np.allclose(matrix[3], [0.0, 0.0, 0.0, 1.0]):
        raise FormatError(file=path, field=field, expected="a last row 0 0 0 1", seen=str(rows[3]))
    return reference_from(matrix[:3, :3], unit_mm * matrix[:3, 3], path, field)
