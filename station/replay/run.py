"""A replay from its beginning to its end: folders found, measured, compared, counted, and noted down."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from importlib.metadata import version
from itertools import islice
from pathlib import Path

from alignment.errors import ConfigurationError, FormatError
from sensors.formats import ARCHIVED_FILE, load_json
from station.replay.archive_walk import FoundFolder, archived_folders, level_of, require_archive
from station.replay.cluster import measure_on_cluster
from station.replay.journal import Journal, identity, own_place
from station.replay.pool import measure_in_processes
from station.replay.stored import StoredResults
from station.replay.summary import ReplaySummary
from station.replay.values import Choices, Job, Replayed, ReplayState
from station.store import CODE, environment

_AT_ONCE = 200
_UNTOLD = "archive"


@dataclass(frozen=True)
class ReplayRequest:
    """What is to be replayed, with what, and where.

    Attributes
    ----------
    archive
        A station's archive, one of its days, or one folder of images.
    choices
        Of the measurement.
    database
        What was stored of them; None where the archive alone counts.
    database_name
        Of it, without password; part of what the journal is of.
    vin
        Only of this vehicle.
    first_day, last_day
        Only of these days, as the archive names them.
    workers
        Processes of this computer; without meaning on a cluster.
    scheduler
        Address of a cluster; None for this computer.
    journal
        File; None for one of the program's own, which goes when the replay is done.
    anew
        Measure what a run before this one had measured too.
    """

    archive: Path
    choices: Choices
    database: StoredResults | None = None
    database_name: str | None = None
    vin: str | None = None
    first_day: str = ""
    last_day: str = "~"
    workers: int = 1
    scheduler: str | None = None
    journal: Path | None = None
    anew: bool = False
    _of_vehicle: list[FoundFolder] = field(default_factory=list, init=False, repr=False)

    def folders(self) -> Iterator[FoundFolder]:
        """Yield what is to be replayed; for those of a vehicle the archive is looked through once."""
        every = archived_folders(self.archive, self.first_day, self.last_day)
        if self.vin is None:
            yield from every
            return
        if not self._of_vehicle:
            self._of_vehicle.extend(found for found in every if self._is_of(found, self.vin))
        yield from self._of_vehicle

    def _is_of(self, found: FoundFolder, vin: str) -> bool:
        if self.database is not None and self.database.cycles is not None:
            return found.cycle in self.database.cycles
        try:
            record = load_json(found.path / ARCHIVED_FILE, "the record of archived images")
        except FormatError:
            return False
        return isinstance(record, dict) and record.get("vin") == vin


@dataclass(frozen=True)
class ReplayProgress:
    """How far a replay is: folders done, of how many, and how many of them are not identical."""

    done: int
    total: int
    others: int


def replay_archive(
    request: ReplayRequest, report: Callable[[ReplayProgress], object] = lambda _: None
) -> ReplaySummary:
    """Measure archived images again and compare them with what was stored.

    Parameters
    ----------
    request
        What, and how.
    report
        Told after every folder.

    Raises
    ------
    ConfigurationError
        When there is nothing to replay, nothing to compare with, a choice does not fit, or the journal is
        none of this replay.
    StoreError
        When the database fails.
    """
    started = time.monotonic()
    total = _look(request)
    of = identity(
        request.archive,
        request.choices,
        {
            "database": request.database_name, "vin": request.vin,
            "days": [request.first_day, request.last_day],
        },
        f"{version('truewheel')} {environment()[CODE]}",
    )  # fmt: skip
    place = request.journal or own_place(of)
    summary = ReplaySummary(request.archive, journal=request.journal)
    with Journal(place, of, anew=request.anew) as journal:
        done: set[str] = set()
        for entry in journal.entries(done):
            summary.add(entry)
        summary.earlier = len(done)
        for each in _measured(request, done):
            journal.add(each)
            summary.add(each)
            others = summary.folders - summary.states[ReplayState.IDENTICAL]
            report(ReplayProgress(summary.folders, max(total, summary.folders), others))
        if request.journal is None:
            journal.remove()
    summary.seconds = time.monotonic() - started
    return summary


def _look(request: ReplayRequest) -> int:
    """Return how many folders there are, after refusing what makes no sense for them."""
    require_archive(request.archive)
    total, wheels, told, named = 0, set[str](), False, True
    for found in request.folders():
        total += 1
        named = named and found.wheel is not None
        wheels |= {found.wheel} if found.wheel is not None else set()
        told = told or (found.path / ARCHIVED_FILE).exists()
    if total == 0:
        what = "archived images" if request.vin is None else f"archived images of {request.vin}"
        raise ConfigurationError(
            file=request.archive, choice=_UNTOLD, expected=what, seen="none",
            cure="Check the folder, the days and the vehicle",
        )  # fmt: skip
    if not told and request.database is None and not request.choices.calibrations:
        raise ConfigurationError(
            file=request.archive,
            choice=_UNTOLD,
            expected=f"folders with {ARCHIVED_FILE}, which say what was found and with which calibration",
            seen="none: an earlier program archived them",
            cure="Name the station's database, which knows it, or a calibration to measure with",
        )
    without = set(request.choices.calibrations) - wheels
    if named and without:
        raise ConfigurationError(
            choice="calibration",
            expected=f"calibrations of the rigs that are archived: {', '.join(sorted(wheels))}",
            seen=", ".join(sorted(without)),
            cure="Leave the others out",
        )
    return total


def _measured(request: ReplayRequest, done: set[str]) -> Iterator[Replayed]:
    jobs = _jobs(request, done)
    if request.scheduler is not None:
        yield from measure_on_cluster(jobs, request.choices, request.scheduler, request.archive.resolve())
    else:
        yield from measure_in_processes(jobs, request.choices, request.workers)
    yield from _missing(request, done)


def _jobs(request: ReplayRequest, done: set[str]) -> Iterator[Job]:
    folders = request.folders()
    while portion := list(islice(folders, _AT_ONCE)):
        known = {} if request.database is None else request.database.facts(portion)
        for found in portion:
            if found.key not in done:
                yield Job(found.key, str(found.path.resolve()), known.get(found.key))


def _missing(request: ReplayRequest, done: set[str]) -> Iterator[Replayed]:
    """Yield what the database promises and the archive does not have."""
    root = level_of(request.archive)
    if request.database is None or root == request.archive.resolve().parent.parent:
        return
    days = request.first_day, request.last_day
    if root != request.archive.resolve():
        days = (request.archive.resolve().name,) * 2
    for record in request.database.missing(root, days):
        if record.path not in done:
            yield Replayed(
                record.path, ReplayState.DAMAGED, record.wheel, None, str(record.cycle),
                damage=("the folder is missing",),
            )  # fmt: skip
