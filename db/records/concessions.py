"""A vehicle that is released although it is not ok: who answers for it, why, and beyond which limits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any
from uuid import UUID, uuid4

from db.records.plain import as_read_back, check_values


@dataclass(frozen=True)
class ConcessionRecord:
    """The release of a vehicle that was measured and found not ok. Its verdict stays what it is.

    Attributes
    ----------
    cycle
        Whose verdict it stands beside; recorded before.
    utc
        When it was granted.
    person
        Who answers for it.
    reason
        Why, in their words.
    exceeded
        What is out of its limits, by characteristic: each a document with ``value``, ``u95``, ``low``,
        ``high`` (None where there is no such limit) and ``unit``, as the results hold them.
    """

    cycle: UUID
    utc: datetime
    person: str
    reason: str
    exceeded: Mapping[str, Any]
    uuid: UUID = field(default_factory=uuid4)

    def __post_init__(self) -> None:
        check_values(self)
        # Equal to what the database gives back.
        object.__setattr__(self, "exceeded", as_read_back("ConcessionRecord.exceeded", self.exceeded))


@dataclass(frozen=True)
class ConcessionWithdrawal:
    """The end of a concession that should not have been granted: both stay stored."""

    concession: UUID
    utc: datetime
    person: str
    reason: str

    def __post_init__(self) -> None:
        check_values(self)


@dataclass(frozen=True)
class StoredConcession:
    """A concession read back: with its withdrawal, if there is one, and when it was stored."""

    record: ConcessionRecord
    withdrawal: ConcessionWithdrawal | None
    stored_utc: datetime

    @property
    def in_force(self) -> bool:
        """Whether it stands."""
        return self.withdrawal is None
