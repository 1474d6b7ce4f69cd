"""How cameras were: joined while their hour lasts, thinned with age, on both databases."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from alignment.errors import InputError, StoreError
from db.queries import ResultReader, camera_trends
from db.records import CameraFigure, CameraSerial
from db.rows import KEPT_HOURS
from db.store import ResultStore

CAMERA = "front_left/head_2/right"
NOON = 499_000


def shot(value: float, start: int = NOON, hours: int = 1, camera: str = CAMERA) -> CameraFigure:
    return CameraFigure.of(camera, "temperature_c", hours, start, value)


def test_figures_of_an_hour_are_joined_whether_they_come_together_or_not(
    database_url: str, open_store: Callable[..., ResultStore]
) -> None:
    store = open_store(database_url)
    store.add_camera_figures("EOL-1", [shot(40.0), shot(44.0), shot(41.0, NOON + 1), shot(7.0, NOON, 24)])
    store.add_camera_figures("EOL-1", [shot(36.0), shot(42.0, NOON + 1), shot(9.0, NOON, 0)])
    store.add_camera_figures("EOL-2", [shot(99.0)])
    store.add_camera_figures("EOL-1", [])
    with ResultReader(database_url) as reader:
        found = camera_trends(reader, "EOL-1")
        assert camera_trends(reader, "EOL-1", from_hour=NOON + 1) == (found[0], found[2])
        assert camera_trends(reader, "EOL-1", camera="front_left/head_2") == found
        assert camera_trends(reader, "EOL-1", camera="front_left/head_3") == ()
        assert camera_trends(reader, "EOL-3") == ()
    assert [(f.hours, f.start, f.n, f.mean, f.minimum, f.maximum) for f in found] == [
        (0, NOON, 1, 9.0, 9.0, 9.0),
        (1, NOON, 3, pytest.approx(40.0), 36.0, 44.0),
        (1, NOON + 1, 2, pytest.approx(41.5), 41.0, 42.0),
        (24, NOON, 1, 7.0, 7.0, 7.0),
    ]


def test_hours_and_days_go_with_age_and_first_shots_stay(
    database_url: str, open_store: Callable[..., ResultStore]
) -> None:
    """A camera takes a bounded number of rows however long its station runs."""
    store = open_store(database_url)
    old = [shot(1.0, NOON, hours) for hours in (0, 1, 24)]
    store.add_camera_figures("EOL-1", old)
    store.add_camera_figures("EOL-2", old)
    store.add_camera_figures("EOL-1", [shot(2.0, NOON + KEPT_HOURS[1])])
    with ResultReader(database_url) as reader:
        assert [figure.hours for figure in camera_trends(reader, "EOL-1")] == [0, 1, 1, 24]
        store.add_camera_figures("EOL-1", [shot(2.0, NOON + KEPT_HOURS[1] + 1)])
        assert [figure.hours for figure in camera_trends(reader, "EOL-1")] == [0, 1, 1, 24]
        store.add_camera_figures("EOL-1", [shot(2.0, NOON + KEPT_HOURS[24] + 1)])
        left = camera_trends(reader, "EOL-1")
        assert [figure.hours for figure in left] == [0, 1]
        assert len(camera_trends(reader, "EOL-2")) == 3, "those of another station are its own"


def test_mean_of_equal_values_lies_between_them_however_often_they_come(
    database_url: str, open_store: Callable[..., ResultStore]
) -> None:
    """Rounding carried it past them, and the database refused the row."""
    store = open_store(database_url)
    for _ in range(20):
        store.add_camera_figures("EOL-1", [shot(0.1)] * 7)
    with ResultReader(database_url) as reader:
        [figure] = camera_trends(reader, "EOL-1")
    assert (figure.n, figure.mean) == (140, 0.1)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_what_is_no_number_is_no_figure(value: float) -> None:
    with pytest.raises(InputError, match="finite"):
        shot(value)


def test_impossible_figures_are_refused_and_nothing_of_them_stored(
    database_url: str, open_store: Callable[..., ResultStore]
) -> None:
    store = open_store(database_url)
    wrong = CameraFigure(CAMERA, "temperature_c", 1, NOON, 1, 50.0, 60.0, 70.0)
    with pytest.raises(StoreError):
        store.add_camera_figures("EOL-1", [shot(40.0, NOON + 1), wrong])
    with ResultReader(database_url) as reader:
        assert camera_trends(reader, "EOL-1") == ()


def test_first_camera_of_a_calibration_stays_the_first(
    database_url: str, open_store: Callable[..., ResultStore]
) -> None:
    store = open_store(database_url)
    first = CameraSerial(CAMERA, "cal-1", "7")
    store.add_camera_serials("EOL-1", [first, CameraSerial(CAMERA, "cal-1", "8")])
    store.add_camera_serials(
        "EOL-1", [CameraSerial(CAMERA, "cal-1", "9"), CameraSerial(CAMERA, "cal-2", "9")]
    )
    store.add_camera_serials("EOL-2", [CameraSerial(CAMERA, "cal-1", "1")])
    store.add_camera_serials("EOL-1", [])
    assert sorted(store.camera_serials("EOL-1"), key=str) == [first, CameraSerial(CAMERA, "cal-2", "9")]
    assert store.camera_serials("EOL-3") == ()
