"""The vehicle's own frame against vehicles whose frame is known."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from alignment.arrays import Array
from alignment.errors import DegenerateInputError
from alignment.geometry.transforms import RigidTransform
from alignment.units import ARCMIN
from alignment.values import Side
from alignment.vehicle.angles import camber_toe, normal_from_angles
from alignment.vehicle.axles import WheelAngles, vehicle_angles
from alignment.vehicle.geometry import (
    COMPONENTS,
    LENGTHS,
    MEASURED,
    TEMPERATURE,
    TYRE_WIDTH,
    VehicleGeometry,
    vehicle_geometry,
)
from alignment.vehicle.wheel_axes import FOUR_WHEELS, Stand, TyreWidths, WheelAxis

CENTRES = {
    "front_left": (1352.0, 770.0, 310.0),
    "front_right": (1346.0, -770.0, 308.0),
    "rear_left": (-1350.0, 781.0, 305.0),
    "rear_right": (-1350.0, -781.0, 305.0),
}
"""Wheel centres in the vehicle's own frame: a front setback of 6 mm, a rear track that is 22 mm wider."""
ANGLES = {
    name: (math.radians(camber), math.radians(toe))
    for name, camber, toe in (
        ("front_left", -0.6, 0.12),
        ("front_right", -0.4, 0.05),
        ("rear_left", -1.4, 0.2),
        ("rear_right", -1.1, 0.1),
    )
}
WIDTH, ROAD = 205.0, -12.0
SIGMA = np.diag([1e-5, 1e-5, 0.01, 0.01, 0.01]) ** 2


def side_of(name: str) -> Side:
    return "left" if name.endswith("left") else "right"


def wheels(
    yaw: float = 0.0,
    place: tuple[float, float] = (0.0, 0.0),
    widths: Mapping[str, float] | None = None,
    covariance: Array = SIGMA,
) -> dict[str, WheelAxis]:
    """What four rigs see of the vehicle when it has turned and moved on the stand."""
    stand_from_vehicle = RigidTransform.from_rotvec(np.array([0.0, 0.0, yaw]), np.array([*place, 0.0]))
    out = {}
    for name, centre in CENTRES.items():
        side = side_of(name)
        normal = normal_from_angles(*ANGLES[name], side)
        half = 0.5 * (widths or {}).get(name, WIDTH)
        camber, toe = camber_toe(stand_from_vehicle.apply_vectors(normal), side)
        point = stand_from_vehicle.apply(np.array(centre) + half * normal)
        out[name] = WheelAxis(side, camber, toe, point, covariance)
    return out


WIDTHS = TyreWidths(WIDTH, WIDTH)
SIDES_OF_FOUR: tuple[Side, ...] = ("left", "right", "left", "right")


@pytest.fixture
def straight() -> VehicleGeometry:
    return vehicle_geometry(wheels(), Stand(ROAD), WIDTHS)


def test_vehicle_askew_by_a_tenth_of_a_degree_keeps_its_toes_and_its_thrust_angle() -> None:
    """Against the stand's axis each toe was wrong by 6′, and so was the thrust angle."""
    yaw = math.radians(0.1)
    askew = wheels(yaw, (12.0, -17.0))
    by_stand = vehicle_angles(*(WheelAngles(askew[name].camber, askew[name].toe) for name in FOUR_WHEELS))
    by_vehicle = vehicle_geometry(askew, Stand(ROAD), WIDTHS)
    thrust = (ANGLES["rear_right"][1] - ANGLES["rear_left"][1]) / 2.0
    assert askew["front_left"].toe - ANGLES["front_left"][1] == pytest.approx(-6.0 * ARCMIN, rel=1e-3)
    assert by_stand.thrust_angle - thrust == pytest.approx(6.0 * ARCMIN, rel=1e-3)
    # What is left is the front wheels' different toe: the centreline runs through wheel centres.
    assert by_vehicle.value("thrust_angle") == pytest.approx(thrust, abs=0.002 * ARCMIN)
    for name, (camber, toe) in ANGLES.items():
        assert by_vehicle.value(f"{name}.toe") == pytest.approx(toe, abs=0.002 * ARCMIN)
        assert by_vehicle.value(f"{name}.camber") == pytest.approx(camber, abs=1e-12)
    assert by_vehicle.value("yaw") == pytest.approx(yaw, abs=0.002 * ARCMIN)


@given(st.floats(-0.5, 0.5), st.floats(-20, 20), st.floats(-20, 20))
def test_nothing_but_yaw_and_place_changes_with_how_the_vehicle_stands(
    yaw_deg: float, x: float, y: float
) -> None:
    here, there = (
        vehicle_geometry(each, Stand(ROAD), WIDTHS)
        for each in (wheels(), wheels(math.radians(yaw_deg), (x, y)))
    )
    assert here.names == there.names
    for name in here.names:
        if not name.startswith(("yaw", "place", "offset")):
            assert there.value(name) == pytest.approx(here.value(name), abs=1e-9)
    assert there.value("yaw") - here.value("yaw") == pytest.approx(math.radians(yaw_deg), abs=1e-12)
    for axle in ("front", "rear"):
        assert abs(there.value(f"{axle}.total_toe") - here.value(f"{axle}.total_toe")) < 1e-4 * ARCMIN


def test_lengths_are_those_of_the_contact_centres(straight: VehicleGeometry) -> None:
    assert straight.between == "contact_centres"

    def outboard(name: str) -> float:
        """How far the contact centre lies outboard of the wheel centre, by the lean of the wheel alone."""
        return (CENTRES[name][2] - ROAD) * math.tan(-ANGLES[name][0])

    for axle in ("front", "rear"):
        left, right = f"{axle}_left", f"{axle}_right"
        track = CENTRES[left][1] - CENTRES[right][1] + outboard(left) + outboard(right)
        assert straight.value(f"track_{axle}") == pytest.approx(track, abs=0.002)
    # Lean and toe together move the contact centre a little along the vehicle.
    assert straight.value("wheelbase_left") == pytest.approx(2702.0, abs=0.05)
    assert straight.value("wheelbase_right") == pytest.approx(2696.0, abs=0.05)
    assert straight.value("wheelbase_difference") == pytest.approx(6.0, abs=0.05)
    assert straight.value("setback_front") == pytest.approx(6.0, abs=0.05)
    assert straight.value("setback_rear") == pytest.approx(0.0, abs=0.05)


def test_without_the_road_lengths_are_between_wheel_centres() -> None:
    found = vehicle_geometry(wheels(), Stand(), WIDTHS)
    assert found.between == "wheel_centres"
    assert found.value("track_front") == pytest.approx(1540.0, abs=1e-3)
    assert found.value("track_rear") == pytest.approx(1562.0, abs=1e-3)
    assert found.value("wheelbase_left") == pytest.approx(2702.0, abs=1e-3)
    assert found.value("setback_front") == pytest.approx(6.0, abs=1e-3)
    assert found.value("place_x") == pytest.approx(-0.5, abs=1e-3)


def test_without_widths_lengths_are_between_sidewalls(straight: VehicleGeometry) -> None:
    found = vehicle_geometry(wheels(), Stand(ROAD))
    assert found.between == "sidewalls"
    assert found.value("track_front") == pytest.approx(1540.0 + WIDTH, abs=0.02)
    assert found.value("track_front") == found.value("sidewall_track_front")
    assert straight.value("sidewall_track_front") == pytest.approx(found.value("track_front"), abs=1e-4)


def test_loaded_radius_that_differs_by_two_millimetres_changes_no_camber() -> None:
    """A plane through the four axes would lean by 4.4′."""
    low = wheels()
    sunk = {
        name: replace(wheel, point=wheel.point - ([0.0, 0.0, 2.0] if name.endswith("left") else 0.0))
        for name, wheel in low.items()
    }
    before, after = vehicle_geometry(low, Stand()), vehicle_geometry(sunk, Stand())
    for name in FOUR_WHEELS:
        assert after.value(f"{name}.camber") == before.value(f"{name}.camber")
        assert after.value(f"{name}.toe") == before.value(f"{name}.toe")


def test_signs_are_those_of_the_conventions(straight: VehicleGeometry) -> None:
    # The left front wheel stands ahead of the right one: the right is set back.
    assert straight.value("setback_front") > 0.0
    # The rear axle rolls to the right here, so the front axle lies to the left of the thrust line.
    assert straight.value("thrust_angle") < 0.0
    assert straight.value("axle_offset") == pytest.approx(
        2699.0 * math.sin(-straight.value("thrust_angle")), abs=0.01
    )
    left = vehicle_geometry(wheels(math.radians(0.2), (3.0, 9.0)), Stand(ROAD), WIDTHS)
    assert left.value("yaw") > 0.0
    assert left.value("offset_front") > left.value("offset_rear") > 0.0
    assert left.value("place_y") == pytest.approx(9.0, abs=0.01)
    assert left.value("place_x") == pytest.approx(3.0 - 0.5, abs=0.01)
    right_positive = vehicle_geometry(wheels(), Stand(ROAD), WIDTHS, thrust_sign="right_positive")
    assert right_positive.value("thrust_angle") == -straight.value("thrust_angle")
    assert right_positive.value("front_left.toe_to_thrust") == straight.value("front_left.toe_to_thrust")


def test_angles_of_axles_and_vehicle_agree_with_the_ones_of_single_wheels(straight: VehicleGeometry) -> None:
    """Axles and thrust are one definition, whichever axis the toes refer to."""
    single = vehicle_angles(
        *(
            WheelAngles(straight.value(f"{name}.camber"), straight.value(f"{name}.toe"))
            for name in FOUR_WHEELS
        )
    )
    found = straight.angles
    assert found.thrust_angle == pytest.approx(single.thrust_angle, abs=1e-15)
    assert found.front.total_toe == pytest.approx(single.front.total_toe, abs=1e-15)
    assert found.rear.camber_difference == pytest.approx(single.rear.camber_difference, abs=1e-15)
    assert found.front_toe_left_to_thrust == pytest.approx(single.front_toe_left_to_thrust, abs=1e-15)
    assert found.front_toe_right_to_thrust == pytest.approx(single.front_toe_right_to_thrust, abs=1e-15)


def changed(each: dict[str, WheelAxis], name: str, place: int, by: float) -> dict[str, WheelAxis]:
    wheel = each[name]
    if place == 0:
        return each | {name: replace(wheel, camber=wheel.camber + by)}
    if place == 1:
        return each | {name: replace(wheel, toe=wheel.toe + by)}
    point = wheel.point.copy()
    point[place - 2] += by
    return each | {name: replace(wheel, point=point)}


@pytest.mark.parametrize(
    ("stand", "tyres"),
    [(Stand(ROAD), WIDTHS), (Stand(), TyreWidths(WIDTH, 225.0)), (Stand(ROAD), TyreWidths())],
    ids=["contact centres", "wheel centres", "sidewalls"],
)
def test_covariance_is_that_of_numeric_derivatives(stand: Stand, tyres: TyreWidths) -> None:
    rng = np.random.default_rng(3)
    own = rng.normal(size=(20, 20)) * np.tile([1e-5, 1e-5, 0.01, 0.01, 0.01], 4)[:, None]
    common = own @ own.T
    at = wheels(0.004, (5.0, -8.0), covariance=np.zeros((5, 5)))
    found = vehicle_geometry(at, stand, tyres, common=common)
    columns = []
    for name in FOUR_WHEELS:
        for place in range(5):
            step = 1e-6 if place < 2 else 1e-2
            up, down = (
                vehicle_geometry(changed(at, name, place, by), stand, tyres).values for by in (step, -step)
            )
            columns.append((up - down) / (2.0 * step))
    jacobian = np.column_stack(columns)
    expected = jacobian @ common @ jacobian.T
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert (found.covariance - expected) / scale == pytest.approx(np.zeros_like(scale), abs=1e-6)


def test_spread_of_tyre_widths_is_felt_by_single_toes_and_not_by_the_total() -> None:
    """A tyre that is 1 mm wider moves its reference point by half of that along the axis."""
    found = vehicle_geometry(wheels(), Stand(ROAD), replace(WIDTHS, sigma_mm=1.0))
    assert found.share("front_left.toe", TYRE_WIDTH) > 0.9
    # Four widths, each moving the middle of its axle by a quarter of what it is wider.
    expected = math.hypot(0.25, 0.25) * math.sqrt(2.0) / 2699.0
    by_width = math.sqrt(found.share("front_left.toe", TYRE_WIDTH)) * found.u("front_left.toe")
    assert by_width == pytest.approx(expected, rel=0.01)
    for axle in ("front", "rear"):
        assert found.share(f"{axle}.total_toe", TYRE_WIDTH) == 0.0
    assert found.share("front_left.camber", TYRE_WIDTH) == 0.0
    assert found.share("thrust_angle", TYRE_WIDTH) > 0.9
    # The distance of sidewalls is measured as it is; that of the wheel centres errs by half of each width.
    assert found.share("sidewall_track_front", TYRE_WIDTH) < 0.01
    assert found.u("track_front") == pytest.approx(math.hypot(0.5, 0.5), rel=0.01)
    for name in found.names:
        assert sum(found.share(name, part) for part in COMPONENTS) == pytest.approx(1.0)


@pytest.mark.parametrize("wide", FOUR_WHEELS)
def test_what_one_wide_tyre_does_is_what_the_covariance_says(wide: str) -> None:
    even, odd = (
        vehicle_geometry(each, Stand(ROAD), replace(WIDTHS, sigma_mm=1e-3))
        for each in (wheels(), wheels(widths={wide: WIDTH + 1e-3}))
    )
    squares = {}
    for name in even.names:
        # Between sidewalls a wider tyre is no error.
        if not name.startswith("sidewall"):
            k = even.names.index(name)
            moved, one = abs(odd.values[k] - even.values[k]), math.sqrt(even.parts[TYRE_WIDTH][k, k])
            assert moved <= one * (1.0 + 1e-6) + 1e-12, name
            squares[name] = (moved / one) ** 2 if one else 0.0
    # Each of the four tyres has a quarter of the yaw's variance, and each of an axle half of its track's.
    assert squares["yaw"] == pytest.approx(0.25, abs=0.01)
    assert squares[f"track_{wide.partition('_')[0]}"] == pytest.approx(0.5, abs=0.01)


def test_stand_that_is_warmer_stretches_every_length_and_turns_nothing() -> None:
    stand = Stand(ROAD, temperature_sigma_k=2.0)
    found = vehicle_geometry(wheels(), stand, WIDTHS)
    grown = math.sqrt(found.share("wheelbase_left", TEMPERATURE)) * found.u("wheelbase_left")
    assert grown == pytest.approx(2.0 * stand.expansion_per_k * 2702.0, rel=1e-3)
    assert found.share("front_left.toe", TEMPERATURE) < 1e-9
    assert found.share("front.total_toe", TEMPERATURE) < 1e-9


def test_stand_that_is_warmer_on_one_side_bends() -> None:
    """Two wheels of one side are turned against each other by α · g · wheelbase."""
    stand = Stand(ROAD, gradient_sigma_k_per_m=1.0)
    found = vehicle_geometry(wheels(), stand, WIDTHS)
    heat = found.parts[TEMPERATURE]
    # Toe of front left less that of rear left: no yaw is in it.
    pick = np.zeros(len(found.names))
    pick[found.names.index("front_left.toe")], pick[found.names.index("rear_left.toe")] = 1.0, -1.0
    turned = math.sqrt(pick @ heat @ pick)
    assert turned == pytest.approx(stand.expansion_per_k * 1e-3 * 2702.0, rel=0.01)


@pytest.mark.parametrize("field", [0, 1])
def test_a_temperature_slope_bends_as_elasticity_says(field: int) -> None:
    """Strains are α·T and no shear, and what turns is the curl: checked by differences of neighbours."""
    stand, step = Stand(gradient_sigma_k_per_m=1.0), 1e-3
    at = np.array([900.0, 500.0, 0.0])
    right, left = np.array([step, 0.0, 0.0]), np.array([0.0, step, 0.0])
    around = np.array([at, at + right, at - right, at + left, at - left])
    heat = stand.covariance(around, ("left",) * 5).reshape(5, 5, 5, 5)
    # Any two independent mixtures of the two slopes.
    both = np.linalg.svd(heat.reshape(25, 25))
    columns = both.U[:, :2] * np.sqrt(both.S[:2])
    fields = columns.reshape(5, 5, 2)
    by_x = (fields[1, 2:4] - fields[2, 2:4]) / (2 * step)
    by_y = (fields[3, 2:4] - fields[4, 2:4]) / (2 * step)
    assert by_x[0] == pytest.approx(by_y[1], rel=1e-5)
    assert by_y[0] == pytest.approx(-by_x[1], rel=1e-5)
    per_mm = stand.expansion_per_k * 1e-3
    # Both slopes together: their strains add in squares to α·g·√(x² + y²).
    assert np.linalg.norm(by_x[0]) == pytest.approx(per_mm * np.hypot(900.0, 500.0), rel=1e-5)
    turned = by_x[1][field] - by_y[0][field]
    assert fields[0, 1][field] == pytest.approx(-0.5 * turned, rel=1e-4)


def test_errors_that_rigs_share_do_not_add_as_if_they_were_their_own() -> None:
    """A gauge frame that lies turned on the stand turns all rigs and with them yaw, and no toe."""
    at = wheels(covariance=np.zeros((5, 5)))
    turned = np.zeros((4, 5))
    for row, name in zip(turned, FOUR_WHEELS, strict=True):
        x, y, _ = at[name].point
        row[1] = 1e-4 if name.endswith("right") else -1e-4
        row[2:4] = -1e-4 * y, 1e-4 * x
    common = np.outer(turned.ravel(), turned.ravel())
    found = vehicle_geometry(at, Stand(ROAD), WIDTHS, common=common)
    assert found.u("yaw") == pytest.approx(1e-4, rel=1e-6)
    assert found.u("front_left.toe") < 1e-10
    assert found.u("thrust_angle") < 1e-10
    assert found.u("track_front") < 1e-7


def test_intervals_hold_the_scatter_of_drawn_vehicles() -> None:
    rng = np.random.default_rng(5)
    stand, tyres = Stand(ROAD, 1.0, 0.2), replace(WIDTHS, sigma_mm=0.6)
    root = np.linalg.cholesky(SIGMA)
    true = vehicle_geometry(wheels(0.005, (4.0, 7.0)), stand, tyres)
    heat = np.linalg.svd(stand.covariance(np.array([wheels()[n].point for n in FOUR_WHEELS]), SIDES_OF_FOUR))
    drawn = []
    for _ in range(400):
        widths = {name: WIDTH + rng.normal(0.0, 0.6) for name in FOUR_WHEELS}
        warm = (heat.U @ (np.sqrt(heat.S) * rng.normal(size=20))).reshape(4, 5)
        seen = {}
        for (name, wheel), by_heat in zip(wheels(0.005, (4.0, 7.0), widths).items(), warm, strict=True):
            error = root @ rng.normal(size=5) + by_heat
            seen[name] = WheelAxis(
                wheel.side, wheel.camber + error[0], wheel.toe + error[1], wheel.point + error[2:], SIGMA
            )
        found = vehicle_geometry(seen, stand, tyres)
        # Between sidewalls the true length is that of these tyres.
        own = vehicle_geometry(wheels(0.005, (4.0, 7.0), widths), stand, tyres)
        drawn.append(
            [
                found.value(name) - (own if name.startswith("sidewall") else true).value(name)
                for name in true.names
            ]
        )
    spread = np.std(drawn, axis=0)
    stated = np.sqrt(np.diag(true.covariance))
    assert spread / stated == pytest.approx(np.ones(len(stated)), abs=0.15)


@pytest.mark.parametrize("axle", ["front", "rear"])
def test_two_rigs_of_one_axle_give_total_toe_and_camber_and_say_what_is_missing(axle: str) -> None:
    whole = wheels(math.radians(0.3))
    two = {name: wheel for name, wheel in whole.items() if name.startswith(axle)}
    found, full = vehicle_geometry(two), vehicle_geometry(whole)
    other = "rear" if axle == "front" else "front"
    assert found.missing == (f"{other}_left", f"{other}_right")
    assert set(found.names) == {
        f"{axle}_left.camber",
        f"{axle}_right.camber",
        f"{axle}.total_toe",
        f"{axle}.camber_difference",
    }
    for name in found.names:
        assert found.value(name) == full.value(name)
        assert found.u(name) == pytest.approx(full.u(name))
    assert found.between is None
    with pytest.raises(KeyError):
        found.value("thrust_angle")
    assert full.missing == ()


def test_names_and_lengths_are_complete(straight: VehicleGeometry) -> None:
    assert set(LENGTHS) < set(straight.names)
    assert len(set(straight.names)) == len(straight.names)
    assert (np.diag(straight.covariance) > 0.0).all()
    assert straight.u95("yaw") == 2.0 * straight.u("yaw")
    assert straight.covariance == pytest.approx(straight.parts[MEASURED])


def exchanged(first: str, second: str) -> dict[str, WheelAxis]:
    at = wheels()
    return {
        first: replace(at[first], point=at[second].point),
        second: replace(at[second], point=at[first].point),
    }


@pytest.mark.parametrize(
    ("given_wheels", "said"),
    [
        ({}, "both wheels of an axle"),
        ({name: wheels()[name] for name in ("front_left", "rear_right")}, "both wheels of an axle"),
        (wheels() | {"middle_left": wheels()["front_left"]}, "'middle_left'"),
        (wheels() | {"front_left": wheels()["front_right"]}, "'front_left' on the right"),
        ({name: replace(wheel, point=np.zeros(3)) for name, wheel in wheels().items()}, "gauge frame"),
        (wheels(math.radians(12.0)), "within 10°"),
        (exchanged("front_left", "rear_left") | exchanged("front_right", "rear_right"), "not exchanged"),
        (exchanged("front_left", "front_right") | exchanged("rear_left", "rear_right"), "left of right"),
    ],
    ids=["none", "no axle", "unknown", "side", "nowhere", "askew", "backward", "exchanged"],
)
def test_wheels_that_are_no_vehicle_are_refused(given_wheels: dict[str, WheelAxis], said: str) -> None:
    with pytest.raises(DegenerateInputError, match=said):
        vehicle_geometry(given_wheels)


def test_covariance_of_another_number_of_wheels_is_refused() -> None:
    with pytest.raises(DegenerateInputError, match="20 × 20"):
        vehicle_geometry(wheels(), common=np.eye(10))


@pytest.mark.parametrize(
    "change",
    [{"point": np.zeros(2)}, {"covariance": np.eye(4)}, {"toe": math.nan}, {"point": np.full(3, np.inf)}],
)
def test_wheel_that_is_no_numbers_is_refused(change: dict[str, object]) -> None:
    with pytest.raises(DegenerateInputError):
        replace(wheels()["front_left"], **change)  # type: ignore[arg-type]
