"""Doubt about stored results: noted after a failed master check, and closed by a good one or by a person.

A doubt stands beside a verdict and never changes it. Conventions as in `db.records.results`.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from datetime import datetime
from uuid import UUID, uuid5

from alignment.errors import InputError
from db.records.plain import check_values

_NAMES = UUID("6f1c51f0-7c3e-5b8e-9a55-3d2b8f0f6c11")
_LONGEST_NAME = 200

MASTER_GOOD, MASTER_OUT, MASTER_REFUSED = "master_good", "master_out", "master_refused"
MASTER_OUTCOMES = (MASTER_GOOD, MASTER_OUT, MASTER_REFUSED)
"""Codes of the events of a master check's wheels; their cycle is a master's, and no vehicle."""
MASTER_RELEASED = "master_released"
"""Code of the event that a person released every vehicle that was in doubt."""

MASTER_AFTER_FAULT, MASTER_AFTER_CAMERA = "master_after_fault", "master_after_camera"
"""Codes of the events that ask for a check; that of a camera is of one rig."""


def master_source(wheel: str) -> str:
    """The source of events about the master check of one rig."""
    return f"station.cycle.{wheel}"


class ClosedBy(enum.StrEnum):
    """What ended a doubt: a good check with the same calibration, or a person who answers for it."""

    GOOD_CHECK = "good_check"
    RELEASE = "release"


@dataclass(frozen=True)
class DoubtRecord:
    """A failed master check speaks against what a rig measured in a cycle.

    Attributes
    ----------
    station, cycle, wheel
        What is in doubt; the cycle is stored before. There is one doubt at most of each.
    check_uuid
        The failed check, which is stored before.
    utc
        When the doubt was noted.
    reason
        What the failed check found.
    """

    station: str
    cycle: UUID
    wheel: str
    check_uuid: UUID
    utc: datetime
    reason: str
    uuid: UUID

    @classmethod
    def of(
        cls, station: str, cycle: UUID, wheel: str, check_uuid: UUID, utc: datetime, reason: str
    ) -> DoubtRecord:
        """The doubt about a wheel of a cycle, under the identity that it always has."""
        return cls(station, cycle, wheel, check_uuid, utc, reason, uuid5(_NAMES, f"{cycle.hex}/{wheel}"))

    def __post_init__(self) -> None:
        check_values(self)


@dataclass(frozen=True)
class DoubtClosing:
    """The end of a doubt, which stays stored.

    Attributes
    ----------
    doubt
        UUID of the doubt, which is stored before.
    closed_by
        GOOD_CHECK names the check, RELEASE the person.
    """

    station: str
    doubt: UUID
    utc: datetime
    closed_by: str
    reason: str
    check_uuid: UUID | None = None
    person: str | None = None

    def __post_init__(self) -> None:
        check_values(self)


@dataclass(frozen=True)
class StoredDoubt:
    """A doubt read back, with its end if it has one."""

    record: DoubtRecord
    closing: DoubtClosing | None

    @property
    def open(self) -> bool:
        """Whether nobody and nothing has ended it."""
        return self.closing is None

    @property
    def word(self) -> str:
        """How it stands, as reports, exports and certificates say it beside the verdict."""
        if self.closing is None:
            return "in doubt"
        by_check = self.closing.closed_by == ClosedBy.GOOD_CHECK
        return "confirmed by a later check" if by_check else f"released by {self.closing.person}"


def person_named(name: str) -> str:
    """The name of a person as records hold it.

    Raises
    ------
    InputError
        When it is empty, too long, or holds what is no name.
    """
    shown = " ".join(name.split())
    if not shown or len(shown) > _LONGEST_NAME or not any(map(str.isalpha, shown)) or not shown.isprintable():
        raise InputError(
            choice="person", expected=f"a name with letters, of at most {_LONGEST_NAME} characters",
            seen=ascii(name[:_LONGEST_NAME]),
        )  # fmt: skip
    return shown


def reason_given(text: str) -> str:
    """A person's reason as records hold it.

    Raises
    ------
    InputError
        When there is none.
    """
    shown = " ".join(text.split())
    if not any(map(str.isalnum, shown)) or len(shown) > 10 * _LONGEST_NAME:
        raise InputError(
            choice="reason", expected=f"a sentence, of at most {10 * _LONGEST_NAME} characters",
            seen=ascii(text[:_LONGEST_NAME]),
        )  # fmt: skip
    return shown
