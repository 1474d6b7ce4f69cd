"""The ride height of a wheel: used, not known, absurd, or too far from the design height."""

from __future__ import annotations

import math
from dataclasses import FrozenInstanceError
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from alignment.vehicle import WheelAngles
from station.configuration.ride_heights import RideHeightOptions
from station.cycle.judging.ride_height import NO_HEIGHT, HeightOutcome, ride_height
from station.cycle.words.vehicle import RideHeights

POINTS = [
    {"height_mm": 340.0, "camber_deg": 0.4, "toe_deg": 0.06},
    {"height_mm": 380.0, "camber_deg": 0.0, "toe_deg": 0.0},
    {"height_mm": 420.0, "camber_deg": -0.4, "toe_deg": -0.06},
]
CURVE = {"design_mm": 380.0, "points": POINTS}


def options(**fields: Any) -> RideHeightOptions:
    return RideHeightOptions.model_validate({"at": {"front": CURVE}, "largest_mm": 25.0} | fields)


def told(height_mm: float, wheel: str = "front_left", age_s: float = 0.0) -> RideHeights:
    return RideHeights({wheel: height_mm}, {wheel: age_s})


def test_a_type_without_a_curve_of_the_wheel_leaves_it_as_it_is() -> None:
    assert ride_height(None, "front_left", told(390.0)) is NO_HEIGHT
    assert ride_height(options(), "rear_left", told(390.0, "rear_left")) is NO_HEIGHT
    raw = WheelAngles(0.01, 0.02, 1e-5, 2e-5)
    assert NO_HEIGHT.at_design(raw) == raw
    assert not NO_HEIGHT.refused
    assert NO_HEIGHT.outcome is HeightOutcome.NOT_ASKED
    with pytest.raises(FrozenInstanceError):
        NO_HEIGHT.toe = 1.0  # type: ignore[misc]


def test_camber_and_toe_are_brought_to_the_design_height_with_what_is_not_known_of_the_height() -> None:
    found = ride_height(options(sigma_mm=2.0), "front_left", told(390.0))
    assert (found.outcome, found.reason, found.refused) == (HeightOutcome.CORRECTED, None, False)
    assert (found.height_mm, found.height_u_mm, found.design_mm) == (390.0, 2.0, 380.0)
    # Points on a line: 0.01° and 0.0015° per millimetre.
    assert math.degrees(found.camber) == pytest.approx(0.1)
    assert math.degrees(found.toe) == pytest.approx(0.015)
    assert math.degrees(found.camber_u) == pytest.approx(0.02)
    assert math.degrees(found.toe_u) == pytest.approx(0.003)
    corrected = found.at_design(WheelAngles(0.0, 0.0, 1e-3, 1e-4))
    assert (corrected.camber, corrected.toe) == (found.camber, found.toe)
    assert corrected.camber_u == pytest.approx(math.hypot(1e-3, found.camber_u))
    assert corrected.toe_u == pytest.approx(math.hypot(1e-4, found.toe_u))


def test_a_wheels_own_curve_goes_before_that_of_its_axle() -> None:
    own = {"design_mm": 385.0, "points": POINTS}
    chosen = options(at={"front": CURVE, "front_right": own})
    assert ride_height(chosen, "front_right", told(390.0, "front_right")).design_mm == 385.0
    assert ride_height(chosen, "front_left", told(390.0)).design_mm == 380.0


@pytest.mark.parametrize(
    "heights", [None, RideHeights({}), told(390.0, "front_right"), told(390.0, age_s=60.1)]
)
@pytest.mark.parametrize("required", [True, False])
def test_a_height_that_is_not_known_is_what_the_vehicle_type_says(
    heights: RideHeights | None, required: bool
) -> None:
    found = ride_height(options(require=required), "front_left", heights)
    assert found.outcome is (HeightOutcome.MISSING if required else HeightOutcome.NOT_KNOWN)
    assert found.refused is required
    assert found.reason == (
        "not brought to the design height: no ride height of this wheel was told, or too long ago"
    )
    assert (found.height_mm, found.design_mm, found.camber, found.toe) == (None, 380.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("height_mm", "words"),
    [
        (0.0, "no vehicle stands at 0 mm"),
        (49.9, "no vehicle stands at 49.9 mm"),
        (1500.1, "no vehicle stands at 1500.1 mm"),
        (-380.0, "no vehicle stands at -380 mm"),
        (405.1, "the ride height of 405.1 mm is 25.1 mm off the design height of 380 mm"),
        (421.0, "not on the curve of the vehicle type"),
        (50.0, "not on the curve of the vehicle type"),
        (1500.0, "not on the curve of the vehicle type"),
    ],
)
@pytest.mark.parametrize("required", [True, False])
def test_an_absurd_height_or_one_beyond_the_limit_is_refused_whatever_the_type_allows(
    height_mm: float, words: str, required: bool
) -> None:
    found = ride_height(options(require=required), "front_left", told(height_mm))
    assert found.outcome is HeightOutcome.REFUSED
    assert found.reason is not None
    assert found.reason.startswith("not brought to the design height: ")
    assert words in found.reason
    assert (found.camber, found.toe, found.camber_u, found.toe_u) == (0.0, 0.0, 0.0, 0.0)
    # What was told is kept, but for what cannot be.
    absurd = "no vehicle" in words
    assert found.height_mm == (None if absurd else height_mm)
    assert found.height_u_mm == (None if absurd else 1.0)
    assert found.design_mm == 380.0


def test_the_limit_itself_is_corrected() -> None:
    assert ride_height(options(), "front_left", told(405.0)).outcome is HeightOutcome.CORRECTED
    assert ride_height(options(), "front_left", told(390.0, age_s=60.0)).outcome is HeightOutcome.CORRECTED


@given(st.floats(-1e6, 1e6), st.booleans())
def test_measured_and_correction_make_what_is_judged_and_nothing_is_corrected_beyond_the_limit(
    height_mm: float, required: bool
) -> None:
    found = ride_height(options(require=required), "front_left", told(height_mm))
    raw = WheelAngles(0.01, 0.002, 1e-5, 1e-5)
    judged = found.at_design(raw)
    assert (judged.camber, judged.toe) == (raw.camber + found.camber, raw.toe + found.toe)
    assert judged.camber_u >= raw.camber_u
    assert judged.toe_u >= raw.toe_u
    assert found.refused is not (355.0 <= height_mm <= 405.0)
