"""Which images of a cycle are kept, and for how long: the policy of the archive."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

from db.records import CycleOutcome, CycleRecord, RetentionClass, Verdict, WheelOutcome
from station.configuration import KeptFor


class Keeping:
    """Says of each cycle which wheels' images are kept; counts the cycles that it is asked of.

    Parameters
    ----------
    keep
        ``all``, ``evidence`` (only wheels that were NOK, refused or failed), or the reasons for which all
        wheels of a cycle are kept: toes and axles are judged together, so the others explain it too.
    every
        Beside that, all wheels of every so many-th cycle, the first one included; None for none.
    """

    def __init__(
        self, keep: Literal["all", "evidence"] | tuple[KeptFor, ...], every: int | None = None
    ) -> None:
        self._keep, self._every = keep, every
        self._asked = 0

    def of(self, record: CycleRecord) -> dict[str, RetentionClass]:
        """Return by name the wheels of a cycle whose images are kept, and how long."""
        self._asked += 1
        own = {wheel.wheel: _own_class(record, wheel.wheel) for wheel in record.wheels}
        reasons = set(_reasons(record))
        if not isinstance(self._keep, str) and reasons & set(self._keep):
            # Kept together, they go together.
            return dict.fromkeys(own, RetentionClass.EVIDENCE)
        if self._keep == "all" or (self._every is not None and (self._asked - 1) % self._every == 0):
            return own
        if self._keep == "evidence":
            return {name: found for name, found in own.items() if found is RetentionClass.EVIDENCE}
        return {}


def _own_class(record: CycleRecord, name: str) -> RetentionClass:
    good = any(
        wheel.wheel == name and wheel.outcome is WheelOutcome.MEASURED and wheel.verdict is not Verdict.NOK
        for wheel in record.wheels
    )
    return RetentionClass.ORDINARY if good else RetentionClass.EVIDENCE


def _reasons(record: CycleRecord) -> Iterator[KeptFor]:
    """Everything for which a cycle may be kept."""
    outcomes = {wheel.outcome for wheel in record.wheels}
    if record.outcome is CycleOutcome.NOK or Verdict.NOK in record.verdicts:
        yield "nok"
    if WheelOutcome.REFUSED in outcomes:
        yield "refused"
    if WheelOutcome.FAULT in outcomes:
        yield "fault"
