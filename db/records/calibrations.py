"""What results rest on, as it is stored: calibrations, their checks, zero measurements.

Conventions as in `db.records.results`.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any
from uuid import UUID, uuid4

from db.records.plain import as_read_back, check_values


class CheckKind(enum.StrEnum):
    """What a calibration was compared with."""

    PLATE_SESSION = "plate_session"
    MASTER_WHEEL = "master_wheel"


class CheckOutcome(enum.StrEnum):
    """Whether a calibration was found within its tolerance."""

    WITHIN = "within"
    OUT = "out"


@dataclass(frozen=True)
class CalibrationRecord:
    """A calibration of one rig: its identity, its validity, and the JSON document itself."""

    id: str
    rig: str
    valid_from_utc: datetime
    document: Mapping[str, Any]
    valid_until_utc: datetime | None = None

    def __post_init__(self) -> None:
        check_values(self)
        object.__setattr__(self, "document", as_read_back("CalibrationRecord.document", self.document))


@dataclass(frozen=True)
class CalibrationCheckRecord:
    """What a plate session or a master wheel said of a calibration.

    Attributes
    ----------
    utc
        When the images were taken.
    calibration_id
        The calibration in force afterwards; recorded before the check is written.
    kind, outcome, reason
        What it was compared with, whether it was within tolerance, and the sentence that says so.
    as_found
        Figures of the calibration that was in force before, a JSON document; None for a rig's first one.
    as_left
        Figures of the calibration in force afterwards; None when nothing was changed.
    predecessor_id
        The calibration that this one replaced: `as_found` is its.
    """

    utc: datetime
    calibration_id: str
    kind: CheckKind
    outcome: CheckOutcome
    reason: str
    as_found: Mapping[str, Any] | None = None
    as_left: Mapping[str, Any] | None = None
    predecessor_id: str | None = None
    uuid: UUID = field(default_factory=uuid4)

    def __post_init__(self) -> None:
        check_values(self)
        for name in ("as_found", "as_left"):
            figures = getattr(self, name)
            if figures is not None:
                object.__setattr__(self, name, as_read_back(f"CalibrationCheckRecord.{name}", figures))


@dataclass(frozen=True)
class ZeroRecord:
    """A zero measurement: a master wheel in front of one rig, as measured and as certified.

    Attributes
    ----------
    id
        Identity; wheel results that it corrected carry it.
    rig, calibration_id
        What measured it; it corrects only what rests on the same calibration, which is recorded before.
    measured_utc
        When the images were taken; of several zero measurements the newest one counts.
    master
        Name of the master wheel.
    method, shots
        How, and of what: ``spin_axis`` from several shots, ``tyre_plane/revolution`` from one.
    camber, toe, certified_camber, certified_toe
        Radians.
    camber_u, toe_u, correlation
        Standard uncertainties, radians (greater than zero), and correlation of measured less certified camber
        and toe, without the calibration's share.
    forced_reason
        Why it was stored although larger than what the station believes; None when it was not.
    """

    id: str
    rig: str
    calibration_id: str
    measured_utc: datetime
    master: str
    method: str
    shots: int
    camber: float
    toe: float
    certified_camber: float
    certified_toe: float
    camber_u: float
    toe_u: float
    correlation: float
    software_version: str
    forced_reason: str | None = None

    def __post_init__(self) -> None:
        check_values(self)


@dataclass(frozen=True)
class ZeroRevocation:
    """The end of a zero measurement: it corrects nothing from then on, and stays stored."""

    zero_id: str
    utc: datetime
    reason: str

    def __post_init__(self) -> None:
        check_values(self)


@dataclass(frozen=True)
class StoredZero:
    """A zero measurement read back: with its revocation, if there is one, and when it was stored."""

    record: ZeroRecord
    revocation: ZeroRevocation | None
    stored_utc: datetime
