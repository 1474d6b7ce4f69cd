"""What a calibration says, as a digest: the part of its identity that never lies."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator

from alignment.arrays import Array
from alignment.values import RigCalibration


def content_digest(calibration: RigCalibration, *, in_vehicle: bool = False) -> str:
    """Return the SHA-256, hexadecimal, of lenses and poses of all cameras, head by head, left before right.

    Parameters
    ----------
    in_vehicle
        Whether the pose of the rig in the vehicle counts too, and comes first. It does for a calibration that
        was measured; simulated and imported ones have a nominal pose.

    The bytes are those of identities that are stored already: an old one can be computed again.
    """
    content = hashlib.sha256()
    for array in _arrays(calibration, in_vehicle):
        content.update(array.tobytes())
    return content.hexdigest()


def _arrays(calibration: RigCalibration, in_vehicle: bool) -> Iterator[Array]:
    if in_vehicle:
        yield calibration.vehicle_from_rig.rotation
        yield calibration.vehicle_from_rig.translation
    for head in calibration.heads:
        for camera in head.cameras:
            yield camera.model.parameters
            yield camera.rig_from_camera.rotation
            yield camera.rig_from_camera.translation
