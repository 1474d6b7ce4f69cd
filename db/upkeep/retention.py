"""The archive of images as a ring: the oldest go when they are too many or too old, evidence last."""

from __future__ import annotations

import logging
import shutil
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

from sqlalchemy import ColumnElement, Connection, and_, func, or_, select

from db.records import ArchivedShotRecord, ArchiveRemoval, RetentionClass
from db.rows import SHOTS, record_of
from db.schema import archive_removals, archived_shots, cycles, doubt_closings, doubts
from db.store import ResultStore

_LOG = logging.getLogger("truewheel.archive")
# In one go; the next call takes the next ones.
_MOST = 500


@dataclass(frozen=True)
class Policy:
    """How much is kept, and how long.

    Attributes
    ----------
    most_bytes
        Of all images together; the oldest ordinary ones go first, evidence only when no other is left.
    ordinary_days, evidence_days
        Longest time of images of good wheels, and of NOK, refused and failed ones.
    """

    most_bytes: int
    ordinary_days: float
    evidence_days: float


@dataclass(frozen=True)
class Kept:
    """What the archive holds."""

    shots: int
    bytes: int


@dataclass(frozen=True)
class Leaving:
    """Images that the policy no longer keeps, and why."""

    record: ArchivedShotRecord
    reason: str


def kept(store: ResultStore) -> Kept:
    """How many images the archive holds, as the database knows."""
    with store.reading() as connection:
        return _kept(connection)


def leaving(store: ResultStore, policy: Policy, now: datetime, most: int = _MOST) -> tuple[Leaving, ...]:
    """What the policy no longer keeps, at most so many of each class; changes nothing."""
    with store.reading() as connection:
        return _leaving(connection, policy, now, most)


def enforce(
    store: ResultStore, folder: Path, policy: Policy, now: datetime
) -> tuple[ArchivedShotRecord, ...]:
    """Remove what the policy no longer keeps, at most some hundreds in one call; return it.

    The removal is recorded before the files go: a record never promises images that are not there. Files that
    cannot be deleted are tried again at the next call, as their size still counts on the disk.

    Raises
    ------
    StoreError
        When the removal cannot be recorded; then nothing is deleted.
    """
    with store.reading() as connection:
        gone = _leaving(connection, policy, now, _MOST)
        late = _removed(connection)
    for one in gone:
        store.remove_shot(ArchiveRemoval(one.record.uuid, now, one.reason))
    records = tuple(one.record for one in gone)
    for record in (*late, *records):
        _delete(folder, record)
    return records


def _kept(connection: Connection) -> Kept:
    query = select(func.count(), func.coalesce(func.sum(archived_shots.c.bytes), 0)).where(_is_kept())
    number, size = connection.execute(query).one()
    return Kept(int(number), int(size))


def _is_kept() -> ColumnElement[bool]:
    return (
        ~select(archive_removals.c.shot_id).where(archive_removals.c.shot_id == archived_shots.c.id).exists()
    )


def _counts_as(retention: RetentionClass) -> ColumnElement[bool]:
    """Of this class; images of a wheel in doubt count as evidence until the doubt is closed."""
    doubted = (
        select(doubts.c.uuid)
        .join(cycles, cycles.c.uuid == doubts.c.cycle)
        .outerjoin(doubt_closings, doubt_closings.c.doubt == doubts.c.uuid)
        .where(
            cycles.c.id == archived_shots.c.cycle_id,
            doubts.c.wheel == archived_shots.c.wheel,
            doubt_closings.c.doubt.is_(None),
        )
        .exists()
    )
    if retention is RetentionClass.EVIDENCE:
        return or_(archived_shots.c.retention == retention, doubted)
    return and_(archived_shots.c.retention == retention, ~doubted)


def _leaving(connection: Connection, policy: Policy, now: datetime, most: int) -> tuple[Leaving, ...]:
    found: list[Leaving] = []
    excess = _kept(connection).bytes - policy.most_bytes
    for retention, days in (
        (RetentionClass.ORDINARY, policy.ordinary_days),
        (RetentionClass.EVIDENCE, policy.evidence_days),
    ):
        oldest = (
            SHOTS.where(_is_kept(), _counts_as(retention))
            .order_by(archived_shots.c.archived_utc, archived_shots.c.id)
            .limit(most)
        )
        rows = connection.execute(oldest).mappings().all()
        for row in rows:
            record = record_of(ArchivedShotRecord, row)
            if record.archived_utc < now - timedelta(days=days):
                reason = f"older than {days:g} days"
            elif excess > 0:
                reason = f"the archive holds more than {policy.most_bytes / 1e9:g} GB"
            else:
                break
            found.append(Leaving(record, reason))
            excess -= record.bytes
        if len(rows) == most:
            # More of this class may be left; until none is, the next one gives no room.
            excess = 0
    return tuple(found)


def _removed(connection: Connection) -> list[ArchivedShotRecord]:
    """Those recorded as gone last, of which files may be left."""
    query = (
        SHOTS.join(archive_removals, archive_removals.c.shot_id == archived_shots.c.id)
        .order_by(archive_removals.c.utc.desc())
        .limit(_MOST)
    )
    return [record_of(ArchivedShotRecord, row) for row in connection.execute(query).mappings()]


def _delete(folder: Path, record: ArchivedShotRecord) -> None:
    path = folder / record.path
    # Only what lies in the archive, and not all of it: a record may come from another station.
    if folder.resolve() not in path.resolve().parents or not path.exists():
        return
    try:
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    except OSError as error:
        _LOG.warning("archived images %s cannot be deleted: %s", path, error)
