"""The words of the master check's duty; the states are words of the DBC's value table."""

from __future__ import annotations

import enum


class MasterState(enum.StrEnum):
    """Whether the calibrations behind the verdicts are known to be good."""

    NOT_REQUIRED = "not_required"
    GOOD = "good"
    DUE_SOON = "due_soon"
    OVERDUE = "overdue"
    FAILED = "failed"

    @property
    def ready(self) -> bool:
        """Whether vehicles may be measured."""
        return self not in (MasterState.OVERDUE, MasterState.FAILED)


class DutyEvent(enum.StrEnum):
    """What happens to the duty of one rig."""

    VEHICLE = "vehicle measured"
    TIME = "time passes"
    SHIFT_START = "shift starts"
    FAULT = "fault"
    RESTART = "restart"
    CAMERA_RESET = "camera reached anew"
    NEW_CALIBRATION = "new calibration"
    CHECK_GOOD = "check good"
    CHECK_OUT = "check out"
    CHECK_REFUSED = "check refused"
    RELEASE = "release by a person"


DEMANDS = {
    "fault": DutyEvent.FAULT,
    "restart": DutyEvent.RESTART,
    "camera": DutyEvent.CAMERA_RESET,
    "calibration": DutyEvent.NEW_CALIBRATION,
}
"""After what a configuration may ask for a check, by its words there."""
