"""Records beside the results: what a station is, the limits it judges by, gauge studies, archived images.

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


class StudyKind(enum.StrEnum):
    """The gauge studies; a type 3 study is a GRR with one appraiser."""

    TYPE1 = "type1"
    GRR = "grr"
    LINEARITY = "linearity"
    STABILITY = "stability"


class RetentionClass(enum.StrEnum):
    """How long archived images stay: those of NOK, refused and failed wheels longer than ordinary ones."""

    ORDINARY = "ordinary"
    EVIDENCE = "evidence"


@dataclass(frozen=True)
class StationRecord:
    """A station as it is from a time on: its plant and its whole configuration, without secrets."""

    station: str
    plant: str
    label: str
    valid_from_utc: datetime
    software_version: str
    config_hash: str
    configuration: Mapping[str, Any]
    # Not compared: rigs are known by name alone, whenever they came.
    rigs: tuple[str, ...] = field(default=(), compare=False)
    uuid: UUID = field(default_factory=uuid4)

    def __post_init__(self) -> None:
        check_values(self)
        object.__setattr__(self, "rigs", tuple(sorted(self.rigs)))
        object.__setattr__(
            self, "configuration", as_read_back("StationRecord.configuration", self.configuration)
        )


@dataclass(frozen=True)
class InstallationRecord:
    """A rig of a station uses a calibration from a time on; the calibration is recorded before."""

    station: str
    rig: str
    calibration_id: str
    from_utc: datetime
    uuid: UUID = field(default_factory=uuid4)

    def __post_init__(self) -> None:
        check_values(self)


@dataclass(frozen=True)
class VehicleTypeRecord:
    """The limits of a vehicle type at a station, from a time on.

    Attributes
    ----------
    limits
        Radians, of lengths millimetres: ``{"front": {"toe": [low, high], …}, …, "vehicle": {"thrust_angle":
        [low, high], "track_front": [low, high]}}``.
    """

    station: str
    vehicle_type: str
    valid_from_utc: datetime
    guard_band: bool
    limits: Mapping[str, Any]
    uuid: UUID = field(default_factory=uuid4)

    def __post_init__(self) -> None:
        check_values(self)
        object.__setattr__(self, "limits", as_read_back("VehicleTypeRecord.limits", self.limits))


@dataclass(frozen=True)
class GaugeStudyRecord:
    """A gauge study as planned.

    Attributes
    ----------
    characteristic
        What is measured: ``front_left.toe``, or any name for values from a file.
    plan
        A JSON document: parts, appraisers, trials, reference values, tolerance, whatever the method needs.
    station
        None for values from a file.
    """

    kind: StudyKind
    name: str
    created_utc: datetime
    characteristic: str
    plan: Mapping[str, Any]
    software_version: str
    station: str | None = None
    comment: str = ""
    uuid: UUID = field(default_factory=uuid4)

    def __post_init__(self) -> None:
        check_values(self)
        object.__setattr__(self, "plan", as_read_back("GaugeStudyRecord.plan", self.plan))


@dataclass(frozen=True)
class GaugeValueRecord:
    """One raw value of a study, in the unit of its characteristic (angles: radians).

    A corrected value is a new record of the same part, appraiser and trial; the newest counts.

    Attributes
    ----------
    study
        UUID of the study, which is recorded before.
    trial
        From 1.
    cycle
        UUID of the live cycle it was taken from.
    """

    study: UUID
    part: str
    appraiser: str
    trial: int
    value: float
    utc: datetime | None = None
    cycle: UUID | None = None
    uuid: UUID = field(default_factory=uuid4)

    def __post_init__(self) -> None:
        check_values(self)


@dataclass(frozen=True)
class StoredGaugeStudy:
    """A study read back.

    Attributes
    ----------
    values
        What counts: for each part, appraiser and trial the newest value, sorted by them.
    all_values
        With the corrected ones, in the order of storing.
    """

    record: GaugeStudyRecord
    values: tuple[GaugeValueRecord, ...]
    all_values: tuple[GaugeValueRecord, ...]
    stored_utc: datetime


@dataclass(frozen=True)
class ArchivedShotRecord:
    """Images of one wheel that are kept; the cycle is recorded before.

    Attributes
    ----------
    path
        Folder or file, relative to the archive's folder.
    bytes
        Size on disk.
    record_sha256
        Of the file ``archived.json`` in that folder, which holds the hash of every other file; None where
        there is no such file, as in archives of earlier programs.
    """

    cycle: UUID
    wheel: str
    path: str
    bytes: int
    archived_utc: datetime
    retention: RetentionClass
    record_sha256: str | None = None
    uuid: UUID = field(default_factory=uuid4)

    def __post_init__(self) -> None:
        check_values(self)


@dataclass(frozen=True)
class ArchiveRemoval:
    """The end of archived images: they left the ring."""

    shot: UUID
    utc: datetime
    reason: str

    def __post_init__(self) -> None:
        check_values(self)


@dataclass(frozen=True)
class StoredShot:
    """Archived images read back, with their removal if they are gone."""

    record: ArchivedShotRecord
    removal: ArchiveRemoval | None
