"""Frames of another moment in a shot: a camera that hangs, counts on its own, or sends an old picture again.

One such camera gave an error of 1.1′ with a stated 0.012′, and nothing was said.
"""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from alignment.errors import (
    CameraError,
    ConfigurationError,
    DegenerateInputError,
    FormatError,
    SeveralErrors,
)
from sensors.camera import Frame
from sensors.drivers.recorded import recorded_rig
from sensors.drivers.simulated import SimulatedCamera
from sensors.formats import read_shot, write_shot
from sensors.formats.shot import SHOT_FILE
from sensors.frames import HOST_SPREAD_S, FrameComparison, FrameTolerance
from sensors.rig import Rig, StereoHead
from sensors.shot import HeadFrames, WheelShot
from tests.sensors.samples import TIME, StillClock, shot

CAMERAS = [f"front_left/head_{h}/{side}" for h in (1, 2, 3) for side in ("left", "right")]
ORIGINS = (10.0, 5000.0, 0.5, 77.0, 1e6, 3.0)


def frames(trigger: int, at_s: float = 0.0, counters: dict[int, int] | None = None) -> list[Frame]:
    """What six cameras with clocks of their own send at a moment."""
    rng = np.random.default_rng(trigger)
    return [
        Frame(
            camera,
            rng.integers(0, 255, (4, 5), dtype=np.uint8),
            (counters or {}).get(number, trigger),
            origin + at_s,
            at_s,
            5.0,
        )
        for number, (camera, origin) in enumerate(zip(CAMERAS, ORIGINS, strict=True))
    ]


def named(errors: list[CameraError]) -> list[str]:
    return [error.camera for error in errors]


def test_six_cameras_of_one_moment_have_no_problem_whatever_their_clocks_show() -> None:
    comparison = FrameComparison()
    for trigger, at_s in enumerate((0.0, 0.1, 60.0, 7200.0, 7200.05), 1):
        assert comparison.problems(frames(trigger, at_s)) == []


def test_a_camera_that_counts_otherwise_than_the_others_is_named() -> None:
    (error,) = FrameComparison().problems(frames(7, counters={3: 6}))
    assert error.camera == CAMERAS[3]
    assert "expected a frame of trigger 7, as most cameras sent, it sent one of trigger 6" in str(error)
    assert named(FrameComparison().problems(frames(65536, counters={0: 0}))) == [CAMERAS[0]]


@pytest.mark.parametrize("number", range(6))
def test_a_stale_frame_with_a_right_counter_is_found_by_its_clock(number: int) -> None:
    comparison = FrameComparison()
    assert comparison.problems(frames(1, 0.0)) == []
    now = frames(2, 4.0)
    now[number] = replace(now[number], device_time_s=ORIGINS[number])
    (error,) = comparison.problems(now)
    assert error.camera == CAMERAS[number]
    assert "by its clock the shot before is 0.000 s, by the others 4.000 s" in str(error)
    # The next good shot is compared with the last good one.
    assert comparison.problems(frames(3, 9.0)) == []


@pytest.mark.parametrize(("off_s", "good"), [(0.019, True), (-0.019, True), (0.021, False), (-0.021, False)])
def test_the_tolerance_of_the_clocks_counts_in_both_directions(off_s: float, good: bool) -> None:
    comparison = FrameComparison(FrameTolerance(0.02))
    comparison.problems(frames(1, 0.0))
    now = frames(2, 1e-3)
    now[4] = replace(now[4], device_time_s=now[4].device_time_s + off_s)
    assert (comparison.problems(now) == []) == good


def test_clocks_may_drift_while_nothing_is_shot() -> None:
    """Between the last car of a shift and the first of the next."""
    for drift, good in ((1e-4, True), (3e-4, False)):
        comparison = FrameComparison()
        comparison.problems(frames(1, 0.0))
        now = frames(2, 36_000.0)
        now[0] = replace(now[0], device_time_s=now[0].device_time_s + drift * 36_000.0)
        assert (comparison.problems(now) == []) == good


def test_synchronised_clocks_are_compared_in_the_first_shot_already() -> None:
    now = [replace(frame, device_time_s=50.0) for frame in frames(1)]
    now[2] = replace(now[2], device_time_s=49.9)
    assert FrameComparison().problems(now) == []
    (error,) = FrameComparison(FrameTolerance(synchronised=True)).problems(now)
    assert error.camera == CAMERAS[2]
    assert "its clock shows 49.900 s, the others show 50.000 s" in str(error)


def test_a_station_may_leave_the_clocks_uncompared_and_cameras_without_a_clock_are() -> None:
    comparison = FrameComparison(FrameTolerance(0.0, synchronised=True))
    comparison.problems(frames(1, 0.0))
    now = frames(2, 4.0)
    now[1] = replace(now[1], device_time_s=ORIGINS[1])
    assert comparison.problems(now) == []
    comparison = FrameComparison()
    for trigger in (1, 2, 3):
        now = frames(trigger, 4.0 * trigger)
        now[1] = replace(now[1], device_time_s=0.0)
        assert comparison.problems(now) == []


def test_a_frozen_camera_is_named_as_often_as_it_sends_the_same_bytes() -> None:
    comparison = FrameComparison()
    old = frames(1, 0.0)[4].image
    for trigger, expected in ((1, []), (2, [CAMERAS[4]]), (3, [CAMERAS[4]])):
        now = frames(trigger, float(trigger))
        now[4] = replace(now[4], image=old.copy())
        errors = comparison.problems(now)
        assert named(errors) == expected
    assert "frozen: expected a new image" in str(errors[0])
    assert comparison.problems(frames(4, 4.0)) == []
    comparison.forget()
    assert comparison.problems(frames(4, 0.0)) == []


def test_one_changed_pixel_is_another_image() -> None:
    comparison = FrameComparison()
    first = frames(1, 0.0)
    comparison.problems(first)
    now = frames(2, 1.0)
    image = first[4].image.copy()
    image[3, 4] ^= 1
    now[4] = replace(now[4], image=image)
    assert comparison.problems(now) == []


def test_two_cameras_that_send_the_same_picture_are_one_camera() -> None:
    now = frames(1)
    now[5] = replace(now[5], image=now[2].image)
    (error,) = FrameComparison().problems(now)
    assert error.camera == CAMERAS[5]
    assert f"the same bytes as camera {CAMERAS[2]}" in str(error)


def test_a_dark_or_blinded_camera_is_left_to_the_measurement() -> None:
    comparison = FrameComparison()
    for trigger in (1, 2):
        now = [replace(frame, image=np.zeros((4, 5), np.uint8)) for frame in frames(trigger, float(trigger))]
        assert comparison.problems(now) == []


def test_impossible_tolerances_are_refused() -> None:
    for wrong in (-1.0, float("nan"), 61.0):
        with pytest.raises(ConfigurationError, match="device_time_s"):
            FrameTolerance(wrong)


class Noisy:
    """A picture with noise at every trigger; frozen when told to be."""

    def __init__(self, number: int) -> None:
        self.rng = np.random.default_rng(number)
        self.frozen = False
        self.picture = self.rng.integers(0, 200, (4, 5), dtype=np.uint8)

    def image(self, trigger_counter: int) -> np.ndarray:
        if not self.frozen:
            self.picture = self.rng.integers(0, 200, (4, 5), dtype=np.uint8)
        return self.picture


def live(clock: StillClock) -> tuple[Rig, list[Noisy], list[float]]:
    """A rig, what its cameras see, and what is added to each one's clock."""
    sources, offsets = [Noisy(n) for n in range(6)], list(ORIGINS)
    cameras = [
        SimulatedCamera(
            name, source, clock=clock, sleep=clock.sleep, device_clock=lambda n=n: clock.now + offsets[n]
        )
        for n, (name, source) in enumerate(zip(CAMERAS, sources, strict=True))
    ]
    heads = [StereoHead(f"head_{k + 1}", cameras[2 * k], cameras[2 * k + 1]) for k in range(3)]
    rig = Rig("front_left", heads, clock=clock, now=lambda: TIME)
    rig.connect()
    rig.arm()
    return rig, sources, offsets


def test_a_live_rig_refuses_the_shot_of_a_frozen_camera_even_when_it_was_armed_between() -> None:
    clock = StillClock()
    rig, sources, _ = live(clock)
    rig.shoot(1.0)
    sources[3].frozen = True
    rig.arm()
    clock.sleep(5.0)
    with pytest.raises(SeveralErrors, match="1 of 6 cameras did not deliver a frame of this shot") as caught:
        rig.shoot(1.0)
    (error,) = caught.value.exceptions
    assert isinstance(error, CameraError)
    assert error.camera == CAMERAS[3]
    sources[3].frozen = False
    assert len(rig.shoot(1.0).frames) == 6


def test_a_live_rig_refuses_a_camera_whose_clock_stood_still_until_it_is_connected_again() -> None:
    clock = StillClock()
    rig, _, offsets = live(clock)
    rig.shoot(1.0)
    clock.sleep(5.0)
    offsets[1] -= 5.0
    with pytest.raises(SeveralErrors) as caught:
        rig.shoot(1.0)
    assert f"{CAMERAS[1]}: a frame of another moment" in str(caught.value)
    rig.close()
    rig.connect()
    rig.arm()
    assert len(rig.shoot(1.0).frames) == 6


def record(tmp_path, count, same=None):
    """Shots of six cameras; camera `same` sends its first picture for ever."""
    first = shot(trigger=1)
    for trigger in range(1, count + 1):
        taken = shot(trigger=trigger)
        if same is not None:
            heads = list(taken.heads)
            heads[same] = replace(
                heads[same], left=replace(heads[same].left, image=first.heads[same].left.image)
            )
            taken = replace(taken, heads=tuple(heads))
        write_shot(tmp_path / f"{trigger:03}", taken)
    return sorted(tmp_path.iterdir())


def played(folders, count, at_end="stop"):
    rig = recorded_rig(folders, at_end)
    rig.connect()
    rig.arm()
    return [rig.shoot(1.0) for _ in range(count)]


def test_a_recording_that_repeats_is_not_frozen(tmp_path) -> None:
    assert len(played(record(tmp_path, 2), 5, "repeat")) == 5


def test_a_recording_of_one_shot_that_repeats_is_not_frozen(tmp_path) -> None:
    assert len(played(record(tmp_path, 1), 3, "repeat")) == 3
    (folder,) = tmp_path.iterdir()
    assert len(played([folder, folder], 2)) == 2


def test_a_camera_that_was_frozen_when_it_was_recorded_is_named(tmp_path) -> None:
    with pytest.raises(SeveralErrors) as caught:
        played(record(tmp_path, 2, same=1), 2)
    assert "head_2/left: frozen" in str(caught.value)


def test_a_shot_holds_heads_of_one_trigger() -> None:
    one, two, three = shot(trigger=4).heads
    late = shot(trigger=5).heads[1]
    with pytest.raises(
        DegenerateInputError, match=r"heads of the same trigger, found 4 of head_1, 5 of head_2"
    ):
        WheelShot("front_left", TIME, (one, late, three))
    assert isinstance(two, HeadFrames)


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("trigger_counter", 5, r"heads\[1\]\.left\.trigger_counter.*expected 4.*found 5 of camera .*write 1"),
        ("host_time_s", 1e9, r"heads\[1\]\.left\.host_time_s.*within 600 s.*write 0"),
    ],
)
def test_a_recorded_shot_of_two_moments_is_refused(tmp_path, key: str, value: float, words: str) -> None:
    """The images of one wheel's left head with those of another's were measured together."""
    folder = tmp_path / "shot"
    write_shot(folder, shot(trigger=4))
    described = json.loads((folder / SHOT_FILE).read_text())
    entry = described["heads"][1]
    for side in ("left", "right"):
        entry[side][key] = value
    (folder / SHOT_FILE).write_text(json.dumps(described))
    with pytest.raises(FormatError, match=words):
        read_shot(folder)


def test_a_recorded_shot_of_which_some_times_are_not_known_is_read(tmp_path) -> None:
    taken = shot(trigger=4)
    heads = [
        replace(head, left=replace(head.left, host_time_s=0.0, device_time_s=0.0)) for head in taken.heads
    ]
    heads[2] = replace(heads[2], right=replace(heads[2].right, host_time_s=5e5))
    heads[1] = replace(heads[1], right=replace(heads[1].right, host_time_s=5e5))
    heads[0] = replace(heads[0], right=replace(heads[0].right, host_time_s=5e5 + 1.0))
    write_shot(tmp_path / "shot", replace(taken, heads=tuple(heads)))
    assert read_shot(tmp_path / "shot").heads[2].left.host_time_s == 0.0


def test_frames_that_arrived_within_the_longest_timeout_are_of_one_moment(tmp_path) -> None:
    taken = shot(trigger=4)
    heads = list(taken.heads)
    host = taken.heads[0].left.host_time_s + HOST_SPREAD_S
    heads[2] = replace(heads[2], right=replace(heads[2].right, host_time_s=host))
    write_shot(tmp_path / "shot", replace(taken, heads=tuple(heads)))
    assert read_shot(tmp_path / "shot").heads[2].right.host_time_s == host


@pytest.mark.parametrize("shape", [(30, 40), (7, 13), (5, 3), (1, 1), (64, 1001)])
@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
def test_a_pixel_that_changed_is_another_image_wherever_it_lies(shape: tuple[int, int], depth: type) -> None:
    """Frozen images are told by a checksum; two of the same would stop a sound camera."""
    rng = np.random.default_rng(5)
    image = rng.integers(0, 200, shape, depth)
    frame = Frame("front_left/head_1/left", image, 1, 0.0, 0.0, 5.0)
    for _ in range(20):
        comparison = FrameComparison()
        other = image.copy()
        place = rng.integers(0, shape[0]), rng.integers(0, shape[1])
        other[place] += 1
        assert not comparison.problems([frame])
        assert not comparison.problems([replace(frame, image=other, trigger_counter=2)])
        still = comparison.problems([replace(frame, image=other.copy(), trigger_counter=3)])
        assert len(still) == (other.size > 1)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("by", [1, 8, 16])
def test_an_image_that_only_moved_is_another_image(axis: int, by: int) -> None:
    image = np.random.default_rng(5).integers(0, 255, (32, 64), np.uint8)
    frame = Frame("front_left/head_1/left", image, 1, 0.0, 0.0, 5.0)
    comparison = FrameComparison()
    assert not comparison.problems([frame])
    assert not comparison.problems([replace(frame, image=np.roll(image, by, axis), trigger_counter=2)])
