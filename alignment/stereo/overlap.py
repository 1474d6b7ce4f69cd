"""Which part of each image both cameras of a head see: only there can a point have a partner."""

from __future__ import annotations

import numpy as np

from alignment.arrays import Array, Index
from alignment.geometry.cameras import PosedCamera
from alignment.stereo.rectification import Rectification
from alignment.values import RigCalibration

_STEP = 16  # pixels between the probed ones
_MARGIN = 48  # pixels that a search needs around the part, for its filters


def shared_views(calibration: RigCalibration, depth_range: tuple[float, float]) -> Index:
    """Columns and rows (2 × heads, 4) of the part of each image whose points the head's other camera may see.

    Parameters
    ----------
    calibration
        Posed cameras of the heads.
    depth_range
        Lowest and highest z of what is looked at, rig frame, millimetres.

    Returns
    -------
    views
        First column, first row, and the column and row behind the last, left before right, with a margin for
        filters. The whole image where the two cameras share nothing.
    """
    out = []
    for head in calibration.heads:
        frame = Rectification.of(head.left, head.right)
        pixels = [_probes(camera) for camera in head.cameras]
        seen = [frame.coordinates(camera, each)[0] for camera, each in zip(head.cameras, pixels, strict=True)]
        for k, sign in enumerate((1.0, -1.0)):
            camera, mine, other = head.cameras[k], seen[k], seen[1 - k]
            low, high = _disparities(frame, camera, mine, depth_range)
            # Where the partners lie that the depth range allows, against what the other camera sees at most.
            partners = mine[:, :1] - sign * np.column_stack([low, high])
            lo, hi = other.min(axis=0), other.max(axis=0)
            useful = (partners.max(axis=1) >= lo[0]) & (partners.min(axis=1) <= hi[0])
            useful &= (high >= low) & (mine[:, 1] >= lo[1]) & (mine[:, 1] <= hi[1])
            size = np.array([camera.model.width, camera.model.height])
            if not useful.any():
                out.append(np.r_[0, 0, size])
                continue
            first = pixels[k][useful].min(axis=0) - _STEP - _MARGIN
            last = pixels[k][useful].max(axis=0) + _STEP + _MARGIN + 1
            out.append(np.r_[np.maximum(first, 0), np.minimum(last, size)])
    return np.array(out, dtype=np.int64)


def _probes(camera: PosedCamera) -> Array:
    """Pixels (N, 2) all over the image, its borders among them."""
    width, height = camera.model.width, camera.model.height
    x, y = np.r_[0 : width - 1 : _STEP, width - 1], np.r_[0 : height - 1 : _STEP, height - 1]
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2).astype(np.float64)


def _disparities(
    frame: Rectification, camera: PosedCamera, seen: Array, depth_range: tuple[float, float]
) -> tuple[Array, Array]:
    """Least and largest disparity (N,) of a camera's rectified places (N, 2); least > largest for none."""
    rays_z = np.column_stack([seen, np.ones(len(seen))]) @ frame.rectified_from_rig[:, 2]
    height = camera.rig_from_camera.translation[2]
    lo, hi = depth_range
    with np.errstate(divide="ignore", invalid="ignore"):
        far, near = (lo - height) / rays_z, (hi - height) / rays_z
    good = (near > 0.0) & (far > near)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(good, frame.baseline / far, np.inf), np.where(good, frame.baseline / near, -np.inf)
