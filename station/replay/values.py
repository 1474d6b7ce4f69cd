"""What travels between who looks for archived images, who measures them and who counts: plain values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

from alignment.values import MeasureSettings


class ReplayState(StrEnum):
    """What came of one wheel: only `IDENTICAL` says that nothing is to be looked at."""

    IDENTICAL = "identical"
    DIFFERS = "differs"
    DAMAGED = "damaged"
    INCOMPLETE = "incomplete"
    FAILED = "failed"


class Cause(StrEnum):
    """Why a result is another one than was stored."""

    CALIBRATION = "other calibration"
    SETTINGS = "other settings"
    SOFTWARE = "other software"
    IMAGES = "other image content"
    UNEXPLAINED = "unexplained"


@dataclass(frozen=True)
class StoredFacts:
    """What the database holds of one archived wheel, for archives that say less themselves.

    Attributes
    ----------
    record_sha256
        Of the folder's record; None in archives of earlier programs.
    result
        As `sensors.formats.ArchivedResult`, the fields that the database has.
    loose
        Those of them that the database holds otherwise than they were measured, and how far apart they may be
        for that, by name.
    document
        The calibration, where the folder holds none; None where it does, or nothing knows it.
    zero, zero_id
        Fields of the zero measurement that corrected, and its id; None where there was none.
    settings
        As they were, where the database says so.
    measure
        ``tyre_plane`` or ``spin_axis``.
    """

    record_sha256: str | None
    cycle: str
    vin: str | None
    software_version: str
    result: Mapping[str, Any]
    loose: Mapping[str, float]
    document: Mapping[str, Any] | None
    zero: Mapping[str, Any] | None
    zero_id: str | None
    settings: MeasureSettings | None
    needs_place: bool
    measure: str


@dataclass(frozen=True)
class Job:
    """One folder of archived images to be measured again.

    Attributes
    ----------
    key
        Its path in the archive; what the journal counts by.
    folder
        Where it is.
    stored
        What a database says of it; None where none was asked, or it knows nothing of it.
    """

    key: str
    folder: str
    stored: StoredFacts | None = None


@dataclass(frozen=True)
class Choices:
    """What is measured with, in place of what was; goes to every process once.

    Attributes
    ----------
    calibrations
        Documents by rig, in place of those that were in force.
    settings
        Of the measurement, in place of those that were.
    within
        Radians. 0 compares every value to its last bit; above it only what became of a wheel and its angles
        count, and only where they are further apart.
    """

    calibrations: Mapping[str, Mapping[str, Any]]
    settings: MeasureSettings | None
    within: float = 0.0


@dataclass(frozen=True)
class Difference:
    """One value that is another one now."""

    field: str
    stored: float | str | bool | None
    found: float | str | bool | None


@dataclass(frozen=True)
class Replayed:
    """What came of one folder.

    Attributes
    ----------
    key
        As in `Job`.
    state
        The worst of it.
    wheel, vin, cycle
        Of what it is, where that is known.
    differences
        Between what was stored and what is found now.
    causes
        Of the differences, in words: a `Cause` and, behind a colon, what is another one.
    damage
        What became of files since they were written.
    lacks
        What the archive does not hold, so that something could not be compared.
    measured
        Whether it was measured again.
    duration_s
        Of the measurement alone.
    """

    key: str
    state: ReplayState
    wheel: str | None = None
    vin: str | None = None
    cycle: str | None = None
    differences: tuple[Difference, ...] = ()
    causes: tuple[str, ...] = ()
    damage: tuple[str, ...] = ()
    lacks: tuple[str, ...] = ()
    measured: bool = False
    duration_s: float = 0.0

    def plain(self) -> dict[str, Any]:
        """Return it as JSON has it."""
        return asdict(self) | {"state": str(self.state)}

    @classmethod
    def of(cls, plain: Mapping[str, Any]) -> Replayed:
        """Return what `plain` gave; KeyError, TypeError or ValueError for anything else."""
        values = dict(plain)
        values["state"] = ReplayState(values["state"])
        values["differences"] = tuple(Difference(**each) for each in values["differences"])
        for name in ("causes", "damage", "lacks"):
            values[name] = tuple(map(str, values[name]))
        return cls(**values)
