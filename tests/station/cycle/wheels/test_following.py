"""What follows a wheel while it is adjusted: whole in time, and forgotten when it was out of sight."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import pytest

from alignment.errors import DegenerateInputError
from alignment.follow import FollowedWheel, FollowResult, FollowRules
from alignment.prepared import PreparedRig
from alignment.values import MeasureSettings, Refusal, RefusalCode, StereoImages, WheelMeasurement
from station.cycle.wheels.following import WHOLE_S, Follower
from station.cycle.wheels.positions import WheelPosition
from station.cycle.words.cycle import LiveState, Mode, Outcome, Stop
from tests.station.bench import WHEELS, Bench, camera_error, measurement, open_bench

NO_WHEEL = Refusal(RefusalCode.NOT_A_WHEEL, "dark")
SOMETHING: object = object()


class Told:
    """Stands for `follow_wheel`: notes by what it was told to follow."""

    def __init__(self) -> None:
        self.by: list[FollowedWheel | None] = []
        self.error: Exception | None = None
        self.keeps = True

    def __call__(
        self,
        images: Sequence[StereoImages],
        rig: PreparedRig,
        settings: MeasureSettings,
        wheel: FollowedWheel | None,
        rules: FollowRules,
    ) -> FollowResult:
        self.by.append(wheel)
        if self.error is not None:
            raise self.error
        after: FollowedWheel | None = SOMETHING if self.keeps else None  # type: ignore[assignment]
        return FollowResult(NO_WHEEL, after, "nothing" if wheel is None else None)

    @property
    def followed(self) -> list[bool]:
        return [wheel is not None for wheel in self.by]


class Clock:
    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def ask(follower: Follower, times: int = 1) -> None:
    for _ in range(times):
        follower.measure([], None, MeasureSettings())  # type: ignore[arg-type]


def test_each_result_is_followed_by_the_one_before() -> None:
    told = Told()
    follower = Follower(told, Clock())
    ask(follower, 3)
    assert told.followed == [False, True, True]
    assert (follower.followed, follower.whole) == (2, 1)


def test_a_wheel_is_measured_whole_once_a_second_however_seldom_it_is_measured() -> None:
    told, clock = Told(), Clock()
    follower = Follower(told, clock)
    ask(follower)
    clock.now += 0.6 * WHOLE_S
    ask(follower)
    clock.now += 0.6 * WHOLE_S
    ask(follower, 2)
    assert told.followed == [False, True, False, True]


def test_a_wheel_that_was_out_of_sight_is_measured_whole() -> None:
    told = Told()
    follower = Follower(told, Clock())
    ask(follower, 2)
    follower.forget()
    ask(follower, 2)
    assert told.followed == [False, True, False, True]


def test_what_cannot_be_followed_and_what_raised_is_measured_whole_the_next_time() -> None:
    told = Told()
    follower = Follower(told, Clock())
    told.keeps = False
    ask(follower, 2)
    told.keeps = True
    ask(follower, 2)
    told.error = DegenerateInputError(field="a", expected="b", seen="c")
    with pytest.raises(DegenerateInputError):
        ask(follower)
    told.error = None
    ask(follower, 2)
    assert told.followed == [False, False, False, True, True, False, True]


class Following(Follower):
    """Stands for what follows one wheel: other angles than whole measurements have."""

    def __init__(self) -> None:
        super().__init__(Told(), Clock())
        self.asked = self.forgot = 0

    def forget(self) -> None:
        self.forgot += 1

    def measure(
        self, images: Sequence[StereoImages], rig: PreparedRig, settings: MeasureSettings
    ) -> WheelMeasurement | Refusal:
        self.asked += 1
        return measurement(camber=0.004)


@pytest.fixture
def bench() -> Iterator[Bench]:
    with open_bench() as bench:
        yield bench


@pytest.fixture
def following(monkeypatch: pytest.MonkeyPatch) -> dict[str, Following]:
    made: dict[str, Following] = {}

    def follower(position: WheelPosition) -> Following:
        made[position.name] = Following()
        return made[position.name]

    monkeypatch.setattr(WheelPosition, "follower", follower)
    return made


def test_what_is_shown_is_followed_and_what_counts_is_measured_whole(
    bench: Bench, following: dict[str, Following]
) -> None:
    def stop_when_all_were_shown() -> None:
        if {angles.wheel for angles, _ in bench.line.live} == set(WHEELS):
            bench.line.queue.append(Stop(1))

    bench.line.on_live = stop_when_all_were_shown
    report = bench.trigger(mode=Mode.ADJUST)
    assert report is not None
    assert report.told is Outcome.OK
    shown = [angles.camber_deg for angles, _ in bench.line.live]
    assert shown == pytest.approx([math.degrees(0.004)] * len(shown))
    (cycle,) = bench.store.cycles
    assert {wheel.camber for wheel in cycle.wheels} == {0.001}
    assert all(one.asked and not one.forgot for one in following.values())


def test_a_wheel_whose_camera_failed_is_not_followed_from_before(
    bench: Bench, following: dict[str, Following]
) -> None:
    def fail_once() -> None:
        mine = [angles.state for angles, _ in bench.line.live if angles.wheel == "front_left"]
        if mine == [LiveState.INSIDE]:
            bench.rigs["front_left"].shoot_error = camera_error()
        elif LiveState.NOT_MEASURED in mine:
            bench.rigs["front_left"].shoot_error = None
            bench.line.queue.append(Stop(1))

    bench.line.on_live = fail_once
    assert bench.trigger(mode=Mode.ADJUST) is not None
    assert following["front_left"].forgot > 0
    assert not any(one.forgot for name, one in following.items() if name != "front_left")
