"""What a station says of itself in its database, and what happens beside its cycles."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

from alignment.errors import ConfigurationError, StoreUnavailableError
from alignment.vehicle import LENGTHS
from db.records import StationRecord
from station.configuration.settings import Configuration, read_configuration
from station.store.opening import describe_station, limits_of, open_store
from tests.station.bench import TODAY

ROOT = Path(__file__).parents[3]


def configuration(tmp_path: Path, **database: object) -> Configuration:
    shipped = read_configuration(ROOT / "configs" / "station.toml")
    changes = {"url": f"sqlite:///{tmp_path / 'station.db'}", "create": True} | database
    settings = shipped.settings.model_copy(
        update={"database": shipped.settings.database.model_copy(update=changes)}
    )
    return replace(shipped, settings=settings)


def test_limits_are_stored_in_radians_for_every_angle_that_has_some(tmp_path: Path) -> None:
    kinds = configuration(tmp_path).vehicle_types
    found = limits_of(kinds[min(kinds)])
    tolerance = kinds[min(kinds)].axles["front"].toe
    assert found["front"]["toe"] == [tolerance.limits().low, tolerance.limits().high]
    lengths = {*LENGTHS, "trail", "scrub"}
    assert all(
        -math.pi < low < high < math.pi
        for axle in found.values()
        for name, (low, high) in axle.items()
        if name not in lengths
    )


def test_a_second_station_on_the_same_database_does_not_start(tmp_path: Path) -> None:
    settings = configuration(tmp_path)
    with (
        open_store(settings) as store,
        pytest.raises(StoreUnavailableError, match=r"is running already on database .*process \d+ on "),
        open_store(settings),
    ):
        pass
    assert store.health.free_bytes is not None


def test_a_central_database_that_is_away_does_not_stop_the_station(tmp_path: Path) -> None:
    away = configuration(tmp_path, central_url="postgresql://station@127.0.0.1:9/results", timeout_s=0.5)
    with open_store(away) as store:
        assert store.results.counts()["cycles"] == 0
        store.background.step()
        assert "cannot be reached" in str(store.health.central_error)
        assert not store.health.good


def test_a_central_database_of_another_kind_is_refused(tmp_path: Path) -> None:
    with (
        pytest.raises(ConfigurationError, match="a URL that begins with 'mysql:'"),
        open_store(configuration(tmp_path, central_url="mysql://x@y/z")),
    ):
        pass


def test_no_password_of_a_database_is_stored_with_the_station(tmp_path: Path) -> None:
    settings = configuration(tmp_path, central_url="postgresql://station:Secret9@quality-server/results")
    told: list[object] = []

    class Store:
        def describe_station(self, *records: object) -> None:
            told.extend(records)

    describe_station(Store(), settings, [], TODAY)  # type: ignore[arg-type]
    assert "station_1" in repr(told)
    assert "Secret9" not in repr(told)
    station = told[0]
    assert isinstance(station, StationRecord)
    assert not {"database", "archive"} & set(station.configuration)
    assert {"line", "cycle", "measure", "rigs"} <= set(station.configuration)
