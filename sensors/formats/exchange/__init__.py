"""Calibrations in the formats of other programs: OpenCV, Kalibr, mrcal.

All three put pixel (0, 0) at the centre of the top-left pixel and define distortion as OpenCV does, as
Truewheel does; none knows the division model or a skew of the pixel axes. None carries the covariance of a
calibration, nor the pose of the rig in the vehicle.

========  =====================  ===============================================  ======  ==============
format    file                   pose that it states                              unit    coefficients
========  =====================  ===============================================  ======  ==============
opencv    one for all cameras    R, T: camera from rig, p_camera = R p_rig + T    mm      5, 8, 12, 14
kalibr    one for all cameras    T_cam_imu: camera from rig; T_cn_cnm1: camera    m       4 (k3 = 0)
                                 from the camera before it; 4 × 4
mrcal     one for each camera    rotation vector and T: camera from rig           m       4, 5, 8, 12
========  =====================  ===============================================  ======  ==============
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from os import PathLike, fspath
from pathlib import Path

from alignment.errors import ConfigurationError
from alignment.values import RigCalibration, Side
from sensors.formats.exchange.cameras import (
    NamedCamera,
    assemble,
    baselines_mm,
    require_believable_baselines,
)
from sensors.formats.exchange.kalibr import read_kalibr, write_kalibr
from sensors.formats.exchange.mrcal import read_mrcal, write_mrcal
from sensors.formats.exchange.opencv import read_opencv, write_opencv

EXPORTS: dict[str, Callable[[Path, RigCalibration], None]] = {
    "opencv": write_opencv,
    "kalibr": write_kalibr,
    "mrcal": write_mrcal,
}
FORMATS = tuple(EXPORTS)


def export_calibration(path: str | PathLike[str], calibration: RigCalibration, kind: str) -> None:
    """Write a calibration in another program's format: a file, or for mrcal a folder.

    Parameters
    ----------
    path
        New file or folder.
    calibration
        What is known of the rig.
    kind
        One of `FORMATS`.

    Raises
    ------
    FormatError
        When the format cannot hold the cameras, or nothing can be written there.
    ConfigurationError
        When there is no such format.
    """
    if kind not in EXPORTS:
        raise ConfigurationError(choice="format", expected=f"one of {', '.join(FORMATS)}", seen=f"'{kind}'")
    EXPORTS[kind](Path(path), calibration)


def import_cameras(
    paths: Sequence[str | PathLike[str]],
    kind: str,
    *,
    unit_mm: float | None = None,
    size: tuple[int, int] | None = None,
) -> tuple[NamedCamera, ...]:
    """Read cameras from another program's files.

    Parameters
    ----------
    paths
        The files; for mrcal also one folder.
    kind
        One of `FORMATS`.
    unit_mm
        Millimetres in the unit of the file's lengths; what the format uses by itself when None.
    size
        (width, height), pixels, for OpenCV's files that do not state it.

    Raises
    ------
    FormatError
        When a file is missing, damaged, or states a camera that Truewheel does not model.
    ConfigurationError
        When there is no such format.
    """
    files = [Path(path) for path in paths]
    if kind == "opencv":
        return read_opencv(files, unit_mm=1.0 if unit_mm is None else unit_mm, size=size)
    metres = 1000.0 if unit_mm is None else unit_mm
    if kind == "kalibr":
        return read_kalibr(files, unit_mm=metres)
    if kind == "mrcal":
        return read_mrcal(files, unit_mm=metres)
    raise ConfigurationError(choice="format", expected=f"one of {', '.join(FORMATS)}", seen=f"'{kind}'")


def import_calibration(
    paths: Sequence[str | PathLike[str]],
    kind: str,
    *,
    identity: str,
    rig: str,
    side: Side,
    unit_mm: float | None = None,
    size: tuple[int, int] | None = None,
) -> RigCalibration:
    """Read a whole rig from another program's files; see `import_cameras` and `assemble`.

    Raises
    ------
    FormatError
        As they do, and when the cameras of a head are nearer or farther apart than is believable, which is
        the sign of another unit of length.
    """
    cameras = import_cameras(paths, kind, unit_mm=unit_mm, size=size)
    files = " and ".join(fspath(path) for path in paths)
    made = assemble(cameras, identity=identity, rig=rig, side=side, file=files)
    require_believable_baselines(made, files)
    return made


__all__ = [
    "FORMATS",
    "NamedCamera",
    "assemble",
    "baselines_mm",
    "export_calibration",
    "import_calibration",
    "import_cameras",
    "read_kalibr",
    "read_mrcal",
    "read_opencv",
    "write_kalibr",
    "write_mrcal",
    "write_opencv",
]
