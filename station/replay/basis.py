"""What a folder of archived images was measured with, and what came of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from alignment.errors import FormatError
from alignment.values import MeasureSettings
from alignment.wheel import SeriesRules
from db.records import ZeroRecord
from sensors.formats import (
    ARCHIVED_CALIBRATION,
    ARCHIVED_FILE,
    SHOT_FILE,
    ArchivedFile,
    archived_hash,
    changed_files,
    load_json,
    read_archived,
)
from station.replay.values import Job, StoredFacts


@dataclass
class ArchivedBasis:
    """What is known of a folder.

    Attributes
    ----------
    result
        What was stored; empty where nothing says it.
    partly
        Whether its angles cannot be compared.
    document
        The calibration that it was measured with; None where it is not known.
    changed, changed_calibration
        Images and what says what they are that are others than were written; whether the calibration is.
    damage, lacks
        In words, as in `Replayed`.
    """

    wheel: str | None = None
    vin: str | None = None
    cycle: str | None = None
    result: Mapping[str, Any] = field(default_factory=dict)
    loose: Mapping[str, float] = field(default_factory=dict)
    document: Mapping[str, Any] | None = None
    zero: ZeroRecord | None = None
    settings: MeasureSettings | None = None
    needs_place: bool = False
    rules: SeriesRules | None = None
    shots: tuple[str, ...] = (".",)
    software: str | None = None
    environment: Mapping[str, str] | None = None
    partly: bool = False
    changed: list[str] = field(default_factory=list)
    changed_calibration: bool = False
    damage: list[str] = field(default_factory=list)
    lacks: list[str] = field(default_factory=list)


def basis_of(job: Job) -> ArchivedBasis:
    """Return what is known of a folder; whatever is wrong with it is told as damage, and raises nothing."""
    folder, stored = Path(job.folder), job.stored
    basis = ArchivedBasis()
    if not folder.is_dir():
        basis.damage.append("the folder is missing")
        return basis
    record = _record(folder, stored, basis)
    if record is not None:
        _by_record(folder, record, basis)
        if stored is not None:
            _agree(record, stored, basis)
    elif stored is not None:
        _by_database(stored, basis)
    elif not basis.damage:
        basis.lacks.append(f"{ARCHIVED_FILE} and a record in a database: nothing says what was found")
    return basis


def _record(folder: Path, stored: StoredFacts | None, basis: ArchivedBasis) -> ArchivedFile | None:
    expected = None if stored is None else stored.record_sha256
    try:
        if not (folder / ARCHIVED_FILE).exists():
            # Earlier programs wrote none, and no calibration beside the images.
            earlier = (folder / SHOT_FILE).exists() and not (folder / ARCHIVED_CALIBRATION).exists()
            if expected is not None or not earlier:
                basis.damage.append(f"{ARCHIVED_FILE} is missing")
            return None
        found = read_archived(folder)
        if expected is not None and archived_hash(folder) != expected:
            basis.damage.append(f"{ARCHIVED_FILE} is another one than the database knows")
    except FormatError as error:
        basis.damage.append(str(error))
        return None
    return found


def _by_record(folder: Path, record: ArchivedFile, basis: ArchivedBasis) -> None:
    basis.wheel, basis.vin, basis.cycle = record.wheel, record.vin, record.cycle
    basis.result = record.result.model_dump(mode="json")
    values = record.settings.model_dump()
    basis.needs_place = values.pop("needs_place")
    basis.settings = MeasureSettings(**values)
    basis.software, basis.environment = record.software_version, record.environment
    basis.shots = record.shots
    if record.series is not None:
        basis.rules = SeriesRules(record.series.exposures, record.series.least_turn)
    if record.zero is not None:
        basis.zero = ZeroRecord(rig=record.wheel, calibration_id=record.calibration_id, **dict(record.zero))
    for name, what in changed_files(folder, record).items():
        basis.damage.append(f"{name} {what}")
        if name == ARCHIVED_CALIBRATION:
            basis.changed_calibration = True
        else:
            basis.changed.append(name)
    try:
        basis.document = load_json(folder / ARCHIVED_CALIBRATION, "a calibration")
    except FormatError:
        # What became of the file is told above.
        basis.document = None


def _agree(record: ArchivedFile, stored: StoredFacts, basis: ArchivedBasis) -> None:
    """Tell where the folder's record and the database contradict each other."""
    if record.cycle != stored.cycle:
        basis.damage.append(f"{ARCHIVED_FILE} is of another cycle, {record.cycle}")
        return
    found = record.result.model_dump(mode="json")
    apart = [
        name
        for name in ("outcome", "camber", "toe")
        if name in stored.result and not _same(stored.result[name], found[name], stored.loose.get(name, 0.0))
    ]
    if apart:
        basis.damage.append(f"{ARCHIVED_FILE} and the database differ in {', '.join(apart)}")


def _same(one: Any, other: Any, apart: float) -> bool:
    if isinstance(one, float) and isinstance(other, float):
        return one == other or abs(one - other) <= apart
    return bool(one == other)


def _by_database(stored: StoredFacts, basis: ArchivedBasis) -> None:
    basis.vin, basis.cycle = stored.vin, stored.cycle
    basis.result, basis.loose = stored.result, stored.loose
    basis.software, basis.needs_place = stored.software_version, stored.needs_place
    basis.settings = stored.settings
    basis.lacks.append("hashes of its images: whether they were changed is not known")
    basis.lacks.append("libraries and processor that measured")
    if stored.settings is None:
        basis.lacks.append("the settings of the measurement: those of a new configuration are taken")
        basis.settings = MeasureSettings()
    if stored.loose:
        basis.lacks.append("toe against the stand: it is worked out from the stored toe and yaw")
    basis.document = stored.document
    if stored.measure == "spin_axis":
        basis.rules = SeriesRules()
    if stored.zero_id is not None and stored.zero is None:
        basis.lacks.append(
            f"the zero measurement {stored.zero_id} that corrected it: angles are not compared"
        )
        basis.partly = True
        angles = ("camber", "toe", "camber_u", "toe_u")
        basis.result = {name: value for name, value in stored.result.items() if name not in angles}
    if stored.zero is not None:
        basis.zero = ZeroRecord(**stored.zero)
