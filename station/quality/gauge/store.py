"""Gauge studies in the result database: planned, filled from live cycles or a file, read back."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any
from uuid import UUID

import numpy as np

from alignment.errors import ConfigurationError, Deed, InputError, Remedy
from db.queries import (
    Characteristic,
    Filter,
    ResultReader,
    gauge_studies,
    gauge_study,
    gauge_value_counts,
    value_series,
)
from db.records import GaugeStudyRecord, GaugeValueRecord, StoredGaugeStudy, StudyKind
from db.store import ResultStore
from station.quality.gauge.file import GaugeRow

RADIANS = "rad"
"""Unit of what the station measures."""
_RUNS, _FROM_CYCLES = "order", "cycles"


@dataclass(frozen=True)
class Run:
    """One measurement that a plan asks for."""

    part: str
    appraiser: str
    trial: int


@dataclass(frozen=True)
class Filled:
    """What filling a study from live cycles came to.

    Attributes
    ----------
    study
        Read back.
    added
        Values stored now.
    missing
        Runs of the plan that have no value yet, in the order of the plan.
    """

    study: StoredGaugeStudy
    added: int
    missing: tuple[Run, ...]


def store_rows(
    database: str,
    kind: StudyKind,
    name: str,
    rows: Sequence[GaugeRow],
    unit: str,
    numbers: Mapping[str, float | None],
    origin: str,
) -> StoredGaugeStudy:
    """Keep the values of a file as a study and read it back.

    Raises
    ------
    ConfigurationError
        When a study of that name is there already.
    StoreError
        When the database fails.
    """
    _require_new(database, name)
    plan: dict[str, Any] = {"unit": unit, "source": "file"}
    plan |= {key: value for key, value in numbers.items() if value is not None}
    references = {row.part: float(row.reference) for row in rows if row.reference is not None}
    if references:
        plan["references"] = references
    record = GaugeStudyRecord(
        kind=kind,
        name=name,
        created_utc=datetime.now(UTC),
        characteristic="values of a file",
        plan=plan,
        software_version=version("truewheel"),
        comment=f"from {origin}",
    )
    values = [
        GaugeValueRecord(record.uuid, row.part, row.appraiser, row.trial, float(row.value), row.utc)
        for row in rows
    ]
    with ResultStore(database) as store:
        store.plan_study(record)
        store.record_study_values(values)
    return load_gauge_study(database, kind, str(record.uuid))


def plan_study(
    database: str,
    kind: StudyKind,
    name: str,
    characteristic: Characteristic,
    parts: Sequence[str],
    *,
    appraisers: Sequence[str] = (),
    trials: int = 3,
    references: Mapping[str, float] | None = None,
    tolerance: float | None = None,
    station: str | None = None,
    seed: int = 0,
) -> GaugeStudyRecord:
    """Store the plan of a study that live cycles will fill.

    Parameters
    ----------
    parts
        VINs of the vehicles or masters that are driven into the station.
    appraisers
        For a study with appraisers; the plan's order then says whose turn it is.
    references, tolerance
        Certified values by part, and the width of the tolerance, radians.
    seed
        Of the order: every repetition runs through all parts in a new random order.

    Raises
    ------
    ConfigurationError
        When a study of that name is there already, or a part stands there twice.
    StoreError
        When the database fails.
    """
    _require_new(database, name)
    for choice, names in (("part", parts), ("appraiser", appraisers)):
        if len(set(names)) != len(names) or any(not each.strip() or "*" in each for each in names):
            raise ConfigurationError(
                choice=choice, expected="names without *, each once", seen=", ".join(names)
            )
    rng = np.random.default_rng(seed)
    owners = list(appraisers) or [""]
    order = [
        [parts[part], owners[owner], trial]
        for trial in range(1, trials + 1)
        for owner in rng.permutation(len(owners))
        for part in rng.permutation(len(parts))
    ]
    plan: dict[str, Any] = {"unit": RADIANS, "source": _FROM_CYCLES, "seed": seed, _RUNS: order}
    if tolerance is not None:
        plan["tolerance"] = tolerance
    if references:
        plan["references"] = dict(references)
        if len(parts) == 1:
            plan["reference"] = references[parts[0]]
    record = GaugeStudyRecord(
        kind=kind,
        name=name,
        created_utc=datetime.now(UTC),
        characteristic=str(characteristic),
        plan=plan,
        software_version=version("truewheel"),
        station=station,
    )
    with ResultStore(database) as store:
        store.plan_study(record)
    return record


def fill_study(
    database: str,
    wanted: str,
    *,
    from_utc: datetime | None = None,
    until_utc: datetime | None = None,
) -> Filled:
    """Take the values of a planned study from the cycles that were stored since.

    The first cycle of a part is its first run in the order of the plan, and so on; a wheel that was refused
    gives no value, so the next cycle stands for it. Filling again adds what came meanwhile.

    Parameters
    ----------
    from_utc, until_utc
        Period in which the study was driven; by default from its plan on, without an end.

    Raises
    ------
    ConfigurationError
        For a study that does not come from cycles.
    StoreError
        When the database fails or has no such study.
    """
    with ResultReader(database) as reader:
        study = _find(reader, None, wanted)
        record = study.record
        if record.plan.get("source") != _FROM_CYCLES:
            raise ConfigurationError(
                choice="study", expected="a study that was planned for live cycles", seen=record.name
            )
        runs = planned_runs(record)
        known = {(value.part, value.appraiser, value.trial) for value in study.values}
        since = from_utc or record.created_utc
        characteristic = Characteristic.parse(record.characteristic)
        stations = () if record.station is None else (record.station,)
        added: list[GaugeValueRecord] = []
        for part in dict.fromkeys(run.part for run in runs):
            where = Filter(from_utc=since, until_utc=until_utc, stations=stations, vin=part)
            mine = [run for run in runs if run.part == part]
            series = value_series(reader, characteristic, where, oldest=len(mine))
            for index, run in enumerate(mine[: len(series)]):
                if (run.part, run.appraiser, run.trial) not in known:
                    added.append(_value(record.uuid, run, series, index))
    if added:
        with ResultStore(database) as store:
            store.record_study_values(added)
    filled = load_gauge_study(database, record.kind, str(record.uuid))
    known = {(value.part, value.appraiser, value.trial) for value in filled.values}
    missing = tuple(run for run in runs if (run.part, run.appraiser, run.trial) not in known)
    return Filled(filled, len(added), missing)


def planned_runs(record: GaugeStudyRecord) -> list[Run]:
    """The runs of a plan, in its order; none for the values of a file."""
    return [Run(part, appraiser, trial) for part, appraiser, trial in record.plan.get(_RUNS, [])]


def load_gauge_study(database: str, kind: StudyKind | None, wanted: str) -> StoredGaugeStudy:
    """A study by UUID or name.

    Raises
    ------
    InputError
        When there is none, several of that name, or it is of another kind.
    StoreError
        When the database fails.
    """
    with ResultReader(database) as reader:
        return _find(reader, kind, wanted)


def all_studies(database: str) -> list[tuple[GaugeStudyRecord, int]]:
    """All studies, newest first, each with the number of its values that count."""
    with ResultReader(database) as reader:
        counts = gauge_value_counts(reader)
        return [(record, counts.get(record.uuid, 0)) for record in gauge_studies(reader)]


def _find(reader: ResultReader, kind: StudyKind | None, wanted: str) -> StoredGaugeStudy:
    try:
        uuids = [UUID(wanted)]
    except ValueError:
        uuids = [record.uuid for record in gauge_studies(reader, name=wanted)]
    if len(uuids) > 1:
        raise InputError(
            choice="study", expected="one study of this name", seen=f"{len(uuids)}", cure="Name its UUID"
        )
    found = gauge_study(reader, uuids[0]) if uuids else None
    if found is None:
        raise InputError(
            choice="study", expected=f"a study in {reader.where}", seen=f"none called {wanted!r}",
            remedy=Remedy(Deed.LIST_STUDIES),
        )  # fmt: skip
    if kind is not None and found.record.kind is not kind:
        raise InputError(
            choice="study", expected=f"a study of kind {kind}", seen=f"one of kind {found.record.kind}"
        )
    return found


def _require_new(database: str, name: str) -> None:
    with ResultReader(database) as reader:
        if gauge_studies(reader, name=name):
            raise ConfigurationError(
                choice="name", expected="a name that no study has", seen=repr(name), cure="Choose another"
            )


def _value(study: UUID, run: Run, series: Any, index: int) -> GaugeValueRecord:
    return GaugeValueRecord(
        study,
        run.part,
        run.appraiser,
        run.trial,
        float(series.value[index]),
        utc_of(series.time[index]),
        UUID(str(series.cycle[index])),
    )


def utc_of(time: Any) -> datetime:
    """An aware time from numpy's, which knows no zones and means UTC."""
    if isinstance(time, datetime):
        return time if time.tzinfo else time.replace(tzinfo=UTC)
    seconds = np.datetime64(time, "us").astype(np.int64) / 1e6
    return datetime.fromtimestamp(math.floor(seconds), UTC).replace(
        microsecond=round(1e6 * (seconds % 1.0)) % 1_000_000
    )
