"""A vehicle from a folder: what is printed of a good one, one clear error for every kind of broken one."""

from __future__ import annotations

import itertools
import json
import math
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import alignment.measure_spin
from sensors.formats import read_image, write_image
from tests.end_to_end.conftest import Ended, Truewheel, simulated

pytestmark = pytest.mark.slow(1)  # All need a rendered vehicle, which takes eleven seconds.

WHEELS = ("front_left", "front_right", "rear_left", "rear_right")
YAW_DEG, OFFSET_MM = 0.4, -15.0


@pytest.fixture(scope="session")
def rendered_vehicle() -> Path:
    return simulated(f"vehicle --seed 3 --yaw-deg {YAW_DEG} --offset-mm {OFFSET_MM}") / "made"


@pytest.fixture
def vehicle(rendered_vehicle: Path, tmp_path: Path) -> Path:
    """A copy of the rendered vehicle that a test may damage."""
    folder = tmp_path / "vehicle"
    shutil.copytree(rendered_vehicle, folder)
    return folder


@pytest.fixture
def truth(vehicle: Path) -> Any:
    """What the vehicle was; the measurement never opens it."""
    found = json.loads((vehicle / "truth.json").read_text(encoding="utf-8"))
    (vehicle / "truth.json").unlink()
    return found


def facts(vehicle: Path, change: Callable[[Any], None]) -> None:
    path = vehicle / "vehicle.json"
    content = json.loads(path.read_text(encoding="utf-8"))
    change(content)
    path.write_text(json.dumps(content), encoding="utf-8")


def test_vehicle_that_stands_askew_is_measured_in_its_own_frame(
    truewheel: Truewheel, vehicle: Path, truth: Any
) -> None:
    ended = truewheel("measure-vehicle", vehicle, "--json")
    assert ended.status == 0, ended.err
    found = ended.json
    assert (found["outcome"], found["reason"], found["missing"]) == ("measured", None, [])
    assert found["between"] == "contact_centres"
    assert set(found["wheels"]) == set(WHEELS)
    for name, wheel in found["wheels"].items():
        true = truth["wheels"][name]
        assert wheel["kind"] == "tyre_plane"
        for angle in ("camber", "toe"):
            # 95 % intervals of a drawn number: half as much again holds all of a few.
            off = abs(wheel[f"{angle}_deg"] - true[f"{angle}_deg"])
            assert off <= 1.5 * wheel[f"{angle}_u95_deg"] + 1e-4
            assert off < 0.1 / 60.0
        assert wheel["reference_mm"] == pytest.approx(true["reference_mm"], abs=0.05)
        # Against the stand the same toe is off by the whole yaw.
        assert abs(wheel["stand_toe_deg"] - true["toe_deg"]) == pytest.approx(YAW_DEG, abs=0.005)
    for name, unit in (
        ("thrust_angle", "deg"),
        ("yaw", "deg"),
        ("wheelbase_left", "mm"),
        ("wheelbase_right", "mm"),
        ("track_front", "mm"),
        ("track_rear", "mm"),
        ("setback_front", "mm"),
        ("setback_rear", "mm"),
        ("sidewall_track_front", "mm"),
    ):
        off, u95 = found[f"{name}_{unit}"] - truth[f"{name}_{unit}"], found[f"{name}_u95_{unit}"]
        assert abs(off) <= 1.5 * u95, name
        assert u95 < (0.2 if unit == "mm" else 0.01)
        assert abs(off) < (0.1 if unit == "mm" else 0.1 / 60.0)
    assert found["place_y_mm"] == pytest.approx(OFFSET_MM, abs=0.05)
    assert found["axles"]["front"]["total_toe_deg"] == pytest.approx(
        truth["total_toe_front_deg"], abs=0.1 / 60.0
    )


def test_table_for_people_says_what_lengths_and_toes_refer_to(truewheel: Truewheel, vehicle: Path) -> None:
    facts(vehicle, lambda content: content.update(tyre_width_sigma_mm=0.6))
    ended = truewheel("measure-vehicle", vehicle)
    assert ended.status == 0
    for words in ("front_left", "thrust angle", "wheelbase left", "against the vehicle's own centreline"):
        assert words in ended.out
    assert "lengths between contact centres" in ended.out
    assert "% is the spread of tyre widths" in ended.out


def test_spread_of_tyre_widths_is_said_of_single_toes_and_not_felt_by_total_toe(
    truewheel: Truewheel, vehicle: Path
) -> None:
    before = truewheel("measure-vehicle", vehicle, "--json").json
    facts(vehicle, lambda content: content.update(tyre_width_sigma_mm=0.6))
    after = truewheel("measure-vehicle", vehicle, "--json").json
    for name in WHEELS:
        assert after["wheels"][name]["toe_u95_deg"] > 3.0 * before["wheels"][name]["toe_u95_deg"]
        assert after["wheels"][name]["toe_share_of_tyre_widths"] > 0.9
        assert after["wheels"][name]["toe_deg"] == before["wheels"][name]["toe_deg"]
    assert after["axles"] == before["axles"]


def test_two_rigs_of_one_axle_say_what_is_missing(truewheel: Truewheel, vehicle: Path) -> None:
    whole = truewheel("measure-vehicle", vehicle, "--json").json

    def without_rear(content: Any) -> None:
        content["rigs"] = {name: rig for name, rig in content["rigs"].items() if "front" in name}

    facts(vehicle, without_rear)
    ended = truewheel("measure-vehicle", vehicle, "--json")
    assert ended.status == 0
    found = ended.json
    assert (found["outcome"], found["missing"]) == ("incomplete", ["rear_left", "rear_right"])
    assert "without rear_left and rear_right" in found["reason"]
    assert found["axles"]["front"] == pytest.approx(whole["axles"]["front"])
    assert found["wheels"]["front_left"]["camber_deg"] == whole["wheels"]["front_left"]["camber_deg"]
    for unknown in (
        "thrust_angle_deg",
        "yaw_deg",
        "wheelbase_left_mm",
        "track_front_mm",
        "track_front_u95_mm",
    ):
        assert found[unknown] is None
    assert found["wheels"]["front_left"]["toe_deg"] is None
    assert "incomplete" in truewheel("measure-vehicle", vehicle).out


def test_refused_wheel_ends_with_status_1_and_leaves_what_the_others_say(
    truewheel: Truewheel, vehicle: Path
) -> None:
    for image in (vehicle / "rear_right").glob("head_1_*.png"):
        shutil.copyfile(vehicle / "rear_left" / image.name, image)
        break
    ended = truewheel("measure-vehicle", vehicle, "--json")
    assert ended.status == 1
    found = ended.json
    assert found["outcome"] == "refused"
    assert found["wheels"]["rear_right"]["outcome"] == "refused"
    assert "rear_right: " in found["reason"]
    assert found["wheels"]["rear_right"]["camber_deg"] is None
    assert found["axles"]["front"]["total_toe_deg"] is not None
    assert found["axles"]["rear"]["total_toe_deg"] is None
    assert found["thrust_angle_deg"] is None


def test_wheel_that_was_turned_is_measured_on_its_spin_axis(
    truewheel: Truewheel, vehicle: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Shots turn_01 … of one rig beside single shots of the others: each result says which it is."""
    home = vehicle / "front_left"
    single = truewheel("measure-vehicle", vehicle, "--json").json
    for number in range(1, 9):
        shot = home / f"turn_{number:02d}"
        shutil.copytree(home, shot, ignore=shutil.ignore_patterns("turn_*", "calibration.json"))
        path = shot / "head_1_left.png"
        image = read_image(path).copy()
        image[0, 0] = number
        path.unlink()
        write_image(path, image)
    (home / "shot.json").unlink()
    # Every exposure shows the wheel as it is, its tyre leaning by a tenth of a degree to another side.
    real, count = alignment.measure_spin.measure_wheel, itertools.count()

    def leaning(*arguments: Any) -> Any:
        found = real(*arguments)
        phase = 2.0 * math.pi * next(count) / 8.0
        lean = math.radians(0.1)
        return replace(
            found,
            camber=found.camber + lean * math.cos(phase),
            toe=found.toe + lean * math.sin(phase),
        )

    monkeypatch.setattr(alignment.measure_spin, "measure_wheel", leaning)
    ended = truewheel("measure-vehicle", vehicle, "--json")
    assert ended.status == 0, ended.err
    wheel = ended.json["wheels"]["front_left"]
    assert wheel["kind"] == "spin_axis"
    assert ended.json["wheels"]["front_right"]["kind"] == "tyre_plane"
    for angle in ("camber_deg", "toe_deg"):
        assert wheel[angle] == pytest.approx(single["wheels"]["front_left"][angle], abs=1e-3)
    assert wheel["reference_mm"] == pytest.approx(single["wheels"]["front_left"]["reference_mm"], abs=0.01)
    assert ended.json["track_front_mm"] == pytest.approx(single["track_front_mm"], abs=0.02)


def bare(*names: str) -> Callable[[Path], None]:
    return lambda vehicle: (vehicle.joinpath(*names)).unlink()


def stated(**changes: Any) -> Callable[[Path], None]:
    return lambda vehicle: facts(vehicle, lambda content: content.update(changes))


def rigs(**changes: Any) -> Callable[[Path], None]:
    return lambda vehicle: facts(vehicle, lambda content: content["rigs"].update(changes))


def placeless(vehicle: Path) -> None:
    """Calibrations that no gauge frame has placed."""
    for name in WHEELS:
        path = vehicle / name / "calibration.json"
        content = json.loads(path.read_text(encoding="utf-8"))
        content["vehicle_from_rig"]["translation_mm"] = [0.0, 0.0, 0.0]
        path.write_text(json.dumps(content), encoding="utf-8")


def both(vehicle: Path) -> None:
    shutil.copytree(
        vehicle / "rear_left", vehicle / "rear_left" / "turn_01", ignore=shutil.ignore_patterns("turn_*")
    )


def exchanged(vehicle: Path) -> None:
    (vehicle / "front_left").rename(vehicle / "spare")
    (vehicle / "front_right").rename(vehicle / "front_left")
    (vehicle / "spare").rename(vehicle / "front_right")


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (shutil.rmtree, "vehicle.json"),
        (bare("vehicle.json"), "vehicle.json"),
        (lambda vehicle: (vehicle / "vehicle.json").write_text("{", encoding="utf-8"), "vehicle.json"),
        (lambda vehicle: (vehicle / "vehicle.json").write_text("[]", encoding="utf-8"), "vehicle.json"),
        (stated(colour="red"), "colour"),
        (stated(tyre_width_mm=0.2), "tyre_width_mm"),
        (stated(tyre_width_sigma_mm=-1.0), "tyre_width_sigma_mm"),
        (stated(rigs={}), "rigs"),
        (stated(rigs={"front_left": "front_left"}), "both wheels of at least one axle"),
        (rigs(front_left="front_right"), "'front_right' twice"),
        (rigs(front_left="nowhere"), "nowhere"),
        (rigs(front_left="../vehicle/front_left"), "rigs"),
        (lambda vehicle: shutil.rmtree(vehicle / "rear_left"), "rear_left"),
        (bare("rear_left", "calibration.json"), "calibration.json"),
        (bare("rear_left", "shot.json"), "neither"),
        (bare("rear_left", "head_2_left.png"), "head_2_left.png"),
        (both, "both"),
        (exchanged, "front_right"),
        (placeless, "gauge frame"),
    ],
    ids=[
        "no folder",
        "no facts",
        "no JSON",
        "no object",
        "unknown field",
        "width in metres",
        "negative spread",
        "no rigs",
        "one wheel",
        "one rig twice",
        "unknown rig",
        "outside",
        "no folder of a rig",
        "no calibration",
        "no shot",
        "no image",
        "shot and turns",
        "exchanged",
        "no places",
    ],
)
def test_broken_folder_is_one_clear_error(
    truewheel: Truewheel, vehicle: Path, damage: Callable[[Path], None], said: str
) -> None:
    damage(vehicle)
    ended: Ended = truewheel("measure-vehicle", vehicle, "--json")
    assert ended.status == 2
    assert ended.out == ""
    assert said in ended.err
    assert ended.err.count("expected") == 1


KIND_BY_HAND = """number = 3
name = "Held"
tyre_width_mm = 195.0
[axles.front]
camber = { lower_deg = -1.0, upper_deg = 1.0 }
toe = { lower_deg = -0.5, upper_deg = 0.5 }
[axles.rear]
camber = { lower_deg = -1.0, upper_deg = 1.0 }
toe = { lower_deg = -0.5, upper_deg = 0.5 }
[steering]
ratio = 16.0
ratio_sigma = 0.0
[ride_height]
require = false
[ride_height.at.front]
design_mm = 380.0
points = [
  { height_mm = 340.0, camber_deg = 0.4, toe_deg = 0.08 },
  { height_mm = 420.0, camber_deg = -0.4, toe_deg = -0.08 },
]
"""


def test_steering_wheel_and_ride_height_by_hand_bring_angles_to_where_they_are_judged(
    truewheel: Truewheel, vehicle: Path, tmp_path: Path
) -> None:
    kind = tmp_path / "held.toml"
    kind.write_text(KIND_BY_HAND, encoding="utf-8")
    raw = truewheel("measure-vehicle", vehicle, "--json").json
    by_hand = ("--vehicle-type", kind, "--steering-wheel-deg", "3.2", "--ride-height", "front_left=390")
    ended = truewheel("measure-vehicle", vehicle, *by_hand, "--json")
    assert ended.status == 0, ended.err
    found = ended.json
    assert (found["outcome"], found["straight_ahead"]) == ("measured", "checked")
    left, right, rear = (found["wheels"][name] for name in ("front_left", "front_right", "rear_left"))
    for name, wheel in found["wheels"].items():
        assert (wheel["raw_toe_deg"], wheel["raw_camber_deg"]) == (
            raw["wheels"][name]["toe_deg"], raw["wheels"][name]["camber_deg"],
        )  # fmt: skip
    # 3.2° of the steering wheel are 0.2° of the front wheels; 10 mm are 0.1° of camber and 0.02° of toe.
    assert left["toe_deg"] == pytest.approx(left["raw_toe_deg"] + 0.2 + 0.02, abs=1e-9)
    assert right["toe_deg"] == pytest.approx(right["raw_toe_deg"] - 0.2, abs=1e-9)
    assert left["camber_deg"] == pytest.approx(left["raw_camber_deg"] + 0.1, abs=1e-9)
    assert (right["camber_deg"], rear["toe_deg"]) == (
        pytest.approx(right["raw_camber_deg"]), pytest.approx(rear["raw_toe_deg"]),
    )  # fmt: skip
    assert (left["ride_height"], right["ride_height"], rear["ride_height"]) == (
        "corrected", "not_known", "not_asked",
    )  # fmt: skip
    assert left["toe_u95_deg"] > raw["wheels"]["front_left"]["toe_u95_deg"]
    total = raw["axles"]["front"]["total_toe_deg"]
    assert found["axles"]["front"]["total_toe_deg"] == pytest.approx(total + 0.02, abs=1e-9)
    assert found["thrust_angle_deg"] == pytest.approx(raw["thrust_angle_deg"], abs=1e-9)
    half = 0.5 * (
        raw["wheels"]["front_left"]["toe_to_thrust_deg"] - raw["wheels"]["front_right"]["toe_to_thrust_deg"]
    )
    assert found["steering_wheel_offset_deg"] == pytest.approx(3.2 + 16.0 * (half + 0.01), abs=1e-6)
    for_people = truewheel("measure-vehicle", vehicle, *by_hand)
    assert "toe is that of straight ahead: the steering wheel stood at +3.20°" in for_people.out
    assert "front_left stood at 390 mm and is judged at 380 mm" in for_people.out
    # A type that requires straight ahead tells no judged toe without it.
    ended = truewheel("measure-vehicle", vehicle, "--vehicle-type", kind, "--json")
    assert ended.status == 1
    assert (ended.json["outcome"], ended.json["straight_ahead"]) == ("refused", "refused")
    assert "straight ahead not checked" in ended.json["reason"]
    assert ended.json["wheels"]["front_left"]["toe_deg"] == pytest.approx(left["raw_toe_deg"])


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--steering-wheel-deg", "3"), "'--steering-wheel-deg': expected a vehicle type"),
        (("--ride-height", "front_left=390"), "'--ride-height': expected a vehicle type"),
        (("--vehicle-type", "KIND", "--steering-wheel-deg", "1081"), "within ±1080°"),
        (("--vehicle-type", "KIND", "--steering-wheel-deg", "nan"), "within ±1080°"),
        (("--vehicle-type", "KIND", "--ride-height", "front_left"), "WHEEL=MILLIMETRES"),
        (("--vehicle-type", "KIND", "--ride-height", "front_left=high"), "found 'front_left=high'"),
        (("--vehicle-type", "KIND", "--ride-height", "front_left=inf"), "WHEEL=MILLIMETRES"),
        (("--vehicle-type", "KIND", "--ride-height", "middle=380"), "each wheel of front_left"),
        (
            ("--vehicle-type", "KIND", "--ride-height", "rear_left=1", "--ride-height", "rear_left=2"),
            "at most once",
        ),
        (("--vehicle-type", "nowhere.toml", "--steering-wheel-deg", "3"), "nowhere.toml"),
    ],
)
def test_what_was_said_by_hand_and_cannot_be_is_one_clear_error(
    truewheel: Truewheel, rendered_vehicle: Path, tmp_path: Path, arguments: tuple[str, ...], said: str
) -> None:
    """Nothing is measured before."""
    kind = tmp_path / "held.toml"
    kind.write_text(KIND_BY_HAND, encoding="utf-8")
    given = [str(kind) if argument == "KIND" else argument for argument in arguments]
    ended = truewheel("measure-vehicle", rendered_vehicle, *given, "--json")
    assert (ended.status, ended.out) == (2, "")
    assert said in ended.err
    assert ended.err.count("expected") == 1
