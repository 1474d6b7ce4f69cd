"""What drifts is told once, before it stops a wheel; trends survive a database that is away."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import Any
from uuid import UUID

import pytest

from alignment.errors import StoreUnavailableError
from alignment.values import HeadQuality, Refusal, RefusalCode, WheelMeasurement
from db.records import CameraFigure, CameraSerial, CycleOutcome, Severity
from sensors.camera_health import CameraCounts, CameraStatistics
from sensors.shot import HeadFrames, WheelShot
from station.configuration.health import HealthOptions
from station.cycle.words.cycle import ErrorCode
from station.health.figures import Figure, figures_of
from station.health.watch import CalibrationUsed, CameraWatch, Taken
from tests.sensors.samples import shot as sample_shot
from tests.station.bench import TODAY, measurement, open_bench

CAMERA = "front_left/head_2/right"
PLACE = "wheel front left, head 2, right camera, serial 7"
HOUR = int(TODAY.timestamp() // 3600)
CALIBRATED = HOUR - 100
HEADS = ("head_1", "head_2", "head_3")


class FakeCamera:
    def __init__(self, name: str = CAMERA) -> None:
        self.name, self.place = name, PLACE
        self.counts, self.statistics = CameraCounts(), CameraStatistics()
        self.serial: str | None = None

    def expect(self, serial: str) -> None:
        self.serial = serial


class FakeStore:
    def __init__(self) -> None:
        self.kept: list[CameraFigure] = []
        self.serials: list[CameraSerial] = []
        self.error: Exception | None = None

    def add_camera_figures(self, station: str, figures: Iterable[CameraFigure]) -> None:
        if self.error is not None:
            raise self.error
        self.kept += figures

    def add_camera_serials(self, station: str, added: Iterable[CameraSerial]) -> None:
        if self.error is not None:
            raise self.error
        self.serials += added


class Watched:
    """A watch with all that it tells at hand; `shots` takes the same value so often."""

    def __init__(
        self, first: Iterable[CameraFigure] = (), serials: Iterable[CameraSerial] = (), **options: Any
    ) -> None:
        self.said: list[tuple[Severity, str, str]] = []
        self.camera, self.store, self.now = FakeCamera(), FakeStore(), 0.0
        self.watch = CameraWatch(
            HealthOptions(**options),
            "EOL-1",
            self.store,
            lambda severity, code, text, cycle: self.said.append((severity, code, text)),
            [self.camera],
            {"front_left": CalibrationUsed("cal-1", CALIBRATED)},
            first,
            serials,
            lambda: self.now,
        )

    def shots(self, figure: Figure, value: float, count: int = 1) -> list[str]:
        """Codes that are told meanwhile."""
        before = len(self.said)
        for _ in range(count):
            self.watch.take(Taken(TODAY, {CAMERA: {figure: value}}))
        return [code for _, code, _ in self.said[before:]]


def good_shot(temperature_c: float | None = None) -> WheelShot:
    taken = sample_shot(heads=HEADS, rig="front_left")
    heads = [
        HeadFrames(
            head.name,
            replace(head.left, temperature_c=temperature_c),
            replace(head.right, temperature_c=temperature_c),
        )
        for head in taken.heads
    ]
    return replace(taken, heads=tuple(heads))


def found(width: float = 2.0, light: float = 4.0, row: float | None = 0.02) -> WheelMeasurement:
    return replace(
        measurement(),
        heads=tuple(
            HeadQuality(
                name, 900, 1000, 0.02, row, 0.25, line_width_px=(1.0, width), line_strength=(3.0, light)
            )
            for name in HEADS
        ),
    )


def test_a_shot_tells_of_each_of_its_cameras() -> None:
    figures = figures_of(good_shot(41.5), found())
    assert len(figures) == 6
    assert figures[CAMERA] == {
        Figure.TEMPERATURE: 41.5,
        Figure.WIDTH: 2.0,
        Figure.LIGHT: 4.0,
        Figure.ROW: 0.02,
    }
    assert figures["front_left/head_2/left"][Figure.WIDTH] == 1.0


def test_what_a_driver_or_a_refusal_does_not_tell_is_no_figure() -> None:
    refused = Refusal(RefusalCode.HEAD_DARK, "dark")
    assert figures_of(good_shot(float("nan")), refused)[CAMERA] == {}
    assert figures_of(good_shot(), replace(found(row=None), heads=found(row=None).heads[:1])).keys() == {
        f"front_left/{head}/{side}" for head in HEADS for side in ("left", "right")
    }
    assert figures_of(None, None) == {}


def test_hot_camera_is_told_once_by_its_place_and_again_when_it_is_well() -> None:
    watched = Watched()
    assert watched.shots(Figure.TEMPERATURE, 65.0, 3) == []
    assert watched.shots(Figure.TEMPERATURE, 66.0, 50) == ["camera_temperature"]
    severity, _, text = watched.said[0]
    assert severity is Severity.WARNING
    assert text.startswith(f"camera {CAMERA} ({PLACE}): 66 °C, at most 65 °C is well. Check")
    assert watched.shots(Figure.TEMPERATURE, 64.0, 5) == [], "it would come and go"
    assert watched.shots(Figure.TEMPERATURE, 60.0, 5) == ["camera_temperature_well"]
    assert watched.shots(Figure.TEMPERATURE, 90.0) == ["camera_temperature"]


@pytest.mark.parametrize(
    ("figure", "first", "good", "bad"),
    [
        (Figure.WIDTH, 2.0, 2.4, 2.6),
        (Figure.LIGHT, 4.0, 2.8, 2.6),
        (Figure.LIGHT, 4.0, 5.8, 6.2),
        (Figure.ROW, 0.02, 0.11, 0.13),
    ],
)
def test_drift_from_the_first_shots_is_told_by_its_mean_and_never_by_one_shot(
    figure: Figure, first: float, good: float, bad: float
) -> None:
    watched = Watched()
    code = f"camera_{figure.name.lower()}"
    assert watched.shots(figure, first, 60) == []
    assert watched.shots(figure, good, 60) == []
    assert watched.shots(figure, bad * 1.2) == []
    assert watched.shots(figure, bad, 60) == [code]
    assert watched.shots(figure, first, 60) == [f"{code}_well"]


def test_first_shots_are_those_after_the_calibration_and_survive_the_program() -> None:
    """After a restart a worn projector would have been the new normal."""
    before = Watched()
    before.shots(Figure.LIGHT, 4.0, 70)
    before.watch.keep()
    [first] = [figure for figure in before.store.kept if figure.hours == 0]
    assert (first.start, first.n, first.mean) == (CALIBRATED, 50, 4.0)
    assert Watched([first]).shots(Figure.LIGHT, 2.0, 10) == ["camera_light"]
    other = replace(first, start=CALIBRATED - 5)
    assert Watched([other]).shots(Figure.LIGHT, 2.0, 60) == [], "they were of the calibration before"


def test_too_few_first_shots_compare_nothing() -> None:
    few = CameraFigure(CAMERA, Figure.WIDTH, 0, CALIBRATED, 9, 2.0, 2.0, 2.0)
    watched = Watched([few], width_stop_ratio=2.0)
    assert watched.shots(Figure.WIDTH, 9.0, 10) == []
    assert watched.watch.stopped(good_shot(), found(width=50.0)) is None


def test_failed_shots_among_the_last_hundred_are_told_and_forgotten_with_them() -> None:
    watched = Watched()
    assert watched.shots(Figure.FAILURES, 0.0, 10) == []
    assert watched.shots(Figure.FAILURES, 1.0) == []
    assert watched.shots(Figure.FAILURES, 0.0, 80) == []
    assert watched.shots(Figure.FAILURES, 1.0) == ["camera_failures"]
    assert "2 of its last 100 shots failed" in watched.said[0][2]
    assert watched.shots(Figure.FAILURES, 0.0, 25) == ["camera_failures_well"]


def test_slow_link_is_told_against_its_fastest() -> None:
    watched = Watched()
    assert watched.shots(Figure.LINK, 1000.0, 3) == []
    assert watched.shots(Figure.LINK, 100.0, 5) == ["camera_link"]
    assert "at 100 Mbit/s, it did at 1000" in watched.said[0][2]
    assert watched.shots(Figure.LINK, 1000.0) == ["camera_link_well"]


def test_what_a_camera_and_its_driver_count_is_counted_once() -> None:
    watched = Watched()
    counts = watched.camera.counts
    assert watched.watch.counted("front_left") == {CAMERA: {Figure.FAILURES: 0.0}}
    counts.missing, counts.bad, counts.lost = 1, 1, 1
    watched.camera.statistics = CameraStatistics(1000.0, dropped=2, incomplete=2)
    assert watched.watch.counted("front_left") == {CAMERA: {Figure.FAILURES: 4.0, Figure.LINK: 1000.0}}
    assert watched.watch.counted("front_left")[CAMERA][Figure.FAILURES] == 0.0
    # Reached anew, its driver counts from nought.
    watched.camera.statistics = CameraStatistics(float("nan"), dropped=1)
    assert watched.watch.counted("front_left") == {CAMERA: {Figure.FAILURES: 1.0}}
    assert watched.watch.counted("rear_left") == {}


@pytest.mark.parametrize(
    ("options", "shot", "measured", "words"),
    [
        ({"temperature_stop_c": 80.0}, good_shot(81.0), found(), "81 °C, at most 80 °C is well"),
        ({"width_stop_ratio": 2.0}, good_shot(), found(width=4.1), "2.05 times as wide"),
        ({"light_stop_ratio": 3.0}, good_shot(), found(light=1.2), "only 30% as bright"),
        ({"row_stop_px": 0.5}, good_shot(), found(row=0.6), "epipolar residual is 0.60 px, it was 0.02"),
    ],
)
def test_limit_that_stops_names_the_camera_and_one_that_is_not_set_stops_nothing(
    options: dict[str, float], shot: WheelShot, measured: WheelMeasurement, words: str
) -> None:
    values = {Figure.WIDTH: 2.0, Figure.LIGHT: 4.0, Figure.ROW: 0.02}
    first = [CameraFigure(CAMERA, f, 0, CALIBRATED, 50, v, v, v) for f, v in values.items()]
    said = Watched(first, **options).watch.stopped(shot, measured)
    assert said is not None
    assert words in said
    if "temperature_stop_c" not in options:
        assert PLACE in said
    assert Watched(first, **options).watch.stopped(good_shot(30.0), found()) is None
    assert Watched(first).watch.stopped(shot, measured) is None


def test_trends_wait_for_a_database_that_is_away() -> None:
    watched = Watched()
    watched.store.error = StoreUnavailableError("away")
    watched.shots(Figure.TEMPERATURE, 40.0, 3)
    watched.watch.keep()
    watched.store.error = None
    watched.shots(Figure.TEMPERATURE, 44.0)
    watched.watch.keep()
    watched.watch.keep()
    assert [(f.hours, f.start, f.n, f.mean) for f in watched.store.kept] == [
        (1, HOUR, 4, 41.0),
        (24, HOUR - HOUR % 24, 4, 41.0),
    ]


def test_camera_that_was_seen_first_with_a_calibration_is_expected_at_every_start_with_it() -> None:
    """A camera that was exchanged while the station was off was believed, and never calibrated."""
    watched = Watched()
    watched.watch.keep()
    assert watched.store.serials == [], "nothing was seen yet"
    watched.camera.serial = "7"
    watched.store.error = StoreUnavailableError("away")
    watched.watch.keep()
    watched.store.error = None
    for _ in range(2):
        watched.watch.keep()
    assert watched.store.serials == [CameraSerial(CAMERA, "cal-1", "7")]
    again = Watched(serials=watched.store.serials)
    assert again.camera.serial == "7"
    again.watch.keep()
    assert again.store.serials == []
    assert Watched(serials=[CameraSerial(CAMERA, "cal-0", "6")]).camera.serial is None
    assert Watched(serials=[CameraSerial("rear_left/head_1/left", "cal-1", "6")]).camera.serial is None


def test_what_waits_at_the_end_is_stored() -> None:
    watched = Watched()
    with watched.watch:
        for hour in range(3):
            at = datetime(2026, 3, 2, tzinfo=UTC) + timedelta(hours=hour)
            watched.watch.offer(Taken(at, {CAMERA: {Figure.TEMPERATURE: 40.0}}, ("again",), UUID(int=1)))
    assert sorted(figure.hours for figure in watched.store.kept) == [1, 1, 1, 24]
    assert [code for _, code, _ in watched.said] == ["shot_retaken"] * 3
    assert watched.watch.thread.failures == 0


def test_more_than_the_watch_can_take_costs_nobody_anything() -> None:
    watched = Watched()
    for _ in range(2000):
        watched.watch.offer(Taken(TODAY, {CAMERA: {Figure.TEMPERATURE: 40.0}}))
    with watched.watch:
        pass
    assert max(figure.n for figure in watched.store.kept) == 256


def test_cycle_is_watched_and_a_stopped_wheel_is_a_camera_fault() -> None:
    watched = Watched(temperature_stop_c=80.0)
    with open_bench(stopped=watched.watch.stopped, watch=watched.watch) as bench:
        bench.found["front_left"] = found()
        bench.rigs["front_left"].shot = good_shot(85.0)
        watched.camera.counts.missing = 1
        report = bench.trigger()
        assert report is not None
        assert report.record.outcome is CycleOutcome.FAULT
        assert bench.line.status.error_code is ErrorCode.CAMERA_FAULT
        [failed] = [w for w in report.record.wheels if w.wheel == "front_left"]
        assert "85 °C, at most 80 °C is well" in (failed.reason_text or "")
    with watched.watch:
        pass
    kept = {(f.camera, f.figure): f.mean for f in watched.store.kept if f.hours == 1}
    assert kept[CAMERA, Figure.TEMPERATURE] == 85.0
    assert kept[CAMERA, Figure.FAILURES] == 1.0


def test_options_warn_before_they_stop() -> None:
    for name, warn, stop in (
        ("temperature_{}_c", 70.0, 70.0),
        ("width_{}_ratio", 1.5, 1.4),
        ("light_{}_ratio", 2.0, 1.9),
        ("row_{}_px", 0.3, 0.2),
    ):
        with pytest.raises(ValueError, match=f"more than {name.format('warn')}"):
            HealthOptions(**{name.format("warn"): warn, name.format("stop"): stop})
