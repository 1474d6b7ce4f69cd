"""The second version of a recorded shot: settings in force, series, dark image; the first stays readable."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from alignment.errors import CameraError, FormatError, SeveralErrors
from sensors.camera import CameraSettings, SettingsInForce
from sensors.drivers.recorded import recorded_rig
from sensors.formats.shot import read_shot, write_shot
from sensors.projectors.lit_rig import LitRig, RigLight
from sensors.shot import HeadFrames, SeriesPlace
from tests.sensors.projectors.fakes import NotedProjector
from tests.sensors.samples import calibration, shot

IN_FORCE = SettingsInForce(
    model="acA1300-60gm",
    serial_number="23042117",
    exposure_ms=4.999,
    gain_db=0.1,
    pixel_format="Mono12p",
    bits=12,
    trigger_source="Line1",
    packet_size=8192,
    others=(("BlackLevel", "4.0"), ("AcquisitionMode", "Continuous")),
)


def with_settings(taken, **changes):
    """The shot whose cameras say what they are set to and how warm they are."""

    def told(frame):
        return replace(frame, **({"in_force": IN_FORCE, "temperature_c": 41.3} | changes))

    return replace(taken, heads=tuple(HeadFrames(h.name, told(h.left), told(h.right)) for h in taken.heads))


def schema_of(folder):
    return json.loads((folder / "shot.json").read_text(encoding="utf-8"))["schema"]


def full():
    taken = with_settings(shot(depth=np.uint16))
    dark = with_settings(shot(trigger=2, depth=np.uint16), temperature_c=None)
    return replace(taken, dark=dark.heads, series=SeriesPlace(3, 16, math.pi / 3))


def test_settings_series_and_dark_images_read_back_to_the_last_bit(tmp_path):
    taken = full()
    write_shot(tmp_path / "shot", taken)
    assert schema_of(tmp_path / "shot") == "truewheel.shot/2"
    again = read_shot(tmp_path / "shot", calibration())
    assert (again.rig, again.time_utc, again.series) == (taken.rig, taken.time_utc, taken.series)
    for read, written in ((again.heads, taken.heads), (again.dark, taken.dark)):
        for one, other in zip(read, written, strict=True):
            for frame, known in ((one.left, other.left), (one.right, other.right)):
                assert frame.image.dtype == known.image.dtype
                assert np.array_equal(frame.image, known.image)
                assert vars(frame) | {"image": None} == vars(known) | {"image": None}


def test_a_shot_that_says_nothing_new_is_written_so_that_older_programs_read_it(tmp_path):
    write_shot(tmp_path / "shot", shot())
    written = json.loads((tmp_path / "shot" / "shot.json").read_text(encoding="utf-8"))
    assert written["schema"] == "truewheel.shot/1"
    assert set(written) == {"schema", "rig", "time_utc", "heads"}
    assert set(written["heads"][0]["left"]) == {
        "image", "camera", "trigger_counter", "device_time_s", "host_time_s", "exposure_ms",
    }  # fmt: skip
    again = read_shot(tmp_path / "shot")
    assert (again.dark, again.series, again.frames[0].in_force) == ((), None, None)


@pytest.mark.parametrize("part", ["settings", "temperature", "series", "dark"])
def test_each_part_alone_makes_it_the_second_version(tmp_path, part):
    taken = shot()
    changed = {
        "settings": lambda: with_settings(taken, temperature_c=None),
        "temperature": lambda: with_settings(taken, in_force=None),
        "series": lambda: replace(taken, series=SeriesPlace(1, 16)),
        "dark": lambda: replace(taken, dark=shot(trigger=2).heads),
    }[part]()
    write_shot(tmp_path / "shot", changed)
    assert schema_of(tmp_path / "shot") == "truewheel.shot/2"


@pytest.mark.parametrize(
    ("change", "parts"),
    [
        (lambda d: d.update(schema="truewheel.shot/1"), ["'series'", "no such field in truewheel.shot/1"]),
        (lambda d: d["series"].update(number=17), ["'series.number': expected at most 16", "found 17"]),
        (lambda d: d["series"].update(number=0), ["'series.number'"]),
        (lambda d: d["dark"].reverse(), ["'dark': expected the heads head_1, head_2, head_3"]),
        (lambda d: d["dark"].pop(), ["'dark'"]),
        (
            lambda d: d["dark"][1]["right"].update(trigger_counter=7),
            ["'dark[1].right.trigger_counter': expected 2"],
        ),
        (
            lambda d: d["dark"][0]["left"].update(image="head_1_left.png"),
            ["a different image for each camera", "'head_1_left.png' twice"],
        ),
        (lambda d: d["heads"][0]["left"]["in_force"].update(bits=17), ["'heads[0].left.in_force.bits'"]),
        (lambda d: d["heads"][0]["left"]["in_force"].update(gian_db=1), ["gian_db", "no such field"]),
        (lambda d: d["heads"][0]["left"].update(temperature_c="warm"), ["'heads[0].left.temperature_c'"]),
    ],
)
def test_a_second_version_with_one_mistake(tmp_path, change, parts):
    folder = tmp_path / "shot"
    write_shot(folder, full())
    data = json.loads((folder / "shot.json").read_text(encoding="utf-8"))
    change(data)
    (folder / "shot.json").write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(FormatError) as caught:
        read_shot(folder)
    for part in (str(folder), *parts):
        assert part in str(caught.value)


def test_the_first_version_refuses_settings_in_its_frames(tmp_path):
    folder = tmp_path / "shot"
    write_shot(folder, with_settings(shot()))
    data = json.loads((folder / "shot.json").read_text(encoding="utf-8")) | {"schema": "truewheel.shot/1"}
    (folder / "shot.json").write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(FormatError, match=r"heads\[0\]\.left\.in_force"):
        read_shot(folder)


def test_a_recorded_rig_plays_the_second_version(tmp_path):
    write_shot(tmp_path / "shot", full())
    rig = recorded_rig([tmp_path / "shot"])
    rig.connect()
    rig.arm()
    played = rig.shoot(1.0)
    rig.close()
    assert np.array_equal(played.frames[3].image, full().frames[3].image)
    same(played, full())


def same(played, recorded):
    """All that a shot says but when it is played, and in which place of the run."""
    assert len(played.dark) == len(recorded.dark)
    pairs = zip((*played.frames, *played.dark_frames), (*recorded.frames, *recorded.dark_frames), strict=True)
    for mine, known in pairs:
        assert (mine.camera, mine.device_time_s, mine.exposure_ms) == (
            known.camera,
            known.device_time_s,
            known.exposure_ms,
        )
        assert (mine.in_force, mine.temperature_c) == (known.in_force, known.temperature_c)
        assert np.array_equal(mine.image, known.image)


def test_recorded_shots_with_and_without_dark_images_play_whole_and_measure_the_same(tmp_path):
    """The dark images of an archive were not played: what was measured live came out otherwise."""
    shots = [full(), shot(trigger=3), full()]
    for index, each in enumerate(shots):
        write_shot(tmp_path / f"{index}", each)
    rig = recorded_rig([tmp_path / f"{index}" for index in range(3)], at_end="repeat")
    rig.connect()
    rig.arm()
    for known in (*shots, *shots):
        played = rig.shoot(1.0)
        same(played, known)
        for mine, theirs in zip(played.images, known.images, strict=True):
            assert np.array_equal(mine.left, theirs.left)
    rig.close()


def test_arming_between_a_shot_and_its_dark_image_goes_on_with_the_next_shot(tmp_path):
    for index in (0, 1):
        write_shot(tmp_path / f"{index}", full())
    camera = recorded_rig([tmp_path / "0", tmp_path / "1"]).cameras[0]
    camera.connect()
    camera.arm(CameraSettings())
    camera.trigger()
    assert camera.dark_next
    camera.arm(CameraSettings())
    assert not camera.dark_next
    camera.trigger()
    assert np.array_equal(camera.fetch(0.0).image, full().frames[0].image)
    camera.trigger()
    assert np.array_equal(camera.fetch(0.0).image, full().dark_frames[0].image)
    with pytest.raises(CameraError, match="ended after 2 shots"):
        camera.trigger()


@pytest.mark.parametrize("dark", [False, True])
def test_no_projector_makes_the_next_recorded_wheel_the_dark_image_of_this_one(tmp_path, dark):
    """With dark = true over a recording every second wheel was subtracted from the one before."""
    shots = [shot(trigger=1), full(), shot(trigger=2)]
    for index, each in enumerate(shots):
        write_shot(tmp_path / f"{index}", each)
    recorded = recorded_rig([tmp_path / f"{index}" for index in range(3)])
    rig = LitRig(recorded, NotedProjector(), RigLight(dark=dark))
    rig.connect()
    rig.arm()
    for known in shots:
        same(rig.shoot(1.0), known)
    rig.close()


def test_a_dark_image_that_is_missing_is_found_when_the_recording_is_opened(tmp_path):
    write_shot(tmp_path / "0", full())
    (tmp_path / "0" / "head_1_left_dark.png").unlink()
    with pytest.raises(SeveralErrors) as caught:
        recorded_rig([tmp_path / "0"]).connect()
    assert "head_1_left_dark.png" in str(caught.value)
