"""When a master check is due, as a configuration says it; what can never be, is refused with one error."""

from __future__ import annotations

from datetime import time, timedelta
from pathlib import Path

import pytest

from alignment.errors import ConfigurationError
from station.configuration.settings import read_station
from station.duty.plan import DutyPlan
from station.duty.words import DutyEvent
from station.running.masters import duty_plan

ROOT = Path(__file__).resolve().parents[3]
TEXT = (ROOT / "configs" / "station.toml").read_text(encoding="utf-8")


def plan_of(folder: Path, table: str) -> DutyPlan:
    (folder / "station.toml").write_text(f"{TEXT}\n{table}", encoding="utf-8")
    return duty_plan(read_station(folder / "station.toml").master_check)


def test_without_the_table_no_check_is_asked_for(tmp_path: Path) -> None:
    assert plan_of(tmp_path, "") == DutyPlan()
    assert not DutyPlan().required


def test_what_a_table_says_is_what_is_asked_for(tmp_path: Path) -> None:
    table = """[master_check]
    every_vehicles = 400
    every_hours = 1.5
    shift_starts = ["22:00", "06:00"]
    timezone = "Europe/Berlin"
    after = ["fault", "restart", "camera", "calibration"]
    warn_before_vehicles = 20
    warn_before_minutes = 30.0
    """
    assert plan_of(tmp_path, table) == DutyPlan(
        400,
        timedelta(minutes=90),
        (time(6), time(22)),
        "Europe/Berlin",
        frozenset({DutyEvent.FAULT, DutyEvent.RESTART, DutyEvent.CAMERA_RESET, DutyEvent.NEW_CALIBRATION}),
        20,
        timedelta(minutes=30),
    )


@pytest.mark.parametrize(
    ("lines", "field"),
    [
        ("", "master_check"),
        ("warn_before_vehicles = 3", "master_check"),
        ("every_vehicles = 0", "every_vehicles"),
        ("every_hours = 0", "every_hours"),
        ("every_hours = nan", "every_hours"),
        ('shift_starts = ["6:00"]', "shift_starts"),
        ('shift_starts = ["24:00"]', "shift_starts"),
        ('shift_starts = ["06:00", "06:00"]', "shift_starts"),
        ('shift_starts = ["06:00"]\ntimezone = "Berlin"', "timezone"),
        ('shift_starts = ["06:00"]\ntimezone = "../etc"', "timezone"),
        ('after = ["lunch"]', "after"),
        ('after = ["fault", "fault"]', "after"),
        ("every_vehicles = 5\nwarn_before_vehicles = 5", "warn_before_vehicles"),
        ("every_hours = 1\nwarn_before_minutes = 60", "warn_before_minutes"),
        ("every_hours = 1\nwarn_before_vehicles = 2", "warn_before_vehicles"),
        ("every_vehicles = 5\nwarn_before_minutes = 2", "warn_before_minutes"),
        ("every_vehicles = 5\nevry_hours = 2", "evry_hours"),
    ],
)
def test_what_can_never_be_is_refused(tmp_path: Path, lines: str, field: str) -> None:
    with pytest.raises(ConfigurationError, match=field):
        plan_of(tmp_path, f"[master_check]\n{lines}\n")
