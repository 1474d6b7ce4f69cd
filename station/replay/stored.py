"""What the database knows of archived images: the facts of each, calibrations, images that are gone."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from alignment.errors import ConfigurationError
from alignment.values import MeasureSettings
from db.queries import (
    ArchivedCycle,
    ResultReader,
    archived_cycles,
    calibrations_by_id,
    configuration_in_force,
    cycles_of_vin,
    kept_images,
)
from db.records import ArchivedShotRecord, CycleRecord, WheelKind, WheelRecord
from sensors.formats import validate
from station.configuration import MeasureOptions
from station.cycle import axle_of
from station.replay.archive_walk import FoundFolder
from station.replay.values import StoredFacts

_LOOSE = 1e-9
"""Radians: a value of the vehicle's own frame is worked out from one against the stand, and back."""
_COMPARED = (
    "reason_code", "points_used", "residual_rms_mm", "method", "degraded", "load_mm", "row_px",
    "knock_evidence", "camber_unseen", "toe_unseen",
)  # fmt: skip


class StoredResults:
    """Asks a result database, some hundred folders at a time.

    Parameters
    ----------
    reader
        Open.
    vin
        Only of this vehicle; None for all.
    """

    def __init__(self, reader: ResultReader, vin: str | None = None) -> None:
        self._reader = reader
        self._settings: dict[tuple[str, str], MeasureSettings | None] = {}
        self._documents: dict[str, Mapping[str, Any] | None] = {}
        self._stations: set[str] = set()
        self.cycles = None if vin is None else frozenset(cycles_of_vin(reader, vin))

    def facts(self, found: Sequence[FoundFolder]) -> dict[str, StoredFacts]:
        """Return by key what the database knows of folders."""
        uuids = sorted({each.cycle for each in found if each.cycle is not None})
        known = archived_cycles(self._reader, uuids)
        self._stations |= {cycle.record.station for cycle in known.values()}
        out: dict[str, StoredFacts] = {}
        for each in found:
            cycle = None if each.cycle is None else known.get(each.cycle)
            facts = None if cycle is None or each.wheel is None else self._facts(cycle, each.wheel)
            if facts is not None:
                out[each.key] = facts
        return out

    def missing(self, root: Path, days: tuple[str, str]) -> Iterator[ArchivedShotRecord]:
        """Yield the images that are promised and have no folder in the archive.

        Only of stations of which `facts` found folders: a central database knows the images of others too.
        """
        for record in kept_images(self._reader, sorted(self._stations)):
            day = record.path.partition("/")[0]
            of_vehicle = self.cycles is None or record.cycle in self.cycles
            if of_vehicle and days[0] <= day <= days[1] and not (root / record.path).exists():
                yield record

    def _facts(self, cycle: ArchivedCycle, wheel: str) -> StoredFacts | None:
        result = next((each for each in cycle.record.wheels if each.wheel == wheel), None)
        if result is None:
            return None
        record, shot = cycle.record, next((each for each in cycle.shots if each.wheel == wheel), None)
        values, loose = _values(record, result)
        zero = cycle.zeros.get(result.zero_measurement_id or "")
        placed = record.geometry is not None and record.geometry.reference == "vehicle"
        return StoredFacts(
            record_sha256=None if shot is None else shot.record_sha256,
            cycle=str(record.uuid),
            vin=None if record.vehicle is None else record.vehicle.vin,
            software_version=record.software_version,
            result=values,
            loose=loose,
            # What has a record of its own holds its calibration too.
            document=None if shot is None or shot.record_sha256 else self._document(result.calibration_id),
            zero=None if zero is None else asdict(zero),
            zero_id=result.zero_measurement_id,
            settings=self._settings_of(record),
            needs_place=placed or result.reason_code == "no_place",
            measure=str(result.kind or WheelKind.TYRE_PLANE),
        )

    def _document(self, name: str | None) -> Mapping[str, Any] | None:
        if name is None:
            return None
        if name not in self._documents:
            found = calibrations_by_id(self._reader, [name]).get(name)
            self._documents[name] = None if found is None else found.document
        return self._documents[name]

    def _settings_of(self, record: CycleRecord) -> MeasureSettings | None:
        key = record.station, record.config_hash
        if key not in self._settings:
            found = configuration_in_force(self._reader, *key)
            given = None if found is None else found.configuration.get("measure")
            try:
                self._settings[key] = (
                    None
                    if given is None
                    else validate(MeasureOptions, given, file=None, error=ConfigurationError).settings()
                )
            except ConfigurationError:
                # Of a program with other settings than this one.
                self._settings[key] = None
        return self._settings[key]


def _values(record: CycleRecord, wheel: WheelRecord) -> tuple[dict[str, Any], dict[str, float]]:
    """Return the fields of the result as it was measured in front of the rig, and which are worked out."""
    values: dict[str, Any] = {name: getattr(wheel, name) for name in _COMPARED}
    values |= {"outcome": str(wheel.outcome)}
    if wheel.camber is None:
        return values, {}
    # Straight ahead and the design height are not what the rig saw.
    raw = wheel.camber_raw is not None
    camber, camber_u, toe, toe_u = (
        (wheel.camber_raw, wheel.camber_raw_u, wheel.toe_raw, wheel.toe_raw_u)
        if raw
        else (wheel.camber, wheel.camber_u, wheel.toe, wheel.toe_u)
    )
    values |= {"camber": camber, "camber_u": camber_u}
    geometry = record.geometry
    if geometry is None or geometry.reference != "vehicle":
        return values | {"toe": toe, "toe_u": toe_u}, {}
    yaw = geometry.yaw
    if yaw is None or toe is None:
        # Its toe is against the stand, as its warning says.
        return values | {"toe": toe, "toe_u": toe_u}, {}
    turn = yaw if wheel.wheel == f"{axle_of(wheel.wheel)}_left" else -yaw
    # Uncertainties of the vehicle's frame have parts of the other wheels.
    del values["camber_u"]
    return values | {"toe": toe - turn}, {"camber": _LOOSE, "toe": _LOOSE}
