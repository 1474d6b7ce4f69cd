"""The methods that calibrate one camera, by name."""

from __future__ import annotations

from alignment.calibration.dlt import calibrate_dlt
from alignment.calibration.faugeras import calibrate_faugeras
from alignment.calibration.lenz import calibrate_lenz
from alignment.calibration.one_camera import OneCameraMethod
from alignment.calibration.tsai import calibrate_tsai
from alignment.calibration.tsai_radial import calibrate_tsai_radial
from alignment.calibration.two_system import calibrate_two_system

ONE_CAMERA_METHODS: dict[str, OneCameraMethod] = {
    "dlt": calibrate_dlt,
    "faugeras": calibrate_faugeras,
    "lenz": calibrate_lenz,
    "tsai": calibrate_tsai,
    "tsai_radial": calibrate_tsai_radial,
    "two_system": calibrate_two_system,
}
"""By name; what stands here is taken by the tests that every method must pass."""
