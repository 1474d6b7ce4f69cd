"""The duty in one table: what every event does in every state, to the state and to the vehicles."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass

from station.duty.words import DutyEvent, MasterState

S, E = MasterState, DutyEvent


class DoubtDeed(enum.StrEnum):
    """What an event does to the vehicles that the rig measured since its last good check."""

    NOTHING = "nothing"
    DOUBT = "each of them is in doubt"
    CONFIRM = "doubt is closed where nothing was calibrated in between"
    RELEASE = "doubt is closed with person and reason"


@dataclass(frozen=True)
class DutyRule:
    """What an event does in a state.

    Attributes
    ----------
    target
        The state it leads to; None stays.
    counted
        Whether what is left until the next check says the state: good, due soon or overdue.
    deed
        What becomes of the vehicles.
    """

    target: MasterState | None = None
    counted: bool = False
    deed: DoubtDeed = DoubtDeed.NOTHING


_STAYS = DutyRule()
_COUNTED = DutyRule(counted=True)
_DUE = DutyRule(S.OVERDUE)
_GOOD = DutyRule(counted=True, deed=DoubtDeed.CONFIRM)
_FAILED = DutyRule(S.FAILED, deed=DoubtDeed.DOUBT)
_RELEASED = DutyRule(deed=DoubtDeed.RELEASE)
_DEMANDED = (E.SHIFT_START, E.FAULT, E.RESTART, E.CAMERA_RESET, E.NEW_CALIBRATION)

_MEASURING = {
    E.VEHICLE: _COUNTED,
    E.TIME: _COUNTED,
    **dict.fromkeys(_DEMANDED, _DUE),
    E.CHECK_GOOD: _GOOD,
    E.CHECK_OUT: _FAILED,
    E.CHECK_REFUSED: _STAYS,
    E.RELEASE: _RELEASED,
}
DUTY: Mapping[MasterState, Mapping[DutyEvent, DutyRule]] = {
    S.NOT_REQUIRED: dict.fromkeys(E, _STAYS) | {E.RELEASE: _RELEASED},
    S.GOOD: _MEASURING,
    S.DUE_SOON: _MEASURING,
    # What is overdue stays so, whatever the clock says afterwards; only a check ends it.
    S.OVERDUE: _MEASURING | {E.VEHICLE: _STAYS, E.TIME: _STAYS, **dict.fromkeys(_DEMANDED, _STAYS)},
    S.FAILED: {
        # One that was under way, or was measured by a station that asked for no checks meanwhile.
        E.VEHICLE: DutyRule(deed=DoubtDeed.DOUBT),
        E.TIME: _STAYS,
        **dict.fromkeys(_DEMANDED, _STAYS),
        E.CHECK_GOOD: _GOOD,
        E.CHECK_OUT: DutyRule(deed=DoubtDeed.DOUBT),
        E.CHECK_REFUSED: _STAYS,
        # The vehicles are answered for, the rig is not: a good check is still owed.
        E.RELEASE: DutyRule(S.OVERDUE, deed=DoubtDeed.RELEASE),
    },
}
"""What every event does in every state. An event that the configuration does not name does not happen."""

STATES_SAID: Mapping[MasterState, str] = {
    S.NOT_REQUIRED: "The station asks for no master checks.",
    S.GOOD: "The last check was good, and the next one is not near.",
    S.DUE_SOON: "The next check is near: `VehiclesLeft` or `MinutesLeft` says so. Vehicles are measured.",
    S.OVERDUE: "A check is due. No vehicle is measured before a good one.",
    S.FAILED: "The last check was out of its limits. No vehicle is measured before a good one.",
}
EVENTS_SAID: Mapping[DutyEvent, str] = {
    E.VEHICLE: "A start that measured with the rig was stored, whatever came of it; a master check is none.",
    E.TIME: "`every_hours` after the last good check it is overdue.",
    E.SHIFT_START: "A time of `shift_starts` since the last good check, by the plant's clock.",
    E.FAULT: "The station stands at fault; with `after` naming fault.",
    E.RESTART: "The station's program starts; with `after` naming restart.",
    E.CAMERA_RESET: "A camera of the rig was let go and reached anew; with `after` naming camera.",
    E.NEW_CALIBRATION: "The rig measures with another calibration than at its last good check; with `after` "
    "naming calibration.",
    E.CHECK_GOOD: "The wheel of a master check is within its limits.",
    E.CHECK_OUT: "The wheel of a master check is out of its limits.",
    E.CHECK_REFUSED: "A master check brought no verdict of the wheel: it was not measured, not stored, or "
    "the type's limits are no master's.",
    E.RELEASE: "A person released every vehicle that was in doubt, with a reason.",
}
