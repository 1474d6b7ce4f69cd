"""The duty of a station by its configuration: off without the table, and each rig's cameras are counted."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

from db.store import ResultStore
from sensors.guarded import GuardedCamera
from station.configuration.settings import StationConfig, read_station
from station.cycle.wheels.positions import WheelPosition
from station.duty.words import DutyEvent
from station.running.masters import masters_of

TEXT = (Path(__file__).resolve().parents[3] / "configs" / "station.toml").read_text(encoding="utf-8")


def settings_of(folder: Path, table: str) -> StationConfig:
    (folder / "station.toml").write_text(f"{TEXT}\n{table}", encoding="utf-8")
    return read_station(folder / "station.toml")


def camera(reconnected: int) -> GuardedCamera:
    found = GuardedCamera.__new__(GuardedCamera)
    found.counts = SimpleNamespace(reconnected=reconnected)  # type: ignore[assignment]
    return found


def position(name: str, *cameras: Any) -> WheelPosition:
    known = SimpleNamespace(calibration=SimpleNamespace(id=f"cal-{name}"))
    return cast(
        "WheelPosition", SimpleNamespace(name=name, in_force=known, rig=SimpleNamespace(cameras=cameras))
    )


def test_a_station_of_today_has_no_duty(tmp_path: Path) -> None:
    assert masters_of(settings_of(tmp_path, ""), cast("ResultStore", None), []) is None


def test_cameras_that_were_reached_anew_are_counted_by_rig(tmp_path: Path) -> None:
    settings = settings_of(tmp_path, "[master_check]\nafter = ['camera']\n")
    cameras = [camera(0), camera(2)]
    places = [position("front_left", *cameras), position("front_right", camera(0), object())]
    found = masters_of(settings, cast("ResultStore", None), places)
    assert found is not None
    assert found.plan.after == {DutyEvent.CAMERA_RESET}
    assert found.book.in_force == {"front_left": "cal-front_left", "front_right": "cal-front_right"}
    assert dict(found.reconnected()) == {"front_left": 2, "front_right": 0}
    cameras[0].counts.reconnected = 1
    assert found.reconnected()["front_left"] == 3
