"""Limits of lengths: millimetres, where such a length lies, and never wider than every vehicle."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from alignment.errors import DegenerateInputError
from station.configuration.lengths import LengthTolerance, LengthTolerances
from station.configuration.vehicle_types import VehicleType, read_vehicle_types
from tests.station.configuration.test_bounds import NEEDED

CONFIGS = Path(__file__).resolve().parents[3] / "configs"
GOOD = {"lower_deg": -0.5, "upper_deg": 0.5}


def vehicle(**fields: Any) -> VehicleType:
    return VehicleType.model_validate(NEEDED[VehicleType] | {"thrust_angle": GOOD} | fields)


def mistake(lengths: dict[str, Any]) -> DegenerateInputError:
    with pytest.raises(ValidationError) as caught:
        vehicle(lengths=lengths)
    (details,) = caught.value.errors()
    found = details["ctx"]["error"]
    assert isinstance(found, DegenerateInputError)
    return found


def test_limits_are_nominal_plus_minus_tolerance_or_lower_and_upper() -> None:
    first = LengthTolerance(nominal_mm=1540.0, tolerance_mm=5.0).limits()
    second = LengthTolerance(lower_mm=1535.0, upper_mm=1545.0).limits()
    assert first == second


@pytest.mark.parametrize(
    "given",
    [
        {},
        {"nominal_mm": 1500.0},
        {"tolerance_mm": 5.0},
        {"nominal_mm": 1500.0, "lower_mm": 1.0},
        {"lower_mm": 2.0, "upper_mm": 1.0},
        {"lower_mm": 1.0, "upper_mm": 1.0},
        {"nominal_mm": 1500.0, "tolerance_mm": 0.0},
        {"nominal_mm": 1500.0, "tolerance_mm": float("nan")},
        {"nominal_deg": 1.0, "tolerance_deg": 1.0},
    ],
)
def test_anything_else_is_refused(given: dict[str, float]) -> None:
    with pytest.raises(ValidationError):
        LengthTolerance.model_validate(given)


@pytest.mark.parametrize(
    ("name", "unit", "nominal", "tolerance"),
    [
        ("track_front", "metres", 1.54, 0.005),
        ("track_rear", "centimetres", 154.0, 0.5),
        ("wheelbase_left", "metres", 2.7, 0.01),
        ("wheelbase_right", "inches", 106.3, 0.2),
    ],
)
def test_length_in_another_unit_is_named(name: str, unit: str, nominal: float, tolerance: float) -> None:
    """Taken as millimetres every vehicle would be NOK, and nobody would know why."""
    found = mistake({name: {"nominal_mm": nominal, "tolerance_mm": tolerance}})
    assert found.field == name
    assert unit in str(found.cure)


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [
        ("track_front", 1480.0, 1600.0),
        ("wheelbase_left", 2600.0, 2800.0),
        ("wheelbase_difference", -60.0, 60.0),
        ("setback_rear", -99.0, 99.0),
        ("axle_offset", 100.0, 120.0),
        ("offset_front", -101.0, 0.0),
        ("wheelbase_difference", 2690.0, 2710.0),
    ],
)
def test_limits_that_accept_everything_or_lie_where_nothing_is_are_refused(
    name: str, low: float, high: float
) -> None:
    assert mistake({name: {"lower_mm": low, "upper_mm": high}}).field == name


@pytest.mark.parametrize("name", [*LengthTolerances.model_fields])
def test_each_length_takes_believable_limits(name: str) -> None:
    middle = {"track": 1500.0, "wheelbase": 2700.0}.get(name.rpartition("_")[0], 0.0)
    if name == "wheelbase_difference":
        middle = 0.0
    kind = vehicle(lengths={name: {"nominal_mm": middle, "tolerance_mm": 10.0}})
    assert kind.lengths.stated[name].limits().high == middle + 10.0


@pytest.mark.parametrize(
    "judged", [{"yaw": GOOD}, {"lengths": {"axle_offset": {"lower_mm": -5, "upper_mm": 5}}}]
)
def test_lengths_and_yaw_are_part_of_the_verdict_that_the_thrust_angle_has(judged: dict[str, Any]) -> None:
    """The record holds one verdict of the vehicle; without its limits a NOK could not be stored."""
    with pytest.raises(ValidationError, match="thrust_angle"):
        vehicle(thrust_angle=None, **judged)


def test_tyres_of_an_axle_may_be_wider_than_the_vehicles() -> None:
    axles = dict.fromkeys(("front", "rear"), NEEDED[VehicleType]["axles"]["front"])
    wide = axles | {"rear": axles["rear"] | {"tyre_width_mm": 255.0}}
    for given, front, rear in (
        ({"axles": axles}, None, None),
        ({"axles": axles, "tyre_width_mm": 225.0}, 225.0, 225.0),
        ({"axles": wide, "tyre_width_mm": 225.0}, 225.0, 255.0),
        ({"axles": wide}, None, 255.0),
    ):
        widths = vehicle(**given).tyre_widths()
        assert (widths.front_mm, widths.rear_mm, widths.sigma_mm) == (front, rear, 0.5)


def test_shipped_vehicle_type_has_limits_of_lengths_and_yaw() -> None:
    kind = read_vehicle_types(CONFIGS / "vehicles")[1]
    assert {"track_front", "track_rear", "wheelbase_difference", "setback_front"} <= set(kind.lengths.stated)
    assert kind.yaw is not None
    assert kind.tyre_widths().front_mm == kind.tyre_width_mm
