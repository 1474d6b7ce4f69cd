"""When a station's master checks are due, by its configuration."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from datetime import time, timedelta

from db.store import ResultStore
from db.upkeep import MasterBook
from sensors.guarded import GuardedCamera
from station.configuration import MasterCheckOptions, StationConfig
from station.cycle import Masters, WheelPosition
from station.duty import DEMANDS, DutyPlan


def duty_plan(options: MasterCheckOptions | None) -> DutyPlan:
    """Return the plan of a configuration; nothing is asked without the table."""
    if options is None:
        return DutyPlan()
    return DutyPlan(
        options.every_vehicles,
        None if options.every_hours is None else timedelta(hours=options.every_hours),
        tuple(sorted(map(time.fromisoformat, options.shift_starts))),
        options.timezone,
        frozenset(DEMANDS[word] for word in options.after),
        options.warn_before_vehicles,
        timedelta(minutes=options.warn_before_minutes),
    )


def masters_of(
    settings: StationConfig, store: ResultStore, positions: Sequence[WheelPosition]
) -> Masters | None:
    """Return what the duty of a station rests on; None where no check is ever due."""
    plan = duty_plan(settings.master_check)
    if not plan.required:
        return None
    used = {position.name: position.in_force.calibration.id for position in positions}

    def reconnected() -> Mapping[str, int]:
        found: Counter[str] = Counter()
        for position in positions:
            for camera in getattr(position.rig, "cameras", ()):
                if isinstance(camera, GuardedCamera):
                    found[position.name] += camera.counts.reconnected
        return found

    return Masters(plan, MasterBook(store, settings.station.id, used), reconnected)
