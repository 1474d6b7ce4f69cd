"""Why a wheel has no angles."""

from __future__ import annotations

from dataclasses import dataclass

from db.records import WheelOutcome
from station.cycle.words.cycle import ErrorCode


@dataclass(frozen=True)
class Failure:
    """Why a wheel has no angles.

    Attributes
    ----------
    outcome
        ``refused`` when the images were taken and judged unusable, ``fault`` when the station failed.
    error_code
        What the line is told.
    reason_code, text
        What is recorded: for programs, and for people.
    """

    outcome: WheelOutcome
    error_code: ErrorCode
    reason_code: str
    text: str

    @property
    def needs_reset(self) -> bool:
        """Whether somebody must look at the station before the next cycle, unlike after a refused wheel."""
        return self.outcome is WheelOutcome.FAULT and self.error_code is not ErrorCode.NONE


def fault(error_code: ErrorCode, text: str) -> Failure:
    """Return the failure of a station part."""
    return Failure(WheelOutcome.FAULT, error_code, str(error_code), text)
