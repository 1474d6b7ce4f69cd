"""Whether the rigs of a station stand in one frame, and what toe and thrust angle refer to."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping

from alignment.errors import ConfigurationError
from alignment.values import RigCalibration
from alignment.vehicle import FOUR_WHEELS
from station.configuration import Configuration
from station.cycle import CommonFrame
from station.running.cameras import read_rig_calibration

_LOG = logging.getLogger("truewheel.station")


def common_frame(configuration: Configuration, calibrations: Iterable[RigCalibration]) -> CommonFrame | None:
    """Return the frame of a station's rigs, None where they have none in common.

    Raises
    ------
    ConfigurationError
        When toes are to refer to the vehicle, and a rig of one of its four wheels is missing or was not
        placed by a gauge frame.
    """
    options = configuration.settings.stand
    by_name = {calibration.rig: calibration for calibration in calibrations}
    lacking = _lacking(by_name)
    if lacking and options.reference == "vehicle":
        raise _no_frame(configuration, lacking)
    frame = None if lacking else CommonFrame(options.stand(), options.reference or "vehicle", by_name)
    reference = "stand" if frame is None else frame.reference
    _LOG.info("toe and thrust angle refer to the %s", reference)
    judged = [
        kind.name
        for kind in configuration.vehicle_types.values()
        if kind.lengths.stated or kind.yaw is not None
    ]
    if frame is None and judged:
        _LOG.warning(
            "limits of lengths and yaw of %s are not judged: %s", ", ".join(judged), "; ".join(lacking)
        )
    return frame


def check_frame(configuration: Configuration) -> None:
    """Look for what is wrong with the frame as far as calibration files tell; errors as `common_frame`.

    What a driver knows of its rig shows at the start.
    """
    settings = configuration.settings
    if settings.stand.reference != "vehicle":
        return
    found = {
        rig.name: read_rig_calibration(configuration, k).calibration
        for k, rig in enumerate(settings.rigs)
        if rig.calibration is not None
    }
    unread = {rig.name for rig in settings.rigs if rig.calibration is None}
    lacking = [each for each in _lacking(found) if each.partition(" ")[0] not in unread]
    if lacking:
        raise _no_frame(configuration, lacking)


def _lacking(calibrations: Mapping[str, RigCalibration]) -> list[str]:
    """What keeps the wheels of a vehicle from one frame, in words, one for each wheel."""
    out = []
    for wheel in FOUR_WHEELS:
        if wheel not in calibrations:
            out.append(f"{wheel} has no rig")
        elif not calibrations[wheel].vehicle_from_rig_measured:
            out.append(f"{wheel} was not placed by a gauge frame (calibration {calibrations[wheel].id})")
    return out


def _no_frame(configuration: Configuration, lacking: list[str]) -> ConfigurationError:
    return ConfigurationError(
        file=configuration.file,
        field="stand.reference",
        expected="for 'vehicle' a rig for each of the four wheels, all placed in one frame by a gauge frame",
        seen="; ".join(lacking),
        cure="Place the rigs with a view of the gauge frame, or choose 'stand' for a stand that clamps the "
        "vehicle",
    )
