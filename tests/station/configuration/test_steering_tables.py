"""What a vehicle type may say of steering and ride heights: believable numbers, degrees and millimetres."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from alignment.errors import DegenerateInputError
from station.configuration.ride_heights import HeightCurve
from station.configuration.steering import SteeringAxisTolerances, SteeringOptions
from station.configuration.vehicle_types import VehicleType, read_vehicle_types
from station.store.opening import limits_of
from tests.station.configuration.test_bounds import HEIGHT_CURVE, NEEDED

CONFIGS = Path(__file__).resolve().parents[3] / "configs"
GOOD = {"lower_deg": -0.5, "upper_deg": 0.5}


def vehicle(**fields: Any) -> VehicleType:
    return VehicleType.model_validate(NEEDED[VehicleType] | fields)


def mistake(make: Any) -> DegenerateInputError:
    with pytest.raises(ValidationError) as caught:
        make()
    found = caught.value.errors()[0]["ctx"]["error"]
    assert isinstance(found, DegenerateInputError)
    return found


def test_a_type_that_says_nothing_asks_for_nothing() -> None:
    plain = vehicle()
    assert (plain.steering, plain.ride_height, dict(plain.steering_axis.stated)) == (None, None, {})
    assert "steering_axis" not in limits_of(plain)


def test_the_example_shows_all_tables_and_its_limits_go_into_the_database() -> None:
    compact = read_vehicle_types(CONFIGS / "vehicles")[1]
    assert compact.steering is not None
    assert compact.ride_height is not None
    assert set(compact.steering_axis.stated) == {
        "caster", "kpi", "trail", "scrub", "caster_difference", "kpi_difference",
    }  # fmt: skip
    found = limits_of(compact)
    assert found["vehicle"]["steering_wheel_offset"] == pytest.approx(
        [-0.05235987755982989, 0.05235987755982989]
    )
    assert found["steering_axis"]["trail"] == [12.0, 24.0]
    # The curves go through what is accepted at the design height.
    front = compact.ride_height.of("front_left")
    assert front is not None
    middle = next(point for point in front.points if point.height_mm == front.design_mm)
    assert (middle.camber_deg, middle.toe_deg) == (-0.5, 0.1)


def test_limits_of_the_steering_wheel_need_those_of_the_thrust_angle() -> None:
    """They are one verdict of the vehicle, which the line is told with the thrust angle."""
    steering = {"ratio": 15.0, "offset": GOOD}
    assert "steering.offset has some" in str(mistake(lambda: vehicle(steering=steering)))
    assert vehicle(steering=steering, thrust_angle=GOOD).steering is not None


def test_a_steering_wheel_that_stands_straight_is_not_refused_for_the_spread_of_its_angle() -> None:
    found = mistake(lambda: SteeringOptions(ratio=15.0, largest_deg=0.6, angle_sigma_deg=0.2))
    assert "more than three times angle_sigma_deg" in str(found)
    assert SteeringOptions(ratio=15.0, largest_deg=0.61, angle_sigma_deg=0.2).largest_deg == 0.61


@pytest.mark.parametrize("name", ["caster", "kpi", "included_angle", "toe_out", "kpi_difference"])
def test_limits_of_an_axis_in_arcminutes_are_refused(name: str) -> None:
    wide = {"nominal_deg": 5.0, "tolerance_deg": 6.0}
    assert "at most ±5° wide" in str(mistake(lambda: SteeringAxisTolerances.model_validate({name: wide})))
    good = {"nominal_deg": 13.0, "tolerance_deg": 0.75}
    assert set(SteeringAxisTolerances.model_validate({name: good}).stated) == {name}


@pytest.mark.parametrize("name", ["trail", "scrub"])
def test_limits_of_trail_and_scrub_in_another_unit_are_refused(name: str) -> None:
    for wrong in ({"lower_mm": 180.0, "upper_mm": 240.0}, {"lower_mm": -60.0, "upper_mm": 60.0}):
        assert "millimetres are asked for" in str(
            mistake(lambda wrong=wrong: SteeringAxisTolerances.model_validate({name: wrong}))
        )


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"points": HEIGHT_CURVE["points"][::-1]}, "heights that rise from point to point"),
        ({"points": [HEIGHT_CURVE["points"][0]] * 2}, "heights that rise from point to point"),
        ({"design_mm": 1600.0}, ""),
        ({"points": HEIGHT_CURVE["points"][:1]}, ""),
    ],
)
def test_a_curve_rises_in_height_and_holds_the_design_height(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(ValidationError) as caught:
        HeightCurve.model_validate(HEIGHT_CURVE | changes)
    assert said in str(caught.value)


def test_a_curve_that_does_not_hold_its_design_height_says_so() -> None:
    points = [{"height_mm": h, "camber_deg": 0.0, "toe_deg": 0.0} for h in (300.0, 350.0)]
    found = mistake(lambda: HeightCurve.model_validate({"design_mm": 380.0, "points": points}))
    assert "a height on the curve, 300 to 350" in str(found)


@pytest.mark.parametrize(("angle", "most"), [("camber_deg", 8.0), ("toe_deg", 2.0)])
def test_a_curve_in_arcminutes_is_refused(angle: str, most: float) -> None:
    def curve(change: float) -> HeightCurve:
        points = [
            {"height_mm": 360.0, "camber_deg": 0.0, "toe_deg": 0.0},
            {"height_mm": 400.0, "camber_deg": 0.0, "toe_deg": 0.0} | {angle: change},
        ]
        return HeightCurve.model_validate({"design_mm": 380.0, "points": points})

    assert len(curve(-most).points) == 2
    assert "degrees are asked for" in str(mistake(lambda: curve(1.01 * most)))


def test_a_curve_of_a_wheel_that_the_type_has_not_is_refused() -> None:
    for part in ("front", "front_left"):
        assert vehicle(ride_height={"at": {part: HEIGHT_CURVE}}).ride_height is not None
    found = mistake(lambda: vehicle(ride_height={"at": {"rear": HEIGHT_CURVE}}))
    assert "axles or wheels of this type: front, front_left, front_right" in str(found)
    with pytest.raises(ValidationError):
        vehicle(ride_height={"at": {}})
