"""Angles brought to the design height: what is added, how sure it is, and how far it goes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from alignment.errors import DegenerateInputError
from alignment.units import ARCMIN
from alignment.values import Refusal, RefusalCode
from alignment.vehicle.ride_height import HeightCorrection, RideHeightCurve

HEIGHTS = (340.0, 360.0, 380.0, 400.0, 420.0)
CAMBER = tuple(math.radians(c) for c in (-1.4, -1.0, -0.7, -0.5, -0.4))
TOE = tuple(math.radians(t) for t in (0.2, 0.16, 0.14, 0.13, 0.125))
CURVE = RideHeightCurve(HEIGHTS, CAMBER, TOE, limit_mm=30.0)


def corrected(curve: RideHeightCurve, height: float, design: float, u: float = 0.0) -> HeightCorrection:
    found = curve.correction(height, design, u)
    assert isinstance(found, HeightCorrection), found
    return found


def test_a_low_car_measured_at_a_point_of_the_curve_gets_what_the_curve_says() -> None:
    found = corrected(CURVE, 360.0, 380.0)
    assert found.camber == pytest.approx(math.radians(0.3), abs=1e-15)
    assert found.toe == pytest.approx(math.radians(-0.02), abs=1e-15)
    assert not found.covariance.any()


@given(height=st.floats(350.0, 410.0))
def test_at_its_design_height_a_wheel_is_left_as_it_is(height: float) -> None:
    found = corrected(CURVE, height, height, 1.0)
    assert found.camber == found.toe == 0.0


@given(
    heights=st.tuples(*[st.floats(365.0, 395.0)] * 2).map(sorted),
)
def test_between_points_the_curve_rises_where_they_rise(heights: list[float]) -> None:
    found = corrected(CURVE, heights[0], heights[1])
    assert found.camber >= 0.0
    assert found.toe <= 0.0
    # And the way back is the same.
    back = corrected(CURVE, heights[1], heights[0])
    assert back.camber == pytest.approx(-found.camber, abs=1e-15)


def test_an_uncertain_height_counts_by_the_slope_where_the_curve_is_straight() -> None:
    straight = RideHeightCurve((0.0, 100.0), (0.0, 0.01), (0.0, -0.002))
    found = corrected(straight, 40.0, 60.0, 3.0)
    slope = np.array([1e-4, -2e-5])
    np.testing.assert_allclose(found.covariance, 9.0 * np.outer(slope, slope), rtol=1e-12)


def test_an_uncertain_height_counts_at_the_turn_of_a_curve_too() -> None:
    """By the slope alone toe at the top of its curve would be sure to the last digit."""
    bump = RideHeightCurve((-40.0, -20.0, 0.0, 20.0, 40.0), (0.0,) * 5, (0.008, 0.002, 0.0, 0.002, 0.008))
    found = corrected(bump, 0.0, 10.0, 5.0)
    rng = np.random.default_rng(1)
    drawn = [corrected(bump, float(h), 10.0).toe for h in 5.0 * rng.standard_normal(2000)]
    off = np.array(drawn) - found.toe
    assert math.sqrt(found.covariance[1, 1]) == pytest.approx(math.sqrt(np.mean(off**2)), rel=0.25)
    assert found.covariance[1, 1] > (0.1 * ARCMIN) ** 2


def test_near_its_end_a_curve_goes_on_for_the_uncertainty_alone() -> None:
    straight = RideHeightCurve((0.0, 100.0), (0.0, 0.01), (0.0, 0.0))
    assert corrected(straight, 100.0, 90.0, 3.0).covariance[0, 0] == pytest.approx((3e-4) ** 2)


@pytest.mark.parametrize("height", [339.9, 420.1, math.nan, math.inf, -math.inf, 0.0, -5.0])
def test_a_height_off_the_curve_is_refused_with_the_curves_ends(height: float) -> None:
    found = CURVE.correction(height, 380.0, 1.0)
    assert isinstance(found, Refusal)
    assert found.code is RefusalCode.RIDE_HEIGHT
    assert "340 to 420 mm" in found.reason
    assert isinstance(CURVE.correction(380.0, height, 1.0), Refusal)


def test_farther_than_the_limit_nothing_is_corrected() -> None:
    assert isinstance(CURVE.correction(350.0, 380.0, 1.0), HeightCorrection)
    found = CURVE.correction(349.9, 380.0, 1.0)
    assert isinstance(found, Refusal)
    assert "at most 30 mm" in found.reason
    assert isinstance(CURVE.correction(410.5, 380.0, 1.0), Refusal)


@pytest.mark.parametrize("u", [-1.0, math.nan, math.inf])
def test_a_height_without_a_believable_uncertainty_is_no_input(u: float) -> None:
    with pytest.raises(DegenerateInputError, match="height_u_mm"):
        CURVE.correction(380.0, 380.0, u)


@pytest.mark.parametrize(
    ("heights", "camber", "toe", "limit", "field"),
    [
        ((1.0,), (0.0,), (0.0,), 5.0, "heights_mm"),
        ((1.0, 1.0), (0.0, 0.0), (0.0, 0.0), 5.0, "heights_mm"),
        ((2.0, 1.0), (0.0, 0.0), (0.0, 0.0), 5.0, "heights_mm"),
        ((1.0, math.nan), (0.0, 0.0), (0.0, 0.0), 5.0, "heights_mm"),
        ((1.0, 2.0), (0.0,), (0.0, 0.0), 5.0, "camber"),
        ((1.0, 2.0), (0.0, 0.0), (0.0, math.inf), 5.0, "toe"),
        ((1.0, 2.0), (0.0, 0.0), (0.0, 0.0), 0.0, "limit_mm"),
        ((1.0, 2.0), (0.0, 0.0), (0.0, 0.0), math.nan, "limit_mm"),
    ],
)
def test_a_curve_that_is_none_is_refused_by_its_field(
    heights: tuple[float, ...], camber: tuple[float, ...], toe: tuple[float, ...], limit: float, field: str
) -> None:
    with pytest.raises(DegenerateInputError, match=field):
        RideHeightCurve(heights, camber, toe, limit)
